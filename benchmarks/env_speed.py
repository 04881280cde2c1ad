"""Physics substeps per second of the batched environments, measured against two yardsticks in one run.

12 cheetah bodies with 8 environments each, observations, rewards and resets included, against

- Gymnasium's AsyncVectorEnv with 12 HalfCheetah-v5, and
- bare `mujoco.rollout`: the same models, start states and controls, 100 control steps a call, nothing else computed.

The three are measured in turns, so that a change of the machine's load hits all of them; medians are printed.

    python benchmarks/env_speed.py [--repeats 5] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections.abc import Callable

import gymnasium
import mujoco
import numpy as np
from mujoco.rollout import Rollout

from morphkit.robots import load
from morphkit.simulation import Simulation, build, compile_plain
from morphkit_rl.envs.batch import BatchEnv
from morphkit_rl.envs.tasks import task_for

BODIES = (
    *("cheetah_2_back", "cheetah_2_front", "cheetah_3_back", "cheetah_3_front", "cheetah_4_allback"),
    *("cheetah_4_allfront", "cheetah_4_back", "cheetah_4_front", "cheetah_5_balanced", "cheetah_5_front"),
    *("cheetah_6_back", "cheetah_7_full"),
)
ENVS = 8
STEPS = 100
GYM_ENVS, GYM_FRAME_SKIP = 12, 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="turns of which the median is taken")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    simulations = [build(load(name)) for name in BODIES]
    rng = np.random.default_rng(0)
    controls = [rng.uniform(-1, 1, (STEPS, ENVS, simulation.model.nu)) for simulation in simulations]
    programs: dict[str, Callable[[], float]] = {
        "morphkit": _batch(simulations, controls),
        "rollout": _bare(simulations, controls),
        "gymnasium": _gymnasium(),
    }
    rates: dict[str, list[float]] = {name: [] for name in programs}
    for turn in range(arguments.repeats + 1):
        for name, program in programs.items():
            start = time.perf_counter()
            substeps = program()
            if turn:  # the first turn warms up
                rates[name].append(substeps / (time.perf_counter() - start))
    _report({name: statistics.median(rate) for name, rate in rates.items()}, as_json=arguments.json)


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


def _gymnasium() -> Callable[[], float]:
    # HalfCheetah's file uses a deprecated attribute: keep twelve processes from warning and from writing a log here.
    mujoco.set_mju_user_warning(lambda _: None)
    env = gymnasium.make_vec("HalfCheetah-v5", num_envs=GYM_ENVS, vectorization_mode="async")
    env.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (STEPS, *(env.action_space.shape or ()))).astype(np.float32)

    def run() -> float:
        for action in actions:
            env.step(action)
        return STEPS * GYM_ENVS * GYM_FRAME_SKIP

    return run


def _report(rates: dict[str, float], *, as_json: bool) -> None:
    ratios = {name: rates["morphkit"] / rates[name] for name in ("gymnasium", "rollout")}
    if as_json:
        print(json.dumps({"substeps_per_s": rates, "ratios": ratios, "cores": len(os.sched_getaffinity(0))}))
        return
    print(f"physics substeps/s on {len(os.sched_getaffinity(0))} cores")
    print(f"  morphkit, {len(BODIES)} cheetah bodies x {ENVS}, obs and reward included {rates['morphkit']:10,.0f}")
    print(f"  bare mujoco.rollout of the same                          {rates['rollout']:10,.0f}")
    print(f"  gymnasium AsyncVectorEnv, {GYM_ENVS} HalfCheetah-v5              {rates['gymnasium']:10,.0f}")
    print(f"morphkit / gymnasium    {ratios['gymnasium']:6.2f}   (goal: at least 6)")
    print(f"morphkit / bare rollout {ratios['rollout']:6.2f}   (goal: at least 0.5)")


if __name__ == "__main__":
    main()
