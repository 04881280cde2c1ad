"""The scale of each robot's rewards, against returns added up one by one."""

from __future__ import annotations

import numpy as np

from morphkit_rl.algorithms.return_normalizer import ReturnNormalizer

DISCOUNT, SUPPORT, ROBOTS, ENVS = 0.9, 5.0, 2, 3


def steps(number: int) -> tuple[np.ndarray, np.ndarray]:
    """Rewards of which the second robot's are 100 times as large, and ends of episodes."""
    rng = np.random.default_rng(0)
    reward = rng.normal(1, 1, (number, ROBOTS, ENVS)) * np.array([1, 100])[:, None]
    return reward, rng.random(reward.shape) < 0.1


def test_the_scale_follows_the_running_returns() -> None:
    normalizer, (reward, ended) = ReturnNormalizer(ROBOTS, ENVS, DISCOUNT, SUPPORT), steps(60)
    running, seen = np.zeros((ROBOTS, ENVS)), []
    for r, e in zip(reward, ended, strict=True):
        normalizer.update(r, e)
        running = DISCOUNT * running + r
        seen.append(running.copy())
        running[e] = 0
    returns = np.stack(seen).transpose(1, 0, 2).reshape(ROBOTS, -1)
    divisor = np.maximum(returns.std(1), np.abs(returns).max(1) / SUPPORT)
    np.testing.assert_allclose(normalizer.scale(), 1 / divisor, rtol=1e-6)


def test_returns_fit_into_the_support_and_robots_are_alike() -> None:
    normalizer, (reward, ended) = ReturnNormalizer(ROBOTS, ENVS, DISCOUNT, SUPPORT), steps(200)
    for r, e in zip(reward, ended, strict=True):
        normalizer.update(r, e)
    first, second = normalizer.scale()
    assert 50 < first / second < 200
    assert (normalizer.largest * normalizer.scale() <= SUPPORT * (1 + 1e-6)).all()


def test_nothing_seen_and_no_reward_leave_finite_scales() -> None:
    normalizer = ReturnNormalizer(1, ENVS, DISCOUNT, SUPPORT)
    assert normalizer.scale().tolist() == [1]
    normalizer.update(np.zeros((1, ENVS)), np.zeros((1, ENVS), bool))
    assert np.isfinite(normalizer.scale()).all()


def test_a_restored_normalizer_goes_on_exactly() -> None:
    (reward, ended), whole = steps(40), ReturnNormalizer(ROBOTS, ENVS, DISCOUNT, SUPPORT)
    for r, e in zip(reward[:20], ended[:20], strict=True):
        whole.update(r, e)
    other = ReturnNormalizer(ROBOTS, ENVS, DISCOUNT, SUPPORT)
    other.load_state_dict(whole.state_dict())
    for r, e in zip(reward[20:], ended[20:], strict=True):
        whole.update(r, e)
        other.update(r, e)
    assert np.array_equal(whole.scale(), other.scale())
    assert np.array_equal(whole.running, other.running)
