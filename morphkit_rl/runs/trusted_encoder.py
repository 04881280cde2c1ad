"""Which text encoder a run may use: nothing is read or fetched because a run says so."""

from __future__ import annotations

import os
import shlex
from dataclasses import replace
from pathlib import Path

from morphkit.errors import ConfigError
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.runs.run_folder import CONFIG
from morphkit_rl.text.model_files import SHIPPED

TRUSTED_ENCODERS = "MORPHKIT_ENCODERS"


def with_encoder(config: TrainConfig, run: Path, chosen: str | None) -> TrainConfig:
    """Settings of a run with a text encoder that the user trusts.

    A run may be somebody else's, and the encoder that its `config.json` names a folder, or a model that is fetched.

    Args:
        config: Settings of the run.
        run: The run folder.
        chosen: The user's encoder, which takes the place of the run's; None: the run's own, where it ships with
            morphkit or is one of those, separated by commas, in `$MORPHKIT_ENCODERS`.

    Raises:
        ConfigError: There is none that the user trusts.
    """
    name = config.text.encoder
    trusted = {SHIPPED, *(each.strip() for each in os.environ.get(TRUSTED_ENCODERS, "").split(","))} - {""}
    if chosen is not None:
        return replace(config, text=replace(config.text, encoder=chosen))
    if name in trusted:
        return config
    raise ConfigError(
        f"{run / CONFIG}: the run's text encoder {name!r} does not ship with morphkit, and nothing is read or fetched "
        f"because a run says so. Where you trust it, give --encoder {shlex.quote(name)}, or a folder that holds it, "
        f"or list it in the environment variable {TRUSTED_ENCODERS}"
    )
