"""What a xacro file that nobody vouches for may read: files of its own packages. Its process asks, this one reads."""

from __future__ import annotations

import base64
import fnmatch
import os
import posixpath
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from morphkit.errors import DescriptionError
from morphkit.formats import xml
from morphkit.formats.packages import Home, homes, own_package

_XACRO = frozenset({".xacro", ".urdf"})


class Access:
    """Answers what the process asks that expands a file.

    Args:
        path: The file.
        packages: Folder of each package that the user named.
    """

    def __init__(self, path: Path, packages: Mapping[str, Path]) -> None:
        self._path = path
        self._packages = packages
        self._folder = path.parent.resolve()
        self._homes = [Home(folder, "named") for folder in packages.values()]
        for folder in dict.fromkeys((self._folder, path.resolve().parent)):
            own = own_package(folder)
            self._homes += [Home(folder, "own"), *([Home(own, "own")] if own else [])]
            if own:  # the same package as ROS knows it may consist of links
                known = homes(own.name, folder, packages)
                self._homes += [home for home in known if home.trust == "named" and folder.is_relative_to(home.path)]

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """Answer `{"open": name}`, `{"list": pattern}`, `{"find": package}` or `{"environment": variable}`.

        Returns:
            `content` (base64), `names`, `path` or `set`; else `refused`, `missing` or `problem`: why not.
        """
        ((kind, value),) = question.items()
        if not isinstance(value, str) or "\0" in value:
            return {"problem": f"impossible name {value!r}"}
        if kind == "open":
            return self._open(value)
        if kind == "list":
            return self._list(value)
        if kind == "find":
            return self.find(value)
        return {"set": value in os.environ}

    def find(self, name: str) -> dict[str, Any]:
        """The folder of a package, as `package://` would find it."""
        tried = list(homes(name, self._folder, self._packages))
        found = next((home for home in tried if home.path.is_dir()), None)
        if found is None:
            listed = ", ".join(str(home.path) for home in tried) or "no folder of that name around the robot"
            advice = f"say where it is with --package {name}=DIR"
            return {"problem": f"package {name!r} not found; {advice}. Tried: {listed}"}
        self._homes.append(found)
        return {"path": str(found.path)}

    def _open(self, name: str) -> dict[str, Any]:
        path = self._folder / name
        try:
            if path != self._folder / self._path.name and not self._allows(path):
                return {"refused": f"{name}, a file outside of its packages (--package NAME=DIR adds one),"}
            if path.exists() and not path.is_file():
                return {"problem": f"{name} is no regular file"}
            return {"content": base64.b64encode(xml.read_limited(path)).decode()}
        except DescriptionError as error:
            return {"problem": str(error)}
        except (OSError, RuntimeError) as error:
            return {"missing": getattr(error, "strerror", None) or "links form a ring"}

    def _list(self, pattern: str) -> dict[str, Any]:
        head, tail = posixpath.split(pattern)
        if any(sign in head for sign in "*?["):
            return {"refused": f"{pattern}, a pattern with wildcards in its folders,"}
        try:
            names = sorted(fnmatch.filter([path.name for path in (self._folder / head).iterdir()], tail))
            found = [posixpath.join(head, name) for name in names if not name.startswith(".") or tail.startswith(".")]
            return {"names": [name for name in found if self._allows(self._folder / name)]}
        except (OSError, RuntimeError):
            return {"names": []}

    def _allows(self, path: Path) -> bool:
        """Whether the file may be read; in a folder that is only near the robot, what xacro reads as XML."""
        real = path.resolve()
        near = [home.path.resolve() for home in self._homes if home.trust == "near" and real.suffix in _XACRO]
        return any(home.allows(path) for home in self._homes) or any(real.is_relative_to(folder) for folder in near)
