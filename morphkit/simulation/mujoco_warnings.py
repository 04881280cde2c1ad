"""MuJoCo without its warnings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco


@contextmanager
def no_warnings() -> Iterator[None]:
    """Keep MuJoCo from printing and from writing MUJOCO_LOG.TXT into the working folder at every diverging substep.

    For those who look for divergence themselves. A handler that somebody set with `mujoco.set_mju_user_warning` stays.
    """
    if mujoco.get_mju_user_warning() is not None:
        yield
        return
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(None)


def _ignore(warning: str) -> None:
    """Do nothing."""
