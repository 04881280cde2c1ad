"""TD3 and SAC in one file, in the pattern of CleanRL's td3_continuous_action and sac_continuous_action.

    python examples/cleanrl_continuous_action.py --algorithm sac --env morphkit/hopper_3-v0 --steps 100000

Nothing here knows morphkit but the import that registers its ids: the environments are Gymnasium's.
"""

from __future__ import annotations

import argparse
import copy
from collections.abc import Callable
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from torch import Tensor, nn
from torch.nn import functional as F

import morphkit_rl  # noqa: F401  # registers morphkit/<robot>-v0

DISCOUNT, TAU, LEARNING_RATE, BATCH = 0.99, 0.005, 3e-4, 256
POLICY_DELAY, EXPLORATION, TARGET_NOISE, NOISE_CLIP = 2, 0.1, 0.2, 0.5
LOG_STD = (-5.0, 2.0)


class Batch(NamedTuple):
    """Transitions; `ended` is 1 where the episode terminated, not where time ended it."""

    obs: Tensor
    action: Tensor
    reward: Tensor
    next_obs: Tensor
    ended: Tensor


class Replay:
    """A ring of transitions."""

    def __init__(self, capacity: int, obs_size: int, action_size: int):
        sizes = (obs_size, action_size, 1, obs_size, 1)
        self.columns = [np.zeros((capacity, size), np.float32) for size in sizes]
        self.added = 0

    def add(self, *rows: np.ndarray) -> None:
        number = len(rows[0])
        places = np.arange(self.added, self.added + number) % len(self.columns[0])
        for column, row in zip(self.columns, rows, strict=True):
            column[places] = np.reshape(row, (number, -1))
        self.added += number

    def sample(self, rng: np.random.Generator) -> Batch:
        places = rng.integers(min(self.added, len(self.columns[0])), size=BATCH)
        return Batch(*(torch.from_numpy(column[places]) for column in self.columns))


def perceptron(inputs: int, outputs: int, width: int) -> nn.Sequential:
    return nn.Sequential(
        *(nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(), nn.Linear(width, outputs))
    )


class Critics(nn.Module):
    """Two Q functions."""

    def __init__(self, obs_size: int, action_size: int, width: int):
        super().__init__()
        self.both = nn.ModuleList(perceptron(obs_size + action_size, 1, width) for _ in range(2))

    def forward(self, obs: Tensor, action: Tensor) -> list[Tensor]:
        return [critic(torch.cat([obs, action], -1)) for critic in self.both]


class TD3:
    """Fujimoto et al. 2018."""

    def __init__(self, obs_size: int, action_size: int, width: int):
        self.actor = nn.Sequential(perceptron(obs_size, action_size, width), nn.Tanh())
        self.critics = Critics(obs_size, action_size, width)
        self.targets = copy.deepcopy(nn.ModuleList([self.actor, self.critics]))
        self.actor_optimizer = torch.optim.Adam(self.actor.parameters(), LEARNING_RATE)
        self.critic_optimizer = torch.optim.Adam(self.critics.parameters(), LEARNING_RATE)
        self.updates = 0

    def act(self, obs: Tensor) -> Tensor:
        action = self.actor(obs)
        return (action + EXPLORATION * torch.randn_like(action)).clamp(-1, 1)

    def update(self, batch: Batch) -> None:
        target_actor, target_critics = self.targets
        with torch.no_grad():
            action = target_actor(batch.next_obs)
            noise = (TARGET_NOISE * torch.randn_like(action)).clamp(-NOISE_CLIP, NOISE_CLIP)
            value = torch.minimum(*target_critics(batch.next_obs, (action + noise).clamp(-1, 1)))
            target = batch.reward + DISCOUNT * (1 - batch.ended) * value
        step(self.critic_optimizer, sum(F.mse_loss(q, target) for q in self.critics(batch.obs, batch.action)))
        self.updates += 1
        if self.updates % POLICY_DELAY == 0:
            step(self.actor_optimizer, -self.critics(batch.obs, self.actor(batch.obs))[0].mean())
            follow(self.targets, nn.ModuleList([self.actor, self.critics]))


class SAC:
    """Haarnoja et al. 2018, with a learned temperature."""

    def __init__(self, obs_size: int, action_size: int, width: int):
        self.actor = perceptron(obs_size, 2 * action_size, width)
        self.critics = Critics(obs_size, action_size, width)
        self.targets = copy.deepcopy(self.critics)
        self.log_alpha = torch.zeros(1, requires_grad=True)
        self.entropy = -float(action_size)
        self.actor_optimizer = torch.optim.Adam(self.actor.parameters(), LEARNING_RATE)
        self.critic_optimizer = torch.optim.Adam(self.critics.parameters(), LEARNING_RATE)
        self.alpha_optimizer = torch.optim.Adam([self.log_alpha], LEARNING_RATE)

    def act(self, obs: Tensor) -> Tensor:
        return self.draw(obs)[0]

    def draw(self, obs: Tensor) -> tuple[Tensor, Tensor]:
        """An action in [-1, 1] and the logarithm of its density."""
        mean, log_std = self.actor(obs).chunk(2, -1)
        low, high = LOG_STD
        normal = torch.distributions.Normal(mean, (low + (high - low) * (log_std.tanh() + 1) / 2).exp())
        raw = normal.rsample()
        action = raw.tanh()
        return action, (normal.log_prob(raw) - (1 - action.square() + 1e-6).log()).sum(-1, keepdim=True)

    def update(self, batch: Batch) -> None:
        alpha = self.log_alpha.exp().detach()
        with torch.no_grad():
            action, density = self.draw(batch.next_obs)
            value = torch.minimum(*self.targets(batch.next_obs, action)) - alpha * density
            target = batch.reward + DISCOUNT * (1 - batch.ended) * value
        step(self.critic_optimizer, sum(F.mse_loss(q, target) for q in self.critics(batch.obs, batch.action)))
        action, density = self.draw(batch.obs)
        step(self.actor_optimizer, (alpha * density - torch.minimum(*self.critics(batch.obs, action))).mean())
        step(self.alpha_optimizer, -(self.log_alpha.exp() * (density.detach() + self.entropy)).mean())
        follow(self.targets, self.critics)


def step(optimizer: torch.optim.Optimizer, loss: Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


@torch.no_grad()
def follow(targets: nn.Module, networks: nn.Module) -> None:
    for target, own in zip(targets.parameters(), networks.parameters(), strict=True):
        target.lerp_(own, TAU)


def make_env(env_id: str, seed: int) -> Callable[[], gym.Env]:
    def thunk() -> gym.Env:
        env = gym.wrappers.RecordEpisodeStatistics(gym.make(env_id))
        env.action_space.seed(seed)
        return env

    return thunk


def train(
    algorithm: str, env_id: str, *, steps: int, warm_up: int = 5000, width: int = 256, seed: int = 0
) -> list[float]:
    """Learn for so many steps; the returns of all episodes, in order."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    envs = SyncVectorEnv([make_env(env_id, seed)], autoreset_mode=AutoresetMode.SAME_STEP)
    obs_size, action_size = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
    low, high = envs.single_action_space.low, envs.single_action_space.high
    agent = {"td3": TD3, "sac": SAC}[algorithm](obs_size, action_size, width)
    replay = Replay(min(steps, 1_000_000), obs_size, action_size)
    returns: list[float] = []
    obs, _ = envs.reset(seed=seed)
    for number in range(steps):
        if number < warm_up:
            action = rng.uniform(-1, 1, (envs.num_envs, action_size)).astype(np.float32)
        else:
            with torch.no_grad():
                action = agent.act(torch.from_numpy(obs)).numpy()
        next_obs, reward, terminated, truncated, infos = envs.step(low + (high - low) * (action + 1) / 2)
        led_to = next_obs.copy()
        for env in np.flatnonzero(terminated | truncated):
            led_to[env] = infos["final_obs"][env]
            returns.append(float(infos["final_info"]["episode"]["r"][env]))
            print(f"step {number + 1}: return {returns[-1]:.1f}", flush=True)
        replay.add(obs, action, reward, led_to, terminated)
        obs = next_obs
        if number >= warm_up:
            agent.update(replay.sample(rng))
    envs.close()
    return returns


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--algorithm", choices=("td3", "sac"), default="td3")
    parser.add_argument("--env", default="morphkit/hopper_3-v0")
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    train(options.algorithm, options.env, steps=options.steps, seed=options.seed)


if __name__ == "__main__":
    main()
