"""What standing still, random actions and a trained policy earn of the most that a task pays, robot by robot.

Standing still: every control is in the middle of its range; for servos that is the start pose. With --run, its
policy is measured, too, and its speed along world x, in which it starts to head, beside the speed that it is told.

    python tools/standing_still.py [ROBOT ...] [--task walk] [--base free] [--episodes 16] [--steps 1000] [--run RUN]
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
from morphkit_rl.envs.robot import Robot, prepare
from morphkit_rl.evaluation.episodes import play, random_controller


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robots", nargs="*", default=["quadruped"], help="shipped robots or files")
    parser.add_argument("--task", default="walk", help="a task with terms, or its TOML file")
    parser.add_argument("--base", choices=("free", "planar", "fixed"), help="how the root is attached to the world")
    parser.add_argument("--episodes", type=int, default=16, help="episodes of each")
    parser.add_argument("--steps", type=int, help="control steps of an episode; default: the task's")
    parser.add_argument("--run", type=Path, help="a run, whose policy is measured, too")
    options = parser.parse_args()
    policy = Policy.load(options.run) if options.run else None
    columns = f"{'robot':24s} {'most':>8s} {'still':>8s} {'steps':>6s} {'random':>8s} {'steps':>6s}"
    print(f"{columns}  stiffness, damping of servos")
    for name in options.robots:
        if policy is None:
            robot = prepare(load(name), task=options.task, base=options.base, drawn=False)
        else:
            (robot,) = policy.prepare([load(name)], task=options.task, base=options.base)
        task = replace(robot.task, episode_length=options.steps or robot.task.episode_length)
        env = BatchEnv([robot.simulation], [task], options.episodes, specs=[robot.spec], seed=0)
        still = ActionScale(robot.spec).to_controls(np.zeros((options.episodes, len(robot.spec.actuators))))
        shares = []
        for controller in (lambda _, still=still: [still], random_controller(env, 0)):
            played, most = play(env, controller), task.most * task.episode_length
            shares += [f"{played.returns[0].mean() / most:8.3f}", f"{played.lengths[0].mean():6.0f}"]
        if policy is not None:
            print(f"{robot.name:24s} policy: {_walk(env, robot, policy)}")
        env.close()
        gains = dict.fromkeys((round(k, 1), round(d, 1)) for k, d in robot.simulation.gains.values())
        print(f"{robot.name:24s} {most:8.0f} {' '.join(shares)}  {', '.join(f'{k:g} {d:g}' for k, d in gains)}")


def _walk(env: BatchEnv, robot: Robot, policy: Policy) -> str:
    """Share of the most, control steps and speed of the first episode of each environment."""
    obs, n = env.reset()[0], env.num_envs[0]
    told = obs[:, [(t.quantity, t.component) == ("command", "x") for t in robot.spec.sensors]].mean()
    going, returns, lengths, way = np.ones(n, bool), np.zeros(n), np.zeros(n), np.zeros(n)
    task, dt = env.tasks[0], (env.tasks[0].frame_skip or 1) * robot.simulation.model.opt.timestep
    while going.any():
        step = env.step([policy.act(robot.spec, obs)])
        returns, lengths = returns + step.reward[0] * going, lengths + going
        way += env.reward_terms(0)["x_velocity"] * dt * going
        going &= ~(step.terminated[0] | step.truncated[0])
        obs = step.obs[0]
    share, whole = returns.mean() / (task.most * task.episode_length), int((lengths == task.episode_length).sum())
    speed = way.sum() / lengths.sum() / dt
    return (
        f"{share:.3f}, {lengths.mean():.0f} steps, {whole} of {n} to the end, {speed:.2f} m/s where told {told:.2f} m/s"
    )


if __name__ == "__main__":
    main()
