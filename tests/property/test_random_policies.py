"""What a policy gives for a robot depends neither on padding nor on the robots next to it, whatever the robots are."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from unittest.mock import patch

import numpy as np
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphkit.description import Description
from morphkit.readers import read
from morphkit.tokens.spec import token_spec
from morphkit_rl.models import build
from morphkit_rl.models.layout import build_layout
from morphkit_rl.models.limb_former import LimbFormerSettings
from tests.support.trees import mjcf_robots, urdf_robots

SIZE = 6


def embed(texts: Sequence[str]) -> np.ndarray:
    """A vector of its own for every text."""
    return np.stack([np.random.default_rng(zlib.crc32(t.encode())).standard_normal(SIZE) for t in texts]).astype("f4")


@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    robots=st.lists(st.one_of(mjcf_robots(), urdf_robots()), min_size=2, max_size=4),
    group_limbs=st.integers(1, 40),
    seed=st.integers(0, 2**31),
)
def test_a_robot_alone_and_among_others_gets_the_same(robots: list[Description], group_limbs: int, seed: int) -> None:
    torch.manual_seed(seed)
    actor, critic = build(LimbFormerSettings(d_model=8, layers=2, heads=2, feedforward=8), SIZE)
    for parameter in (*actor.parameters(), *critic.parameters()):
        torch.nn.init.normal_(parameter, std=0.3)
    specs = [token_spec(read(robot)) for robot in robots]
    with patch("morphkit_rl.models.layout.GROUP_LIMBS", group_limbs):
        mixed = build_layout(specs, embed)
    obs, action = torch.randn(3, mixed.num_tokens), torch.rand(3, mixed.num_actions) * 2 - 1
    actions, values = actor(obs, mixed), critic(obs, action, mixed)
    assert actions.shape == action.shape
    for robot, spec in enumerate(specs):
        alone = build_layout([spec], embed)
        own_obs, own_action = obs[:, mixed.tokens[robot]], action[:, mixed.actions[robot]]
        torch.testing.assert_close(actor(own_obs, alone), actions[:, mixed.actions[robot]], atol=1e-6, rtol=0)
        torch.testing.assert_close(critic(own_obs, own_action, alone)[..., 0], values[..., robot], atol=1e-6, rtol=0)
