"""Replay rings and n-step returns."""

from __future__ import annotations

import numpy as np

from morphkit_rl.replay import Ring, sample


def fill(ring: Ring, sweeps: int, *, ends: dict[tuple[int, int], bool] | None = None) -> None:
    """Add sweeps: observation (sweep, env), reward the sweep; `ends` maps (sweep, env) to terminated."""
    ends = ends or {}
    envs = np.arange(ring.num_envs)
    for sweep in range(sweeps):
        obs = np.stack([np.full(ring.num_envs, sweep), envs], 1)
        ring.add(
            obs=obs,
            action=np.zeros((ring.num_envs, 1)),
            reward=np.full(ring.num_envs, float(sweep)),
            next_obs=obs + np.array([1, 0]),
            terminated=np.array([ends.get((sweep, env), False) for env in envs]),
            ended=np.array([(sweep, env) in ends for env in envs]),
        )


def test_one_step_samples_are_the_transitions_that_were_added() -> None:
    ring = Ring(2, 1, num_envs=3, capacity=30)
    fill(ring, 4, ends={(2, 1): True})
    obs, _, reward, next_obs, factor = ring.sample(500, 1, 0.9, np.random.default_rng(0))
    assert set(map(tuple, obs.tolist())) == {(float(s), float(e)) for s in range(4) for e in range(3)}
    np.testing.assert_array_equal(reward, obs[:, 0])
    np.testing.assert_array_equal(next_obs, obs + np.array([1, 0]))
    terminated = (obs == [2, 1]).all(1)
    np.testing.assert_allclose(factor, np.where(terminated, 0, 0.9), rtol=1e-6)


def test_n_step_sums_stop_at_ends_and_at_the_newest_sweep() -> None:
    ring = Ring(2, 1, num_envs=2, capacity=40)
    fill(ring, 10, ends={(4, 0): True, (6, 1): False})
    obs, _, reward, next_obs, factor = ring.sample(2000, 3, 0.5, np.random.default_rng(1))
    for (sweep, env), r, after, f in zip(obs.astype(int).tolist(), reward, next_obs, factor, strict=True):
        end = {0: 4, 1: 6}[env]
        last = min(sweep + 2, end if sweep <= end else 99, 9)
        expected = sum(0.5**k * (sweep + k) for k in range(last - sweep + 1))
        assert np.isclose(r, expected)
        assert after[0] == last + 1
        assert np.isclose(f, 0 if (last, env) == (4, 0) else 0.5 ** (last - sweep + 1))


def test_a_full_ring_holds_the_newest_sweeps_and_never_reads_across_its_seam() -> None:
    ring = Ring(2, 1, num_envs=2, capacity=10)
    fill(ring, 13)
    assert len(ring) == 10
    obs, _, reward, next_obs, _ = ring.sample(1000, 4, 1.0, np.random.default_rng(2))
    assert obs[:, 0].min() == 8
    assert obs[:, 0].max() == 12
    last = np.minimum(obs[:, 0] + 3, 12)
    np.testing.assert_array_equal(next_obs[:, 0], last + 1)
    np.testing.assert_allclose(reward, (obs[:, 0] + last) * (last - obs[:, 0] + 1) / 2)


def test_batches_stand_side_by_side() -> None:
    rings = [Ring(2, 1, 2, 20), Ring(2, 1, 2, 20)]
    for ring in rings:
        fill(ring, 5)
    batch = sample(rings, 7, 1, 0.99, np.random.default_rng(0))
    assert batch.obs.shape == (7, 4)
    assert batch.action.shape == (7, 2)
    assert batch.reward.shape == batch.discount.shape == (7, 2)
    np.testing.assert_array_equal(batch.obs[:, [0, 2]], batch.reward)
