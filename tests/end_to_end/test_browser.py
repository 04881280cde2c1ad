"""`morphkit show --web` in a real browser, without a screen."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from .conftest import COMMAND, environment

pytest.importorskip("viser", reason="the extra `viewer` is not installed")
from .chrome import Chrome, find_chrome, wait_for

CHROME = find_chrome()
ROBOT = """
<mujoco>
  <worldbody>
    <body name="post">
      <geom type="box" size=".05 .05 .3" pos="0 0 .3" rgba="0 .2 1 1"/>
      <body name="it's red" pos="0 0 .6">
        <joint name="turn" type="hinge" axis="0 1 0" range="-100 100"/>
        <geom type="box" size=".08 .08 .2" pos="0 0 .25" rgba="1 0 0 1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="turn" joint="turn" ctrlrange="-1 1"/></actuator>
</mujoco>
"""


@dataclass
class Session:
    """A running `morphkit show --web` and a browser at its page."""

    chrome: Chrome
    url: str
    server: subprocess.Popen[str]

    def red(self) -> np.ndarray:
        """Pixels of the red limb: x and y, int, shape (n, 2)."""
        picture = self.chrome.picture().astype(int)
        red, green, blue = np.moveaxis(picture, -1, 0)
        y, x = np.nonzero((red > 120) & (green < red / 4) & (blue < red / 4))
        return np.stack([x, y], axis=1)

    def wait_for_red(self, accepted: Callable[[np.ndarray], bool], seconds: float = 40.0) -> np.ndarray:
        """Wait until the red limb is in sight and as it should be."""
        found: list[np.ndarray] = []

        def look() -> bool:
            found[:] = [self.red()]
            return len(found[0]) > 200 and bool(accepted(found[0]))

        wait_for(look, seconds)
        return found[0]


def start(robot: str, folder: Path) -> tuple[subprocess.Popen[str], str]:
    """Start the server, on whatever port is free; returns it and the address that it prints."""
    server = subprocess.Popen(
        [COMMAND, "show", robot, "--web"],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert server.stderr is not None
    line = server.stderr.readline()
    assert line.startswith("http://"), line + server.stderr.read()
    return server, line.split()[0]


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    if CHROME is None:
        pytest.skip("no browser is installed: apt-get install chromium")
    (tmp_path / "robot.xml").write_text(ROBOT)
    server, url = start("robot.xml", tmp_path)
    try:
        chrome = Chrome(CHROME, tmp_path / "profile")
        try:
            yield Session(chrome, url, server)
        finally:
            chrome.close()
    finally:
        server.kill()
        server.wait()


def test_sliders_move_joints_and_clicks_remove_limbs(session: Session) -> None:
    page = session.chrome
    page.open(session.url)
    wait_for(lambda: "Click on a limb" in page.text())
    before = session.wait_for_red(lambda _: True)

    # A slider moves the joint.
    wait_for(lambda: page.run("document.querySelector('[role=slider]') !== null"))
    page.run("document.querySelector('[role=slider]').focus()")
    page.press("End")
    moved = session.wait_for_red(lambda red: np.ptp(red[:, 0]) > 1.5 * np.ptp(before[:, 0]))

    # A click removes the limb, and the command that does it is shown.
    x, y = np.median(moved, axis=0)
    page.click(float(x), float(y))
    wait_for(lambda: "--remove" in page.text())
    text = " ".join(page.text().split())
    assert """morphkit ablate robot.xml \\ --remove 'it'"'"'s red'""" in text
    assert "1 limb · 0 joints · 0 actuators" in text
    wait_for(lambda: len(session.red()) == 0)

    # Undo brings it back, where the slider has it.
    page.run("[...document.querySelectorAll('button')].find(b => b.innerText.includes('Undo')).click()")
    session.wait_for_red(lambda red: np.abs(np.median(red, axis=0) - (x, y)).max() < 3)
    assert "--remove" not in page.text()

    # Nothing came from or went to another machine.
    schemes = {urlsplit(url).scheme for url in page.requested}
    assert {urlsplit(url).hostname for url in page.requested if not url.startswith(("data:", "blob:"))} == {"127.0.0.1"}
    assert schemes <= {"http", "ws", "data", "blob"}

    # Ctrl-C ends it without a word of complaint.
    session.server.send_signal(signal.SIGINT)
    out, err = session.server.communicate(timeout=40)
    assert session.server.returncode == 0
    assert (out, err) == ("", "")
