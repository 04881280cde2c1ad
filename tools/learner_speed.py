"""Samples a second that presets learn from, compared with the default of before, and the share of the processor's peak.

One robot of a user's own (the quadruped), 4 walkers, 12 cheetahs, all 32 bodies of the benchmark; one and two threads.
A replay of random transitions is sampled and learned from as in training, without the environments. The presets take
turns; medians over turns are printed. The yardstick `limb-former-2026-11` runs as it did then: without compiled
kernels.

The share of the peak is that of the matrix products that the method needs for each robot alone, without padding,
over what one large matrix product reaches on as many threads in the same turns.

    python tools/learner_speed.py [--presets default] [--bodies 1 4 12 32] [--threads 1 2] [--turns 5] [--seconds 2]
        [--set SECTION.NAME=VALUE] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

from morphkit.description import Description
from morphkit.registry import load
from morphkit_rl.algorithms.agent import Agent
from morphkit_rl.benchmark.bodies import members
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.buffers.replay_buffer import Batch, ReplayBuffer
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.kernels import library
from morphkit_rl.runs import run_settings
from morphkit_rl.training.schedules import batches

YARDSTICK = "limb-former-2026-11"
WALKERS = ("walker_2_main", "walker_4_main", "walker_5_main", "walker_7_main")
CHEETAHS = (
    *("cheetah_2_back", "cheetah_2_front", "cheetah_3_back", "cheetah_3_front", "cheetah_4_allback"),
    *("cheetah_4_allfront", "cheetah_4_back", "cheetah_4_front", "cheetah_5_balanced", "cheetah_5_front"),
    *("cheetah_6_back", "cheetah_7_full"),
)
TRANSITIONS = 2000
"""Random transitions a robot that are sampled from."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--presets", nargs="+", default=["default"], help="compared with the yardstick")
    parser.add_argument("--bodies", nargs="+", type=int, choices=[1, 4, 12, 32], default=[1, 4, 12, 32])
    parser.add_argument("--threads", nargs="+", type=int, default=[1, 2])
    parser.add_argument("--turns", type=int, default=5, help="turns of which the median is taken")
    parser.add_argument("--seconds", type=float, default=2.0, help="length of a turn")
    parser.add_argument("--set", nargs="+", default=[], help="settings of the compared presets")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    rows = []
    for number in options.bodies:
        for threads in options.threads:
            torch.set_num_threads(threads)
            rows += measure(number, options)
            for row in rows[-1 - len(options.presets) :] if not options.json else ():
                print(
                    f"{row['bodies']:>3} bodies  {row['threads']} threads  {row['preset']:<20}"
                    f"{row['samples_per_s']:>9.0f} samples/s {row['updates_per_s']:>7.1f} updates/s"
                    f"{row['share_of_peak']:>6.0%} of {row['peak_gflops']:.0f} GFLOP/s  x {row['ratio']:.2f}",
                    flush=True,
                )
    if options.json:
        print(json.dumps(rows))


def measure(number: int, options: argparse.Namespace) -> list[dict[str, float | str]]:
    """The yardstick's figures and those of the presets, on so many bodies and torch's number of threads."""
    learners = {YARDSTICK: Learner(number, load_config(YARDSTICK))}
    learners |= {name: Learner(number, load_config(name, options.set)) for name in options.presets}
    rates: dict[str, list[float]] = {name: [] for name in learners}
    peaks = []
    for turn in range(options.turns + 1):
        for name, learner in learners.items():
            with kernels(on=name != YARDSTICK):
                rate = learner.samples_per_s(options.seconds)
            if turn:  # the first turn warms up
                rates[name].append(rate)
        peaks.append(peak())
    slow, best = statistics.median(rates[YARDSTICK]), max(peaks)
    rows: list[dict[str, float | str]] = []
    for name, learner in learners.items():
        rate = statistics.median(rates[name])
        rows.append({
            "bodies": number, "threads": torch.get_num_threads(), "preset": name, "precision": learner.precision,
            "batch": learner.batch_size, "samples_per_s": rate, "updates_per_s": rate / learner.batch_size,
            "flop_per_sample": learner.flop_per_sample(), "peak_gflops": best, "ratio": rate / slow,
            "share_of_peak": rate * learner.flop_per_sample() / best / 1e9,
        })  # fmt: skip
    return rows


class Learner:
    """A preset's learner with a replay of random transitions."""

    def __init__(self, number: int, config: TrainConfig):
        torch.manual_seed(0)
        self.config, self.rng = config, np.random.default_rng(0)
        specs = [run_settings.prepare_robot(config, body).spec for body in _bodies(number)]
        self.agent = Agent(config, specs, "cpu")
        self.precision = self.agent.learner.precision
        self.batch_size = -(-config.td3.batch_size // len(specs)) * len(specs)
        layout, envs = self.agent.robots.layout, config.trainer.num_envs
        self.buffers = [
            ReplayBuffer(tokens.stop - tokens.start, a.stop - a.start, envs, TRANSITIONS)
            for tokens, a in zip(layout.tokens, layout.actions, strict=True)
        ]
        for _ in range(TRANSITIONS // envs):
            self._add(envs)
        self._flop: float | None = None

    def samples_per_s(self, seconds: float) -> float:
        """Learn for so long."""
        start, updates = time.perf_counter(), 0
        while (passed := time.perf_counter() - start) < seconds:
            for batch in batches(self.config, self.buffers, self.rng, self.config.td3.discount):
                self.agent.update(batch, self.rng)
                updates += 1
        return updates * self.batch_size / passed

    def flop_per_sample(self) -> float:
        """Operations of the matrix products of `policy_delay` updates, robot by robot, over their samples."""
        if self._flop is None:
            updates, share = self.config.td3.policy_delay, self.batch_size // len(self.buffers)
            with kernels(on=False), FlopCounterMode(display=False) as counter:
                for number in range(updates):
                    batch = next(iter(batches(self.config, self.buffers, self.rng, self.config.td3.discount)))
                    for robot, view in enumerate(self.agent.each):
                        self.agent.update(self._part(batch, robot), self.rng, view, number)
            self._flop = counter.get_total_flops() / (updates * share * len(self.buffers))
        return self._flop

    def _part(self, batch: Batch, robot: int) -> Batch:
        layout = self.agent.robots.layout
        tokens, actions, own = layout.tokens[robot], layout.actions[robot], slice(robot, robot + 1)
        return Batch(
            batch.obs[:, tokens], batch.action[:, actions], batch.reward[:, own], batch.next_obs[:, tokens],
            batch.discount[:, own],
        )  # fmt: skip

    def _add(self, envs: int) -> None:
        for buffer in self.buffers:
            obs, next_obs = self.rng.standard_normal((2, envs, buffer.obs.shape[1])).astype(np.float32)
            ended = self.rng.random(envs) < 0.01
            buffer.add(
                obs=obs, next_obs=next_obs, action=self.rng.uniform(-1, 1, (envs, buffer.action.shape[1])).astype("f4"),
                reward=self.rng.standard_normal(envs).astype("f4"), terminated=ended, ended=ended,
            )  # fmt: skip


@contextmanager
def kernels(*, on: bool) -> Iterator[None]:
    """With or without compiled kernels."""
    if on:
        yield
        return
    before = os.environ.get(library.SWITCH)
    os.environ[library.SWITCH] = "0"
    _forget()
    try:
        yield
    finally:
        os.environ.pop(library.SWITCH)
        if before is not None:
            os.environ[library.SWITCH] = before
        _forget()


def peak() -> float:
    """GFLOP/s of one large product in float32."""
    x = torch.randn(1024, 1024)
    best = float("inf")
    for _ in range(8):
        start = time.perf_counter()
        torch.mm(x, x)
        best = min(best, time.perf_counter() - start)
    return float(2 * 1024**3 / best / 1e9)


def _forget() -> None:
    library.load.cache_clear()
    library.function.cache_clear()


def _bodies(number: int) -> list[Description]:
    names = {1: ("quadruped",), 4: WALKERS, 12: CHEETAHS}.get(number)
    return [load(name) for name in names] if names else [member.description for member in members(load_benchmark())]


if __name__ == "__main__":
    main()
