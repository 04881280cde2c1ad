"""The errors that morphkit raises for a user's mistake; the command line prints them and exits with 2."""

from __future__ import annotations


class MorphkitError(Exception):
    """Something that the user can mend; the message says what, where and how."""


class DescriptionError(MorphkitError, ValueError):
    """A robot description file, a `robot.toml` or a manifest that cannot be read or makes no sense."""


class UnknownNameError(MorphkitError, LookupError):
    """A robot, limb, task, preset or variant that does not exist; the message lists what does."""


class AblationError(MorphkitError, ValueError):
    """A cut that cannot be made, such as removing the root."""


class AssetError(MorphkitError, FileNotFoundError):
    """A mesh, texture or included file that is needed and missing, or that lies outside the robot's folder."""


class OutputError(MorphkitError, OSError):
    """An output folder or file that cannot be written or must not be overwritten."""


class ConfigError(MorphkitError, ValueError):
    """A setting that does not exist or has an impossible value."""


class TrainingError(MorphkitError, ArithmeticError):
    """A training run whose numbers are no longer finite; the command line exits with 1."""


class CheckpointError(MorphkitError, ValueError):
    """A run folder or checkpoint that is missing, damaged or made for something else."""


class DependencyError(MorphkitError, ImportError):
    """An optional package, model file or system library that is missing; the message says how to get it."""
