"""The order of collecting and learning."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from morphkit.registry import load
from morphkit_rl.buffers.replay_buffer import Batch, sample
from morphkit_rl.config.methods import method_names
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.envs.episode_counters import Episode
from morphkit_rl.runs.run_settings import RunSettings
from morphkit_rl.training import schedules
from morphkit_rl.training.schedules import Rounds, Sweeps, batches
from morphkit_rl.training.session import Session
from tests.support.networks import tiny_overrides

TINY = ("td3.batch_size=4", "trainer.precision=float32")
TINY_MODEL = ("model.d_model=16", "model.layers=1", "model.feedforward=16")


def session(*names: str, overrides: tuple[str, ...] = (), model: Sequence[str] = TINY_MODEL, seed: int = 0) -> Session:
    robots = tuple(load(name) for name in names)
    config = load_config(overrides=[*TINY, *model, *overrides])
    return Session(RunSettings(robots, (), (), config, None, None, seed, None, 1000, "cpu", 1))


def run_on(one: Session, pieces: int) -> Session:
    for _ in range(pieces):
        one.schedule.advance()
    return one


def content(one: Session) -> dict[str, Any]:
    """Everything that a continuation depends on."""
    groups = {**one.agent.arrays(), "environments": one.collector.arrays()}
    arrays = {f"{group}/{key}": np.array(a) for group, part in groups.items() for key, a in part.items()}
    drawn = [buffer.sample(20, 2, 0.9, np.random.default_rng(0)) for buffer in one.collector.buffers if len(buffer)]
    arrays.update({f"replay/{number}": np.hstack([a.ravel() for a in part]) for number, part in enumerate(drawn)})
    state = {**one.agent.state(), **one.collector.state(), **one.schedule.state(), "rng": one.rng.bit_generator.state}
    return {**arrays, "state": json.dumps(state)}


def assert_same(one: Session, other: Session) -> None:
    a, b = content(one), content(other)
    assert a.keys() == b.keys()
    for key in a:
        np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def test_first_episodes_of_a_robot_that_never_falls_end_spread_over_the_episode_length() -> None:
    one = session("arm", overrides=("trainer.start_steps=1000000", "trainer.num_envs=8"))
    reported, first = [], []
    for sweep in range(1, 2001):
        one.schedule.advance()
        reported += [sweep] * (one.collector.episodes - len(reported))
        first += [sweep] * (len(one.collector.first[0]) - len(first))
        if sweep == 999:
            assert one.collector.first_returns().keys() == {"arm"}
            assert not one.collector.returns()
    assert len(first) >= 7, "all but the shortest are reported, as what they are"
    assert first[0] < 250
    assert not one.collector.first_returns(), "whole ones take their place"
    assert len(reported) == 8, "each environment ends one whole episode; the shortened first ones are left out"
    assert np.histogram(reported, bins=8, range=(1000, 2000))[0].tolist() == [1] * 8
    assert all(1000 <= sweep <= 2000 for sweep in reported)
    assert session("arm", seed=1).collector.env.state_dict()["length"].tolist() != (
        session("arm").collector.env.state_dict()["length"].tolist()
    )


ROUNDS = (
    *("trainer.schedule=rounds", "trainer.num_envs=1", "trainer.start_steps=10", "td3.n_step=2"),
    "td3.actor_first=true",
)


def test_a_round_is_an_episode_of_every_robot_then_equal_shares_of_as_many_updates_from_their_own_replays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one = session("hopper", "hopper_3", overrides=ROUNDS)
    schedule, collector = one.schedule, one.collector
    assert isinstance(schedule, Rounds)
    trained_on: list[tuple[int, int]] = []
    update = one.agent.update

    def spy(batch: Any, rng: Any, view: Any, number: int) -> Any:
        trained_on.append((one.agent.each.index(view), number))
        assert batch.obs.shape == (4, view.layout.num_tokens)
        losses = update(batch, rng, view, number)
        assert ("actor_loss" in losses) == (number % 2 == 0), "each robot begins with an update of the actor"
        return losses

    monkeypatch.setattr(one.agent, "update", spy)
    lengths: list[int] = []
    report = collector.report
    monkeypatch.setattr(collector, "report", lambda episode: (lengths.append(episode.length), report(episode)))
    unlike = 0
    for _ in range(2):
        steps, real_steps, episodes = collector.steps, collector.real_steps, collector.episodes
        lengths.clear()
        while not schedule.updates_left.any():
            schedule.advance()
        unlike += abs(lengths[0] - lengths[1])
        shares = schedule.updates_left.copy()
        sweeps = (collector.real_steps - real_steps) // 2
        assert collector.steps - steps == shares.sum() == sum(lengths)
        assert shares.max() - shares.min() == shares.sum() % 2, "robots share alike, whose episode was longer too"
        assert max(lengths) == sweeps, "the round lasts as long as the longest of the episodes"
        assert collector.episodes - episodes == 2
        trained_on.clear()
        while schedule.updates_left.any():
            schedule.advance()
        assert trained_on == [(robot, number) for robot in range(2) for number in range(shares[robot])]
    assert collector.real_steps == 2 * collector.buffers[0].added > collector.steps
    assert one.agent.learner.updates == collector.steps
    assert unlike > 2, "episodes as long as each other would not tell how updates are shared"


def test_no_sum_of_rewards_reaches_over_the_end_of_a_round() -> None:
    one = session("hopper", "hopper_3", overrides=ROUNDS)
    schedule = one.schedule
    assert isinstance(schedule, Rounds)
    while not schedule.updates_left.any():
        schedule.advance()
    for buffer in one.collector.buffers:
        assert buffer.ended[buffer.added - 1]
        assert buffer.finals.numbers[-1] == buffer.added - 1


def test_a_round_with_several_environments_waits_for_all_of_them() -> None:
    one = session("hopper", overrides=(*ROUNDS, "trainer.num_envs=3"))
    schedule = one.schedule
    assert isinstance(schedule, Rounds)
    while not schedule.updates_left.any():
        schedule.advance()
    assert one.collector.episodes == 3
    assert one.collector.buffers[0].added <= schedule.updates_left[0] <= one.collector.real_steps


@pytest.mark.parametrize("pieces", [7, 80])
def test_a_round_goes_on_exactly_from_a_checkpoint_in_its_middle(tmp_path: Path, pieces: int) -> None:
    for folder in ("checkpoints", "replay"):
        (tmp_path / folder).mkdir()
    whole = run_on(session("hopper", "hopper_3", overrides=ROUNDS), pieces)
    whole.save(tmp_path, 12.5)
    resumed = session("hopper", "hopper_3", overrides=ROUNDS)
    assert resumed.restore(tmp_path) == 12.5
    assert_same(whole, resumed)
    assert_same(run_on(whole, 50), run_on(resumed, 50))


def test_random_steps_are_counted_over_all_robots_or_a_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    for overrides, expected in (
        (("trainer.start_steps=40",), 40),
        (("trainer.start_steps=0", "trainer.start_steps_per_robot=30"), 60),
        (("trainer.start_steps=80", "trainer.start_steps_per_robot=30"), 80),
    ):
        one = session("hopper", "arm", overrides=("trainer.num_envs=2", "trainer.updates_per_sweep=1", *overrides))
        acted: list[int] = []
        act = one.agent.act
        monkeypatch.setattr(one.agent, "act", lambda obs, one=one, acted=acted, act=act: (
            acted.append(one.collector.steps), act(obs))[1])  # fmt: skip
        run_on(one, 25)
        assert acted[0] == expected


def test_without_normalization_networks_see_the_observations_as_they_are() -> None:
    one = session("hopper", overrides=("trainer.normalize=false", "trainer.num_envs=2", "trainer.start_steps=8"))
    run_on(one, 6)
    assert one.agent.normalizer.count.sum() == 0
    seen: list[Any] = []
    actor = one.agent.learner.actor
    handle = actor.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0].numpy()))
    wild = np.full_like(one.collector.obs, 50.0)
    one.agent.act(wild)
    handle.remove()
    np.testing.assert_array_equal(seen[0], wild)


def test_the_schedule_of_a_checkpoint_must_be_that_of_the_run(tmp_path: Path) -> None:
    from morphkit.errors import CheckpointError

    for folder in ("checkpoints", "replay"):
        (tmp_path / folder).mkdir()
    run_on(session("hopper", overrides=("trainer.num_envs=1",)), 3).save(tmp_path, 1.0)
    with pytest.raises(CheckpointError, match="of schedule 'sweeps', but the run says 'rounds'"):
        session("hopper", overrides=ROUNDS).restore(tmp_path)


def test_sweeps_is_the_default() -> None:
    assert isinstance(session("arm").schedule, Sweeps)
    assert replace(TrainConfig().trainer, schedule="rounds") != TrainConfig().trainer


class Operations(TorchDispatchMode):
    """Counts the operations of a stretch of code by name."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: Counter[str] = Counter()

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.seen[str(func.overloadpacket)] += 1
        indices = args[1] if str(func.overloadpacket) in ("aten.index", "aten.index_put", "aten.index_put_") else ()
        self.seen["aten.nonzero"] += sum(index is not None and index.dtype == torch.bool for index in indices)
        return func(*args, **(kwargs or {}))


WAITING = {f"aten.{name}" for name in ("_local_scalar_dense", "nonzero", "bincount", "masked_select", "_unique2")}
"""Operations that make the host wait for a GPU."""


@pytest.mark.parametrize("method", method_names())
def test_collecting_and_learning_wait_for_a_device_only_to_fetch_actions(method: str) -> None:
    small = ("trainer.num_envs=2", "trainer.start_steps=4")
    one = run_on(session("hopper", "hopper_3", overrides=small, model=tiny_overrides(method)), 3)
    with Operations() as operations:
        one.schedule.advance()
    assert operations.seen
    assert {name: count for name, count in operations.seen.items() if count and name in WAITING} == {}


def test_noise_differs_from_environment_to_environment_of_a_robot(monkeypatch: pytest.MonkeyPatch) -> None:
    spread = ("td3.exploration_noise=0.2", "learner.noise_spread=0.15", "trainer.num_envs=4", "trainer.start_steps=4")
    one = session("arm", overrides=(*spread, "trainer.updates_per_sweep=1"))
    taken = []
    advance = one.collector.advance
    monkeypatch.setattr(one.collector, "advance", lambda action: taken.append(action) or advance(action))
    monkeypatch.setattr(one.agent, "act", lambda obs: np.zeros((4, one.collector.layout.num_actions), np.float32))
    run_on(one, 401)
    levels = np.stack(taken[1:]).std((0, 2))
    np.testing.assert_allclose(levels, [0.05, 0.15, 0.25, 0.35], rtol=0.08)


def test_batches_drawn_ahead_are_parts_of_one_draw_and_as_many_and_large_as_otherwise() -> None:
    one = run_on(session("hopper", "arm", overrides=("trainer.start_steps=1000000", "td3.batch_size=6")), 20)
    config, buffers = one.settings.config, one.collector.buffers
    ahead, apart = (replace(config, learner=replace(config.learner, sample_ahead=way)) for way in (True, False))
    together = list(batches(ahead, buffers, np.random.default_rng(3), config.td3.discount))
    single = list(batches(apart, buffers, np.random.default_rng(3), config.td3.discount))
    updates = config.trainer.updates_per_sweep
    assert [len(batch.obs) for batch in together] == [len(batch.obs) for batch in single] == [3] * updates
    whole = sample(buffers, 3 * updates, config.td3.n_step, config.td3.discount, np.random.default_rng(3))
    for name in Batch.__slots__:
        np.testing.assert_array_equal(np.concatenate([getattr(b, name) for b in together]), getattr(whole, name))


def test_the_discount_goes_from_first_to_last_with_the_updates_and_is_that_of_batches_and_returns(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    overrides = ("trainer.start_steps=0", "td3.discount=0.9", "learner.final_discount=0.999")
    overrides = (*overrides, "learner.discount_updates=8000")
    one, drawn = session("hopper", overrides=overrides), []
    monkeypatch.setattr(schedules, "sample", lambda *given: drawn.append(given[3]) or sample(*given))
    assert one.agent.returns is not None
    for updates, expected in ((0, 0.9), (4000, 0.99), (8000, 0.999), (9000, 0.999)):
        one.agent.learner.updates = updates
        run_on(one, 1)
        assert [drawn.pop(), one.agent.returns.discount] == pytest.approx([expected] * 2)


def test_returns_are_counted_with_the_ends_of_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    one = session("hopper", overrides=("trainer.start_steps=1000000", "trainer.num_envs=3"))
    assert one.agent.returns is not None
    running, seen, steps, store = np.zeros(3), [], [], one.collector.store
    monkeypatch.setattr(one.collector, "store", lambda action, step: steps.append(step) or store(action, step))
    run_on(one, 60)
    for step in steps:
        running = one.settings.config.td3.discount * running + step.reward[0]
        seen.append(running.copy())
        running[step.terminated[0] | step.truncated[0]] = 0
    assert any(step.terminated[0].any() for step in steps)
    np.testing.assert_allclose(one.agent.returns.running[0], running)
    divisor = max(np.std(seen), np.abs(seen).max() / one.settings.config.learner.support)
    np.testing.assert_allclose(one.agent.returns.scale(), 1 / divisor, rtol=1e-5)


def test_updates_take_the_scale_of_the_robots_that_they_are_for(monkeypatch: pytest.MonkeyPatch) -> None:
    one = run_on(session("hopper", "arm", overrides=("trainer.start_steps=1000000",)), 20)
    given = []
    monkeypatch.setattr(one.agent.learner, "update", lambda *rest: given.append(rest[6].tolist()) or {})
    one.agent.refresh()
    for view in (one.agent.robots, *one.agent.each):
        batch = next(iter(batches(one.settings.config, one.collector.buffers, one.rng, one.agent.discount)))
        one.agent.update(batch, one.rng, view)
    assert one.agent.returns is not None
    scales = one.agent.returns.scale().tolist()
    assert given == [scales, scales[:1], scales[1:]]
    assert scales[0] != scales[1]


def test_returns_of_first_episodes_are_scaled_to_the_full_length_where_time_ended_them() -> None:
    collector = session("hopper").collector
    full = collector.robots[0].task.episode_length
    collector.report_first(Episode(0, 0, 50.0, full), elapsed=full - full // 10)
    assert collector.first_returns() == {"hopper": pytest.approx(500.0)}
    collector.report_first(Episode(0, 1, 50.0, full - 1), elapsed=full // 2)
    assert collector.first_returns() == {"hopper": pytest.approx((500 + 50) / 2)}, "a fall is no shorter for that"
    collector.report_first(Episode(0, 1, 50.0, full), elapsed=full - 1)
    assert len(collector.first[0]) == 2, "one step says nothing"
    again = session("hopper").collector
    again.restore(collector.arrays(), collector.state(), Path("environments.safetensors"))
    assert again.first_returns() == collector.first_returns()
