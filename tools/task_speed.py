"""Environment steps per second of the quadruped on the task `walk`, with and without terms, in the same run.

- `walk`: position actuation, rewards of all terms, and observations: of all limbs, and `proprioceptive`;
- `without terms`: the same start, ends and observations of limbs, no terms, commands or previous action;
- `rollout`: bare `mujoco.rollout` of the same model from the same states with the same controls, a control step a call.

The programs are measured in turns, so that a change of the machine's load hits all of them; medians are printed.

    python tools/task_speed.py [--envs 64] [--steps 50] [--repeats 5] [--threads 1] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from morphkit.registry import load
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot, prepare

Program = Callable[[], None]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--envs", type=int, default=64, help="environments")
    parser.add_argument("--steps", type=int, default=50, help="control steps a turn")
    parser.add_argument("--repeats", type=int, default=5, help="turns of which the median is taken")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="threads that step")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    whole, few = prepare(load("quadruped")), prepare(load("quadruped"), sensors=["proprioceptive"])
    plain = replace(whole.task, terms=(), commands=None)
    bare = replace(whole, task=plain, spec=whole.simulation.tokens)
    controls = np.random.default_rng(0).uniform(-0.2, 0.2, (options.steps, options.envs, whole.simulation.model.nu))
    programs = {
        "walk": _stepping(whole, controls, options.threads),
        "walk, proprioceptive": _stepping(few, controls, options.threads),
        "without terms": _stepping(bare, controls, options.threads),
        "rollout": _rolling(whole, controls, options.threads),
    }
    rates: dict[str, list[float]] = {name: [] for name in programs}
    for turn in range(options.repeats + 1):
        for name, program in programs.items():
            start = time.perf_counter()
            program()
            if turn:  # the first turn warms up
                rates[name].append(options.steps * options.envs / (time.perf_counter() - start))
    medians = {name: statistics.median(values) for name, values in rates.items()}
    if options.json:
        print(json.dumps({"steps_per_s": medians, "envs": options.envs, "threads": options.threads}))
        return
    print(f"environment steps/s, {options.envs} environments, {options.threads} threads")
    for name, rate in medians.items():
        print(f"  {name:24s} {rate:10,.0f}   {rate / medians['rollout']:6.2f} of bare rollout")


def _stepping(robot: Robot, controls: np.ndarray, threads: int) -> Program:
    env = BatchEnv([robot.simulation], [robot.task], controls.shape[1], specs=[robot.spec], num_threads=threads)

    def run() -> None:
        env.seed(0)
        env.reset()
        for control in controls:
            env.step([control])

    return run


def _rolling(robot: Robot, controls: np.ndarray, threads: int) -> Program:
    """The same physics and nothing else."""
    env = BatchEnv([robot.simulation], [robot.task], controls.shape[1], specs=[robot.spec], seed=0)
    env.reset()
    starts = env.state_dict()["state"].reshape(controls.shape[1], -1)
    model, skip = robot.simulation.model, robot.task.frame_skip or 1
    pool = Rollout(nthread=threads if threads > 1 else 0)
    data = [mujoco.MjData(model) for _ in range(max(threads, 1))]
    held = [np.ascontiguousarray(np.repeat(control[:, None], skip, axis=1)) for control in controls]

    def run() -> None:
        state = starts
        for control in held:
            states, _ = pool.rollout(model, data, state, control)
            state = np.ascontiguousarray(states[:, -1])

    return run


if __name__ == "__main__":
    main()
