"""What the commands share: results on stdout, everything else on stderr, files written in one step."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from morphkit.errors import OutputError

from .terminal import label, note, write_json

if TYPE_CHECKING:
    from morphkit.description import Description


PackageOption = Annotated[
    list[str] | None,
    typer.Option(
        "--package",
        metavar="NAME=DIR",
        help="Where a ROS package or Gazebo model lies that the file refers to; its files may be read. Goes before "
        "ROS_PACKAGE_PATH, AMENT_PREFIX_PATH and the folders around the file. Can be given several times.",
    ),
]


XacroArgOption = Annotated[
    list[str] | None,
    typer.Option(
        "--xacro-arg",
        metavar="NAME:=VALUE",
        help="Value of an argument of a .xacro file; others have their defaults. Can be given several times.",
    ),
]


RobotArgument = Annotated[str, typer.Argument(metavar="ROBOT", help="Name of a shipped robot, or a URDF or MJCF file.")]

RootOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="The top-level body to take, where the file has several.")
]

RunTaskOption = Annotated[str | None, typer.Option(help="Task of the robot.", show_default="as in the run")]

RunBaseOption = Annotated[
    Literal["planar", "free", "fixed"] | None,
    typer.Option(
        help="How the root is attached to the world, where the file leaves it open.", show_default="as in the run"
    ),
]

PolicyArgument = Annotated[
    Path, typer.Argument(metavar="RUN", help="Folder of a training run, or zoo:NAME (see morphkit zoo).")
]

CheckpointOption = Annotated[
    str,
    typer.Option(
        metavar="NAME", help="'latest'; 'best' on the validation bodies, see trainer.keep; or the name of one."
    ),
]

EncoderOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME_OR_FOLDER",
        help="Text encoder of the run, where it does not ship with morphkit: a folder, or a name on the Hugging Face "
        "hub. A run alone has none read or fetched.",
        show_default="the run's, if it ships or MORPHKIT_ENCODERS lists it",
    ),
]

TrackOption = Annotated[
    Literal["tensorboard", "wandb", "trackio"] | None,
    typer.Option("--track", help="Where to show it: TensorBoard, Weights & Biases or Trackio; the latter are extras."),
]

RayOption = Annotated[
    str | None,
    typer.Option(
        "--ray",
        metavar="[ADDRESS]",
        help="Run as tasks of the Ray cluster at HOST:PORT, ray://HOST:PORT or auto; without an address, of one that "
        "is started on this machine.",
        show_default=False,
    ),
]

CpusOption = Annotated[
    float, typer.Option(min=0.01, metavar="N", help="With --ray: cores of a node that each task takes.")
]

TrustXacroOption = Annotated[
    bool,
    typer.Option(
        "--trust-xacro",
        help="Let .xacro files do what only those you trust may: read any file and the environment, and run any code.",
    ),
]


def xacro_arguments(options: Sequence[str] | None, *targets: str) -> dict[str, dict[str, str]]:
    """What each of `targets` is to be read with: the arguments for a xacro file, nothing for another.

    Raises:
        ConfigError: An option is not of the form NAME:=VALUE.
        UsageError: There are arguments, and none of the targets is a xacro file.
    """
    from morphkit.formats.xacro import parse_arguments
    from morphkit.registry import is_xacro

    arguments = parse_arguments(options or ())
    if arguments and not any(map(is_xacro, targets)):
        raise UsageError(f"--xacro-arg is for .xacro files; {', '.join(targets)} is none.")
    return {target: arguments if is_xacro(target) else {} for target in targets}


class UsageError(typer.BadParameter):
    """Arguments that make no sense together."""

    def format_message(self) -> str:
        """The message as it is, without Typer's `Invalid value`."""
        return self.message


def complain(message: str) -> None:
    """Print an error on stderr."""
    label("error:", "red")
    note(f" {message}")


def output_format(asked: str | None, default: str, *, as_json: bool) -> str:
    """What a command prints, of whose --format `json` has --json as another name.

    Raises:
        UsageError: --json, and another format.
    """
    if as_json and asked not in (None, "json"):
        raise UsageError(f"only one of json and {asked} can be printed.")
    return "json" if as_json else asked or default


def print_json(value: Any) -> None:
    """Print `value` on stdout as JSON, with two spaces of indentation; infinite and undefined numbers become null."""
    write_json(json.dumps(_finite(value), indent=2, allow_nan=False) + "\n")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return value


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` in one step, so that no half-written file is left.

    Raises:
        OutputError: The folder does not exist, or the file cannot be written there.
    """
    from morphkit.utils import atomic_write

    if path.is_dir():
        raise OutputError(f"{path} is a folder; --output takes the name of a file.")
    try:
        atomic_write.write_text(path, text)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror or error}.") from error


def count(number: int, singular: str) -> str:
    """`1 limb`, `7 limbs`, `4 bodies`."""
    plural = f"{singular[:-1]}ies" if singular.endswith("y") else f"{singular}s"
    return f"{number} {singular if number == 1 else plural}"


def duration(seconds: float) -> str:
    """`45 s`, `3 min 20 s`, `2 h 05 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def load_robots(
    *robots: str,
    root: str | None,
    package: Sequence[str] | None,
    xacro_arg: Sequence[str] | None,
    trust_xacro: bool = False,
) -> list[Description]:
    """Load each of `robots` as `morphkit.registry.load` does, with the options of a command."""
    from morphkit.formats.packages import parse_packages
    from morphkit.registry import load

    packages = parse_packages(package or ())
    arguments = xacro_arguments(xacro_arg, *robots)
    loaded = {
        robot: load(robot, root=root, packages=packages, xacro_args=arguments[robot], trust_xacro=trust_xacro)
        for robot in dict.fromkeys(robots)
    }
    return [loaded[robot] for robot in robots]


def load_bodies(
    targets: Sequence[str], xacro_args: Sequence[str] | None = None, *, trust_xacro: bool = False
) -> list[Description]:
    """Load every body that the targets name: shipped robots, files, folders of files and manifests.

    Args:
        targets: What to load.
        xacro_args: NAME:=VALUE arguments of those that are xacro files.
        trust_xacro: Whether those may do all that the library lets them do.

    Raises:
        UnknownNameError: Two different bodies have one name, so that results could not tell them apart.
    """
    from morphkit.errors import UnknownNameError
    from morphkit.registry import load_all

    bodies: dict[str, Description] = {}
    for target, arguments in xacro_arguments(xacro_args, *targets).items():
        for description in load_all(target, xacro_args=arguments, trust_xacro=trust_xacro):
            known = bodies.setdefault(description.name, description)
            if _differ(known, description):
                raise UnknownNameError(
                    f"two different bodies are called {description.name}; the second is in {target}. "
                    "Rename one of the files, or give morphkit ablate a --name."
                )
    return list(bodies.values())


def _differ(one: Description, other: Description) -> bool:
    """Whether two bodies are different, in what their files say or in files that these name next to them."""
    if one.source != other.source:
        return True
    apart = (one.folder and one.folder.resolve()) != (other.folder and other.folder.resolve())
    return apart and b"file" in one.source  # every attribute that names a file has that in its name
