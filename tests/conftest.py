from __future__ import annotations

import os
import re
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from morphkit.description import Description


@pytest.hookimpl(trylast=True)
def pytest_configure() -> None:
    """Forget what a machine may have set: colors for a CI system's logs (pytest has set up its own by now) and ROS."""
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        os.environ.pop(name, None)


def _plain_spec(description: Description) -> mujoco.MjSpec:
    """A description through MuJoCo alone; a URDF with its fixed links and visuals kept."""
    text = re.sub(r"^\s*<\?xml.*?\?>", "", description.source.decode())
    if description.format == "urdf":
        end = text.index(">", text.index("<robot")) + 1
        options = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco>'
        text = text[:end] + options + text[end:]
    return mujoco.MjSpec.from_string(text)


def _differences(first: mujoco.MjModel, second: mujoco.MjModel) -> list[str]:
    """Names of the arrays, sizes and name tables in which two models differ."""
    found = []
    for name in (name for name in dir(first) if not name.startswith("_")):
        one, other = getattr(first, name), getattr(second, name)
        if isinstance(one, np.ndarray):
            if one.shape != other.shape or not np.allclose(one, other, rtol=0, atol=1e-12, equal_nan=True):
                found.append(name)
        elif isinstance(one, int | float | bytes) and one != other:
            found.append(name)
    return found


@pytest.fixture(scope="session")
def plain_spec() -> Callable[[Description], mujoco.MjSpec]:
    return _plain_spec


@pytest.fixture(scope="session")
def differences() -> Callable[[mujoco.MjModel, mujoco.MjModel], list[str]]:
    return _differences
