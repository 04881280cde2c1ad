"""Methods by name: their settings, and methods of other packages."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from morphkit.errors import ConfigError
from morphkit_rl.benchmark.methods import method_config, preset_of
from morphkit_rl.benchmark.report import figure_style
from morphkit_rl.config import methods
from morphkit_rl.config.methods import find_method, method_names
from morphkit_rl.config.train_config import TrainConfig, load_config, presets
from morphkit_rl.models import build

OTHER = '''
from dataclasses import dataclass

from morphkit_rl.config.methods import Method, ModelSettings
from morphkit_rl.config.parsing import bounded
from morphkit_rl.models import limb_former


@dataclass(frozen=True, slots=True)
class WideSettings(ModelSettings):
    """Sizes."""

    method: str = "wide"
    width: int = bounded(32, at_least=2, at_most=64)


def build(settings, embedding_size, vocabulary):
    sizes = limb_former.LimbFormerSettings(d_model=settings.width)
    return limb_former.build(sizes, embedding_size, vocabulary)


METHOD = Method(
    "wide", "Limb-Former by another name", "actuators", WideSettings, build, limb_former.check_robot, color="#123456"
)
ODD = "no method"
'''


@pytest.fixture
def other_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An installed package that adds the method `wide`, and others that cannot be used."""
    (tmp_path / "other_methods.py").write_text(OTHER)
    values = {"wide": "other_methods:METHOD", "odd": "other_methods:ODD", "gone": "no_such_module:METHOD", "smp": "x:Y"}
    about = tmp_path / "other_methods-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: other-methods\nVersion: 1.0\n")
    lines = [f"[{methods.GROUP}]", *(f"{name} = {value}" for name, value in values.items())]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    monkeypatch.syspath_prepend(tmp_path)
    find_method.cache_clear()
    yield
    find_method.cache_clear()
    sys.modules.pop("other_methods", None)


@pytest.mark.parametrize("name", method_names())
def test_every_method_has_settings_a_preset_and_a_style(name: str) -> None:
    method = find_method(name)
    assert method.name == name
    settings = method.settings(method=name)
    assert TrainConfig.from_dict({"model": dataclasses.asdict(settings)}, origin="x").model == settings
    assert method.preset in presets()
    assert load_config(method.preset).model.method == name
    assert figure_style.label(name) == method.label != ""
    assert figure_style.color(name, method_names()) == method.color != ""


def test_settings_of_another_method_are_refused_with_its_name() -> None:
    with pytest.raises(ConfigError, match=r"model\.message_size is a setting of smp, not of limb-former"):
        load_config(overrides=["model.message_size=3"])
    with pytest.raises(ConfigError, match=r"model\.code_size is a setting of ma-bert, anymorph, not of smp"):
        load_config("smp-paper", ["model.code_size=4"])
    with pytest.raises(ConfigError, match=r"unknown setting 'model\.d_modl'; did you mean 'd_model'"):
        load_config(overrides=["model.d_modl=3"])
    with pytest.raises(ConfigError, match="expected the name of a method"):
        load_config(overrides=["model.method=3"])


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("model.layers=0", "expected a number of at least 1"),
        ("td3.tau=1.5", "expected a number from 0 to 1"),
        ("td3.learning_rate=-1.0", "expected a number of at least 0"),
        ("td3.learning_rate=inf", "expected a number of at least 0"),
    ],
)
def test_bounds_stand_at_the_settings(override: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        load_config(overrides=[override])


@pytest.mark.usefixtures("other_package")
def test_another_package_adds_a_method() -> None:
    assert method_names()[-3:] == ("gone", "odd", "wide")
    config = load_config(overrides=["model.method=wide", "model.width=48"])
    assert config.to_dict()["model"] == {"method": "wide", "width": 48}
    actor, critic = build(config.model, 12)
    assert sum(parameter.numel() for parameter in actor.parameters()) > 1000
    assert critic is not None
    with pytest.raises(ConfigError, match=r"model\.width is 65; expected a number from 2 to 64"):
        load_config(overrides=["model.method=wide", "model.width=65"])
    assert preset_of("wide") == "default"
    assert (
        method_config("wide", "1", overrides=["model.method=wide"]).model
        == load_config(overrides=["model.method=wide"]).model
    )
    assert figure_style.color("wide", ["wide"]) == "#123456"


@pytest.mark.usefixtures("other_package")
def test_a_package_that_cannot_be_used_spoils_no_message_about_a_setting() -> None:
    with pytest.raises(ConfigError, match=r"model\.message_size is a setting of smp, not of limb-former"):
        load_config(overrides=["model.message_size=3"])
    with pytest.raises(ConfigError, match=r"unknown setting 'model\.d_modl'; did you mean 'd_model'"):
        load_config(overrides=["model.d_modl=3"])


@pytest.mark.usefixtures("other_package")
def test_methods_of_other_packages_that_cannot_be_used_are_explained() -> None:
    with pytest.raises(ConfigError, match="'gone': no_such_module:METHOD cannot be imported"):
        find_method("gone")
    with pytest.raises(ConfigError, match="'odd': other_methods:ODD is no Method"):
        find_method("odd")
    assert find_method("smp").label == "SMP"
