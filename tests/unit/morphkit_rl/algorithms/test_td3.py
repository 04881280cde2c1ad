"""TD3 updates against the algorithm written out."""

from __future__ import annotations

import math
from copy import deepcopy

import numpy as np
import pytest
import torch

from morphkit.errors import ConfigError
from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import token_spec
from morphkit_rl.algorithms.saturation import saturation, saturation_and_gradient
from morphkit_rl.algorithms.td3 import TD3, find_device, resolve_precision
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.learner_config import LearnerConfig
from morphkit_rl.config.train_config import TD3Config
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.limb_former import LimbFormerSettings
from morphkit_rl.models.vocabulary import Vocabulary

MODEL = LimbFormerSettings(d_model=16, layers=1, heads=2, feedforward=16)
SIZE = 8


@pytest.fixture
def layout() -> Layout:
    specs = [token_spec(read(load(name))) for name in ("hopper", "arm")]
    return build_layout(specs, lambda texts: np.random.default_rng(0).standard_normal((len(texts), SIZE)).astype("f4"))


def make_batch(layout: Layout, size: int = 6) -> Batch:
    rng = np.random.default_rng(3)
    obs, next_obs = rng.standard_normal((2, size, layout.num_tokens)).astype("f4")
    action = rng.uniform(-1, 1, (size, layout.num_actions)).astype("f4")
    reward = rng.standard_normal((size, layout.num_robots)).astype("f4")
    discount = np.where(rng.random((size, layout.num_robots)) < 0.3, 0, 0.99).astype("f4")
    return Batch(obs, action, reward, next_obs, discount)


def unit(layout: Layout) -> tuple[torch.Tensor, torch.Tensor]:
    return torch.ones(layout.num_tokens), torch.zeros(layout.num_tokens)


def test_losses_and_targets_follow_the_algorithm(layout: Layout) -> None:
    torch.manual_seed(0)
    config = TD3Config(target_noise=0.0, reward_scale=0.5, tau=0.25, learning_rate=1e-3, gradient_clip=0.0)
    learner, batch = TD3(MODEL, config, SIZE), make_batch(layout)
    before = deepcopy(learner)
    t = {name: torch.from_numpy(getattr(batch, name)) for name in Batch.__slots__}
    with torch.no_grad():
        next_q = before.critic_target(t["next_obs"], before.actor_target(t["next_obs"], layout), layout).amin(0)
        y = 0.5 * t["reward"] + t["discount"] * next_q
        q = before.critic(t["obs"], t["action"], layout)
    first = learner.update(batch, *unit(layout), layout, np.random.default_rng(0))
    expected = sum(((q[member] - y) ** 2).mean() for member in range(2))
    torch.testing.assert_close(first["critic_loss"], expected)
    assert "actor_loss" not in first
    for name in ("actor", "actor_target", "critic_target"):
        for old, new in zip(getattr(before, name).parameters(), getattr(learner, name).parameters(), strict=True):
            assert torch.equal(old, new), f"{name} changed before its turn"

    second = learner.update(batch, *unit(layout), layout, np.random.default_rng(0))
    with torch.no_grad():
        expected = -learner.critic(t["obs"], before.actor(t["obs"], layout), layout)[0].mean()
    torch.testing.assert_close(second["actor_loss"], expected)
    for name in ("actor", "critic"):
        nets = (getattr(before, f"{name}_target"), getattr(learner, name), getattr(learner, f"{name}_target"))
        for old, online, new in zip(*(net.parameters() for net in nets), strict=True):
            torch.testing.assert_close(new, 0.75 * old + 0.25 * online)


def test_learning_moves_the_values_toward_their_targets(layout: Layout) -> None:
    torch.manual_seed(0)
    config = TD3Config(learning_rate=3e-3, target_noise=0.0, reward_scale=1.0)
    learner, batch = TD3(MODEL, config, SIZE), make_batch(layout)
    batch = Batch(batch.obs, batch.action, batch.reward, batch.next_obs, np.zeros_like(batch.discount))
    losses = [
        float(learner.update(batch, *unit(layout), layout, np.random.default_rng(0))["critic_loss"]) for _ in range(60)
    ]
    assert losses[-1] < 0.1 * losses[0]


def test_the_same_seed_gives_the_same_weights(layout: Layout) -> None:
    weights = []
    for _ in range(2):
        torch.manual_seed(5)
        learner, rng = TD3(MODEL, TD3Config(), SIZE), np.random.default_rng(7)
        for _ in range(4):
            learner.update(make_batch(layout), *unit(layout), layout, rng)
        weights.append(torch.cat([p.detach().ravel() for p in learner.actor.parameters()]))
    assert torch.equal(*weights)


def test_precision_follows_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: False)
    assert resolve_precision("auto", "cpu") == "float32"
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: True)
    assert resolve_precision("auto", "cpu") == "bfloat16"
    assert resolve_precision("float32", "cpu") == "float32"


@pytest.mark.parametrize("name", ["cuda:99", "banana", "meta", "cuda" if not torch.cuda.is_available() else "cuda:98"])
def test_a_device_that_cannot_be_used_is_named(name: str) -> None:
    for attempt in (find_device, lambda device: resolve_precision("auto", device)):
        with pytest.raises(ConfigError, match=rf"device '{name}' cannot be used here: \S"):
            attempt(name)
    with pytest.raises(ConfigError, match=f"device '{name}'"):
        TD3(MODEL, TD3Config(), SIZE, device=name)
    assert find_device("cpu").type == "cpu"


def test_saturation_penalty_is_added_to_the_actors_loss_and_pulls_it_back(layout: Layout) -> None:
    action = torch.tensor([[-0.9, 0.5], [0.0, 1.0]], dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(saturation(action), action)
    exact = [math.atanh(a) for a in (-0.9, 0.5, 0.0, 1 - 1e-6)]
    torch.testing.assert_close(saturation(action).item(), sum(x**2 for x in exact) / 4)
    assert gradient[0, 0] < 0 < gradient[0, 1]
    torch.testing.assert_close(saturation_and_gradient(action.detach()), (saturation(action).detach(), gradient))

    losses, sizes = {}, {}
    for penalty in (0.0, 10.0):
        torch.manual_seed(0)
        config = TD3Config(actor_first=True, target_noise=0.0, learning_rate=3e-3, saturation_penalty=penalty)
        learner, batch = TD3(MODEL, config, SIZE), make_batch(layout)
        before = learner.act(batch.obs, *unit(layout), layout)
        losses[penalty] = learner.update(batch, *unit(layout), layout, np.random.default_rng(0))["actor_loss"].item()
        for _ in range(20):
            learner.update(batch, *unit(layout), layout, np.random.default_rng(0))
        sizes[penalty] = np.abs(np.arctanh(learner.act(batch.obs, *unit(layout), layout))).mean()
        expected = 10.0 * np.square(np.arctanh(before)).mean()
    assert losses[10.0] - losses[0.0] == pytest.approx(expected, rel=1e-4)
    assert sizes[10.0] < 0.5 * sizes[0.0]


def test_a_margin_leaves_moderate_actions_alone_and_pulls_back_the_rest() -> None:
    action = torch.tanh(torch.tensor([-3.0, -1.9, 0.0, 1.0, 2.5], dtype=torch.float64)).requires_grad_()
    penalty = saturation(action, 2.0)
    torch.testing.assert_close(penalty.item(), (1.0 + 0.25) / 5)
    (gradient,) = torch.autograd.grad(penalty, action)
    assert gradient.sign().tolist() == [-1, 0, 0, 0, 1]
    torch.testing.assert_close(saturation_and_gradient(action.detach(), 2.0), (penalty.detach(), gradient))


def with_options(layout: Layout, config: TD3Config, **options: object) -> TD3:
    torch.manual_seed(0)
    options = {"critic": "perceptron", "critic_width": 16, "critic_layers": 1, **options}
    return TD3(MODEL, config, SIZE, learner=LearnerConfig(**options), vocabulary=Vocabulary.of(layout.specs))


def test_categorical_critics_and_the_mean_of_both_follow_the_algorithm(layout: Layout) -> None:
    config = TD3Config(target_noise=0.0, reward_scale=1.0, actor_first=True, gradient_clip=0.0)
    learner = with_options(layout, config, value="categorical", actor_objective="mean", critic_learning_rate=1e-9)
    batch, scale, before = make_batch(layout), torch.tensor([0.5, 2.0]), deepcopy(learner)
    losses = learner.update(batch, *unit(layout), layout, np.random.default_rng(0), reward_scale=scale)
    t = {name: torch.from_numpy(getattr(batch, name)) for name in Batch.__slots__}
    loss = learner.critic_loss
    with torch.no_grad():
        next_output = before.critic_target(t["next_obs"], before.actor_target(t["next_obs"], layout), layout)
        target = loss.target(next_output, t["reward"] * scale, t["discount"])
        output = before.critic(t["obs"], t["action"], layout)
        climbed = before.critic(t["obs"], before.actor(t["obs"], layout), layout)
    torch.testing.assert_close(losses["critic_loss"], 2 * loss.error(output, target).mean())
    torch.testing.assert_close(losses["q_mean"], (loss.expectation(output) / scale).mean())
    torch.testing.assert_close(losses["actor_loss"], -loss.expectation(climbed).mean(), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("value", ["scalar", "categorical"])
def test_perceptron_critics_learn_their_targets(layout: Layout, value: str) -> None:
    learner = with_options(layout, TD3Config(target_noise=0.0, reward_scale=1.0, learning_rate=1e-2), value=value)
    batch = make_batch(layout)
    batch = Batch(batch.obs, batch.action, batch.reward, batch.next_obs, np.zeros_like(batch.discount))
    for _ in range(150):
        learner.update(batch, *unit(layout), layout, np.random.default_rng(0))
    t = {name: torch.from_numpy(getattr(batch, name)) for name in Batch.__slots__}
    values = learner.critic_loss.expectation(learner.critic(t["obs"], t["action"], layout))
    assert (values - t["reward"]).abs().mean() < 0.2 * t["reward"].abs().mean()


def test_step_sizes_are_apart_and_fall_to_their_share(layout: Layout) -> None:
    learner = with_options(layout, TD3Config(learning_rate=2e-4), critic_learning_rate=1e-3, final_learning_rate=0.1)
    for used, left in ((0.0, 1.0), (0.5, 0.55), (1.0, 0.1)):
        learner.set_rates(used)
        rates = [optimizer.param_groups[0]["lr"] for optimizer in learner.optimizers().values()]
        assert rates == pytest.approx([2e-4 * left, 1e-3 * left])


def test_the_averaged_actor_follows_slowly_and_is_the_one_that_is_kept(layout: Layout) -> None:
    config = TD3Config(actor_first=True, policy_delay=1, learning_rate=1e-2)
    learner, batch = with_options(layout, config, actor_average=0.75), make_batch(layout)
    expected = [p.detach().clone() for p in learner.actor.parameters()]
    for _ in range(3):
        learner.update(batch, *unit(layout), layout, np.random.default_rng(0))
        expected = [
            0.75 * old + 0.25 * new.detach() for old, new in zip(expected, learner.actor.parameters(), strict=True)
        ]
    for average, kept in zip(expected, learner.networks()["actor"].parameters(), strict=True):
        torch.testing.assert_close(kept, average)
    online, final = (learner.act(batch.obs, *unit(layout), layout, final=final) for final in (False, True))
    assert np.abs(online - final).max() > 1e-4
    assert learner.networks()["actor_online"] is learner.actor


def test_categorical_values_need_critics_that_have_them(layout: Layout) -> None:
    with pytest.raises(ConfigError, match=r"needs learner\.critic = 'perceptron'"):
        with_options(layout, TD3Config(), critic="method", value="categorical")
