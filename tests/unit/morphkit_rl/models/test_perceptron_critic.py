"""Perceptron critics against their formula, robot by robot."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F

from morphkit.errors import ConfigError
from morphkit_rl.models.blocks import set_precision
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.perceptron_critic import PerceptronCritic
from morphkit_rl.models.vocabulary import Vocabulary
from tests.support.networks import ROBOTS, layout_of, rows, spec

WIDTH, LAYERS, ATOMS = 16, 2, 7


def make(atoms: int = ATOMS) -> PerceptronCritic:
    torch.manual_seed(0)
    critic = PerceptronCritic(Vocabulary.of([spec(name) for name in ROBOTS]), WIDTH, LAYERS, atoms)
    for parameter in critic.parameters():  # scales and shifts of norms, and biases, that matter
        parameter.data += 0.1 * torch.randn_like(parameter)
    return critic


def plain(critic: PerceptronCritic, member: int, name: str, obs: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """The formula for one robot."""
    own = spec(name)
    texts = [token.text for token in (*own.sensors, *own.actuators)]
    vectors = critic.token[member, [critic.texts[text] for text in texts]]
    x = torch.cat([obs, action], -1) @ vectors + critic.robot[member, critic.robots[name]]
    x = F.relu(F.layer_norm(x, (WIDTH,), critic.norms[0].weight[member], critic.norms[0].bias[member]))
    for linear, norm in zip(critic.hidden, list(critic.norms)[1:], strict=True):
        x = x @ linear.weight[member] + linear.bias[member, 0]
        x = F.relu(F.layer_norm(x, (WIDTH,), norm.weight[member], norm.bias[member]))
    return x @ critic.head.weight[member] + critic.head.bias[member, 0]


@pytest.mark.parametrize("robots", [ROBOTS, ROBOTS[1:2], ROBOTS[::-1]])
def test_each_robots_values_follow_the_formula(robots: tuple[str, ...]) -> None:
    critic, layout = make(), layout_of("limb-former", *robots)
    obs, action = rows(layout)
    values = critic(obs, action, layout)
    assert values.shape == (2, len(obs), len(robots), ATOMS)
    for number, name in enumerate(robots):
        own = obs[:, layout.tokens[number]], action[:, layout.actions[number]]
        for member in range(2):
            torch.testing.assert_close(values[member, :, number], plain(critic, member, name, *own))


def test_numbers_have_no_axis_of_atoms_and_one_member_gives_its_own() -> None:
    critic, layout = make(0), layout_of("limb-former", *ROBOTS)
    values = critic(*rows(layout), layout)
    assert values.shape == (2, 5, len(ROBOTS))
    torch.testing.assert_close(critic(*rows(layout), layout, members=1)[0], values[0])
    assert (values[0] - values[1]).abs().min() > 1e-6


def test_robots_with_equal_tokens_are_told_apart() -> None:
    critic, layout = make(), layout_of("limb-former", "hopper", "hopper_3")
    obs, action = rows(layout)
    before = critic(obs, action, layout)
    critic.robot.data[:, critic.robots["hopper"]] += torch.randn(WIDTH)
    changed = (critic(obs, action, layout) - before).abs().amax((0, 1, 3))
    assert changed[0] > 1e-3
    assert changed[1] == 0


def test_gradients_of_all_parameters_and_inputs_are_those_of_the_formula() -> None:
    critic, layout = make(), layout_of("limb-former", *ROBOTS)
    obs, action = (x.requires_grad_() for x in rows(layout))
    weight = torch.randn(2, len(obs), len(ROBOTS), ATOMS)
    (critic(obs, action, layout) * weight).sum().backward()
    found = [p.grad.clone() for p in (*critic.parameters(), obs, action)]
    for x in (*critic.parameters(), obs, action):
        x.grad = None
    for number, name in enumerate(ROBOTS):
        own = obs[:, layout.tokens[number]], action[:, layout.actions[number]]
        for member in range(2):
            (plain(critic, member, name, *own) * weight[member, :, number]).sum().backward()
    for gradient, x in zip(found, (*critic.parameters(), obs, action), strict=True):
        torch.testing.assert_close(gradient, x.grad, rtol=1e-4, atol=1e-4)


def test_low_precision_stays_close() -> None:
    critic, layout = make(), layout_of("limb-former", *ROBOTS)
    exact = critic(*rows(layout, 16), layout)
    set_precision(critic, torch.bfloat16)
    low = critic(*rows(layout, 16), layout)
    assert low.dtype == torch.float32
    assert 1e-7 < (low - exact).norm() / exact.norm() < 0.05


def test_robots_beside_those_of_training_are_refused() -> None:
    layout: Layout = layout_of("limb-former", "walker_2_main")
    with pytest.raises(ConfigError, match="only the training robots, not walker_2_main"):
        make()(*rows(layout), layout)
