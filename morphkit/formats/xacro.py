"""xacro files into URDF, by the library of that name, in a process of its own that can do little else.

A xacro file is a program: its expressions are evaluated, and it can include files.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from morphkit.errors import ConfigError, DependencyError, DescriptionError, UnknownNameError
from morphkit.formats import xml
from morphkit.formats.xacro_access import Access

LIMIT_S = 30
LIMIT_BYTES = 2 * 1024**3
_KEPT = ("PYTHONPATH", "PYTHONHOME", "PYTHONUSERBASE", "LD_LIBRARY_PATH", "SYSTEMROOT", "LANG", "LC_ALL")
_NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})


def expand(
    path: Path,
    packages: Mapping[str, Path],
    arguments: Mapping[str, str] = _NO_ARGUMENTS,
    *,
    trusted: bool = False,
) -> bytes:
    """Return the URDF that a `.xacro` file describes.

    `$(find name)` is looked for as in `package://name`. The library runs for 30 s and in 2 GiB at most. Unless the file
    is trusted, its process has no secrets in its environment and reads only what `Access` allows; on Linux the kernel
    sees to it that it does nothing else (`confine`).

    Args:
        path: The file.
        packages: Folder of each package that the user named.
        arguments: Values of the file's arguments, by name; others have their defaults.
        trusted: Whether the file may do all that the library lets it do.

    Raises:
        DependencyError: The library is not installed.
        DescriptionError: The file is larger than 64 MiB, cannot be expanded (the message is the library's), or does
            what only a trusted file may do.
        UnknownNameError: The file has no argument of such a name; the message lists those that it has.
    """
    _check_libraries(path)
    xml.read_limited(path)  # what is too large for a reader is too large for the library
    access = Access(path, packages)
    request = {
        "file": str(path) if trusted else path.name,
        "arguments": {**arguments},
        "trusted": trusted,
        "seconds": LIMIT_S,
        "memory": LIMIT_BYTES,
    }
    environment = None if trusted else {name: os.environ[name] for name in _KEPT if name in os.environ}
    result = _converse(request, access, environment)
    if "unknown" in result:
        raise UnknownNameError(f"{path}: {result['unknown']}")
    if "refused" in result:
        raise DescriptionError(
            f"{path}: cannot be expanded by xacro: {result['refused']} is refused; if you trust the file, say so with"
            " --trust-xacro"
        )
    if "urdf" not in result:
        raise DescriptionError(f"{path}: cannot be expanded by xacro: {result.get('error', 'no result')}")
    return str(result["urdf"]).encode()


def parse_arguments(options: Iterable[str]) -> dict[str, str]:
    """Return the values of `NAME:=VALUE` options by name; ConfigError where one has another form."""
    found = {}
    for option in options:
        name, assigned, value = option.partition(":=")
        if not assigned or not name.strip():
            raise ConfigError(f"--xacro-arg {option!r}: expected NAME:=VALUE, such as prefix:=left_")
        found[name.strip()] = value
    return found


def _check_libraries(path: Path) -> None:
    wanted = ["xacro", *(["seccompy"] if sys.platform.startswith("linux") else [])]
    missing = [name for name in wanted if importlib.util.find_spec(name) is None]
    if missing:
        raise DependencyError(
            f"{path}: is a xacro file, and what expands it is not installed ({', '.join(missing)}):"
            f" pip install 'morphkit[xacro]'. Or expand it elsewhere: xacro {path.name} >"
            f" {path.name.removesuffix('.xacro')}"
        )


def _converse(request: dict[str, Any], access: Access, environment: dict[str, str] | None) -> dict[str, Any]:
    """Start the process, answer its questions, and return its result."""
    command = [sys.executable, "-P", "-m", "morphkit.formats.xacro_process"]  # modules of the working folder stay out
    late = threading.Event()
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment
    ) as child:

        def stop() -> None:
            late.set()
            child.kill()

        assert child.stdin is not None
        timer = threading.Timer(LIMIT_S, stop)
        timer.start()
        try:
            result = _questions(child, request, access)
        except (OSError, ValueError, KeyError, TypeError):  # it died, or says what makes no sense
            result = {}
        finally:
            timer.cancel()
            timer.join()
            child.kill()
            with contextlib.suppress(OSError):  # what it did not read any more
                child.stdin.close()
    if late.is_set() or (os.name == "posix" and child.returncode == -signal.SIGXCPU):
        return {"error": f"it took more than {LIMIT_S} s"}
    return result or {"error": "the process that expands it ended without a result"}


def _questions(child: subprocess.Popen[bytes], request: dict[str, Any], access: Access) -> dict[str, Any]:
    assert child.stdin is not None
    assert child.stdout is not None
    message: dict[str, Any] = request
    while True:
        child.stdin.write(json.dumps(message).encode() + b"\n")
        child.stdin.flush()
        line = child.stdout.readline(2 * xml.MAX_BYTES)
        if not line.endswith(b"\n"):
            return {"error": "it makes more than 64 MiB of XML"} if len(line) > xml.MAX_BYTES else {}
        said = dict(json.loads(line))
        if said.keys() & {"urdf", "error", "unknown", "refused"}:
            return said
        message = access.answer(said)
