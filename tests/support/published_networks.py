"""Our networks with the weights of the published programs compared with the same networks written plainly."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import nn

from morphkit_rl.models import load_published

Arrays = dict[str, np.ndarray]


def weights_of(actor: nn.Module, critic: nn.Module) -> Arrays:
    nets = {"actor": actor, "critic": critic}
    return {f"weights/{n}/{k}": v.numpy() for n, net in nets.items() for k, v in net.state_dict().items()}


def random_parents(rng: np.random.Generator, limbs: int, children: int) -> list[int]:
    """A random tree in depth-first order, and with the order shuffled every other time."""
    parents = [-1]
    while len(parents) < limbs:
        free = [limb for limb in range(len(parents)) if parents.count(limb) < children]
        parents.append(int(rng.choice(free)))
    if rng.random() < 0.5:
        order = rng.permutation(limbs).tolist()
        parents = [order.index(parents[limb]) if parents[limb] >= 0 else -1 for limb in order]
    return parents


def assert_same_networks(
    method: str, actor: Any, critic: Any, parents: list[int], scalars: int, heads: int = 2
) -> None:
    """Outputs and gradients of ours with the plain networks' weights are theirs."""
    limbs = [f"limb{number}" for number in range(len(parents))]
    ours = load_published(method, weights_of(actor, critic), limbs, parents, num_heads=heads)
    batch = int(torch.randint(1, 9, ()))
    obs, action = torch.randn(batch, len(parents) * scalars), torch.rand(batch, len(parents)) * 2 - 1
    weight = torch.randn(batch, 1)
    results = []
    for policy, value in ((actor, critic), ours):
        acts, (q1, q2) = policy(obs), value(obs, action)
        ((acts + policy(obs) ** 2) * weight).sum().backward()
        ((q1 + 2 * q2) * weight).sum().backward()
        norms = [
            torch.stack([p.grad.norm() for p in net.parameters() if p.grad is not None]).norm()
            for net in (policy, value)
        ]
        results.append((acts, q1, q2, *norms))
    for theirs, our in zip(*results, strict=True):
        torch.testing.assert_close(our, theirs, atol=1e-5, rtol=1e-4)
