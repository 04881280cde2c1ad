"""The published methods written plainly, in float32: yardsticks for speed, and what tests compare outputs with.

`nn.Transformer` on concatenated embedding and frequency code and `nn.TransformerEncoder` over limbs, both with
PyTorch's defaults, tokens first, as in the published programs; recursion from limb to limb. Parameters have the names
of the published programs.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from copy import deepcopy

import torch
import torch.nn.functional as F
from torch import Tensor, nn


class TokenTransformer(nn.Module):
    """Embeddings and values to one number an action."""

    def __init__(self, size: int, code: int, d_model: int, heads: int, feedforward: int, layers: int):
        super().__init__()
        self.code = code
        self.obs_z_input_layer = nn.Linear(size + code, d_model)
        self.act_z_input_layer = nn.Linear(size, d_model)
        self.act_output_layer = nn.Linear(size + d_model, 1)
        self.obs_norm, self.act_norm = nn.LayerNorm(d_model), nn.LayerNorm(d_model)
        with warnings.catch_warnings():  # about nested tensors, which nobody asked for
            warnings.simplefilter("ignore")
            self.transformer = nn.Transformer(d_model, heads, layers, layers, feedforward, dropout=0.0)

    def forward(self, sensors: Tensor, actions: Tensor, obs: Tensor) -> Tensor:
        sensors, actions = (table[:, None].expand(-1, len(obs), -1) for table in (sensors, actions))
        i = torch.arange(0, self.code, 2, device=obs.device)
        angles = (1000 * obs.T)[..., None] * torch.exp(i * (-math.log(10000.0) / self.code))
        code = 2 / math.sqrt(2) * torch.cat([angles.sin(), angles.cos()], -1)
        x = self.obs_norm(self.obs_z_input_layer(torch.cat([sensors, code], -1)))
        y = self.transformer(x, self.act_norm(self.act_z_input_layer(actions)))
        return self.act_output_layer(torch.cat([actions, y], -1))[..., 0].T


class TokenActor(nn.Module):
    """AnyMorph's actor; with frozen tables MA-BERT's."""

    def __init__(
        self, limbs: int, scalars: int, size: int, code: int, d_model: int, heads: int, feedforward: int, layers: int,
        *, frozen: bool = False,
    ):  # fmt: skip
        super().__init__()
        self.obs_embeddings, self.act_embeddings = nn.Embedding(limbs * scalars, size), nn.Embedding(limbs, size)
        for table in (self.obs_embeddings, self.act_embeddings):
            table.requires_grad_(not frozen)
        self.actor = TokenTransformer(size, code, d_model, heads, feedforward, layers)

    def forward(self, obs: Tensor) -> Tensor:
        return torch.tanh(self.actor(self.obs_embeddings.weight, self.act_embeddings.weight, obs))


class LimbTransformer(nn.Module):
    """Limb scalars to one number a limb."""

    def __init__(self, inputs: int, d_model: int, heads: int, feedforward: int, layers: int, conditioned: bool):
        super().__init__()
        self.conditioned = conditioned
        layer = nn.TransformerEncoderLayer(d_model, heads, feedforward, dropout=0.0)
        self.encoder = nn.Linear(inputs, d_model)
        self.transformer_encoder = nn.TransformerEncoder(
            layer, layers, nn.LayerNorm(d_model), enable_nested_tensor=False
        )
        self.decoder = nn.Linear(d_model + inputs * conditioned, 1)

    def forward(self, limbs: Tensor) -> Tensor:
        limbs = limbs.transpose(0, 1)
        z = self.transformer_encoder(self.encoder(limbs) * math.sqrt(self.encoder.out_features))
        return self.decoder(torch.cat([z, limbs], -1) if self.conditioned else z)[..., 0].T


class LimbActor(nn.Module):
    """Amorpheus's actor."""

    def __init__(self, limbs: int, scalars: int, *sizes: int, conditioned: bool = True):
        super().__init__()
        self.limbs, self.actor = limbs, LimbTransformer(scalars, *sizes, conditioned)

    def forward(self, obs: Tensor) -> Tensor:
        return torch.tanh(self.actor(obs.view(len(obs), self.limbs, -1)))


class LimbCritic(nn.Module):
    """The critics of Amorpheus, AnyMorph and MA-BERT."""

    def __init__(self, limbs: int, scalars: int, *sizes: int, conditioned: bool = True):
        super().__init__()
        self.limbs = limbs
        self.critic1 = LimbTransformer(scalars + 1, *sizes, conditioned)
        self.critic2 = LimbTransformer(scalars + 1, *sizes, conditioned)

    def forward(self, obs: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        limbs = torch.cat([obs.view(len(obs), self.limbs, -1), action[..., None]], -1)
        return self.critic1(limbs), self.critic2(limbs)

    def q1(self, obs: Tensor, action: Tensor) -> Tensor:
        return self.critic1(torch.cat([obs.view(len(obs), self.limbs, -1), action[..., None]], -1))


class MLP(nn.Module):
    """Two hidden relu layers."""

    def __init__(self, inputs: int, outputs: int, first: int, second: int):
        super().__init__()
        self.l1, self.l2, self.l3 = nn.Linear(inputs, first), nn.Linear(first, second), nn.Linear(second, outputs)

    def forward(self, x: Tensor) -> Tensor:
        return self.l3(F.relu(self.l2(F.relu(self.l1(x)))))


class Up(nn.Module):
    """What a limb says to its parent."""

    def __init__(self, inputs: int, message: int, children: int, width: int):
        super().__init__()
        self.fc1 = nn.Linear(inputs, width)
        self.fc2 = nn.Linear(width + children * message, width)
        self.fc3 = nn.Linear(width, message)

    def forward(self, x: Tensor, heard: Tensor) -> Tensor:
        h = torch.tanh(torch.cat([F.normalize(self.fc1(x), dim=-1), heard], -1))
        return F.normalize(self.fc3(torch.tanh(self.fc2(h))), dim=-1)


class Modular(nn.Module):
    """Shared Modular Policies: the part that actor and critic have in common, limb by limb."""

    def __init__(
        self, parents: Sequence[int], scalars: int, actions: int, message: int, children: int, direction: str,
        heads: Sequence[str], top: str, widths: tuple[int, int, int],
    ):  # fmt: skip
        super().__init__()
        self.parents, self.message, self.children_, self.heads = list(parents), message, children, list(heads)
        self.up, self.down, self.acts = direction in ("both", "up"), direction in ("both", "down"), actions
        own = message if direction == "both" else scalars
        heard = {"up": children * message, "none": 0}.get(direction, message)
        if self.up:
            self.sNet = nn.ModuleList([Up(scalars + actions, message, children, widths[0])])
        if self.up and not self.down:
            self.top: nn.Module = self.sNet[0]
        else:
            self.top = nn.Module()
            self.add_module(top, nn.ModuleList([self.top]))
        for name in heads:
            self.top.add_module(name, MLP(own + actions + heard, 1, *widths[1:]))
        if self.down:
            self.top.add_module("msg_base", MLP(own + message, children * message, *widths[1:]))

    def limbs(self, obs: Tensor, action: Tensor | None) -> list[tuple[Tensor, Tensor]]:
        """Each limb's own state and what it heard."""
        batch, number = len(obs), len(self.parents)
        states = obs.view(batch, number, -1).unbind(1)
        said: dict[int, Tensor] = {}
        passed: dict[int, Tensor] = {}
        zeros = obs.new_zeros(batch, self.message)

        def children(limb: int) -> Tensor:
            messages = [up(child) for child, parent in enumerate(self.parents) if parent == limb]
            return torch.cat([*messages, *[zeros] * (self.children_ - len(messages))], -1)

        def up(limb: int) -> Tensor:
            if limb not in said:
                x = states[limb] if action is None else torch.cat([states[limb], action[:, limb, None]], -1)
                said[limb] = self.sNet[0](x, children(limb))
            return said[limb]

        def state(limb: int) -> Tensor:
            return up(limb) if self.up else states[limb]

        def piece(limb: int) -> Tensor:
            parent = self.parents[limb]
            if parent < 0:
                return zeros
            return down(parent).chunk(self.children_, -1)[self.parents[:limb].count(parent)]

        def down(limb: int) -> Tensor:
            if limb not in passed:
                x = torch.tanh(torch.cat([state(limb), piece(limb)], -1))
                passed[limb] = F.normalize(self.top.msg_base(x), dim=-1)
            return passed[limb]

        result = []
        for limb in range(number):
            if self.down:
                down(limb)
                result.append((state(limb), piece(limb)))
            elif self.up:
                up(limb)
                result.append((states[limb], children(limb)))
            else:
                result.append((states[limb], states[limb][:, :0]))
        return result


class ModularActor(Modular):
    """SMP's actor."""

    def __init__(
        self, parents: Sequence[int], scalars: int, message: int, children: int, direction: str = "both",
        widths: tuple[int, int, int] = (64, 400, 300),
    ):  # fmt: skip
        head = "base" if direction == "none" else "action_base"
        super().__init__(parents, scalars, 0, message, children, direction, [head], "actor", widths)

    def forward(self, obs: Tensor) -> Tensor:
        head = getattr(self.top, self.heads[0])
        talks = self.up or self.down
        inputs = [torch.cat(limb, -1) for limb in self.limbs(obs, None)]
        return torch.tanh(torch.cat([head(torch.tanh(x) if talks else x) for x in inputs], -1))


class ModularCritic(Modular):
    """SMP's critics."""

    def __init__(
        self, parents: Sequence[int], scalars: int, message: int, children: int, direction: str = "both",
        widths: tuple[int, int, int] = (64, 400, 300),
    ):  # fmt: skip
        super().__init__(
            parents, scalars, 1, message, children, direction, ["baseQ1", "baseQ2"], "critic", widths
        )  # fmt: skip

    def forward(self, obs: Tensor, action: Tensor) -> tuple[Tensor, ...]:
        return tuple(self._values(obs, action, self.heads))

    def q1(self, obs: Tensor, action: Tensor) -> Tensor:
        return self._values(obs, action, self.heads[:1])[0]

    def _values(self, obs: Tensor, action: Tensor, heads: Sequence[str]) -> list[Tensor]:
        limbs = self.limbs(obs, action)
        return [
            sum(
                (getattr(self.top, head)(torch.cat([own, action[:, limb, None], heard], -1))
                for limb, (own, heard) in enumerate(limbs)),
                start=obs.new_zeros(len(obs), 1),
            )
            for head in heads
        ]  # fmt: skip


class TD3:
    """The update of the published programs."""

    def __init__(self, actor: nn.Module, critic: nn.Module, *, learning_rate: float, tau: float, clip: float):
        self.actor, self.critic, self.tau, self.clip = actor, critic, tau, clip
        self.actor_target, self.critic_target = deepcopy(actor), deepcopy(critic)
        self.actor_optimizer = torch.optim.Adam([p for p in actor.parameters() if p.requires_grad], learning_rate)
        self.critic_optimizer = torch.optim.Adam(critic.parameters(), learning_rate)
        self.updates = 0

    def update(
        self, obs: Tensor, action: Tensor, reward: Tensor, next_obs: Tensor, discount: Tensor, noise: Tensor
    ) -> list[tuple[float, float]]:
        """One update; loss and gradient norm of the critics and, every second time, of the actor."""
        with torch.no_grad():
            next_action = (self.actor_target(next_obs) + noise).clamp(-1, 1)
            target = reward + discount * torch.min(*self.critic_target(next_obs, next_action))
        q1, q2 = self.critic(obs, action)
        done = [self._step(F.mse_loss(q1, target) + F.mse_loss(q2, target), self.critic, self.critic_optimizer)]
        if self.updates % 2 == 0:
            loss = -self.critic.q1(obs, self.actor(obs)).mean()
            done.append(self._step(loss, self.actor, self.actor_optimizer))
            for net, target_net in ((self.critic, self.critic_target), (self.actor, self.actor_target)):
                for p, q in zip(net.parameters(), target_net.parameters(), strict=True):
                    q.data.copy_(self.tau * p.data + (1 - self.tau) * q.data)
        self.updates += 1
        return done

    def _step(self, loss: Tensor, network: nn.Module, optimizer: torch.optim.Optimizer) -> tuple[float, float]:
        optimizer.zero_grad()
        loss.backward()
        norm = nn.utils.clip_grad_norm_(network.parameters(), self.clip) if self.clip > 0 else math.nan
        optimizer.step()
        return float(loss.detach()), float(norm)
