"""Counting rewards and control steps, and where episodes end."""

from __future__ import annotations

import numpy as np

from morphkit_rl.envs.episode_counters import Episode, EpisodeCounters

ENVS = [slice(0, 2), slice(2, 5)]


def test_episodes_are_as_long_as_their_robots_say() -> None:
    counters = EpisodeCounters(ENVS, [2, 3])
    counters.restart(slice(None), np.array([0, 1, 0, 0, 2]))
    assert counters.add(np.ones(5)).tolist() == [False, True, False, False, True]
    assert counters.add(np.ones(5)).tolist() == [True, True, False, False, True]


def test_what_ended_is_reported_once_and_counted_anew() -> None:
    counters = EpisodeCounters(ENVS, [9, 9])
    for _ in range(2):
        counters.add(np.arange(5.0))
    done, diverged = np.array([False, True, False, True, False]), np.array([False, False, False, True, False])
    assert counters.end(done, diverged) == [Episode(0, 1, 2.0, 2), Episode(1, 1, 6.0, 2, diverged=True)]
    assert counters.end(np.zeros(5, bool), None) == []
    assert counters.returns.tolist() == [0, 0, 4, 0, 8]
    assert counters.lengths.tolist() == [2, 0, 2, 0, 2]


def test_restarting_a_robot_leaves_the_others_alone() -> None:
    counters = EpisodeCounters(ENVS, [9, 9])
    counters.add(np.ones(5))
    counters.restart(ENVS[1])
    assert counters.lengths.tolist() == [1, 1, 0, 0, 0]
    assert counters.returns.tolist() == [1, 1, 0, 0, 0]
