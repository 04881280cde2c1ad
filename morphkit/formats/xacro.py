"""xacro files into URDF, by the library of that name, in a process of its own with limits.

A xacro file is a program: its expressions are evaluated, and it can include files. The library forbids Python's
builtins, but only a file that one trusts should be expanded.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from morphkit.errors import ConfigError, DependencyError, DescriptionError, UnknownNameError
from morphkit.formats import xml
from morphkit.utils.suggest import did_you_mean

LIMIT_S = 30
LIMIT_BYTES = 2 * 1024**3
_UNKNOWN = 3
_NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})


def expand(path: Path, packages: Mapping[str, Path], arguments: Mapping[str, str] = _NO_ARGUMENTS) -> bytes:
    """Return the URDF that a `.xacro` file describes.

    `$(find name)` is looked for as in `package://name`. The library runs for 30 s and in 2 GiB at most.

    Args:
        path: The file.
        packages: Folder of each package that the user named.
        arguments: Values of the file's arguments, by name; others have their defaults.

    Raises:
        DependencyError: The library is not installed.
        DescriptionError: The file is larger than 64 MiB or cannot be expanded; the message is the library's.
        UnknownNameError: The file has no argument of such a name; the message lists those that it has.
    """
    if importlib.util.find_spec("xacro") is None:
        raise DependencyError(
            f"{path}: is a xacro file, and the library that expands it is not installed: pip install 'morphkit[xacro]'."
            f" Or expand it elsewhere: xacro {path.name} > {path.name.removesuffix('.xacro')}"
        )
    xml.read_limited(path)  # what is too large for a reader is too large for the library
    request = json.dumps([str(path), {name: str(folder) for name, folder in packages.items()}, {**arguments}])
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", "morphkit.formats.xacro", request],  # modules of the working folder stay out
            capture_output=True,
            timeout=LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise DescriptionError(f"{path}: expanding it took more than {LIMIT_S} s") from None
    if done.returncode:
        lines = done.stderr.decode(errors="replace").strip().splitlines()
        reason = lines[-1].removeprefix("error: ") if lines else f"the library ended with code {done.returncode}"
        if done.returncode == _UNKNOWN:
            raise UnknownNameError(f"{path}: {reason}")
        raise DescriptionError(f"{path}: cannot be expanded by xacro: {reason}")
    return done.stdout


def parse_arguments(options: Iterable[str]) -> dict[str, str]:
    """Return the values of `NAME:=VALUE` options by name; ConfigError where one has another form."""
    found = {}
    for option in options:
        name, assigned, value = option.partition(":=")
        if not assigned or not name.strip():
            raise ConfigError(f"--xacro-arg {option!r}: expected NAME:=VALUE, such as prefix:=left_")
        found[name.strip()] = value
    return found


class _UnknownArgumentError(Exception):
    pass


def _expand_here(path: Path, packages: Mapping[str, Path], arguments: Mapping[str, str]) -> str:
    """Expand in this process."""
    import xacro
    from xacro import substitution_args

    from morphkit.formats.packages import homes

    def find(name: str) -> str:
        tried = [home.path for home in homes(name, path.parent.resolve(), packages)]
        found = next((home for home in tried if home.is_dir()), None)
        if found is None:
            listed = ", ".join(map(str, tried)) or "no folder of that name around the robot"
            raise ValueError(f"package {name!r} not found; say where it is with --package {name}=DIR. Tried: {listed}")
        return str(found)

    substitution_args._eval_find = find
    substitution_args._eval_dict["find"] = find
    parse = xacro.parse

    def parse_plain(source: object, filename: str | None = None) -> object:
        if filename and b"<!DOCTYPE" in Path(filename).read_bytes():
            raise ValueError(f"{filename}: document type declarations are refused")
        document = parse(source, filename)
        for element in document.getElementsByTagName("xacro:arg"):
            known.setdefault(element.getAttribute("name"), element.getAttribute("default"))
        return document

    known: dict[str, str] = {}
    xacro.parse = parse_plain
    try:
        document = xacro.process_file(str(path), mappings=dict(arguments))
    except Exception:
        _refuse_unknown(arguments, known)  # this explains more than what came of it
        raise
    _refuse_unknown(arguments, known)
    return str(document.toprettyxml(indent="  "))


def _refuse_unknown(arguments: Iterable[str], known: Mapping[str, str]) -> None:
    listed = ", ".join(f"{name} (default {default!r})" for name, default in known.items())
    for name in arguments:
        if name not in known:
            has = f"its arguments: {listed}" if listed else "it has none"
            raise _UnknownArgumentError(f"has no argument {name!r}{did_you_mean(name, known)} ({has})")


def _limit_resources() -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT_S, LIMIT_S))


def main() -> None:
    """Expand what the first argument says and print it."""
    path, packages, arguments = json.loads(sys.argv[1])
    if os.name == "posix":
        _limit_resources()
    sys.stdout.reconfigure(encoding="utf-8")  # type: ignore[union-attr]
    try:
        print(_expand_here(Path(path), {name: Path(folder) for name, folder in packages.items()}, arguments))
    except MemoryError:
        sys.exit("error: it needs more than 2 GiB of memory")
    except _UnknownArgumentError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(_UNKNOWN)
    except Exception as error:
        cause = getattr(error, "exc", None) or error
        sys.exit(f"error: {' '.join(str(cause).split()) or type(cause).__name__}")


if __name__ == "__main__":
    main()
