"""All methods on robots side by side: what a network gives for a robot never depends on what is next to it."""

from __future__ import annotations

import gc
from typing import Any

import numpy as np
import pytest
import torch

from morphkit.errors import ConfigError
from morphkit_rl.algorithms.td3 import TD3
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.methods import ModelSettings, find_method, method_names
from morphkit_rl.config.train_config import TD3Config
from morphkit_rl.models import build
from morphkit_rl.models.blocks import set_precision
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.vocabulary import Vocabulary
from tests.support.networks import ROBOTS, SIZE, batch_of, layout_of, networks, rows, small, spec

VARIANTS = [
    *[{"method": name} for name in method_names()],
    {"method": "ma-bert", "combine": "add", "hidden": True},
    {"method": "anymorph", "hidden": True},
    {"method": "amorpheus", "conditioned": False},
    {"method": "smp", "actor_messages": "up", "critic_messages": "down"},
    {"method": "smp", "actor_messages": "down", "critic_messages": "up"},
    {"method": "smp", "actor_messages": "none", "critic_messages": "none"},
]


@pytest.fixture(params=VARIANTS, ids=lambda changes: "-".join(map(str, changes.values())))
def config(request: pytest.FixtureRequest) -> ModelSettings:
    return small(**request.param)


def test_a_robot_alone_and_in_a_mixed_batch_gives_the_same(config: ModelSettings) -> None:
    actor, critic = networks(config)
    mixed = layout_of(config.method, *ROBOTS)
    obs, action = rows(mixed)
    actions, values = actor(obs, mixed), critic(obs, action, mixed)
    robot_of = critic.value_robot(mixed)
    assert actions.shape == action.shape
    assert values.shape == (2, len(obs), len(robot_of))
    assert actions.std(0).min() > 1e-4
    for number, name in enumerate(ROBOTS):
        alone = layout_of(config.method, name)
        own_obs, own_action = obs[:, mixed.tokens[number]], action[:, mixed.actions[number]]
        torch.testing.assert_close(actor(own_obs, alone), actions[:, mixed.actions[number]], atol=1e-6, rtol=0)
        own_values = critic(own_obs, own_action, alone)
        torch.testing.assert_close(own_values, values[..., robot_of == number], atol=1e-6, rtol=0)
        for row in range(2):  # nor does it depend on the other rows of the batch
            one = actor(own_obs[row : row + 1], alone)[0]
            torch.testing.assert_close(one, actions[row, mixed.actions[number]], atol=1e-6, rtol=0)


def test_gradients_stay_within_a_robot(config: ModelSettings) -> None:
    actor, critic = networks(config)
    mixed = layout_of(config.method, *ROBOTS)
    obs, action = (x.requires_grad_() for x in rows(mixed))
    (
        actor(obs, mixed)[:, mixed.actions[1]].sum()
        + critic(obs, action, mixed)[..., critic.value_robot(mixed) == 1].sum()
    ).backward()
    for gradient, slices in ((obs.grad, mixed.tokens), (action.grad, mixed.actions)):
        assert gradient is not None
        for number, columns in enumerate(slices):
            assert (gradient[:, columns].abs().amax(0) > 0).all() == (number == 1)
            assert number == 1 or (gradient[:, columns] == 0).all()


def test_names_read_ahead_give_the_same_actions(config: ModelSettings) -> None:
    actor, _ = networks(config)
    layout = layout_of(config.method, *ROBOTS)
    obs, _ = rows(layout)
    assert torch.equal(actor(obs, layout, actor.read_names(layout)), actor(obs, layout))


def test_the_first_critic_alone_gives_its_values(config: ModelSettings) -> None:
    _, critic = networks(config)
    layout = layout_of(config.method, *ROBOTS)
    q1, q2 = critic(*rows(layout), layout)
    (alone,) = critic(*rows(layout), layout, members=1)
    torch.testing.assert_close(alone, q1)
    assert (q1 - q2).abs().min() > 1e-6


def test_low_precision_stays_close(config: ModelSettings) -> None:
    actor, critic = networks(config)
    layout = layout_of(config.method, *ROBOTS)
    obs, action = rows(layout, 16)
    exact = actor(obs, layout), critic(obs, action, layout)
    for network in (actor, critic):
        set_precision(network, torch.bfloat16)
    for low, high in zip((actor(obs, layout), critic(obs, action, layout)), exact, strict=True):
        assert low.dtype == torch.float32
        assert 1e-7 < (low - high).norm() / high.norm() < 0.05


@pytest.mark.parametrize("precision", [torch.float32, torch.bfloat16])
def test_the_way_of_accelerators_gives_the_same(
    config: ModelSettings, precision: torch.dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    actor, critic = networks(config)
    for network in (actor, critic):
        set_precision(network, precision)
    layout = layout_of(config.method, *ROBOTS)
    obs, action = rows(layout, 16)
    own = actor(obs, layout), critic(obs, action, layout)
    monkeypatch.setattr("morphkit_rl.models.transformer.on_cpu", lambda _: False)
    for other, way in zip((actor(obs, layout), critic(obs, action, layout)), own, strict=True):
        assert (other - way).norm() / way.norm() < (1e-5 if precision == torch.float32 else 0.03)


def learner(config: ModelSettings, layout: Layout, **changes: Any) -> TD3:
    torch.manual_seed(0)
    return TD3(config, TD3Config(**changes), SIZE, vocabulary=Vocabulary.of(layout.specs))


def test_values_move_toward_their_targets(config: ModelSettings) -> None:
    layout = layout_of(config.method, *ROBOTS[:2])
    net, batch, rng = (
        learner(config, layout, learning_rate=3e-3, reward_scale=1.0),
        batch_of(layout),
        np.random.default_rng(0),
    )
    batch = Batch(batch.obs, batch.action, batch.reward, batch.next_obs, 0 * batch.discount)
    losses = [float(net.update(batch, None, None, layout, rng)["critic_loss"]) for _ in range(40)]
    assert losses[-1] < 0.5 * losses[0]


def test_a_robots_reward_is_that_of_each_of_its_values_and_robots_count_alike() -> None:
    layout = layout_of("amorpheus", "cheetah", "hopper_3")
    net, batch = (
        learner(small("amorpheus"), layout, reward_scale=1.0, target_noise=0.0),
        batch_of(layout),
    )
    t = {name: torch.from_numpy(getattr(batch, name)) for name in Batch.__slots__}
    with torch.no_grad():
        q = net.critic(t["obs"], t["action"], layout)
        next_q = net.critic_target(t["next_obs"], net.actor_target(t["next_obs"], layout), layout).amin(0)
    losses = []
    for number, limbs in enumerate(layout.limbs):
        y = t["reward"][:, number, None] + t["discount"][:, number, None] * next_q[:, limbs]
        losses.append(sum(((q[member][:, limbs] - y) ** 2).mean() for member in range(2)))
    found = net.update(batch, None, None, layout, np.random.default_rng(0))["critic_loss"]
    torch.testing.assert_close(found, sum(losses) / 2)


def test_reset_draws_the_last_layers_anew_and_only_them() -> None:
    for method in method_names():
        layout = layout_of(method, "hopper_3")
        nets = [learner(small(method), layout, reset_updates=n) for n in (0, 2)]
        for net in nets:
            for _ in range(2):
                net.update(batch_of(layout), None, None, layout, np.random.default_rng(5))
        for name in ("actor", "critic", "actor_target", "critic_target"):
            kept, reset = (dict(getattr(net, name).named_parameters()) for net in nets)
            changed = {key for key in kept if not torch.equal(kept[key], reset[key])}
            assert changed, f"{method} {name}"
            assert all(key.startswith(nets[0].networks()[name].last_layers) for key in changed)
        online, target = (dict(nets[1].networks()[name].named_parameters()) for name in ("actor", "actor_target"))
        last = [key for key in online if key.startswith(nets[1].actor.last_layers)]
        assert all(torch.equal(online[key], target[key]) for key in last)
        losses = nets[1].update(batch_of(layout), None, None, layout, np.random.default_rng(6))
        assert torch.isfinite(losses["critic_loss"])


def test_updates_leave_nothing_behind() -> None:
    gc.collect()
    gc.freeze()  # Looking through what is there already takes long.
    try:
        _update_and_count()
    finally:
        gc.unfreeze()


def _update_and_count() -> None:
    for method in method_names():
        layout = layout_of(method, "hopper_3")
        net, batch, rng = learner(small(method), layout), batch_of(layout), np.random.default_rng(0)

        def held() -> tuple[int, int]:
            gc.collect()
            everything = gc.get_objects()
            return len(everything), sum(type(each) in (torch.Tensor, torch.nn.Parameter) for each in everything)

        for _ in range(4):
            net.update(batch, None, None, layout, rng)
        before = held()
        for _ in range(30):
            net.update(batch, None, None, layout, rng)
        after = held()
        assert after[1] <= before[1], method
        assert after[0] - before[0] < 30, method


def test_robots_that_a_method_cannot_express_are_named() -> None:
    published = [name for name in method_names() if name != "limb-former"]
    for method in published:
        config = small(method)
        with pytest.raises(ConfigError, match=rf"arm: method '{method}'.*'flexor_ctrl' drives no single limb"):
            find_method(method).check(spec("arm"), config)
        find_method(method).check(spec("cheetah"), config, Vocabulary.of([spec("walker")]))
        fewer = Vocabulary(scalars=15)
        with pytest.raises(ConfigError, match=r"cheetah: .* takes 15 scalars a limb, but limb 'torso' has 19"):
            find_method(method).check(spec("cheetah"), config, fewer)
    with pytest.raises(ConfigError, match=r"at most 2 children a limb, but limb 'torso' has 4"):
        find_method("smp").check(spec("humanoid_2d"), small("smp"), Vocabulary.of([spec("cheetah")]))
    find_method("limb-former").check(spec("arm"), small())


def test_unknown_methods_and_odd_codes_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"unknown method 'bert'; there is limb-former, ma-bert"):
        build(small("bert"), SIZE)
    with pytest.raises(ConfigError, match="even size"):
        build(small("ma-bert", code_size=7), SIZE, Vocabulary.of([spec("hopper")]))
    for method in ("limb-former", "ma-bert", "anymorph", "amorpheus"):
        with pytest.raises(ConfigError, match="d_model is 16, which does not divide into 3 attention heads"):
            networks(small(method, heads=3))


def test_anymorph_knows_names_of_training_only_and_gives_others_zeros() -> None:
    actor, _ = networks(small("anymorph"), ["hopper_3"])
    known, other = layout_of("anymorph", "hopper_3"), layout_of("anymorph", "cheetah")
    sensors, actions = actor.tokens(known)
    assert (sensors.abs().amax(1) > 0).all()
    assert (actions.abs().amax(1) > 0).all()
    sensors, _ = actor.tokens(other)
    seen = torch.tensor([name.name in actor.tokens.vocabulary.sensors for name in other.specs[0].sensors])
    assert 0 < seen.sum() < len(seen)
    assert ((sensors.abs().amax(1) > 0) == seen).all()


def test_a_vocabulary_survives_json() -> None:
    import json

    vocabulary = Vocabulary.of([spec("hopper"), spec("humanoid_2d")])
    assert (vocabulary.scalars, vocabulary.children) == (19, 4)
    assert "torso_ctrl" in vocabulary.actions
    assert "torso ctrl" in vocabulary.texts
    assert Vocabulary.from_dict(json.loads(json.dumps(vocabulary.to_dict()))) == vocabulary


def test_action_columns_of_limbs_and_of_actuators() -> None:
    by_limb, by_actuator = layout_of("smp", "hopper", "cheetah"), layout_of("limb-former", "hopper", "cheetah")
    assert (by_limb.num_actions, by_actuator.num_actions) == (12, 10)
    for robot, one in enumerate(by_limb.specs):
        own = by_limb.action_names[by_limb.actions[robot]]
        assert [own[column] for column in by_limb.actuator_columns[robot]] == [a.name for a in one.actuators]
        assert by_actuator.actuator_columns[robot].tolist() == list(range(len(one.actuators)))
    assert by_limb.action_names[0] == "torso_ctrl"
    assert by_limb.texts[by_limb.action_text[0]] == "torso ctrl"
