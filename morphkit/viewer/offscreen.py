"""Off-screen OpenGL for MuJoCo's renderer, with or without a display."""

from __future__ import annotations

import importlib
import os
import platform
from typing import Any

import numpy as np

from morphkit.errors import DependencyError

_BACKENDS = {"egl": "mujoco.egl", "glx": "mujoco.glfw", "glfw": "mujoco.glfw", "osmesa": "mujoco.osmesa"}


class OffscreenRenderer:
    """An off-screen OpenGL context and MuJoCo's renderer in it.

    Args:
        model: The MjModel whose meshes and textures are drawn; its `offwidth` and `offheight` are those below.
        width: Width of a picture, pixels.
        height: Height of a picture, pixels.

    Raises:
        DependencyError: No OpenGL; the message says which system packages to install.
    """

    def __init__(self, model: Any, width: int, height: int) -> None:
        import mujoco

        self._gl: Any = None
        self._renderer: Any = None
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._picture = np.empty((height, width, 3), dtype=np.uint8)
        self._gl = open_context(width, height)
        try:
            self._gl.make_current()
            self._renderer = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)
        except Exception as error:
            self.close()
            raise _no_opengl([f"{type(error).__name__}: {error}"]) from None

    def draw(self, scene: Any) -> np.ndarray:
        """Draw an MjvScene; returns uint8, shape (height, width, 3)."""
        import mujoco

        self._gl.make_current()
        mujoco.mjr_render(self._rectangle, scene, self._renderer)
        mujoco.mjr_readPixels(self._picture, None, self._rectangle, self._renderer)
        return np.ascontiguousarray(self._picture[::-1])  # OpenGL's rows start at the bottom.

    def close(self) -> None:
        """Give the context back; the renderer is of no use afterwards."""
        if self._renderer is not None:
            self._renderer.free()
            self._renderer = None
        if self._gl is not None:
            self._gl.free()
            self._gl = None


def open_context(width: int, height: int) -> Any:
    """Open an off-screen OpenGL context.

    `MUJOCO_GL` chooses the way where it is set. Else EGL is tried first on Linux: it needs no display.

    Raises:
        DependencyError: No way works; the message says which system packages to install.
    """
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if chosen in _BACKENDS:
        modules = [_BACKENDS[chosen]]
    elif platform.system() == "Linux":
        display = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        modules = ["mujoco.egl", *(["mujoco.glfw"] if display else [])]
    else:
        modules = ["mujoco.cgl", "mujoco.glfw"] if platform.system() == "Darwin" else ["mujoco.glfw"]
    reasons = []
    for module in modules:
        try:
            return importlib.import_module(module).GLContext(width, height)
        except Exception as error:  # Missing libraries show as ImportError, AttributeError, OSError, RuntimeError, ...
            reasons.append(f"{module}: {error}".split("\n")[0][:200])
    raise _no_opengl(reasons)


def _no_opengl(reasons: list[str]) -> DependencyError:
    return DependencyError(
        f"no OpenGL to draw pictures with ({'; '.join(reasons)}). On Debian or Ubuntu: "
        "apt-get install libegl1 libgl1-mesa-dri (works without a graphics card or display); "
        "leave MUJOCO_GL unset or set MUJOCO_GL=egl"
    )
