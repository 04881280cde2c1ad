"""Memory of a replay of 10 million transitions over all 32 bodies of the benchmark, and what half precision costs.

Printed for each number format: bytes of all arrays, and of a replay that stores next observations too; memory
that the process takes for the empty replay and for what a random policy filled of it; bytes of final observations if
the whole replay were filled so; and the largest and mean errors of stored observations, in the tokens' own units.

    python tools/replay_memory.py [--capacity 10000000] [--sweeps 1500] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.registry import load, recipes
from morphkit.simulation.build import build_simulation
from morphkit_rl.buffers.replay_buffer import FIELDS, ReplayBuffer, ReplayDtype
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.tasks import task_for
from morphkit_rl.evaluation.episodes import random_controller

ROBOTS = tuple(name for family in ("cheetah", "walker", "humanoid_2d", "hopper") for name in recipes(family))
ENVS = 8
LIMIT_GIB = 8.0
GIB = 2**30


def resident() -> int:
    """Bytes of memory that this process takes."""
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def fill(env: BatchEnv, buffers: list[ReplayBuffer], sweeps: int) -> dict[str, list[float]]:
    """Fill with a random policy; the absolute errors of the stored observations by quantity: largest, mean, |value|."""
    act, obs = random_controller(env, 0), env.reset()
    errors: dict[str, list[np.ndarray]] = {}
    for sweep in range(sweeps):
        step = env.step(act(obs))
        for robot, buffer in enumerate(buffers):
            start = (buffer.added % buffer.sweeps) * ENVS
            buffer.add(
                obs=obs[robot],
                action=np.zeros((ENVS, buffer.action.shape[1])),
                reward=step.reward[robot],
                next_obs=step.final_obs[robot],
                terminated=step.terminated[robot],
                ended=step.terminated[robot] | step.truncated[robot],
            )
            if sweep % 50 == 0:
                error = np.abs(buffer.obs[start : start + ENVS].astype(np.float64) - obs[robot])
                for sensor in env.specs[robot].sensors:
                    column = np.stack([error[:, sensor.index], np.abs(obs[robot][:, sensor.index])])
                    errors.setdefault(sensor.quantity, []).append(column)
        obs = step.obs
    whole = {quantity: np.concatenate(parts, axis=1) for quantity, parts in errors.items()}
    return {q: [float(both[0].max()), float(both[0].mean()), float(both[1].mean())] for q, both in whole.items()}


def measure(dtype: ReplayDtype, capacity: int, sweeps: int) -> dict[str, Any]:
    """One number format."""
    simulations = [build_simulation(load(name)) for name in ROBOTS]
    env = BatchEnv(simulations, [task_for(simulation) for simulation in simulations], ENVS)
    env.step([np.zeros((ENVS, len(spec.actuators))) for spec in env.specs])
    before = resident()
    # One action a limb, as the published methods store them: the widest case.
    buffers = [
        ReplayBuffer(len(spec.sensors), len(spec.limbs), ENVS, capacity // len(ROBOTS), dtype) for spec in env.specs
    ]
    empty = resident() - before
    errors = fill(env, buffers, sweeps)
    filled = resident() - before
    env.close()
    arrays = sum(getattr(buffer, name).nbytes for buffer in buffers for name in FIELDS)
    share = sum(map(len, buffers)) / capacity
    finals = sum(buffer.finals.obs.nbytes + buffer.finals.numbers.nbytes for buffer in buffers) / share
    return {
        "dtype": dtype,
        "transitions": sum(buffer.sweeps * ENVS for buffer in buffers),
        "arrays_gib": arrays / GIB,
        "final_observations_gib": finals / GIB,
        "whole_gib": (arrays + finals) / GIB,
        "stored_twice_gib": (arrays + sum(buffer.obs.nbytes for buffer in buffers)) / GIB,
        "filled_share": share,
        "resident_empty_gib": empty / GIB,
        "resident_filled_gib": filled / GIB,
        "errors": errors,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--capacity", type=int, default=10_000_000)
    parser.add_argument("--sweeps", type=int, default=1500, help="steps of every environment that are stored")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = [measure(dtype, options.capacity, options.sweeps) for dtype in ("float32", "float16")]
    if options.json:
        print(json.dumps(found, indent=2))
    else:
        for result in found:
            report(result)
    if found[0]["whole_gib"] > LIMIT_GIB:
        sys.exit(f"the float32 replay takes more than {LIMIT_GIB:g} GiB")


def report(result: dict[str, Any]) -> None:
    print(f"{result['dtype']}, {result['transitions']:,} transitions of {len(ROBOTS)} bodies")
    print(f"  arrays                 {result['arrays_gib']:6.2f} GiB")
    print(f"  final observations     {result['final_observations_gib']:6.2f} GiB where a random policy fills all of it")
    print(f"  both                   {result['whole_gib']:6.2f} GiB (limit {LIMIT_GIB:g})")
    print(f"  next_obs stored too    {result['stored_twice_gib']:6.2f} GiB")
    print(f"  resident, empty        {result['resident_empty_gib']:6.2f} GiB")
    print(f"  resident, {result['filled_share']:5.1%} filled {result['resident_filled_gib']:6.2f} GiB")
    print("  error of stored observations   largest       mean   mean |value|")
    for quantity, (largest, mean, size) in result["errors"].items():
        print(f"    {quantity:<26} {largest:9.2e}  {mean:9.2e}   {size:9.2e}")


if __name__ == "__main__":
    main()
