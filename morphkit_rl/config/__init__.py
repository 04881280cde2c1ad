"""Settings of a training run: dataclasses, TOML presets, and how they are read."""
