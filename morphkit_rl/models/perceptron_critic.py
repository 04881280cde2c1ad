"""Critics that know tokens and robots by learned vectors.

No robot but those of training ever asks a critic, so it need not generalize, and a perceptron is enough. With v_i the
scalars that a robot senses and its actions,

    h_0 = relu(norm( sum_i v_i t_name(i) + r_robot )),    h_k = relu(norm( W_k h_(k-1) + b_k )),    Q = W h + b.

Robots share everything but their vector r; the vectors t are shared by tokens with the same text.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.errors import ConfigError
from morphkit_rl.config.learner_config import LearnerConfig
from morphkit_rl.kernels import perceptron_critic
from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.perceptron_critic import CriticPass
from morphkit_rl.models.blocks import MemberLinear, first
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.transformer import Norm
from morphkit_rl.models.vocabulary import Vocabulary

_TOKEN_SIZE = 0.1
"""Standard deviation of learned vectors at first; a norm follows."""


@dataclass(frozen=True)
class _Reading:
    """What each robot of a layout reads.

    Attributes:
        column: (robots, scalars) column of each scalar in [observation row, action row, 0]; the last where there is
            none.
        text: (robots, scalars) row of its vector.
        robot: (robots,) row of the robot's vector.
        kernel: The same for the compiled kernel.
    """

    column: Tensor
    text: Tensor
    robot: Tensor
    kernel: perceptron_critic.Readings


class PerceptronCritic(nn.Module):
    """Twin critics in one module: (batch, tokens), (batch, actions) -> (2, batch, robots[, atoms]).

    Args:
        vocabulary: Texts and robots of training.
        width: Width of the hidden layers.
        layers: Hidden layers after the first.
        atoms: Logits of a value; 0 where it is a number.

    Attributes:
        precision: What products are computed in; everything around them is float32.
    """

    last_layers = ("head.",)

    def __init__(self, vocabulary: Vocabulary, width: int, layers: int, atoms: int = 0):
        super().__init__()
        self.precision = torch.float32
        self.texts, self.robots = ({k: i for i, k in enumerate(n)} for n in (vocabulary.texts, vocabulary.robots))
        self.atoms = atoms
        self.token = nn.Parameter(torch.randn(2, len(self.texts), width) * _TOKEN_SIZE)
        self.robot = nn.Parameter(torch.randn(2, len(self.robots), width) * _TOKEN_SIZE)
        self.hidden = nn.ModuleList(MemberLinear(2, width, width) for _ in range(layers))
        self.norms = nn.ModuleList(Norm(2, width) for _ in range(layers + 1))
        self.head = MemberLinear(2, width, atoms or 1, gain=0.1)
        self._readings: WeakKeyDictionary[Layout, _Reading] = WeakKeyDictionary()

    def value_robot(self, layout: Layout) -> Tensor:
        """(robots,) robot of each value: one value a robot."""
        return torch.arange(layout.num_robots, device=layout.relation.device)

    def forward(self, obs: Tensor, action: Tensor, layout: Layout, members: int = 2) -> Tensor:
        """Value actions in [-1, 1] at normalized observation rows, by the first `members` critics.

        Raises:
            ConfigError: The layout holds a robot that is none of training.
        """
        reading = self._reading(layout)
        if self.suits_kernel(obs):
            parameters = self.parameters_in_order
            output = perceptron_critic.perceptron_critic(
                obs, action, reading.kernel, members, parameters, self.precision
            )
        else:
            output = self._compute(obs, action, reading, members)
        return output if self.atoms else output[..., 0]

    def bound(
        self,
        obs: Tensor,
        action: Tensor,
        layout: Layout,
        members: int = 2,
        *,
        into: GradientRows | Tensor | None = None,
    ) -> CriticPass:
        """`forward` by the compiled kernel at rows in fixed memory, and its way back, without autograd.

        Args:
            obs: As in `forward`.
            action: As in `forward`.
            layout: As in `forward`.
            members: As in `forward`.
            into: Where gradients of the `parameters_in_order` go, or, (members, batch, actions), those of the actions;
                None where there is no way back.
        """
        reading, parameters = self._reading(layout).kernel, self.parameters_in_order
        return CriticPass(obs, action, reading, members, parameters, self.precision, into=into)

    def suits_kernel(self, obs: Tensor) -> bool:
        """Whether `bound` can value actions at such observations."""
        return perceptron_critic.available(obs, self.token.shape[-1], self.precision)

    def _compute(self, obs: Tensor, action: Tensor, reading: _Reading, members: int) -> Tensor:
        row = F.pad(torch.cat([obs, action], -1), (0, 1)).to(self.precision)
        scalars = row[:, reading.column].transpose(0, 1)
        vectors = first(self.token, members)[:, reading.text].to(self.precision)
        robots = first(self.robot, members)[:, reading.robot].unsqueeze(2)
        summed = torch.matmul(scalars, vectors).to(obs.dtype) + robots
        x = F.relu(self.norms[0](summed)).flatten(1, 2).to(self.precision)
        for linear, norm in zip(self.hidden, self.norms[1:], strict=True):
            x = F.relu(norm(linear(x)))
        return self.head(x).to(obs.dtype).view(members, len(reading.robot), len(obs), -1).transpose(1, 2)

    @cached_property
    def parameters_in_order(self) -> list[Tensor]:
        """The parameters as the kernel takes them."""
        layers = zip(self.hidden, self.norms[1:], strict=True)
        parts = [self.head, self.norms[0], *(part for pair in layers for part in pair)]
        return [self.token, self.robot, *(parameter for part in parts for parameter in part.parameters())]

    def _reading(self, layout: Layout) -> _Reading:
        if layout not in self._readings:
            self._readings[layout] = self._read(layout)
        return self._readings[layout]

    def _read(self, layout: Layout) -> _Reading:
        names = [spec.morphology for spec in layout.specs]
        known = [self.texts.get(text, -1) for text in layout.texts]
        unknown = [name for name in names if name not in self.robots]
        if unknown or -1 in known:
            raise ConfigError(f"the critics know only the training robots, not {', '.join(unknown or names)}")
        place = torch.tensor(known, device=layout.token_text.device)
        text_of = place[torch.cat([layout.token_text, layout.action_text])]
        columns = [
            [*range(tokens.start, tokens.stop), *range(layout.num_tokens + a.start, layout.num_tokens + a.stop)]
            for tokens, a in zip(layout.tokens, layout.actions, strict=True)
        ]
        empty = layout.num_tokens + layout.num_actions
        longest = max(map(len, columns))
        column = torch.tensor([own + [empty] * (longest - len(own)) for own in columns], device=place.device)
        robot = torch.tensor([self.robots[name] for name in names], device=place.device)
        rows = [
            [tokens.start, tokens.stop - tokens.start, a.start, a.stop - a.start, self.robots[name]]
            for tokens, a, name in zip(layout.tokens, layout.actions, names, strict=True)
        ]
        kernel = perceptron_critic.Readings.of(rows, [text_of[own].tolist() for own in columns])
        return _Reading(column, F.pad(text_of, (0, 1))[column], robot, kernel)


def build_perceptron_critic(config: LearnerConfig, vocabulary: Vocabulary) -> PerceptronCritic:
    """The critics that `config` describes."""
    atoms = config.atoms if config.value == "categorical" else 0
    return PerceptronCritic(vocabulary, config.critic_width, config.critic_layers, atoms)
