"""A robot in the browser: sliders for its joints, and a click on a limb that removes it."""

from __future__ import annotations

import contextlib
import io
import secrets
import shlex
import socket
import threading
from collections.abc import Callable, Sequence
from typing import Any

from morphkit.ablation.ablate import Variant, ablate
from morphkit.description import Description
from morphkit.errors import ConfigError, DependencyError, MorphkitError
from morphkit.simulation.inspection_model import Mechanics, load_mechanics
from morphkit.simulation.limb_inertia import limb_masses
from morphkit.viewer.joint_sliders import Dial, dials, pose
from morphkit.viewer.web_markdown import fenced, plain_text
from morphkit.viewer.web_origins import own_pages_only, unprinted
from morphkit.viewer.web_scene import RobotScene

HOST = "127.0.0.1"
_PORTS = 100  # How many to try where any will do.
_SHOWN_LOSSES = 4
_NO_LIMB = "choose a limb"
_UNITS = {"°": "°", "m": " m"}


def serve(
    description: Description,
    *,
    command: Sequence[str],
    port: int,
    search: bool,
    ready: Callable[[str], None],
    note: Callable[[str], None],
) -> None:
    """Show a robot in the browser until the process is interrupted. Only pages from this machine with the token in
    the address can connect.

    Args:
        description: The robot.
        command: The command line that cuts it, up to its options, for showing what makes a variant.
        port: Where to listen.
        search: Whether one of the ports that follow will do where `port` is taken.
        ready: Called with the address as soon as a browser can connect.
        note: Called with a sentence for everything in the file that cannot be shown.

    Raises:
        DependencyError: viser is not installed.
        ConfigError: The port is taken.
        DescriptionError: The robot cannot be read.
    """
    _import_viser()
    port = _free_port(port, search=search)
    viewer = BrowserViewer(description, command=command, port=port)
    try:
        for text in viewer.notes:
            note(text)
        ready(viewer.url)
        threading.Event().wait()
    except KeyboardInterrupt:
        pass
    finally:
        viewer.close()


class BrowserViewer:
    """The robot, what was removed from it, and the panel next to it; the same for all browsers that look at it.

    Args:
        description: The robot.
        command: The command line that cuts it, up to its options.
        port: Where to listen, on the loopback interface.

    Raises:
        DependencyError: viser is not installed.
        DescriptionError: The robot cannot be read.
    """

    def __init__(self, description: Description, *, command: Sequence[str], port: int) -> None:
        viser = _import_viser()
        self._source = description
        self._command = list(command)
        self._whole = load_mechanics(description)
        self._mechanics = self._whole
        self._removed: list[str] = []
        self._lock = threading.RLock()
        self._token = secrets.token_urlsafe(24)
        with _silence(), own_pages_only(self._token):
            self._server = viser.ViserServer(host=HOST, port=port, label="morphkit", verbose=False)
        self._scene = RobotScene(self._server, self.remove)
        self._scene.set_up(self._whole, pose(self._whole, {}))
        self._build_panel()
        self._refresh(None)

    @property
    def url(self) -> str:
        """Address for the browser, with the token that lets it in."""
        return f"http://{HOST}:{self._server.get_port()}/?token={self._token}"

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence for everything in the file that cannot be shown."""
        return self._whole.notes

    @property
    def removed(self) -> tuple[str, ...]:
        """Limbs and links that were removed, in that order."""
        return tuple(self._removed)

    def remove(self, name: str) -> None:
        """Remove a limb, or a link fixed to one, with everything below it."""
        with self._lock:
            if name not in self._removed:
                self._change([*self._removed, name])

    def undo(self) -> None:
        """Bring back what was removed last."""
        with self._lock:
            self._change(self._removed[:-1])

    def reset(self) -> None:
        """Bring back everything that was removed."""
        with self._lock:
            self._change([])

    def close(self) -> None:
        """Close the connections to all browsers and stop listening."""
        with _silence():
            self._server.stop()

    def command_line(self) -> str:
        """The command that makes the variant on show, an option a line; empty while nothing is removed."""
        if not self._removed:
            return ""
        options = [shlex.join(["--remove", name]) for name in self._topmost()]
        return " \\\n  ".join([shlex.join(self._command), *options])

    def _topmost(self) -> list[str]:
        """What was removed, without limbs that went with another one anyway."""
        robot = self._whole.morphology
        limbs = {limb.name for limb in robot.limbs}
        below = {
            lower.name for name in self._removed if name in limbs for lower in robot.subtree(name) if lower.name != name
        }
        return [name for name in self._removed if name not in below]

    def _change(self, removed: list[str]) -> None:
        """Show the robot without `removed`; a cut that cannot be made is explained and leaves everything as it was."""
        try:
            variant = ablate(self._source, remove=removed) if removed else None
            mechanics = load_mechanics(variant.description) if variant is not None else self._whole
        except MorphkitError as error:
            for client in self._server.get_clients().values():
                client.add_notification("Not possible", str(error), color="red", auto_close_seconds=6)
            return
        self._removed, self._mechanics = removed, mechanics
        self._refresh(variant)

    def _build_panel(self) -> None:
        gui = self._server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", brand_color=(214, 92, 38))
        self._title = gui.add_markdown("")
        with gui.add_folder("Variant"):
            self._story = gui.add_markdown("")
            self._undo = gui.add_button("Undo", hint="Bring back what was removed last", icon="arrow-back-up")
            self._reset = gui.add_button("Reset", hint="Bring back everything", icon="refresh")
            self._choice = gui.add_dropdown("Remove", (_NO_LIMB,), hint="For limbs that are hard to click on")
        self._undo.on_click(unprinted(lambda _: self.undo()))
        self._reset.on_click(unprinted(lambda _: self.reset()))
        self._choice.on_update(unprinted(self._chosen))
        self._joints = gui.add_folder("Joints")
        with self._joints:
            rest = gui.add_button("Start pose", hint="Put all joints back", icon="home")
        rest.on_click(unprinted(lambda _: self._rest()))
        self._sliders: dict[str, Any] = {}

    def _chosen(self, event: Any) -> None:
        name = event.target.value
        if name != _NO_LIMB:
            self.remove(name)

    def _rest(self) -> None:
        with self._lock:
            for dial in dials(self._mechanics):
                self._sliders[dial.name].value = _rounded(dial, dial.start)
            self._move()

    def _refresh(self, variant: Variant | None) -> None:
        """Bring scene and panel up to date with what is removed."""
        moving = dials(self._mechanics)
        shown = {dial.name for dial in moving}
        for dial in moving:
            if dial.name not in self._sliders:
                self._sliders[dial.name] = self._add_slider(dial)
        for name, slider in self._sliders.items():
            slider.visible = name in shown
        self._joints.visible = bool(moving)
        self._title.content = _title(self._mechanics)
        self._story.content = self._describe(variant)
        self._undo.disabled = self._reset.disabled = not self._removed
        members = [member for limb in self._mechanics.morphology.limbs for member in limb.members]
        self._choice.options = (_NO_LIMB, *members[1:])
        self._choice.value = _NO_LIMB
        self._scene.show(self._mechanics)
        self._move()

    def _add_slider(self, dial: Dial) -> Any:
        step = 0.1 if dial.unit == "°" else 0.001
        with self._joints:
            low, high = _rounded(dial, dial.low), _rounded(dial, dial.high)
            slider = self._server.gui.add_slider(
                dial.name,
                min=low,
                max=high,
                step=step,
                marks=tuple((end, f"{end:g}{_UNITS[dial.unit]}") for end in (low, high)),
                initial_value=_rounded(dial, dial.start),
                hint=f"moves {dial.limb}",
            )
        slider.on_update(unprinted(lambda _: self._move()))
        return slider

    def _move(self) -> None:
        with self._lock:
            values = {name: float(slider.value) for name, slider in self._sliders.items()}
            self._scene.move(pose(self._mechanics, values))

    def _describe(self, variant: Variant | None) -> str:
        if variant is None:
            return "Click on a limb to remove it with everything below it."
        lines = [f"Removed: **{plain_text(', '.join(variant.removed))}**", fenced(self.command_line())]
        if variant.lost:
            lines.append(f"Lost with it: {len(variant.lost)}")
            lines.append("\n".join(f"- {loss.kind} {plain_text(loss.name)}" for loss in variant.lost[:_SHOWN_LOSSES]))
            if len(variant.lost) > _SHOWN_LOSSES:
                lines.append(f"and {len(variant.lost) - _SHOWN_LOSSES} more")
        return "\n\n".join(lines)


def _title(mechanics: Mechanics) -> str:
    robot = mechanics.morphology
    masses = [mass.mass for mass in limb_masses(mechanics).values() if mass is not None]
    parts = (("limb", robot.limbs), ("joint", robot.joints), ("actuator", robot.actuators))
    numbers = [f"{len(some)} {what}{'' if len(some) == 1 else 's'}" for what, some in parts]
    return f"### {plain_text(robot.name)}\n{' · '.join(numbers)} · {sum(masses):.4g} kg"


def _rounded(dial: Dial, value: float) -> float:
    return round(value, 1 if dial.unit == "°" else 3)


def _free_port(port: int, *, search: bool) -> int:
    last = min(port + (_PORTS if search else 1), 65536)
    for candidate in range(port, last):
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((HOST, candidate))
            except OSError:
                continue
            return candidate
    where = f"port {port} is" if not search else f"ports {port} to {last - 1} are"
    raise ConfigError(f"{where} taken or not allowed; choose another with --port N")


def _silence() -> contextlib.AbstractContextManager[object]:
    """Keep viser's greetings off stdout, which is for results."""
    return contextlib.redirect_stdout(io.StringIO())


def _import_viser() -> Any:
    try:
        import viser
    except ImportError as error:
        raise DependencyError(f'the browser view needs viser: pip install "morphkit[viewer]" ({error})') from None
    return viser
