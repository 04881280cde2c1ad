"""Where ROS packages and Gazebo models lie: named folders, the environment's, and those around the robot."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from morphkit.errors import ConfigError

MARKERS = ("package.xml", "model.config")
MESHES = frozenset({".stl", ".dae", ".obj", ".msh", ".ply", ".glb", ".gltf", ".off", ".3mf", ".stp", ".step"})
IMAGES = frozenset({".png", ".jpg", ".jpeg", ".bmp", ".tga", ".ktx", ".mtl"})
_LEFTOVER = re.compile(r"\$\(\s*(?:find|find-pkg-share)\s+([\w.-]+)\s*\)/?(.*)", re.DOTALL)
_NAMED = re.compile(r"(?:package|model):/*([^/]*)/?(.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Home:
    """A folder that may be a package.

    Attributes:
        path: The folder.
        trust: `named` by the user or the environment: links may lead out of it, as in workspaces built of links
            (`colcon build --symlink-install`). The robot's `own` folder or package: what is really inside. `near` the
            robot: only meshes and images that are really inside.
    """

    path: Path
    trust: Literal["named", "own", "near"]

    def allows(self, path: Path) -> bool:
        """Whether the file `path` may be read because it lies here.

        Raises:
            OSError: A name on the way is impossible.
            RuntimeError: Links form a ring.
        """
        real = path.resolve()
        if self.trust == "named" and Path(os.path.normpath(path)).is_relative_to(self.path):
            return True
        harmless = self.trust != "near" or real.suffix.lower() in MESHES | IMAGES
        return harmless and real.is_relative_to(self.path.resolve())


def split_reference(text: str) -> tuple[str, str] | None:
    """Return name and path of `package://name/path`, `model://...` or xacro's `$(find name)/path`; else None."""
    text = text.removeprefix("file://") if "$(" in text else text
    match = _NAMED.fullmatch(text) or _LEFTOVER.fullmatch(text)
    return (match[1], match[2]) if match else None


def homes(name: str, folder: Path, packages: Mapping[str, Path]) -> Iterator[Home]:
    """Yield the folders that may be package `name`, in the order in which they are tried.

    First `packages[name]`; then what `ROS_PACKAGE_PATH` (packages, or folders of packages, two levels deep at most)
    and `AMENT_PREFIX_PATH` (prefixes, with packages in `share`) say; then every folder above the robot that is called
    so; then the folders called so next to those above the robot.

    Args:
        name: Name of the package.
        folder: The robot's folder.
        packages: Folder of each package that the user named.
    """
    if name in packages:
        yield Home(packages[name], "named")
    if not name or name in (".", ".."):
        return
    for entry in _paths("ROS_PACKAGE_PATH"):
        near = [entry] if entry.name == name else []
        yield from (Home(path, "named") for path in (*near, entry / name, *_nested(entry, name)))
    for prefix in _paths("AMENT_PREFIX_PATH"):
        yield Home(prefix / "share" / name, "named")
    above = [folder, *folder.parents][:-1]
    around = [path for path in above if path.name == name] + [path / name for path in above[1:]]
    for path in around:
        if path.is_dir():
            yield Home(path, "own" if is_package(path) else "near")


def own_package(folder: Path) -> Path | None:
    """The nearest folder at or above the robot's that holds a `package.xml` or `model.config`; None without one."""
    return next((path for path in (folder, *folder.parents) if is_package(path)), None)


def is_package(path: Path) -> bool:
    """Whether `path` is the folder of a ROS package or Gazebo model."""
    return any((path / marker).is_file() for marker in MARKERS)


def parse_packages(options: Iterable[str]) -> dict[str, Path]:
    """Return the folders of `NAME=DIR` options.

    Raises:
        ConfigError: An option has another form, or its folder does not exist.
    """
    found = {}
    for option in options:
        name, equals, folder = option.partition("=")
        path = Path(os.path.expanduser(folder))  # noqa: PTH111 - leaves it as it is where there is no such home
        if not name or not equals or not folder:
            raise ConfigError(
                f"--package {option!r}: expected NAME=DIR, such as my_robot_description=~/ws/src/my_robot"
            )
        if not path.is_dir():
            raise ConfigError(f"--package {option!r}: there is no folder {path}")
        found[name] = path.resolve()
    return found


def _paths(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _nested(entry: Path, name: str) -> list[Path]:
    """Packages called `name` two levels below `entry`: those in a folder of several packages."""
    try:
        return sorted(path for path in entry.glob(f"*/{name}") if is_package(path)) if _plain(name) else []
    except OSError:
        return []


def _plain(name: str) -> bool:
    return re.fullmatch(r"[\w.-]+", name) is not None
