"""Physics substeps per second of the batched environments, measured against other simulators in the same run.

Observations, rewards and resets are included. Two sets of bodies, 8 environments each:

- `cheetahs`, 12 cheetah bodies, against Gymnasium's AsyncVectorEnv with 12 HalfCheetah-v5, and against bare
  `mujoco.rollout`: the same models, start states and controls, 100 control steps a call, nothing else computed;
- `mixed`, all 32 bodies of the benchmark in one batch, against AsyncVectorEnv with 12 Walker2d-v5.

The programs of a set are measured in turns, so that a change of the machine's load hits all of them; medians are
printed. A Runge-Kutta step counts as one substep, here and there.

    python tools/env_speed.py [--repeats 5] [--set cheetahs|mixed] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium
import mujoco
import numpy as np
from mujoco.rollout import Rollout

from morphkit.registry import load, recipes
from morphkit.simulation.build import Simulation, build_simulation, compile_plain
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.tasks import task_for

CHEETAHS = (
    *("cheetah_2_back", "cheetah_2_front", "cheetah_3_back", "cheetah_3_front", "cheetah_4_allback"),
    *("cheetah_4_allfront", "cheetah_4_back", "cheetah_4_front", "cheetah_5_balanced", "cheetah_5_front"),
    *("cheetah_6_back", "cheetah_7_full"),
)
ALL = tuple(name for robot in ("cheetah", "walker", "humanoid_2d", "hopper") for name in recipes(robot))
ENVS = 8
STEPS = 100
GYM_ENVS = 12


@dataclass(frozen=True)
class Bodies:
    """A set of bodies and what it is compared with; `goals` are ratios morphkit / other program."""

    names: tuple[str, ...]
    gym_id: str
    gym_frame_skip: int
    goals: dict[str, float]


SETS = {
    "cheetahs": Bodies(CHEETAHS, "HalfCheetah-v5", 5, {"gymnasium": 6.0, "rollout": 0.5}),
    "mixed": Bodies(ALL, "Walker2d-v5", 4, {"gymnasium": 5.0}),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="turns of which the median is taken")
    parser.add_argument("--set", choices=SETS, action="append", help="measure this set only")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    rates = {name: _measure(SETS[name], arguments.repeats) for name in arguments.set or SETS}
    if arguments.json:
        results = {name: {"substeps_per_s": rate, "ratios": _ratios(SETS[name], rate)} for name, rate in rates.items()}
        print(json.dumps({**results, "cores": len(os.sched_getaffinity(0))}))
        return
    print(f"physics substeps/s on {len(os.sched_getaffinity(0))} cores")
    for name, rate in rates.items():
        _print(SETS[name], rate)


def _measure(bodies: Bodies, repeats: int) -> dict[str, float]:
    """Median substeps/s of every program."""
    simulations = [build_simulation(load(name)) for name in bodies.names]
    rng = np.random.default_rng(0)
    controls = [rng.uniform(-1, 1, (STEPS, ENVS, simulation.model.nu)) for simulation in simulations]
    programs: dict[str, Callable[[], float]] = {"morphkit": _batch(simulations, controls)}
    if "rollout" in bodies.goals:
        programs["rollout"] = _bare(simulations, controls)
    programs["gymnasium"], close = _gymnasium(bodies)
    rates: dict[str, list[float]] = {name: [] for name in programs}
    for turn in range(repeats + 1):
        for name, program in programs.items():
            start = time.perf_counter()
            substeps = program()
            if turn:  # the first turn warms up
                rates[name].append(substeps / (time.perf_counter() - start))
    close()
    return {name: statistics.median(rate) for name, rate in rates.items()}


def _batch(simulations: list[Simulation], controls: list[np.ndarray]) -> Callable[[], float]:
    tasks = [task_for(simulation) for simulation in simulations]
    env = BatchEnv(simulations, tasks, ENVS)
    env.reset()

    def run() -> float:
        for step in range(STEPS):
            env.step([control[step] for control in controls])
        return STEPS * ENVS * sum(task.frame_skip or 1 for task in tasks)

    return run


def _bare(simulations: list[Simulation], controls: list[np.ndarray]) -> Callable[[], float]:
    threads = len(os.sched_getaffinity(0))
    pool = Rollout(nthread=threads)
    skips = [task_for(simulation).frame_skip or 1 for simulation in simulations]
    models = [compile_plain(simulation.description) for simulation in simulations]
    data = [[mujoco.MjData(model) for _ in range(threads)] for model in models]
    starts = []
    for model in models:
        start = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, mujoco.MjData(model), start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        starts.append(np.tile(start, (ENVS, 1)))
    ctrls = [np.repeat(c.swapaxes(0, 1), skip, axis=1) for c, skip in zip(controls, skips, strict=True)]

    def run() -> float:
        for model, buffers, start, ctrl in zip(models, data, starts, ctrls, strict=True):
            pool.rollout(model, buffers, start, ctrl)
        return STEPS * ENVS * sum(skips)

    return run


def _gymnasium(bodies: Bodies) -> tuple[Callable[[], float], Callable[[], None]]:
    """What steps Gymnasium's environments, and what ends their processes."""
    # HalfCheetah's file uses a deprecated attribute: keep twelve processes from warning and from writing a log here.
    mujoco.set_mju_user_warning(lambda _: None)
    env = gymnasium.make_vec(bodies.gym_id, num_envs=GYM_ENVS, vectorization_mode="async")
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (STEPS, *(env.action_space.shape or ()))).astype(np.float32)

    def run() -> float:
        for action in actions:
            env.step(action)
        return STEPS * GYM_ENVS * bodies.gym_frame_skip

    return run, env.close


def _ratios(bodies: Bodies, rates: dict[str, float]) -> dict[str, float]:
    return {name: rates["morphkit"] / rates[name] for name in bodies.goals}


def _print(bodies: Bodies, rates: dict[str, float]) -> None:
    titles = {
        "morphkit": f"morphkit, {len(bodies.names)} bodies x {ENVS}, obs and reward included",
        "rollout": "bare mujoco.rollout of the same",
        "gymnasium": f"gymnasium AsyncVectorEnv, {GYM_ENVS} {bodies.gym_id}",
    }
    for name, rate in rates.items():
        print(f"  {titles[name]:56s} {rate:10,.0f}")
    for name, ratio in _ratios(bodies, rates).items():
        print(f"  morphkit / {name:45s} {ratio:10.2f}   (goal: at least {bodies.goals[name]:g})")


if __name__ == "__main__":
    main()
