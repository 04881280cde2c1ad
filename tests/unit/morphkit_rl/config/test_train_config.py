"""Training settings."""

from __future__ import annotations

import dataclasses
import json

import pytest

from morphkit.errors import ConfigError, UnknownNameError
from morphkit_rl.config.methods import method_names
from morphkit_rl.config.train_config import TrainConfig, load_config, presets


def test_every_preset_loads() -> None:
    assert "default" in presets()
    for name in presets():
        assert isinstance(load_config(name), TrainConfig)


def test_the_default_before_november_2026_is_kept_as_a_preset() -> None:
    kept = load_config("limb-former-2026-11")
    assert kept == dataclasses.replace(TrainConfig(), model=kept.model)
    assert (kept.td3.batch_size, kept.td3.learning_rate, kept.td3.tau) == (252, 6e-4, 0.02)
    assert (kept.learner.critic, kept.trainer.num_envs, kept.trainer.updates_per_sweep) == ("method", 8, 4)


STUDY = {  # Appendix II of the study, and the baseline runs of the AnyMorph project
    "td3": {
        "batch_size": 100, "discount": 0.99, "n_step": 1, "tau": 0.046, "policy_delay": 2, "target_noise": 0.2,
        "target_noise_clip": 0.5, "exploration_noise": 0.126, "reward_scale": 1.0,
    },
    "trainer": {
        "schedule": "rounds", "num_envs": 1, "start_steps": 0, "start_steps_per_robot": 10_000,
        "replay_capacity": 10_000_000, "normalize": False,
    },
}  # fmt: skip
TRANSFORMER = {"d_model": 128, "layers": 3, "heads": 2, "feedforward": 256, "conditioned": True}
OWN = {
    "ma-bert": ({**TRANSFORMER, "code_size": 96, "combine": "concat", "hidden": False}, 5e-5, 0.1),
    "anymorph": ({**TRANSFORMER, "code_size": 96, "token_size": 32, "hidden": False}, 5e-5, 0.1),
    "amorpheus": (TRANSFORMER, 1e-4, 0.1),
    "smp": ({"message_size": 32, "actor_messages": "both", "critic_messages": "both"}, 1e-4, 0.0),
}


def test_every_published_method_has_a_paper_and_a_quick_preset() -> None:
    assert set(OWN) == set(method_names()) - {"limb-former"}
    for method in OWN:
        assert load_config(f"{method}-quick").model.method == method


@pytest.mark.parametrize("method", OWN)
def test_paper_presets_are_the_published_hyperparameters(method: str) -> None:
    config = load_config(f"{method}-paper").to_dict()
    model, learning_rate, gradient_clip = OWN[method]
    expected = {
        "model": {"method": method, **model},
        "td3": {**STUDY["td3"], "learning_rate": learning_rate, "gradient_clip": gradient_clip},
        "trainer": STUDY["trainer"],
    }
    for section, values in expected.items():
        assert {name: config[section][name] for name in values} == values
    if method == "ma-bert":
        text = {"encoder": "bert-base-uncased", "pooling": "cls", "style": "raw", "standardize": False}
        assert {name: config["text"][name] for name in text} == text


def test_overrides_change_one_setting() -> None:
    base, changed = load_config(), load_config(overrides=["td3.tau=0.5", "text.encoder=bert-base-uncased"])
    assert changed.td3.tau == 0.5
    assert changed.text.encoder == "bert-base-uncased"
    assert dataclasses.replace(changed.td3, tau=base.td3.tau) == base.td3


def test_round_trip_through_a_dict() -> None:
    config = load_config(overrides=["model.layers=1"])
    assert TrainConfig.from_dict(config.to_dict(), origin="test") == config


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("td3.taux=0.1", "did you mean 'tau'"),
        ("tdd3.tau=0.1", "did you mean 'td3'"),
        ("td3.tau=fast", "expected float"),
        ("td3.tau=-1", "from 0 to 1"),
        ("td3.tau=1.5", "from 0 to 1"),
        ("td3.discount=2", "from 0 to 1"),
        ("td3.batch_size=0", "at least 1"),
        ("td3.batch_size=1.5", "expected int"),
        ("td3.batch_size=true", "expected int"),
        ("td3.learning_rate=nan", "expected a number"),
        ("text.pooling=max", "expected one of default, mean, cls"),
        ("trainer.sensors=3", "expected a list of strings"),
        ("trainer.sensors=[1, 2]", "expected a list of strings"),
        ("learner.critic=linear", "expected one of method, perceptron"),
        ("learner.final_learning_rate=1.5", "from 0 to 1"),
        ("learner.critic_layers=0", "at least 1"),
        ("tau=0.1", "expected section.name=value"),
        ("td3.tau", "expected section.name=value"),
        ("td3=1", "expected section.name=value"),
    ],
)
def test_impossible_settings_are_refused(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(overrides=[override])


def test_a_preset_file_of_ones_own(tmp_path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[td3]\ntau = 0.25\n")
    assert load_config(path).td3.tau == 0.25
    for damaged in (b"[td3\n", b"\xff\xfe[td3]"):
        path.write_bytes(damaged)
        with pytest.raises(ConfigError, match="not valid TOML"):
            load_config(path)
    with pytest.raises(UnknownNameError, match="presets: "):
        load_config("defualt")


@pytest.mark.parametrize(
    ("text", "expected"),
    [("no_ltv", ("no_ltv",)), ("position, angle", ("position", "angle")), ('["angle"]', ("angle",)), ("[]", ())],
)
def test_a_list_of_words_and_its_way_through_json(text: str, expected: tuple[str, ...]) -> None:
    config = load_config(overrides=[f"trainer.sensors={text}"])
    assert config.trainer.sensors == expected
    saved = json.loads(json.dumps(config.to_dict()))
    assert saved == config.to_dict()
    assert TrainConfig.from_dict(saved, origin="saved") == config


@pytest.mark.parametrize(("robots", "envs"), [(1, 128), (3, 43), (8, 16), (14, 16)])
def test_few_robots_get_more_environments_each(robots: int, envs: int) -> None:
    config = load_config().for_robots(robots)
    assert config.trainer.num_envs == envs
    assert config.for_robots(robots) == config
    assert load_config("limb-former-2026-11").for_robots(robots).trainer.num_envs == 8
    assert load_config(overrides=["trainer.num_envs=4"]).for_robots(robots).trainer.num_envs == 4
