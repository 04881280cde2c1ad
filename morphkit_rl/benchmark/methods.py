"""From the name of a method to the settings that it is trained with."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.utils.suggest import did_you_mean
from morphkit_rl.benchmark.published import paper_settings
from morphkit_rl.config.methods import find_method, method_names
from morphkit_rl.config.train_config import TrainConfig, load_config, presets

EVALUATE_STEPS = 50_000
"""Counted steps between two noise-free evaluations of the training robots."""

_PAPER = "-paper"
_NO_TYPES = "-no-ltv"


def preset_of(method: str) -> str:
    """The preset of a method: `default` for limb-former, `ma-bert-paper` for ma-bert, a preset's own name for itself.

    `-no-ltv` behind a name is left out: it changes what is observed.

    Raises:
        UnknownNameError: There is neither such a method nor such a preset.
        ConfigError: A method of another package cannot be imported.
    """
    known = presets()
    method = method.removesuffix(_NO_TYPES)
    if method in method_names():
        return find_method(method).preset
    if method in known:
        return method
    names = sorted({*method_names(), *known})
    raise UnknownNameError(f"no method or preset {method!r}{did_you_mean(method, names)}; there is {', '.join(names)}")


def method_config(method: str, split: str, *, preset: str | None = None, overrides: Sequence[str] = ()) -> TrainConfig:
    """Settings of a method in a split.

    The paper presets take what the study sets by split, and a name with `-no-ltv` behind it observes no limb types, as
    in the study. Every run evaluates without noise every 50 000 steps. `overrides` go before all that.

    Args:
        method: Name of a method or of a preset.
        split: Name of the split.
        preset: Name or TOML file of a preset that goes before the method's own.
        overrides: Settings such as `td3.tau=0.01`.

    Raises:
        UnknownNameError: There is no such method or preset.
        ConfigError: A setting makes no sense, or the preset is one of another method.
    """
    name = preset_of(method) if preset is None else preset
    by_split = _settings_of_split(name, split) if name.endswith(_PAPER) else []
    without_types = ['trainer.sensors=["no_ltv"]'] if method.endswith(_NO_TYPES) else []
    fixed = [f"trainer.evaluate_steps={EVALUATE_STEPS}"]
    config = load_config(name, [*fixed, *by_split, *without_types, *overrides])
    base = method.removesuffix(_NO_TYPES)
    if base in method_names() and config.model.method != base:
        raise ConfigError(f"preset {name} is for method {config.model.method!r}, not for {base!r}")
    return config


def _settings_of_split(preset: str, split: str) -> list[str]:
    """What the study set in a split, but for settings that the preset's method does not have."""
    own = {f"model.{field.name}" for field in dataclasses.fields(load_config(preset).model)}
    keys = {text: text.partition("=")[0] for text in paper_settings(split)}
    return [text for text, key in keys.items() if key in own or not key.startswith("model.")]
