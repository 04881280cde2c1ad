"""Shared Modular Policies: one module for all limbs, and messages along the tree (Huang, Mordatch, Pathak 2020).

With o_l the scalars of limb l, e_l = o_l in the actor and [o_l ; a_l] in the critics, n(x) = x / |x|, and MLPs of 400
and 300 relu units,

    up:    h_l = tanh [ n(fc1 e_l) ; u_child 1 ; u_child 2 ; ... ]        zeros for children that are not there
           u_l = n(fc3 tanh(fc2 h_l))
    down:  p_child k of l = piece k of n(message(tanh [ s_l ; p_l ]))     p_l = 0 for the root

    messages            both, s = u          down, s = o           up                         none
    action a_l =        action(tanh [u ; p])  action(tanh [o ; p])  action(tanh [o ; u_children])  action(o)
    value  Q_l =        value([u ; a ; p])    value([o ; a ; p])    value([o ; a ; u_children])    value([o ; a])

with a tanh on every action. The robot's value is the sum over its limbs. Twin critics share all messages and differ in
`value`. Limbs of equal depth, of all robots, are evaluated at once, and what no limb hears is never said.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.methods import Method, ModelSettings
from morphkit_rl.config.parsing import bounded
from morphkit_rl.kernels import mlp
from morphkit_rl.models.blocks import MemberLinear, affine, first
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_checks import check_children, check_limbs
from morphkit_rl.models.smp_tree import Tree, tree
from morphkit_rl.models.vocabulary import Vocabulary

Direction = Literal["both", "up", "down", "none"]


@dataclass(frozen=True, slots=True)
class SmpSettings(ModelSettings):
    """Sizes of actor and critics, and which way messages go.

    Attributes:
        message_size: Size of a message.
        actor_messages: Which way messages go in the actor.
        critic_messages: The same in the critics.
    """

    method: str = "smp"
    message_size: int = bounded(32, at_least=1)
    actor_messages: Direction = "both"
    critic_messages: Direction = "both"


class Widths(NamedTuple):
    """Hidden units: on the way up, and in both layers of an MLP."""

    up: int = 64
    first: int = 400
    second: int = 300


PUBLISHED = Widths()


class MLP(nn.Module):
    """Two hidden relu layers, computed in `precision`: (members, rows, inputs) -> (members, rows, outputs)."""

    def __init__(self, members: int, inputs: int, outputs: int, widths: Widths):
        super().__init__()
        self.precision = torch.float32
        self.l1 = MemberLinear(members, inputs, widths.first).draw()
        self.l2 = MemberLinear(members, widths.first, widths.second).draw()
        self.l3 = MemberLinear(members, widths.second, outputs).draw()

    def weights(self) -> list[tuple[Tensor, Tensor | None]]:
        """Weights and biases in `precision`, for several calls of `forward`."""
        layers = (self.l1, self.l2, self.l3)
        return [(m.weight.to(self.precision), m.bias if m.bias is None else m.bias.to(self.precision)) for m in layers]

    def forward(self, x: Tensor, weights: list[tuple[Tensor, Tensor | None]] | None = None) -> Tensor:
        """Map rows."""
        if mlp.available(x, self.precision):
            return mlp.mlp(x, list(self.parameters()), self.precision)
        hidden = x.to(self.precision)
        for number, (weight, bias) in enumerate(weights or self.weights()):
            hidden = F.relu(hidden) if number else hidden
            hidden = affine(hidden, first(weight, len(x)), bias if bias is None else first(bias, len(x)))
        return hidden.to(x.dtype)


class Up(nn.Module):
    """Messages from the leaves to the roots."""

    def __init__(self, inputs: int, message: int, children: int, width: int):
        super().__init__()
        self.fc1 = MemberLinear(1, inputs, width).draw()
        self.fc2 = MemberLinear(1, width + children * message, width).draw()
        self.fc3 = MemberLinear(1, width, message).draw()

    def forward(self, limbs: Tensor, tree: Tree) -> tuple[Tensor, Tensor]:
        """Pass messages up.

        Args:
            limbs: (limbs, batch, inputs), by depth.
            tree: Who hears whom.

        Returns:
            What each limb says (limbs, batch, message), and what it hears (limbs, batch, children * message).
        """
        number, batch, inputs = limbs.shape
        width, message = self.fc3.weight.shape[1:]
        own, children = self.fc2.weight[0].split([width, self.fc2.weight.shape[1] - width])
        h = torch.tanh(F.normalize(self.fc1(limbs.reshape(1, -1, inputs)), dim=-1))
        bias = self.fc2.bias
        assert bias is not None
        before = torch.addmm(bias[0], h[0], own).view(number, batch, width)
        said = limbs.new_zeros(0, batch, message)
        says, hears = [], []
        for level in reversed(tree.levels):
            hidden = before[level.limbs]
            heard = F.pad(said, (0, 0, 0, 0, 0, 1))[level.children].transpose(1, 2).flatten(2)
            if len(said):
                hidden = hidden + torch.matmul(torch.tanh(heard), children)
            said = self.fc3(torch.tanh(hidden).reshape(1, -1, width)).view(-1, batch, message)
            said = F.normalize(said, dim=-1)
            says.append(said)
            hears.append(heard)
        return torch.cat(says[::-1]), torch.cat(hears[::-1])


class Down(nn.Module):
    """Messages from the roots to the leaves."""

    def __init__(self, inputs: int, message: int, children: int, widths: Widths):
        super().__init__()
        self.message, self.places = message, children
        self.base = MLP(1, inputs + message, children * message, widths)

    def forward(self, limbs: Tensor, tree: Tree) -> Tensor:
        """What each limb hears (limbs, batch, message), where limbs say something of `limbs` (limbs, batch, inputs)."""
        batch = limbs.shape[1]
        piece = limbs.new_zeros(len(tree.levels[0].children), batch, self.message)
        pieces, weights = [piece], None if mlp.available(limbs, self.base.precision) else self.base.weights()
        for level, deeper in zip(tree.levels, tree.levels[1:], strict=False):
            own = torch.tanh(torch.cat([limbs[level.limbs], piece], -1)[level.senders])
            said = F.normalize(self.base(own.view(1, -1, own.shape[-1]), weights), dim=-1)
            said = said.view(len(own), batch, self.places, self.message).transpose(1, 2).flatten(0, 1)
            piece = said[deeper.piece]
            pieces.append(piece)
        return torch.cat(pieces)


class Messages(nn.Module):
    """What a limb knows once messages went in a direction.

    Args:
        scalars: Number of scalars in a limb.
        inputs: Width of what the way up reads of a limb.
        message: Size of a message.
        children: Most children of a limb.
        direction: Which way messages go.
        widths: Hidden units.

    Attributes:
        places: Places for children a limb.
        sizes: Width of both results of `forward`.
    """

    def __init__(
        self, scalars: int, inputs: int, message: int, children: int, direction: Direction, widths: Widths = PUBLISHED
    ):
        super().__init__()
        self.direction = direction
        self.places = max(children, 1)
        own = message if direction == "both" else scalars
        self.up = Up(inputs, message, self.places, widths.up) if direction in ("both", "up") else None
        self.down = Down(own, message, self.places, widths) if direction in ("both", "down") else None
        self.sizes = (own, {"up": self.places * message, "none": 0}.get(direction, message))

    def forward(self, scalars: Tensor, inputs: Tensor, layout: Layout) -> tuple[Tensor, Tensor]:
        """Let limbs talk.

        Args:
            scalars: (limbs, batch, scalars), by depth.
            inputs: (limbs, batch, inputs), what the way up reads.
            layout: The robots.

        Returns:
            Each limb's own state, and what it heard.
        """
        limbs = tree(layout, self.places)
        own, heard = scalars, scalars[..., :0]
        if self.up is not None:
            said, heard = self.up(inputs, limbs)
            own = said if self.down is not None else own
        if self.down is not None:
            heard = self.down(own, limbs)
        return own, heard


class Actor(nn.Module):
    """(batch, tokens) -> (batch, limbs) in [-1, 1]."""

    last_layers = ("action.",)

    def __init__(self, scalars: int, message: int, children: int, direction: Direction, widths: Widths = PUBLISHED):
        super().__init__()
        self.messages = Messages(scalars, scalars, message, children, direction, widths)
        self.action = MLP(1, sum(self.messages.sizes), 1, widths)

    def read_names(self, layout: Layout) -> None:
        """Names mean nothing to this method."""

    def forward(self, obs: Tensor, layout: Layout, names: None = None) -> Tensor:
        """Act on observation rows."""
        limbs = tree(layout, self.messages.places)
        scalars = _by_depth(obs.reshape(obs.shape[0], layout.num_actions, -1), limbs)
        x = torch.cat(self.messages(scalars, scalars, layout), -1)
        x = x if self.messages.direction == "none" else torch.tanh(x)
        action = torch.tanh(self.action(x.view(1, -1, x.shape[-1]))).view(x.shape[:2])
        return action[limbs.place].T


class TwinCritic(nn.Module):
    """Two values a robot: (batch, tokens), (batch, limbs) -> (2, batch, robots)."""

    last_layers = ("value.",)

    def __init__(self, scalars: int, message: int, children: int, direction: Direction, widths: Widths = PUBLISHED):
        super().__init__()
        self.messages = Messages(scalars, scalars + 1, message, children, direction, widths)
        self.value = MLP(2, sum(self.messages.sizes) + 1, 1, widths)

    def value_robot(self, layout: Layout) -> Tensor:
        """(robots,) robot of each value: one value a robot."""
        return torch.arange(layout.num_robots, device=layout.relation.device)

    def forward(self, obs: Tensor, action: Tensor, layout: Layout, members: int = 2) -> Tensor:
        """Value actions in [-1, 1] at observation rows, by the first `members` critics."""
        limbs = tree(layout, self.messages.places)
        scalars = _by_depth(obs.reshape(*action.shape, -1), limbs)
        acts = action.T[limbs.order][..., None]
        own, heard = self.messages(scalars, torch.cat([scalars, acts], -1), layout)
        x = torch.cat([own, acts, heard], -1)
        values = self.value(x.view(1, -1, x.shape[-1]).expand(members, -1, -1)).view(members, *x.shape[:2])
        return torch.matmul((layout.robot_limbs > 0).to(values.dtype), values[:, limbs.place]).transpose(1, 2)


def check_robot(spec: TokenSpec, settings: SmpSettings, vocabulary: Vocabulary | None = None) -> None:
    """Raise ConfigError where the robot's limbs are not alike, or a limb has more children than in training."""
    check_limbs(settings.method, spec, vocabulary)
    if vocabulary and settings.actor_messages != "none":
        check_children(settings.method, spec, max(vocabulary.children, 1))


def build(settings: SmpSettings, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    sizes = (vocabulary.scalars, settings.message_size, vocabulary.children)
    return Actor(*sizes, settings.actor_messages), TwinCritic(*sizes, settings.critic_messages)


def _by_depth(limbs: Tensor, tree: Tree) -> Tensor:
    """(batch, limbs, scalars) -> (limbs by depth, batch, scalars)."""
    return limbs.transpose(0, 1)[tree.order]


METHOD = Method(
    name="smp",
    summary="one module for all limbs, with messages along the tree",
    actions="limbs",
    settings=SmpSettings,
    build=build,
    check=check_robot,
    preset="smp-paper",
    label="SMP",
    color="#56B4E9",
)
