"""Updates by compiled kernels from end to end against those by autograd."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
import pytest
import torch

from morphkit_rl.algorithms import autograd_update, compiled_update
from morphkit_rl.algorithms.compiled_update import CompiledUpdate
from morphkit_rl.algorithms.td3 import TD3
from morphkit_rl.config.learner_config import LearnerConfig
from morphkit_rl.config.train_config import TD3Config
from morphkit_rl.kernels import library
from morphkit_rl.models import limb_former_pass
from morphkit_rl.models.limb_former import LimbFormerSettings
from morphkit_rl.models.vocabulary import Vocabulary
from tests.support.kernels import compiled
from tests.support.networks import ROBOTS, SIZE, batch_of, layout_of

LAYOUT = layout_of("limb-former", *ROBOTS)
MODEL = LimbFormerSettings(d_model=32, layers=2, heads=2, feedforward=48)
CONFIG = {"saturation_penalty": 0.1, "learning_rate": 1e-3, "tau": 0.05, "gradient_clip": 1.0, "reward_scale": 0.5}
OPTIONS = {
    "critic": "perceptron", "critic_width": 32, "value": "categorical", "atoms": 21, "actor_objective": "mean",
    "actor_average": 0.9, "saturation_margin": 0.02,
}  # fmt: skip


def learner(**options: Any) -> TD3:
    torch.manual_seed(0)
    own = LearnerConfig(**{**OPTIONS, **options})
    return TD3(MODEL, TD3Config(**CONFIG), SIZE, learner=own, vocabulary=Vocabulary.of(LAYOUT.specs))


def updated(own: TD3, updates: int = 8) -> dict[str, float]:
    rng = np.random.default_rng(0)
    scale, shift = torch.full((LAYOUT.num_tokens,), 0.9), torch.full((LAYOUT.num_tokens,), 0.1)
    factors, losses = torch.tensor([0.5, 1.0, 2.0, 1.0]), {}
    for _ in range(updates):
        losses.update(own.update(batch_of(LAYOUT, 24, rng), scale, shift, LAYOUT, rng, reward_scale=factors))
    return {name: float(loss) for name, loss in losses.items()}


@compiled
@pytest.mark.parametrize("options", [{}, {"actor_objective": "first", "actor_average": 0.0, "saturation_margin": 0.0}])
def test_both_ways_learn_the_same(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    original = CompiledUpdate.update_actor
    monkeypatch.setattr(CompiledUpdate, "update_actor", lambda own: calls.append(1) or original(own))
    quick, plain = learner(**options), learner(**options)
    quick_losses = updated(quick)
    monkeypatch.setattr(compiled_update, "suits", lambda *_: False)
    plain_losses = updated(plain)
    assert len(calls) == 4
    assert quick_losses == pytest.approx(plain_losses, rel=1e-3)
    start = learner(**options).networks()
    for name, network in quick.networks().items():
        moved = torch.cat([(p - q).flatten() for p, q in pairs(network, start[name])])
        apart = torch.cat([(p - q).flatten() for p, q in pairs(network, plain.networks()[name])])
        assert moved.norm() > 0
        assert apart.norm() < 0.01 * moved.norm(), name


@compiled
def test_it_is_the_way_of_the_default_networks_only() -> None:
    obs = torch.zeros(3, LAYOUT.num_tokens)
    assert compiled_update.suits(learner(), obs, LAYOUT)
    assert not compiled_update.suits(learner(value="scalar"), obs, LAYOUT)
    assert not compiled_update.suits(learner(critic_width=20), obs, LAYOUT)
    assert not compiled_update.suits(learner(), obs.double(), LAYOUT)
    assert not compiled_update.suits(learner(critic="method", value="scalar"), obs, LAYOUT)


def test_the_pass_knows_all_parameters() -> None:
    actor = learner().actor
    known = limb_former_pass.parameters_in_order(actor)
    assert {id(p) for p in known} == {id(p) for p in actor.parameters()}
    assert len(known) == len({id(p) for p in known})


def test_the_same_seed_gives_the_same_weights() -> None:
    first, second = learner(), learner()
    assert updated(first) == updated(second)
    for name, network in first.networks().items():
        assert all(torch.equal(p, q) for p, q in pairs(network, second.networks()[name]))


def pairs(a: torch.nn.Module, b: torch.nn.Module) -> list[tuple[torch.Tensor, torch.Tensor]]:
    return [(p.detach(), q.detach()) for p, q in zip(a.parameters(), b.parameters(), strict=True)]


def test_autograd_is_left_without_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_update.adam, "available", lambda _: False)
    calls = []
    original = autograd_update.update_critics
    monkeypatch.setattr(
        autograd_update, "update_critics", lambda *given, **more: calls.append(1) or original(*given, **more)
    )
    updated(learner(), 2)
    assert len(calls) == 2


@compiled
def test_what_has_moved_is_found_anew() -> None:
    """Kernels write to the places that they were told; weights and moments may have left these."""
    own, plain = learner(), learner()
    known = []
    for number, move in enumerate((None, move_weights, load_moments, load_moments)):
        for each in (own, plain):
            if move is not None:
                move(each)
        updated(own, 2)
        with library.suspended():
            updated(plain, 2)
        known.append(own._compiled[LAYOUT])
        assert len({id(each) for each in known}) == number + 1
    start = learner()
    for name, network in own.networks().items():
        moved = torch.cat([(p - q).flatten() for p, q in pairs(network, start.networks()[name])])
        apart = torch.cat([(p - q).flatten() for p, q in pairs(network, plain.networks()[name])])
        assert apart.norm() < 0.01 * moved.norm(), name


def move_weights(own: TD3) -> None:
    for network in own.networks().values():
        for parameter in network.parameters():
            parameter.data = parameter.data.clone()


def load_moments(own: TD3) -> None:
    for optimizer in own.optimizers().values():
        optimizer.load_state_dict(deepcopy(optimizer.state_dict()))


@compiled
def test_kernels_that_were_suspended_at_first_are_used_afterwards() -> None:
    own = learner()
    with library.suspended():
        updated(own, 1)
    assert not own._compiled
    updated(own, 1)
    assert own._compiled[LAYOUT] is not None


@compiled
def test_other_batches_and_threads_are_no_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    own, rng = learner(), np.random.default_rng(0)
    before = torch.get_num_threads()
    try:
        for size, threads in ((24, 1), (8, 1), (8, 3), (8, 3)):
            torch.set_num_threads(threads)
            own.update(batch_of(LAYOUT, size, rng), None, None, LAYOUT, rng)
            found = own._compiled[LAYOUT]
            assert found is not None
            assert found.fits(size)
            assert not found.fits(size + 1)
    finally:
        torch.set_num_threads(before)
    monkeypatch.setattr(CompiledUpdate, "update_critics", lambda *_, **__: pytest.fail("kernels are suspended"))
    with library.suspended():
        own.update(batch_of(LAYOUT, 8, rng), None, None, LAYOUT, rng)
