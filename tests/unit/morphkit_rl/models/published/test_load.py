"""Networks with published weights against the published programs' numbers, and against plain code at other sizes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import published_baselines as plain
import pytest
import torch
from torch import nn

from morphkit.errors import CheckpointError, ConfigError
from morphkit_rl.algorithms.td3 import TD3
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.train_config import TD3Config
from morphkit_rl.models import load_published
from morphkit_rl.models.limb_former import LimbFormerSettings
from tests.support.published_networks import Arrays, assert_same_networks, random_parents, weights_of

DATA = Path(__file__).parents[4] / "data" / "published_networks.npz"
"""The weights, inputs and outputs of the benchmark's reference networks, those of SMP without the weights."""
LIMBS, PARENTS = ("torso", "bthigh", "bshin", "fthigh"), (-1, 0, 1, 0)
FILES = {"anymorph": "anymorph", "amorpheus": "amorpheus", "amorpheus_unconditioned": "amorpheus", "smp": "smp"}


def smp_weights() -> Arrays:
    """The published networks came from torch's generator, seed 7: actor, actor's target, critic."""
    torch.manual_seed(7)
    actor, _ = (plain.ModularActor(PARENTS, 19, 4, 2) for _ in range(2))
    return weights_of(actor, plain.ModularCritic(PARENTS, 19, 4, 2))


def stored(file: str) -> Arrays:
    with np.load(DATA) as arrays:
        own = {key.partition("/")[2]: arrays[key] for key in arrays.files if key.partition("/")[0] == file}
    return own | smp_weights() if file == "smp" else own


@pytest.fixture(scope="module", params=FILES)
def reference(request: pytest.FixtureRequest) -> tuple[str, Arrays]:
    return FILES[request.param], stored(request.param)


def tensor(arrays: Arrays, key: str) -> torch.Tensor:
    return torch.from_numpy(arrays[key])


def assert_outputs(actor: Any, critic: Any, arrays: Arrays, which: str, tolerance: float) -> None:
    obs, action = tensor(arrays, "batch/obs")[0], tensor(arrays, "batch/action")[0]
    for name, value in zip(("action", "q1", "q2"), (actor(obs), *critic(obs, action)), strict=True):
        torch.testing.assert_close(value, tensor(arrays, f"{which}/{name}"), atol=tolerance, rtol=0)


def test_published_weights_give_the_published_outputs(reference: tuple[str, Arrays]) -> None:
    method, arrays = reference
    assert_outputs(*load_published(method, arrays, LIMBS, PARENTS), arrays, "out_before/online", 1e-5)


def test_three_updates_give_the_published_losses_norms_and_outputs(
    reference: tuple[str, Arrays], monkeypatch: pytest.MonkeyPatch
) -> None:
    method, arrays = reference
    actor, critic = load_published(method, arrays, LIMBS, PARENTS)
    config = TD3Config(
        discount=0.99, tau=0.046, learning_rate=1e-3, target_noise=0.0, gradient_clip=0.1, reward_scale=1.0,
        actor_first=True,
    )  # fmt: skip
    monkeypatch.setattr("morphkit_rl.algorithms.td3.build", lambda *_: (actor.network, critic.network))
    learner = TD3(LimbFormerSettings(), config, 0)
    norms, clip = [], nn.utils.clip_grad_norm_
    monkeypatch.setattr(nn.utils, "clip_grad_norm_", lambda *args: norms.append(clip(*args)))
    losses = []
    for update in range(3):
        b = {name: arrays[f"batch/{name}"][update] for name in ("obs", "action", "reward", "next_obs", "done")}
        batch = Batch(b["obs"], b["action"], b["reward"], b["next_obs"], 0.99 * (1 - b["done"]))
        unit = torch.ones(b["obs"].shape[1]), torch.zeros(b["obs"].shape[1])
        done = learner.update(batch, *unit, actor.layout, np.random.default_rng(0))
        losses += [done[name] for name in ("critic_loss", "actor_loss") if name in done]
    for found, key in ((losses, "losses"), (norms, "grad_norms")):
        expected = tensor(arrays, f"updates/{key}_in_order")
        torch.testing.assert_close(torch.stack(found).double(), expected, rtol=1e-5, atol=0)
    for which, nets in {
        "online": (learner.actor, learner.critic),
        "target": (learner.actor_target, learner.critic_target),
    }.items():
        actor.network, critic.network = nets
        assert_outputs(actor, critic, arrays, f"out_after3/{which}", 1e-4)


def test_ma_bert_with_the_learned_tables_as_frozen_embeddings_is_anymorph() -> None:
    arrays = stored("anymorph")
    actor, critic = load_published("ma-bert", arrays, LIMBS, PARENTS)
    assert_outputs(actor, critic, arrays, "out_before/online", 1e-5)
    assert not any(name.startswith("network.tokens") for name, _ in actor.named_parameters())


def test_plain_yardsticks_do_the_published_updates(reference: tuple[str, Arrays]) -> None:
    method, arrays = reference
    conditioned = "weights/actor/actor.decoder.weight" in arrays and (
        arrays["weights/actor/actor.decoder.weight"].shape[1] > 16
    )
    sizes = (16, 2, 24, 2)
    nets = {
        "anymorph": lambda: (plain.TokenActor(4, 19, 6, 12, *sizes), plain.LimbCritic(4, 19, *sizes)),
        "amorpheus": lambda: (
            plain.LimbActor(4, 19, *sizes, conditioned=conditioned),
            plain.LimbCritic(4, 19, *sizes, conditioned=conditioned),
        ),
        "smp": lambda: (plain.ModularActor(PARENTS, 19, 4, 2), plain.ModularCritic(PARENTS, 19, 4, 2)),
    }[method]()
    for name, net in zip(("actor", "critic"), nets, strict=True):
        prefix = f"weights/{name}/"
        net.load_state_dict({k.removeprefix(prefix): tensor(arrays, k) for k in arrays if k.startswith(prefix)})
    learner = plain.TD3(*nets, learning_rate=1e-3, tau=0.046, clip=0.1)
    done = []
    for update in range(3):
        obs, action, reward, next_obs, ended = (
            tensor(arrays, f"batch/{name}")[update] for name in ("obs", "action", "reward", "next_obs", "done")
        )
        done += learner.update(obs, action, reward, next_obs, 0.99 * (1 - ended), torch.zeros(()))
    for found, key in zip(zip(*done, strict=True), ("losses", "grad_norms"), strict=True):
        np.testing.assert_allclose(found, arrays[f"updates/{key}_in_order"], rtol=1e-5)
    assert_outputs(learner.actor, learner.critic, arrays, "out_after3/online", 1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_token_transformers_of_other_sizes_and_trees(seed: int) -> None:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    heads, limbs, scalars = int(rng.integers(1, 5)), int(rng.integers(1, 8)), int(rng.integers(1, 12))
    size, code, d_model = int(rng.integers(1, 9)), 2 * int(rng.integers(1, 9)), heads * int(rng.integers(2, 9))
    sizes = (d_model, heads, int(rng.integers(3, 30)), int(rng.integers(1, 4)))
    actor = plain.TokenActor(limbs, scalars, size, code, *sizes)
    critic = plain.LimbCritic(limbs, scalars, *sizes, conditioned=seed % 2 == 0)
    assert_same_networks("anymorph", actor, critic, random_parents(rng, limbs, 3), scalars, heads)


@pytest.mark.parametrize("seed", range(4))
def test_limb_transformers_of_other_sizes_and_trees(seed: int) -> None:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    heads, limbs, scalars = int(rng.integers(1, 5)), int(rng.integers(1, 10)), int(rng.integers(1, 22))
    sizes = (heads * int(rng.integers(2, 9)), heads, int(rng.integers(3, 30)), int(rng.integers(1, 4)))
    actor = plain.LimbActor(limbs, scalars, *sizes, conditioned=seed % 2 == 0)
    critic = plain.LimbCritic(limbs, scalars, *sizes, conditioned=seed % 2 == 0)
    assert_same_networks("amorpheus", actor, critic, random_parents(rng, limbs, 3), scalars, heads)


@pytest.mark.parametrize("directions", [("both", "both"), ("up", "down"), ("down", "up"), ("none", "none")])
@pytest.mark.parametrize("seed", range(4))
def test_modular_policies_of_other_sizes_and_trees(seed: int, directions: tuple[str, str]) -> None:
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    limbs, scalars, message = int(rng.integers(1, 10)), int(rng.integers(1, 22)), int(rng.integers(1, 6))
    parents = random_parents(rng, limbs, 3)
    # Messages that only come down do not tell by their shape for how many children they were made.
    exact = "down" in directions
    children = max(1, max(parents.count(limb) for limb in range(limbs)), 0 if exact else int(rng.integers(1, 5)))
    widths = tuple(int(w) for w in rng.integers(2, 20, 3))
    actor = plain.ModularActor(parents, scalars, message, children, directions[0], widths)
    critic = plain.ModularCritic(parents, scalars, message, children, directions[1], widths)
    assert_same_networks("smp", actor, critic, parents, scalars)


@pytest.mark.parametrize("direction", ["both", "up", "down"])
def test_modular_policies_say_for_how_many_children_they_were_made(direction: str) -> None:
    nets = [net(PARENTS, 5, 4, 2, direction, (6, 6, 6)) for net in (plain.ModularActor, plain.ModularCritic)]
    for parents in ((-1, 0, 0, 0), (-1, 0, 0, 0, 1, 1, 1)):
        with pytest.raises(CheckpointError, match=r"children"):
            load_published("smp", weights_of(*nets), [f"limb{n}" for n in range(len(parents))], parents)


def test_modular_policies_of_a_single_limb() -> None:
    for direction in ("both", "up", "down", "none"):
        nets = [net([-1], 5, 4, 1, direction) for net in (plain.ModularActor, plain.ModularCritic)]
        assert_same_networks("smp", *nets, [-1], 5)


def test_weights_of_any_number_type_and_trees_in_arrays_can_be_loaded() -> None:
    actor, critic = plain.TokenActor(4, 3, 5, 4, 8, 2, 8, 1), plain.LimbCritic(4, 3, 8, 2, 8, 1)
    weights = {key: torch.from_numpy(value).bfloat16() for key, value in weights_of(actor, critic).items()}
    exact, obs = {key: value.float() for key, value in weights.items()}, torch.randn(2, 12)
    acts, same = (load_published("anymorph", w, np.array(LIMBS), np.array(PARENTS))[0](obs) for w in (weights, exact))
    assert torch.equal(acts, same)


def test_what_cannot_be_loaded_is_said() -> None:
    actor, critic = plain.LimbActor(4, 3, 8, 2, 8, 1), plain.LimbCritic(4, 3, 8, 2, 8, 1)
    weights = weights_of(actor, critic)
    with pytest.raises(ConfigError, match=r"method 'limb-former'.*anymorph"):
        load_published("limb-former", weights, LIMBS, PARENTS)
    for heads in (0, 3, 16):
        with pytest.raises(ConfigError, match=f"d_model is 8, which does not divide into {heads} attention heads"):
            load_published("amorpheus", weights, LIMBS, PARENTS, num_heads=heads)
    with pytest.raises(CheckpointError, match=r"lack 'actor\.0\.action_base"):
        load_published("smp", weights, LIMBS, PARENTS)
    tables = weights_of(plain.TokenActor(4, 3, 5, 4, 8, 2, 8, 1), critic)
    with pytest.raises(CheckpointError, match="12 sensors and 4 actions do not fit 3 limbs"):
        load_published("anymorph", tables, LIMBS[:3], PARENTS[:3])
    with pytest.raises(ConfigError, match="make no tree"):
        load_published("amorpheus", weights, LIMBS, (1, 0, 1, 0))
    with pytest.raises(CheckpointError, match=r"lack 'encoder\.weight'"):
        load_published("amorpheus", {k: v for k, v in weights.items() if "critic" in k}, LIMBS, PARENTS)
    changed = {**weights, "weights/critic/critic2.encoder.weight": np.zeros((8, 9), np.float32)}
    with pytest.raises(CheckpointError, match=r"network\.read\.weight"):
        load_published("amorpheus", changed, LIMBS, PARENTS)
