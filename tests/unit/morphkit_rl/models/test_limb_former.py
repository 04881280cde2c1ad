"""Limb-Former on several robots side by side."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
import pytest
import torch

from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.models import build
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.limb_former import LimbFormerSettings

SIZE = 12


def embed(texts: Sequence[str]) -> np.ndarray:
    """A vector of its own for every text."""
    return np.stack([np.random.default_rng(zlib.crc32(t.encode())).standard_normal(SIZE) for t in texts]).astype("f4")


def spec(name: str) -> TokenSpec:
    return token_spec(read(load(name)))


def networks(**changes: int) -> tuple[torch.nn.Module, torch.nn.Module]:
    torch.manual_seed(0)
    config = LimbFormerSettings(**{"d_model": 16, "layers": 2, "heads": 2, "feedforward": 24, **changes})
    actor, critic = build(config, SIZE)
    for parameter in (*actor.parameters(), *critic.parameters()):
        torch.nn.init.normal_(parameter, std=0.3)
    return actor, critic


def rows(layout: Layout, batch: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    obs = torch.randn(batch, layout.num_tokens, generator=generator)
    return obs, torch.rand(batch, layout.num_actions, generator=generator) * 2 - 1


@pytest.mark.parametrize("robots", [("cheetah", "arm"), ("quadruped", "hopper", "walker")])
def test_a_robot_alone_and_in_a_mixed_batch_gives_the_same(robots: tuple[str, ...]) -> None:
    actor, critic = networks()
    mixed = build_layout([spec(name) for name in robots], embed)
    obs, action = rows(mixed)
    actions, values = actor(obs, mixed), critic(obs, action, mixed)
    assert actions.shape == action.shape
    assert values.shape == (2, len(obs), len(robots))
    for number, name in enumerate(robots):
        alone = build_layout([spec(name)], embed)
        own_obs, own_action = obs[:, mixed.tokens[number]], action[:, mixed.actions[number]]
        torch.testing.assert_close(actor(own_obs, alone), actions[:, mixed.actions[number]], atol=1e-6, rtol=0)
        torch.testing.assert_close(critic(own_obs, own_action, alone)[..., 0], values[..., number], atol=1e-6, rtol=0)


def test_every_sensor_and_every_action_of_a_robot_matters_to_it_alone() -> None:
    _, critic = networks()
    layout = build_layout([spec("arm"), spec("cheetah")], embed)
    obs, action = (x.requires_grad_() for x in rows(layout))
    critic(obs, action, layout)[..., 0].sum().backward()
    arm_obs, arm_action = layout.tokens[0], layout.actions[0]
    assert (obs.grad[:, arm_obs].abs().amax(0) > 0).all()
    assert (action.grad[:, arm_action].abs().amax(0) > 0).all()
    assert (obs.grad[:, layout.tokens[1]] == 0).all()
    assert (action.grad[:, layout.actions[1]] == 0).all()


def test_actuators_of_one_limb_act_differently() -> None:
    actor, _ = networks()
    layout = build_layout([spec("arm")], embed)
    shoulder = [a.index for a in layout.specs[0].actuators if a.limb and "shoulder" in a.limb]
    assert len(shoulder) == 2
    actions = actor(rows(layout)[0], layout)
    assert (actions[:, shoulder[0]] - actions[:, shoulder[1]]).abs().min() > 1e-4


def test_the_policy_knows_a_robot_only_by_its_names() -> None:
    actor, _ = networks()
    one, other = (build_layout([spec("cheetah")], e) for e in (embed, lambda texts: embed([t[::-1] for t in texts])))
    obs, _ = rows(one)
    assert (actor(obs, one) - actor(obs, other)).abs().max() > 1e-3


def test_twin_critics_are_two_networks() -> None:
    _, critic = networks()
    layout = build_layout([spec("hopper")], embed)
    q1, q2 = critic(*rows(layout), layout)
    assert (q1 - q2).abs().min() > 1e-4


def test_low_precision_stays_close() -> None:
    actor, critic = networks()
    layout = build_layout([spec("cheetah")], embed)
    obs, action = rows(layout, 64)
    exact_action, exact_value = actor(obs, layout), critic(obs, action, layout)
    actor.encoder.precision = critic.encoder.precision = torch.bfloat16
    assert (actor(obs, layout) - exact_action).norm() / exact_action.norm() < 0.05
    assert (critic(obs, action, layout) - exact_value).norm() / exact_value.norm() < 0.05


def test_groups_hold_whole_robots_and_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    actor, critic = networks()
    specs = [spec(name) for name in ("quadruped", "hopper", "walker", "hopper", "cheetah")]
    whole = build_layout(specs, embed)
    monkeypatch.setattr("morphkit_rl.models.layout.GROUP_LIMBS", 12)
    parts = build_layout(specs, embed)
    assert [group.indices(37) for group in whole.groups] == [(0, 37, 1)]
    assert [group.indices(37) for group in parts.groups] == [(0, 13, 1), (13, 25, 1), (25, 37, 1)]
    obs, action = rows(whole)
    torch.testing.assert_close(actor(obs, parts), actor(obs, whole), atol=1e-6, rtol=0)
    torch.testing.assert_close(critic(obs, action, parts), critic(obs, action, whole), atol=1e-6, rtol=0)
