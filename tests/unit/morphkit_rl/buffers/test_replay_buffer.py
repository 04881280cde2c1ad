"""Replay buffers and n-step returns."""

from __future__ import annotations

import numpy as np
import pytest

from morphkit.readers import read
from morphkit.tokens.spec import token_spec
from morphkit_rl.buffers.replay_buffer import ReplayBuffer, sample


def fill(buffer: ReplayBuffer, sweeps: int, *, ends: dict[tuple[int, int], bool] | None = None) -> None:
    """Add sweeps: observation (sweep, env), reward the sweep; `ends` maps (sweep, env) to terminated."""
    ends = ends or {}
    envs = np.arange(buffer.num_envs)
    for sweep in range(sweeps):
        obs = np.stack([np.full(buffer.num_envs, sweep), envs], 1)
        buffer.add(
            obs=obs,
            action=np.zeros((buffer.num_envs, 1)),
            reward=np.full(buffer.num_envs, float(sweep)),
            next_obs=obs + np.array([1, 0]),
            terminated=np.array([ends.get((sweep, env), False) for env in envs]),
            ended=np.array([(sweep, env) in ends for env in envs]),
        )


def test_one_step_samples_are_the_transitions_that_were_added() -> None:
    buffer = ReplayBuffer(2, 1, num_envs=3, capacity=30)
    fill(buffer, 4, ends={(2, 1): True})
    obs, _, reward, next_obs, factor = buffer.sample(500, 1, 0.9, np.random.default_rng(0))
    assert set(map(tuple, obs.tolist())) == {(float(s), float(e)) for s in range(4) for e in range(3)}
    np.testing.assert_array_equal(reward, obs[:, 0])
    np.testing.assert_array_equal(next_obs, obs + np.array([1, 0]))
    terminated = (obs == [2, 1]).all(1)
    np.testing.assert_allclose(factor, np.where(terminated, 0, 0.9), rtol=1e-6)


def test_n_step_sums_stop_at_ends_and_at_the_newest_sweep() -> None:
    buffer = ReplayBuffer(2, 1, num_envs=2, capacity=40)
    fill(buffer, 10, ends={(4, 0): True, (6, 1): False})
    obs, _, reward, next_obs, factor = buffer.sample(2000, 3, 0.5, np.random.default_rng(1))
    for (sweep, env), r, after, f in zip(obs.astype(int).tolist(), reward, next_obs, factor, strict=True):
        end = {0: 4, 1: 6}[env]
        last = min(sweep + 2, end if sweep <= end else 99, 9)
        expected = sum(0.5**k * (sweep + k) for k in range(last - sweep + 1))
        assert np.isclose(r, expected)
        assert after[0] == last + 1
        assert np.isclose(f, 0 if (last, env) == (4, 0) else 0.5 ** (last - sweep + 1))


def test_a_full_ring_holds_the_newest_sweeps_and_never_reads_across_its_seam() -> None:
    buffer = ReplayBuffer(2, 1, num_envs=2, capacity=10)
    fill(buffer, 13)
    assert len(buffer) == 10
    obs, _, reward, next_obs, _ = buffer.sample(1000, 4, 1.0, np.random.default_rng(2))
    assert obs[:, 0].min() == 8
    assert obs[:, 0].max() == 12
    last = np.minimum(obs[:, 0] + 3, 12)
    np.testing.assert_array_equal(next_obs[:, 0], last + 1)
    np.testing.assert_allclose(reward, (obs[:, 0] + last) * (last - obs[:, 0] + 1) / 2)


def test_batches_stand_side_by_side() -> None:
    buffers = [ReplayBuffer(2, 1, 2, 20), ReplayBuffer(2, 1, 2, 20)]
    for buffer in buffers:
        fill(buffer, 5)
    batch = sample(buffers, 7, 1, 0.99, np.random.default_rng(0))
    assert batch.obs.shape == (7, 4)
    assert batch.action.shape == (7, 2)
    assert batch.reward.shape == batch.discount.shape == (7, 2)
    np.testing.assert_array_equal(batch.obs[:, [0, 2]], batch.reward)


class SimpleBuffer:
    """The same replay with each next observation stored next to its transition, in a plain list."""

    def __init__(self, num_envs: int, sweeps: int):
        self.num_envs, self.sweeps, self.added, self.rows = num_envs, sweeps, 0, {}

    def add(self, **fields: np.ndarray) -> None:
        for env in range(self.num_envs):
            self.rows[self.added, env] = {name: np.copy(values[env]) for name, values in fields.items()}
            self.rows.pop((self.added - self.sweeps, env), None)
        self.added += 1

    def sample(self, batch: int, n_step: int, discount: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        sweeps = rng.integers(max(self.added - self.sweeps, 0), self.added, batch)
        envs = rng.integers(0, self.num_envs, batch)
        out: list[tuple[np.ndarray, ...]] = []
        for sweep, env in zip(sweeps.tolist(), envs.tolist(), strict=True):
            row, reward, factor, number = self.rows[sweep, env], np.float32(0), np.float32(1), sweep
            while True:
                last = self.rows[number, env]
                reward = np.float32(reward + factor * last["reward"])
                factor = np.float32(factor * discount)
                number += 1
                if last["ended"] or number - sweep == n_step or number == self.added:
                    break
            factor = np.float32(0) if last["terminated"] else factor
            out.append((row["obs"], row["action"], reward, last["next_obs"], factor))
        return tuple(np.stack(part) for part in zip(*out, strict=True))


def play_randomly(buffers: list[ReplayBuffer | SimpleBuffer], sweeps: int, seed: int, scale: float = 1.0) -> None:
    """Add random episodes that terminate and are truncated to all `buffers` alike."""
    rng = np.random.default_rng(seed)
    obs = rng.standard_normal((3, 4)).astype(np.float32) * scale
    for _ in range(sweeps):
        next_obs = rng.standard_normal((3, 4)).astype(np.float32) * scale
        terminated, truncated = rng.random((2, 3)) < 0.15
        fields = {
            "obs": obs,
            "action": rng.uniform(-1, 1, (3, 2)).astype(np.float32),
            "reward": rng.standard_normal(3).astype(np.float32),
            "next_obs": next_obs,
            "terminated": terminated,
            "ended": terminated | truncated,
        }
        for buffer in buffers:
            buffer.add(**fields)
        obs = np.where(fields["ended"][:, None], rng.standard_normal((3, 4)) * scale, next_obs).astype(np.float32)


@pytest.mark.parametrize("n_step", [1, 2, 5])
@pytest.mark.parametrize("sweeps", [1, 2, 6, 7, 8, 40])
def test_samples_equal_those_of_a_replay_that_stores_every_next_observation(sweeps: int, n_step: int) -> None:
    buffer, simple = ReplayBuffer(4, 2, num_envs=3, capacity=22), SimpleBuffer(3, 7)
    assert buffer.sweeps == 7
    play_randomly([buffer, simple], sweeps, seed=sweeps)
    mine, expected = (r.sample(400, n_step, 0.9, np.random.default_rng(5)) for r in (buffer, simple))
    for name, one, other in zip(("obs", "action", "reward", "next_obs", "factor"), mine, expected, strict=True):
        assert one.dtype == np.float32
        np.testing.assert_allclose(one, other, rtol=0 if n_step == 1 else 1e-6, atol=0, err_msg=name)


def test_final_observations_go_with_their_transitions() -> None:
    buffer = ReplayBuffer(4, 2, num_envs=3, capacity=30)
    play_randomly([buffer], 5000, seed=0)
    assert len(buffer.finals.numbers) == buffer.ended.sum() <= 30
    assert buffer.finals.nbytes < 10 * 30 * (4 * 4 + 8), "what was overwritten must go"


def test_half_precision_rounds_and_bounds_but_never_overflows() -> None:
    exact, half = ReplayBuffer(4, 2, 3, 60), ReplayBuffer(4, 2, 3, 60, dtype="float16")
    play_randomly([exact, half], 30, seed=1)
    for one, other in zip(*(r.sample(500, 3, 0.99, np.random.default_rng(0)) for r in (exact, half)), strict=True):
        np.testing.assert_allclose(other, one, rtol=2**-11, atol=1e-7)
        assert other.dtype == np.float32
    assert half.obs.nbytes * 2 == exact.obs.nbytes
    wild = ReplayBuffer(4, 2, 3, 60, dtype="float16")
    play_randomly([wild], 30, seed=1, scale=1e6)
    obs, _, _, next_obs, _ = wild.sample(500, 1, 0.99, np.random.default_rng(0))
    assert np.isfinite(obs).all()
    assert np.isfinite(next_obs).all()
    assert np.abs(obs).max() == 65504


def test_ten_million_transitions_of_the_whole_benchmark_take_less_than_eight_gib() -> None:
    from morphkit.registry import load, recipes

    names = [name for family in ("cheetah", "walker", "humanoid_2d", "hopper") for name in recipes(family)]
    assert len(names) == 32
    specs = [token_spec(read(load(name))) for name in names]
    share, capacity = 1000, 10_000_000
    for dtype, limit in (("float32", 4.5), ("float16", 2.3)):
        buffers = [ReplayBuffer(len(s.sensors), len(s.limbs), 8, capacity // 32 // share, dtype) for s in specs]
        held = sum(buffer.sweeps * buffer.num_envs for buffer in buffers)
        newest = sum(buffer.newest.nbytes for buffer in buffers)
        assert (sum(buffer.nbytes for buffer in buffers) - newest) / held * capacity < limit * 2**30
