"""Stable-Baselines3 on any robot.

pip install "morphkit[rl,peers]"
python examples/stable_baselines.py --env morphkit/hopper_3-v0 --steps 100000
"""

from __future__ import annotations

import argparse

import gymnasium as gym
from stable_baselines3 import SAC
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor

import morphkit_rl  # noqa: F401  # registers morphkit/<robot>-v0


def train(env_id: str, *, steps: int, seed: int = 0, **settings: object) -> tuple[SAC, float]:
    """Learn for so many steps; the model and its mean noise-free return over three episodes."""
    env = Monitor(gym.make(env_id))
    model = SAC("MlpPolicy", env, seed=seed, **settings).learn(steps)
    mean, _ = evaluate_policy(model, env, n_eval_episodes=3)
    env.close()
    return model, float(mean)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env", default="morphkit/hopper_3-v0")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    _, mean = train(options.env, steps=options.steps, seed=options.seed, verbose=1)
    print(f"mean return over 3 episodes: {mean:.1f}")


if __name__ == "__main__":
    main()
