"""Compiled kernels against PyTorch's operations in float64, and what happens where they cannot be made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import published_baselines as plain
import pytest
import torch
from torch import Tensor, nn

from morphkit_rl.kernels import actuator_heads
from morphkit_rl.kernels.limb_layer import Kinship
from morphkit_rl.kernels.perceptron_critic import Readings
from morphkit_rl.models.blocks import MemberLinear, TransformerLayer, set_precision
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_former import LimbEncoder
from morphkit_rl.models.perceptron_critic import PerceptronCritic
from morphkit_rl.models.smp import MLP, Widths
from morphkit_rl.models.transformer import EncoderLayer, Norm, read_tokens
from morphkit_rl.models.vocabulary import Vocabulary
from tests.support.kernels import compiled
from tests.support.networks import ROBOTS, SIZE, layout_of, rows, spec
from tests.support.published_networks import assert_same_networks, random_parents

ERRORS = {torch.float32: 2e-6, torch.bfloat16: 0.2}
"""Of a whole gradient; in bfloat16, one relu in a hundred is on the other side of zero."""


def spans(lengths: tuple[int, ...]) -> list[slice]:
    ends = np.cumsum(lengths).tolist()
    return [slice(end - length, end) for end, length in zip(ends, lengths, strict=True)]


def assert_exact(
    operation: str, network: nn.Module, double: nn.Module, compute: Callable[..., Tensor], inputs: list[Tensor],
    precision: torch.dtype,
) -> None:  # fmt: skip
    """One kernel does it; output and gradients are those of float64, and the same every time."""
    for parameter in network.parameters():
        parameter.data += 0.1 * torch.randn_like(parameter)
    double.load_state_dict(network.state_dict())
    found = []
    for own, dtype in ((network, inputs[0].dtype), (network, inputs[0].dtype), (double.double(), torch.float64)):
        given = [x.detach().to(dtype, copy=True).requires_grad_() for x in inputs]
        out = compute(own, *given)
        assert (out.grad_fn.name() == f"{operation}Backward") is (dtype != torch.float64)
        columns = out.shape[::-1]  # A gradient that does not lie row by row.
        weight = (
            torch.arange(out.numel(), dtype=torch.float64)
            .sin()
            .view(columns)
            .to(out.dtype)
            .permute(*reversed(range(out.dim())))
        )
        found.append([out.detach(), *torch.autograd.grad(out, [*given, *own.parameters()], weight)])
        with torch.no_grad():
            torch.testing.assert_close(compute(own, *given), out, atol=0, rtol=0)
    for first, second, exact in zip(*found, strict=True):
        assert torch.equal(first, second)
        assert (first - exact).norm() <= ERRORS[precision] * exact.norm()


@compiled
@pytest.mark.parametrize(
    ("members", "batch", "robots", "d_model", "heads", "hidden"),
    [(1, 1, (133,), 128, 2, 256), (2, 20, (7,), 128, 2, 256), (2, 5, (7, 5, 1), 64, 4, 48), (1, 1, (2,), 16, 1, 16),
     (2, 2, (150, 3), 48, 3, 80)],
)  # fmt: skip
def test_encoder_layers(
    members: int, batch: int, robots: tuple[int, ...], d_model: int, heads: int, hidden: int, precision: torch.dtype,
    threads: int,
) -> None:  # fmt: skip
    torch.manual_seed(0)
    layer, double = (EncoderLayer(members, d_model, heads, hidden) for _ in range(2))
    x = torch.randn(members, batch, sum(robots), d_model).to(precision)
    assert_exact("_EncoderLayer", layer, double, lambda own, x: own(x, spans(robots)), [x], precision)


@compiled
@pytest.mark.parametrize(
    ("batch", "heads", "queries", "tokens", "d_model"),
    [(3, 2, (7,), (133,), 128), (2, 1, (3, 1), (20, 17), 32), (1, 3, (1,), (1,), 16)],
)
def test_reading_of_tokens(
    batch: int, heads: int, queries: tuple[int, ...], tokens: tuple[int, ...], d_model: int, precision: torch.dtype,
    threads: int,
) -> None:  # fmt: skip
    torch.manual_seed(0)
    probes = 0.3 * torch.randn(batch, heads, sum(queries), d_model)
    memory = torch.randn(batch, sum(tokens), d_model)
    assert_exact(
        "_Read", nn.Module(), nn.Module(), lambda _, p, m: read_tokens(p, m, spans(queries), spans(tokens)),
        [probes.to(precision), memory.to(precision)], precision,
    )  # fmt: skip


@compiled
@pytest.mark.parametrize("shape", [(1, 3, 133, 128), (2, 5, 7, 32), (1, 1, 16)])
def test_norms(shape: tuple[int, ...], precision: torch.dtype, threads: int) -> None:
    torch.manual_seed(0)
    network, double = (Norm(shape[0], shape[-1]) for _ in range(2))
    assert_exact(
        "_Norm", network, double, lambda own, x: own(x), [(3 * torch.randn(shape) + 1).to(precision)], precision
    )


@compiled
@pytest.mark.parametrize(
    ("members", "rows", "shared", "inputs", "outputs", "widths"),
    [(2, 700, True, 65, 1, (64, 400, 300)), (2, 5, False, 3, 2, (1, 7, 19)), (1, 97, False, 16, 17, (1, 16, 32))],
)
def test_perceptrons(
    members: int, rows: int, shared: bool, inputs: int, outputs: int, widths: tuple[int, int, int],
    precision: torch.dtype, threads: int,
) -> None:  # fmt: skip
    torch.manual_seed(0)
    network, double = (MLP(members, inputs, outputs, Widths(*widths)) for _ in range(2))
    network.precision, double.precision = precision, torch.float64
    x = torch.randn(1 if shared else members, rows, inputs)
    assert_exact("_MLP", network, double, lambda own, x: own(x.expand(members, -1, -1)), [x], precision)


@compiled
@pytest.mark.parametrize(
    ("members", "batch", "robots", "d_model", "heads", "hidden"),
    [(1, 20, (7, 2, 5), 64, 2, 128), (2, 5, (13, 1), 64, 4, 48), (1, 1, (2,), 16, 1, 16), (2, 2, (40, 3), 48, 3, 80)],
)
def test_limb_layers(
    members: int, batch: int, robots: tuple[int, ...], d_model: int, heads: int, hidden: int, precision: torch.dtype,
    threads: int,
) -> None:  # fmt: skip
    torch.manual_seed(0)
    layer, double = (LimbLayer(members, d_model, heads, hidden, robots) for _ in range(2))
    x = torch.randn(members, batch, sum(robots), d_model).to(precision)
    assert_exact("LimbLayer", layer, double, lambda own, x: own(x), [x], precision)


class LimbLayer(nn.Module):
    """A layer over limbs of several robots, with a bias for each kind of kinship."""

    def __init__(self, members: int, d_model: int, heads: int, hidden: int, robots: tuple[int, ...]):
        super().__init__()
        self.layer = TransformerLayer(members, d_model, heads, hidden)
        self.bias = nn.Parameter(torch.zeros(members, heads, 4))
        self.robots, limbs = spans(robots), sum(robots)
        self.relation = torch.arange(limbs * limbs).view(limbs, limbs) * 7 % 4
        self.kinship = Kinship.of(self.relation, self.robots)

    def forward(self, x: Tensor) -> Tensor:
        if self.layer.suits_kernel(x):
            return self.layer.mix_kin(x, self.kinship, self.bias)
        parts = [
            self.layer(x[:, :, s].contiguous(), self.bias[..., self.relation[s, s]].unsqueeze(1)) for s in self.robots
        ]
        return torch.cat(parts, 2)


class LimbTokens(nn.Module):
    """Tokens of a layout's limbs, from vectors and names that are parameters."""

    def __init__(self, members: int, layout: Layout, d_model: int, precision: torch.dtype):
        super().__init__()
        self.encoder = LimbEncoder(members, SIZE, d_model, 1, 1, 16)
        self.layout = layout
        set_precision(self.encoder, precision)

    def forward(self, row: Tensor) -> Tensor:
        embeddings, limbs = (x.to(row.dtype) for x in (self.layout.embeddings, self.layout.limb_embeddings))
        layout = replace(self.layout, embeddings=embeddings, limb_embeddings=limbs)
        return self.encoder._tokens(row, self.encoder.read_names(layout.observation, layout))


@compiled
@pytest.mark.parametrize(
    ("robots", "members", "batch", "d_model"), [(("hopper", "cheetah_4_back"), 2, 22, 64), (("hopper_3",), 1, 1, 16)]
)
def test_limb_tokens(
    robots: tuple[str, ...], members: int, batch: int, d_model: int, precision: torch.dtype, threads: int
) -> None:
    layout = layout_of("limb-former", *robots)
    row, _ = rows(layout, batch)
    found = []
    for dtype, own in ((torch.float32, precision), (torch.float64, torch.float64)):
        torch.manual_seed(0)
        network = LimbTokens(members, layout, d_model, own).to(dtype)
        out = network(row.to(dtype))
        assert (out.grad_fn.name() == "LimbTokensBackward") is (dtype == torch.float32)
        weight = torch.arange(out.numel()).sin().view(out.shape)
        used = [*network.encoder.value.parameters(), *network.encoder.name.parameters()]
        found.append([out, *torch.autograd.grad(out, used, weight.to(out.dtype))])
        with torch.no_grad():
            torch.testing.assert_close(network(row.to(dtype)), out, atol=0, rtol=0)
    for one, exact in zip(*found, strict=True):
        assert (one - exact).norm() <= ERRORS[precision] * exact.norm()


class Heads(nn.Module):
    """What turns limb tokens into actions."""

    def __init__(self, limb: Tensor, d_model: int):
        super().__init__()
        self.limb = limb
        self.read, self.head = MemberLinear(1, d_model, d_model), MemberLinear(1, d_model, 1, gain=0.3)
        self.names = nn.Parameter(0.3 * torch.randn(len(limb), d_model))

    def forward(self, x: Tensor) -> Tensor:
        parts = (*self.read.parameters(), self.names[None], *self.head.parameters())
        if actuator_heads.available(x):
            return actuator_heads.actuator_heads(x, self.limb, [part[0] for part in parts])
        own = torch.nn.functional.layer_norm(x, x.shape[-1:])[:, self.limb]
        read = self.read(own.reshape(1, -1, own.shape[-1])).view(own.shape)
        hidden = (read + self.names).relu()
        return torch.tanh(self.head(hidden.view(1, -1, own.shape[-1])).view(own.shape[:2]))


@compiled
@pytest.mark.parametrize(
    ("batch", "limbs", "limb", "d_model"), [(22, 9, (1, 3, 3, 8, 0), 64), (3, 1, (0,), 16), (3, 4, (2, 1) * 80, 48)]
)
def test_actuator_heads(
    batch: int, limbs: int, limb: tuple[int, ...], d_model: int, precision: torch.dtype, threads: int
) -> None:
    torch.manual_seed(0)
    network, double = (Heads(torch.tensor(limb), d_model) for _ in range(2))
    x = torch.randn(batch, limbs, d_model).to(precision)
    assert_exact("ActuatorHeads", network, double, lambda own, x: own(x), [x], precision)


@compiled
@pytest.mark.parametrize(
    ("robots", "batch", "width", "layers", "atoms"),
    [(("hopper", "cheetah_4_back", "hopper_3"), 80, 64, 2, 101), (("cheetah_4_back",), 1, 16, 1, 7),
     (("hopper_3", "hopper"), 7, 48, 3, 16), (("hopper", "hopper_3", "cheetah_4_back"), 80, 32, 1, 5)],
)  # fmt: skip
def test_perceptron_critics(
    robots: tuple[str, ...], batch: int, width: int, layers: int, atoms: int, precision: torch.dtype, threads: int
) -> None:
    torch.manual_seed(0)
    layout = layout_of("limb-former", *robots)
    vocabulary = Vocabulary.of([spec(name) for name in ROBOTS])
    critic, double = (PerceptronCritic(vocabulary, width, layers, atoms) for _ in range(2))
    critic.precision, double.precision = precision, torch.float64
    assert_exact("Critic", critic, double, lambda own, *rows: own(*rows, layout), list(rows(layout, batch)), precision)


def test_robots_with_texts_in_common_are_read_together() -> None:
    alike, others = [5, 3, 9, 7], [[100 * robot + i for i in range(4)] for robot in (1, 2)]
    readings = Readings.of([[0, 3, 0, 1, robot] for robot in range(5)], [alike, alike[::-1], alike[:2], *others])
    assert readings.robots[:, 5:].tolist() == [[0, 0], [4, 0], [8, 0], [10, 1], [14, 2]]
    assert readings.places.tolist() == [0, 1, 2, 3, 3, 2, 1, 0, 0, 1, *range(4), *range(4)]
    assert readings.groups.tolist() == [[0, 4], [4, 4], [8, 4]]
    assert readings.texts.tolist() == [*alike, *others[0], *others[1]]


@compiled
def test_critics_that_are_held_fixed_pass_the_actions_gradient_on() -> None:
    torch.manual_seed(0)
    layout = layout_of("limb-former", *ROBOTS)
    critic = PerceptronCritic(Vocabulary.of(layout.specs), 32, 2, 5)
    obs, action = rows(layout)
    action.requires_grad_()
    (whole,) = torch.autograd.grad(critic(obs, action, layout).sin().sum(), action)
    critic.requires_grad_(False)
    (alone,) = torch.autograd.grad(critic(obs, action, layout).sin().sum(), action)
    assert whole.abs().min() > 0
    assert torch.equal(whole, alone)


@compiled
def test_what_needs_no_gradient_gets_none_and_changes_no_other() -> None:
    torch.manual_seed(0)
    layer, x = EncoderLayer(2, 32, 2, 16), torch.randn(1, 3, 4, 32, requires_grad=True)
    (whole,) = torch.autograd.grad(layer(x, spans((4,))).square().sum(), x)
    grads = torch.autograd.grad(layer(x, spans((4,))).square().sum(), list(layer.parameters()))
    assert all(gradient[0].any() and not gradient[1].any() for gradient in grads)  # One of two members was used.
    layer.requires_grad_(False)
    (alone,) = torch.autograd.grad(layer(x, spans((4,))).square().sum(), x)
    assert torch.equal(whole, alone)


@compiled
def test_sizes_that_the_kernels_cannot_do_go_the_other_way() -> None:
    for layer, x, own in (
        (EncoderLayer(1, 24, 2, 16), torch.randn(1, 2, 4, 24), spans((4,))),
        (EncoderLayer(1, 32, 2, 20), torch.randn(1, 2, 4, 32), spans((4,))),
        (EncoderLayer(1, 32, 2, 16).double(), torch.randn(1, 2, 4, 32).double(), spans((4,))),
    ):
        assert layer(x, own).grad_fn.name() != "_EncoderLayerBackward"


@compiled
@pytest.mark.parametrize("seed", range(2))
def test_published_networks_whose_layers_the_kernels_do(seed: int) -> None:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    heads, limbs, scalars = int(rng.integers(1, 4)), int(rng.integers(2, 8)), int(rng.integers(1, 12))
    sizes = (16 * heads, heads, 16 * int(rng.integers(1, 4)), int(rng.integers(1, 4)))
    parents = random_parents(rng, limbs, 3)
    for method, actor in (
        ("anymorph", plain.TokenActor(limbs, scalars, 5, 8, *sizes)),
        ("amorpheus", plain.LimbActor(limbs, scalars, *sizes)),
    ):
        assert_same_networks(method, actor, plain.LimbCritic(limbs, scalars, *sizes), parents, scalars, heads)
