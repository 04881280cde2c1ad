"""Targets and errors of scalar and categorical values, against the algorithms written out."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from morphkit.errors import ConfigError
from morphkit_rl.algorithms.critic_losses import CrossEntropy, SquaredError, make_critic_loss
from morphkit_rl.config.learner_config import LearnerConfig

ATOMS, SUPPORT = 11, 5.0


@pytest.fixture
def loss() -> CrossEntropy:
    return CrossEntropy(ATOMS, SUPPORT)


def probabilities(*shape: int) -> torch.Tensor:
    return torch.softmax(3 * torch.randn(*shape, ATOMS, generator=torch.Generator().manual_seed(0)), -1)


def project(p: np.ndarray, reward: float, discount: float) -> np.ndarray:
    """Bellemare et al. 2017, algorithm 1."""
    z = np.linspace(-SUPPORT, SUPPORT, ATOMS)
    step, m = z[1] - z[0], np.zeros(ATOMS)
    for j in range(ATOMS):
        b = (np.clip(reward + discount * z[j], -SUPPORT, SUPPORT) + SUPPORT) / step
        lower, upper = int(np.floor(b)), int(np.ceil(b))
        m[lower] += p[j] * (upper - b if upper > lower else 1)
        m[upper] += p[j] * (b - lower)
    return m


def test_the_projection_is_the_published_one(loss: CrossEntropy) -> None:
    p = probabilities(4, 3)
    rng = np.random.default_rng(0)
    reward, discount = rng.normal(0, 4, (4, 3)), rng.choice([0.0, 0.5, 0.99, 1.0], (4, 3))
    reward[0, 0], discount[0, 0] = 2.0, 0.0  # exactly on an atom
    found = loss.project(p, torch.tensor(reward).float(), torch.tensor(discount).float())
    for row in range(4):
        for value in range(3):
            expected = project(p[row, value].double().numpy(), reward[row, value], discount[row, value])
            np.testing.assert_allclose(found[row, value], expected, atol=1e-6)
    torch.testing.assert_close(found.sum(-1), torch.ones(4, 3))


def test_within_the_support_the_target_has_the_mean_that_td_says(loss: CrossEntropy) -> None:
    p = probabilities(6, 2)
    reward, discount = torch.linspace(-0.4, 0.4, 12).view(6, 2), torch.full((6, 2), 0.9)
    mean = loss.project(p, reward, discount) @ loss.values
    torch.testing.assert_close(mean, reward + 0.9 * (p @ loss.values))


def test_the_target_is_that_of_the_twin_with_the_smaller_mean(loss: CrossEntropy) -> None:
    output = torch.randn(2, 5, 3, ATOMS, generator=torch.Generator().manual_seed(1))
    reward, discount = torch.rand(5, 3), torch.full((5, 3), 0.99)
    found, means = loss.target(output, reward, discount), loss.expectation(output)
    assert 0 < (means[0] < means[1]).sum() < 15
    for row in range(5):
        for value in range(3):
            twin = output[int(means[0, row, value] > means[1, row, value]), row, value]
            expected = loss.project(torch.softmax(twin, -1), reward[row, value], discount[row, value])
            torch.testing.assert_close(found[row, value], expected)


def test_cross_entropy_is_least_where_the_output_is_the_target(loss: CrossEntropy) -> None:
    target = probabilities(3, 2)
    exact = target.log().expand(2, -1, -1, -1).clone().requires_grad_()
    error = loss.error(exact, target)
    torch.testing.assert_close(error[0], -(target * target.log()).sum(-1))
    (gradient,) = torch.autograd.grad(error.sum(), exact)
    assert gradient.abs().max() < 1e-6
    assert (loss.error(exact + torch.randn_like(exact), target) > error).all()


def test_squared_errors_follow_td3() -> None:
    loss = SquaredError()
    output, reward = torch.tensor([[[1.0, 4.0]], [[3.0, 2.0]]]), torch.tensor([[0.5, 0.5]])
    target = loss.target(output, reward, torch.tensor([[1.0, 0.0]]))
    assert target.tolist() == [[1.5, 0.5]]
    assert loss.error(output, target).tolist() == [[[0.25, 12.25]], [[2.25, 2.25]]]


def test_settings_choose_the_loss() -> None:
    assert isinstance(make_critic_loss(LearnerConfig()), SquaredError)
    categorical = make_critic_loss(LearnerConfig(value="categorical", atoms=5, support=2.0))
    assert isinstance(categorical, CrossEntropy)
    assert categorical.values.tolist() == [-2, -1, 0, 1, 2]


@pytest.mark.parametrize("changes", [{"atoms": 1}, {"support": 0.0}])
def test_impossible_atoms_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"learner.{next(iter(changes))}"):
        CrossEntropy(**{"atoms": ATOMS, "support": SUPPORT, **changes})
