"""OpenGL without a display, and what is said where it is missing."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from morphkit.errors import DependencyError
from morphkit.viewer import offscreen
from morphkit.viewer.render import model_frames
from tests.support.walking_box import box


def test_missing_opengl_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> None:
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(offscreen.importlib, "import_module", fail)
    with pytest.raises(DependencyError, match=r"(?s)eglQueryString.*apt-get install libegl1 libgl1-mesa-dri"):
        next(model_frames(box()))


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is the Linux way")
def test_a_machine_without_egl_drivers_gets_the_message_and_no_crash() -> None:
    code = (
        "import mujoco; from morphkit.viewer.render import model_frames\n"
        "from morphkit.errors import DependencyError\n"
        "try: next(model_frames(mujoco.MjModel.from_xml_string('<mujoco><worldbody><body/></worldbody></mujoco>')))\n"
        "except DependencyError as error: print(error)"
    )
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    environment["__EGL_VENDOR_LIBRARY_FILENAMES"] = "/dev/null"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "libegl1 libgl1-mesa-dri" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("gl")
def test_egl_is_found_without_a_display_even_after_mujoco_was_imported() -> None:
    code = (
        "import mujoco; from morphkit.viewer.render import model_frames; "
        "next(model_frames(mujoco.MjModel.from_xml_string('<mujoco><worldbody><body/></worldbody></mujoco>')))"
    )
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "MUJOCO_GL")}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, timeout=60)
