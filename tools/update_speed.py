"""Time of a TD3 update of the published methods, compared with the same methods written plainly in float32.

Seven limbs of 19 scalars, batch 100, the sizes of the paper presets; same weights, same batches, one process. The
yardsticks are in published_baselines.py. Ours and theirs take turns; medians over turns are printed, with the ratio.
Each precision is followed by the relative error of the actions and of all parameters' gradients (critics', actor's)
against float64, and the most memory that an update held at once. Embeddings of MA-BERT are random numbers of BERT's
size, which changes no time.

    python tools/update_speed.py [--methods ma-bert anymorph amorpheus smp] [--precisions float32 bfloat16]
        [--turns 7] [--updates 4] [--batch 100] [--threads N] [--device cpu] [--growth UPDATES] [--json]

--growth does so many updates at toy size instead, and prints by how much memory and Python objects grew.
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import json
import os
import resource
import statistics
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np
import published_baselines as plain
import torch
from torch import Tensor, nn

from morphkit_rl.algorithms.td3 import TD3, resolve_precision
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.methods import ModelSettings, find_method
from morphkit_rl.config.train_config import TD3Config
from morphkit_rl.models import load_published
from morphkit_rl.models.blocks import set_precision
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.vocabulary import Vocabulary

LIMBS = ("torso", "bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot")
PARENTS = (-1, 0, 1, 2, 0, 4, 5)
SCALARS = 19
PAPER = {
    "d_model": 128, "layers": 3, "heads": 2, "feedforward": 256, "code_size": 96, "token_size": 32, "message_size": 32,
}  # fmt: skip
TOY = {"d_model": 16, "layers": 1, "heads": 1, "feedforward": 16, "code_size": 4, "token_size": 4, "message_size": 4}
EMBEDDING = {"ma-bert": 768, "anymorph": 32}
RATE = {"ma-bert": 5e-5, "anymorph": 5e-5, "amorpheus": 1e-4, "smp": 1e-4}
TAU, NOISE, CLIP, DISCOUNT = 0.046, 0.2, 0.5, 0.99


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", nargs="+", choices=list(RATE), default=list(RATE))
    parser.add_argument("--precisions", nargs="+", choices=["float32", "bfloat16"])
    parser.add_argument("--turns", type=int, default=7, help="turns of which the median is taken")
    parser.add_argument("--updates", type=int, default=4, help="updates in a turn; an even number")
    parser.add_argument("--batch", type=int, default=100)
    parser.add_argument("--threads", type=int, help="torch threads; default: torch's own choice")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--growth", type=int, metavar="UPDATES", help="watch memory at toy size instead")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    if options.threads:
        torch.set_num_threads(options.threads)
    default = resolve_precision("auto", options.device)
    precisions = options.precisions or list(dict.fromkeys(["float32", default]))
    results = {}
    if not options.json:
        print(f"{torch.get_num_threads()} threads, {options.device}, torch {torch.__version__}", flush=True)
    for method in options.methods:
        rows = growth(method, options.growth) if options.growth else measure(method, precisions, options)
        results[method] = rows
        for name, figures in rows.items() if not options.json else ():
            values = "  ".join(
                f"{key} {value:{'d' if isinstance(value, int) else '.4g'}}" for key, value in figures.items()
            )
            print(f"{method:<10}{name:<10}{values}", flush=True)
    if options.json:
        print(json.dumps({"threads": torch.get_num_threads(), "device": options.device, "methods": results}))


def measure(method: str, precisions: list[str], options: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Milliseconds an update, ratio to the yardstick, errors and memory, by precision."""
    torch.manual_seed(0)
    actor, critic = yardstick(method, PAPER)
    tensors = {f"weights/actor/{k}": v for k, v in actor.state_dict().items()}
    tensors |= {f"weights/critic/{k}": v for k, v in critic.state_dict().items()}
    theirs = plain.TD3(
        actor.to(options.device), critic.to(options.device), learning_rate=RATE[method], tau=TAU,
        clip=0.0 if method == "smp" else 0.1,
    )  # fmt: skip
    learners = {name: learner(method, PAPER, tensors, name, options.device) for name in precisions}
    batches = [batch(number, options.batch, len(LIMBS)) for number in range(2)]
    device_batches = [{k: torch.from_numpy(getattr(b, k)).to(options.device) for k in Batch.__slots__} for b in batches]
    rng = np.random.default_rng(0)

    def ours(name: str) -> Callable[[int], object]:
        net, layout = learners[name]
        return lambda number: net.update(batches[number % 2], None, None, layout, rng)

    def plainly(number: int) -> None:
        b = device_batches[number % 2]
        noise = (torch.randn_like(b["action"]) * NOISE).clamp(-CLIP, CLIP)
        theirs.update(b["obs"], b["action"], b["reward"], b["next_obs"], b["discount"], noise)

    runs: dict[str, Callable[[int], object]] = {"plain": plainly, **{name: ours(name) for name in precisions}}
    errors = {name: relative_errors(*learners[name], device_batches[0]) for name in precisions}
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(options.turns + 1):
        for name, run in runs.items():
            start = time.perf_counter()
            for number in range(options.updates):
                run(number)
            if options.device != "cpu":
                torch.cuda.synchronize()
            if turn:  # the first turn warms up
                times[name].append((time.perf_counter() - start) / options.updates * 1e3)
    rows: dict[str, dict[str, float]] = {}
    for name, run in runs.items():
        median = statistics.median(times[name])
        ratio = statistics.median(p / o for p, o in zip(times["plain"], times[name], strict=True))
        rows[name] = {"ms": median} if name == "plain" else {"ms": median, "ratio": ratio, **errors[name]}
        rows[name]["memory_mb"] = peak_memory(run)
    net, _ = learners[precisions[0]]
    for name in ("actor", "critic"):
        rows["plain"][f"{name}_parameters"] = sum(p.numel() for p in net.networks()[name].parameters())
    return rows


def yardstick(method: str, sizes: dict[str, int]) -> tuple[nn.Module, nn.Module]:
    """Actor and critics, written plainly."""
    widths = (sizes["d_model"], sizes["heads"], sizes["feedforward"], sizes["layers"])
    if method == "smp":
        width = (SCALARS, sizes["message_size"], 2)
        return plain.ModularActor(PARENTS, *width), plain.ModularCritic(PARENTS, *width)
    critic = plain.LimbCritic(len(LIMBS), SCALARS, *widths)
    if method == "amorpheus":
        return plain.LimbActor(len(LIMBS), SCALARS, *widths), critic
    size = EMBEDDING[method] if sizes is PAPER else sizes["token_size"]
    frozen = method == "ma-bert"
    return plain.TokenActor(len(LIMBS), SCALARS, size, sizes["code_size"], *widths, frozen=frozen), critic


def settings(method: str, sizes: dict[str, int]) -> ModelSettings:
    """Settings of a method, of those sizes that it has."""
    own = find_method(method).settings
    fields = {each.name for each in dataclasses.fields(own)}
    return own(method=method, **{key: size for key, size in sizes.items() if key in fields})


def learner(
    method: str, sizes: dict[str, int], tensors: dict[str, Tensor], precision: str, device: str
) -> tuple[TD3, Layout]:
    """Our learner with the yardstick's weights."""
    actor, critic = load_published(method, tensors, LIMBS, PARENTS)
    config = TD3Config(
        tau=TAU, learning_rate=RATE[method], target_noise=NOISE, target_noise_clip=CLIP, discount=DISCOUNT,
        gradient_clip=0.0 if method == "smp" else 0.1, reward_scale=1.0, actor_first=True,
    )  # fmt: skip
    vocabulary = Vocabulary(scalars=SCALARS, children=2)
    if method == "anymorph":
        vocabulary = actor.network.tokens.vocabulary
    size = actor.layout.embeddings.shape[1]
    net = TD3(settings(method, sizes), config, size, vocabulary=vocabulary, device=device, precision=precision)
    for name, network in net.networks().items():
        network.load_state_dict((actor if name.startswith("actor") else critic).network.state_dict())
    return net, to(actor.layout, device)


def to(layout: Layout, kind: str | torch.dtype) -> Layout:
    """The layout with its tensors on a device, or its floating-point tensors as precise as said."""
    changes: dict[str, Any] = {}
    for name, value in vars(layout).items():
        if isinstance(value, Tensor) and (isinstance(kind, str) or value.is_floating_point()):
            changes[name] = value.to(kind)
    return replace(layout, **changes)


def batch(seed: int, size: int, limbs: int) -> Batch:
    """Random transitions."""
    rng = np.random.default_rng(seed)
    obs, next_obs = rng.standard_normal((2, size, limbs * SCALARS)).astype(np.float32)
    action = rng.uniform(-1, 1, (size, limbs)).astype(np.float32)
    reward = rng.uniform(0, 1, (size, 1)).astype(np.float32)
    return Batch(obs, action, reward, next_obs, np.full((size, 1), DISCOUNT, np.float32))


def relative_errors(net: TD3, layout: Layout, b: dict[str, Tensor]) -> dict[str, float]:
    """Relative errors of actions and of both gradients against float64."""
    results = []
    for dtype in (None, torch.float64):
        actor, critic, where = deepcopy(net.actor), deepcopy(net.critic), layout
        obs, action = b["obs"], b["action"]
        if dtype is not None:
            where, obs, action = to(layout, dtype), obs.to(dtype), action.to(dtype)
            for network in (actor, critic):
                set_precision(network.to(dtype), dtype)
        acts = actor(obs, where)
        critic(obs, action, where).square().sum(0).mean().backward()
        critic_gradient = torch.cat([p.grad.ravel() for p in critic.parameters() if p.grad is not None])
        (-critic(obs, acts, where, members=1).mean()).backward()
        actor_gradient = torch.cat([p.grad.ravel() for p in actor.parameters() if p.grad is not None])
        results.append((acts, critic_gradient, actor_gradient))
    names = ("action_error", "critic_gradient_error", "actor_gradient_error")
    return {
        name: float((ours.detach().double() - exact.detach()).norm() / exact.detach().norm())
        for name, ours, exact in zip(names, *results, strict=True)
    }


def peak_memory(update: Callable[[int], object]) -> float:
    """Most megabytes that two updates, one of them with the actor's, held beyond what was there before."""
    held = peak = 0
    loud, quiet = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 2)  # the profiler talks
    try:
        with torch.autograd.profiler.profile(profile_memory=True) as profile:
            for number in range(2):
                update(number)
    finally:
        os.dup2(loud, 2)
        os.close(loud)
        os.close(quiet)
    for event in profile.kineto_results.events():
        if event.name() == "[memory]":
            held += event.nbytes()
            peak = max(peak, held)
    return peak / 1e6


def growth(method: str, updates: int) -> dict[str, dict[str, float]]:
    """Growth of resident memory and of Python's objects over `updates` toy updates, after a tenth of them."""
    actor, critic = yardstick(method, TOY)
    tensors = {f"weights/actor/{k}": v for k, v in actor.state_dict().items()}
    tensors |= {f"weights/critic/{k}": v for k, v in critic.state_dict().items()}
    net, layout = learner(method, TOY, tensors, "float32", "cpu")
    b, rng = batch(0, 4, len(LIMBS)), np.random.default_rng(0)
    before: tuple[float, int] = (0.0, 0)
    for number in range(updates + 1):
        if number in (updates // 10, updates):
            gc.collect()
            objects = len(gc.get_objects())  # first: the list is memory, too
            now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, objects
            growths, before = (now[0] - before[0], now[1] - before[1]), now
        net.update(b, None, None, layout, rng)
    return {"growth": {"updates": updates, "resident_mb": growths[0], "objects": growths[1]}}


if __name__ == "__main__":
    main()
