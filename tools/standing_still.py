"""What standing still and random actions earn of the most that a task pays, robot by robot.

Standing still: every control is in the middle of its range; for servos that is the start pose.

    python tools/standing_still.py [ROBOT ...] [--task walk] [--base free] [--episodes 16] [--steps 1000]
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from morphkit.registry import load
from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare
from morphkit_rl.evaluation.episodes import play, random_controller


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=["quadruped"], help="shipped robots or files")
    parser.add_argument("--task", default="walk", help="a task with terms, or its TOML file")
    parser.add_argument("--base", choices=("free", "planar", "fixed"), help="how the root is attached to the world")
    parser.add_argument("--episodes", type=int, default=16, help="episodes of each")
    parser.add_argument("--steps", type=int, help="control steps of an episode; default: the task's")
    options = parser.parse_args()
    columns = f"{'robot':24s} {'most':>8s} {'still':>8s} {'steps':>6s} {'random':>8s} {'steps':>6s}"
    print(f"{columns}  stiffness, damping of servos")
    for name in options.robots:
        robot = prepare(load(name), task=options.task, base=options.base, drawn=False)
        task = replace(robot.task, episode_length=options.steps or robot.task.episode_length)
        env = BatchEnv([robot.simulation], [task], options.episodes, specs=[robot.spec], seed=0)
        still = ActionScale(robot.spec).to_controls(np.zeros((options.episodes, len(robot.spec.actuators))))
        shares = []
        for controller in (lambda _, still=still: [still], random_controller(env, 0)):
            played, most = play(env, controller), task.most * task.episode_length
            shares += [f"{played.returns[0].mean() / most:8.3f}", f"{played.lengths[0].mean():6.0f}"]
        env.close()
        gains = dict.fromkeys((round(k, 1), round(d, 1)) for k, d in robot.simulation.gains.values())
        print(f"{robot.name:24s} {most:8.0f} {' '.join(shares)}  {', '.join(f'{k:g} {d:g}' for k, d in gains)}")


if __name__ == "__main__":
    main()
