"""What the actor is shown besides the robots as they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from morphkit.ablation.symmetry import other_side
from morphkit.errors import ConfigError
from morphkit.registry import load
from morphkit_rl.algorithms.augmentation import Augmentation, Shown, check_augmentation
from morphkit_rl.algorithms.mirror import mirror_image
from morphkit_rl.config.augment_config import AugmentConfig
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare
from morphkit_rl.models.blocks import TransformerLayer
from morphkit_rl.models.layout import FOREIGN, build_layout
from tests.support import networks


def augmentation(*names: str, **settings: float) -> Augmentation:
    specs = [networks.spec(name) for name in names]
    return Augmentation(AugmentConfig(**settings), build_layout(specs, networks.embed), lay_out)  # type: ignore[arg-type]


def lay_out(specs):  # type: ignore[no-untyped-def]
    return build_layout(specs, networks.embed)


def draws(made: Augmentation, number: int = 64) -> list[Shown]:
    rng = np.random.default_rng(0)
    return [made.draw(rng) for _ in range(number)]


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("left thigh position x", "right thigh position x"),
        ("right1 ctrl", "left1 ctrl"),
        ("Left Right", "Right Left"),
        ("l foot angle", "r foot angle"),
        ("torso position x", "torso position x"),
        ("front thigh type 0", "front thigh type 0"),
    ],
)
def test_the_other_side_of_a_text(text: str, other: str) -> None:
    assert other_side(text) == other
    assert other_side(other) == text


@pytest.mark.parametrize("name", ["humanoid_2d_9_full", "walker_7_main"])
def test_a_mirror_image_is_what_the_mirrored_robot_senses(name: str) -> None:
    """In a state whose left and right joints are swapped, each limb senses what the image shows of its counterpart."""
    robot = prepare(load(name))
    spec = robot.spec
    rng = np.random.default_rng(1)
    model = robot.simulation.model
    names = [model.joint(i).name for i in range(model.njnt)]
    place = [names.index(next(n for n in (other_side(own), own) if n in names)) for own in names]
    assert place != sorted(place)
    qpos = 0.1 * rng.standard_normal((1, model.nq)) + model.qpos0
    qvel = 0.1 * rng.standard_normal((1, model.nv))
    env = BatchEnv([robot.simulation], [robot.task], 1, specs=[spec])
    own = env.set_state(0, qpos, qvel).copy()
    mirrored = env.set_state(0, qpos[:, place], qvel[:, place]).copy()
    image = mirror_image(spec)
    column = {sensor.text: number for number, sensor in enumerate(spec.sensors)}
    order = [column[sensor.text] for sensor in image.sensors]
    shown = augmentation(name, mirror=True).image
    assert shown is not None
    seen = shown.observe(torch.from_numpy(own), None).numpy()
    moved = [sensor.frame == "world" for sensor in image.sensors]  # the shoulders' ranges differ from side to side
    np.testing.assert_allclose(seen[:, moved], mirrored[:, order][:, moved], atol=2e-5)
    assert np.abs(own - mirrored)[:, moved].max() > 1e-2


def test_the_actor_of_an_image_acts_as_that_of_the_mirrored_robot() -> None:
    name = "humanoid_2d_9_full"
    actor, _ = networks.networks(networks.small(), [name])
    made = augmentation(name, mirror=True)
    assert made.image is not None
    spec, image = networks.spec(name), mirror_image(networks.spec(name))
    obs, _ = networks.rows(made.layout)
    order = [[own.text for own in spec.sensors].index(other.text) for other in image.sensors]
    acts = [[own.text for own in spec.actuators].index(other.text) for other in image.actuators]
    mirrored = torch.empty_like(obs)
    mirrored[:, order] = obs
    with torch.no_grad():
        shown, direct = actor(obs, made.image.layout), actor(mirrored, made.layout)
    torch.testing.assert_close(shown, direct[:, acts], atol=1e-5, rtol=1e-4)


def test_rows_are_mirrored_before_they_are_standardized() -> None:
    raw, scale, shift = torch.tensor([[2.0, -3.0]]), torch.tensor([0.5, 2.0]), torch.tensor([0.25, -1.0])
    shown = Shown(networks.layout_of("limb-former", "hopper"), torch.tensor([1.0, -1.0]))
    seen = shown.observe(raw * scale + shift, shift)
    torch.testing.assert_close(seen, torch.tensor([[1.25, 5.0]]))


def test_half_of_the_draws_are_mirror_images() -> None:
    made = augmentation("walker_7_main", mirror=True)
    images = sum(shown.sign is not None for shown in draws(made, 200))
    assert 70 < images < 130


def test_robots_that_move_in_space_have_no_image() -> None:
    spec = networks.spec("quadruped")
    assert mirror_image(spec) is spec


@pytest.mark.parametrize("kernels", [True, False])
def test_a_hidden_limb_is_unseen_by_the_others_only(kernels: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not kernels:
        monkeypatch.setattr(TransformerLayer, "suits_kernel", lambda *_: False)
    actor, _ = networks.networks(networks.small(d_model=32, heads=2, feedforward=32), ["walker_7_main", "hopper"])
    made = augmentation("walker_7_main", "hopper", limb_dropout=0.3)
    shown = next(s for s in draws(made) if 0 < (s.layout.relation[:7, :7] == FOREIGN).any(0).sum() < 6).layout
    hidden = (shown.relation[:7, :7] == FOREIGN).any(0)
    assert (shown.relation.diagonal() != FOREIGN).all()
    obs, _ = networks.rows(shown)
    obs.requires_grad_()
    limb_of = torch.tensor(shown.specs[0].token_limb)
    for action, limb in enumerate(shown.action_limb[:6].tolist()):
        (gradient,) = torch.autograd.grad(actor(obs, shown)[:, action].sum(), obs)
        seen = gradient[:, : len(limb_of)].abs().sum(0)
        for other in range(7):
            assert bool(seen[limb_of == other].max() > 1e-12) == (other == limb or not hidden[other]), (limb, other)


def test_names_are_made_unsure_without_changing_the_layout() -> None:
    made = augmentation("hopper", name_noise=0.1)
    before = made.layout.embeddings.clone()
    one, other = draws(made, 2)
    assert torch.equal(made.layout.embeddings, before)
    assert 0.08 < float((one.layout.embeddings - before).std()) < 0.12
    assert not torch.equal(one.layout.embeddings, other.layout.embeddings)
    own = made.layout.with_embeddings(made.layout.embeddings)
    torch.testing.assert_close(own.limb_embeddings, made.layout.limb_embeddings)
    dropped = draws(augmentation("hopper", name_dropout=0.5), 20)
    shares = [float((shown.layout.embeddings == 0).all(1).float().mean()) for shown in dropped]
    assert 0.4 < np.mean(shares) < 0.6


def test_settings_that_a_method_cannot_follow_are_refused() -> None:
    check_augmentation(AugmentConfig(mirror=True), "anymorph", "residual")
    with pytest.raises(ConfigError, match="limb-former"):
        check_augmentation(AugmentConfig(limb_dropout=0.1), "anymorph", "frozen")
    with pytest.raises(ConfigError, match="not frozen"):
        check_augmentation(replace(AugmentConfig(), name_noise=0.1), "limb-former", "residual")
