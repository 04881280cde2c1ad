"""How close the tip of an arm is to random targets some seconds after each was given, held still and with a policy.

python tools/reaching.py ROBOT --run RUN [--targets 100] [--seconds 4] [--seed 1]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from morphkit.registry import load
from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare

CLOSE_M = 0.05


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", help="a shipped robot or a file")
    parser.add_argument("--run", type=Path, required=True, help="a run on the task reach")
    parser.add_argument("--targets", type=int, default=100, help="number of random targets")
    parser.add_argument("--seconds", type=float, default=4.0, help="time for each")
    parser.add_argument("--seed", type=int, default=1, help="seed of targets and start states")
    options = parser.parse_args()
    policy = Policy.load(options.run)
    settings = policy.config.trainer
    robot = prepare(
        load(options.robot), task="reach", sensors=settings.sensors, actuation=settings.actuation, drawn=False
    )
    task = replace(robot.task, episode_length=10**9, reach_seconds=0.0)
    still = ActionScale(robot.spec).to_controls(np.zeros((options.targets, len(robot.spec.actuators))))
    for name in ("still", "policy"):
        env = BatchEnv([robot.simulation], [task], options.targets, specs=[robot.spec], seed=options.seed)
        obs = env.reset()[0]
        before = _distances(env)
        for _ in range(round(options.seconds / (task.frame_skip or 1) / robot.simulation.model.opt.timestep)):
            obs = env.step([still if name == "still" else policy.act(robot.spec, obs)]).obs[0]
        after = _distances(env)
        env.close()
        close, middle, most = (after < CLOSE_M).sum(), np.median(after), after.max()
        reached = f"{close} of {len(after)} within {CLOSE_M:g} m; distance {middle:.3f} m, at most {most:.3f} m"
        print(f"{name}: {reached}; at the start {np.median(before):.3f} m (medians)")


def _distances(env: BatchEnv) -> np.ndarray:
    """Of the tips from their targets, m."""
    return np.linalg.norm(env._tasks._parts[0].arrays.to_target, axis=1)


if __name__ == "__main__":
    main()
