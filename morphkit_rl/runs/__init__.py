"""The folder of a training run: settings, checkpoints, replay, metrics, and its lock."""
