"""`morphkit show`: a robot for the eyes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import common
from .terminal import note, write

if TYPE_CHECKING:
    from morphkit.description import Description

DEFAULT_PORT = 8080

EXAMPLES = (
    "morphkit show quadruped",
    "morphkit show my_robot.urdf --png robot.png --gif joints.gif",
    "morphkit show my_robot.urdf --web",
    "morphkit show zoo:cheetah-family",
)


def show(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            help="Name of a shipped robot, a URDF or MJCF file; or zoo:NAME, a policy, for its model card.",
        ),
    ],
    png: Annotated[
        Path | None, typer.Option("--png", metavar="FILE", help="Draw the robot in its start pose into a .png.")
    ] = None,
    gif: Annotated[
        Path | None,
        typer.Option("--gif", metavar="FILE", help="Film its joints, one after the other, into a .gif or .mp4."),
    ] = None,
    web: Annotated[
        bool,
        typer.Option("--web", help="Show it in the browser: sliders move joints, a click on a limb removes it."),
    ] = False,
    port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, metavar="N", help="With --web: port on this machine.", show_default="8080"),
    ] = None,
    root: common.RootOption = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
) -> None:
    """Show a robot: as a tree in the terminal, as a picture, as a film of its joints, or in the browser.

    The tree has limbs with their masses, what is fixed to them, joints with their ranges, and actuators. --web listens
    on this machine only and ends with Ctrl-C.
    """
    if port is not None and not web:
        raise common.UsageError("--port belongs to --web.")
    if robot.startswith("zoo:"):
        if png is not None or gif is not None or web:
            raise common.UsageError(f"{robot} is a policy, which has a card alone; morphkit evaluate films it.")
        _card(robot)
        return

    (description,) = common.load_robots(robot, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)
    if png is not None:
        _draw(description, png)
    if gif is not None:
        _film(description, gif)
    if web:
        _browse(description, robot, port, root)
    elif png is None and gif is None:
        _tree(description)


def _card(policy: str) -> None:
    from morphkit_rl.runs import saved_policy, zoo

    write(saved_policy.read_card(zoo.find(policy)))


def _tree(description: Description) -> None:
    from morphkit.simulation.inspection_model import base_joints, load_mechanics
    from morphkit.simulation.limb_inertia import limb_masses

    from .robot_tree import tree
    from .terminal import show as show_text

    mechanics = load_mechanics(description, shapes=False)
    _say(mechanics.notes)
    show_text(tree(mechanics.morphology, masses=limb_masses(mechanics), base_joints=base_joints(mechanics)))


def _draw(description: Description, path: Path) -> None:
    from morphkit.simulation.inspection_model import load_mechanics
    from morphkit.viewer.joint_sweep import portrait
    from morphkit.viewer.media import check_picture_path, write_png

    check_picture_path(path)
    mechanics = load_mechanics(description)
    _say(mechanics.notes)
    write_png(portrait(mechanics), path)
    note(f"picture: {path}")


def _film(description: Description, path: Path) -> None:
    from rich.console import Console
    from rich.progress import track

    from morphkit.simulation.inspection_model import load_mechanics
    from morphkit.viewer.joint_sweep import FPS, film, swing_shots
    from morphkit.viewer.media import check_video_path, write_video

    check_video_path(path)
    mechanics = load_mechanics(description)
    _say(mechanics.notes)
    shots = swing_shots(mechanics)
    console = Console(stderr=True)
    frames = track(
        film(mechanics, shots),
        "filming",
        total=len(shots),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
    write_video(frames, path, FPS)
    note(f"film: {path}")


def _browse(description: Description, robot: str, port: int | None, root: str | None) -> None:
    from morphkit.viewer.web import serve

    command = ["morphkit", "ablate", robot, *(["--root", root] if root else [])]
    serve(
        description,
        command=command,
        port=port if port is not None else DEFAULT_PORT,
        search=port is None,
        ready=lambda url: note(f"{url} shows {description.name}; Ctrl-C ends it"),
        note=lambda text: _say([text]),
    )


def _say(notes: list[str] | tuple[str, ...]) -> None:
    for text in notes:
        note(f"note: {text.splitlines()[0]}")
