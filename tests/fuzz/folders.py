"""Matrices, families and shipped policies with something wrong, used by every command that reads them."""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from unittest import mock

from hypothesis import strategies as st

from morphkit.errors import MorphkitError
from morphkit.registry import load_all
from morphkit_rl.runs import checkpoint, saved_policy, zoo
from tests.fuzz.damage import cases, damaged, plain_files
from tests.support.benchmark_matrix import make_matrix
from tests.support.command_output import printed_by

SMALL = """
tasks.few = ["few"]
splits.few.few = {train = ["hopper_3"], test = ["hopper_4"]}
"""
KINDS = ("matrix", "family", "policy")


def examples() -> st.SearchStrategy[dict[str, bytes]]:
    """A kind of folder, and a file that lists changes."""
    for kind in KINDS:
        attempt({f"{kind}.json": b'{"changes": [], "signed": true}'}, Path())
    return st.tuples(st.sampled_from(KINDS), cases()).map(lambda made: {f"{made[0]}.json": made[1]})


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """Use the changed folder; every command has to end well or with an error that says something."""
    ((name, source),) = files.items()
    kind, case = Path(name).stem, json.loads(source)
    with damaged(_whole(kind), case["changes"]) as broken:
        if case["signed"]:
            with contextlib.suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
                _sign(kind, broken)
        codes = {"matrix": _use_matrix, "family": _use_family, "policy": _use_policy}[kind](broken)
    return f"{kind} {'refused' if all(codes) else 'refused in part' if any(codes) else 'used'}"


def _use_matrix(matrix: Path) -> list[int]:
    report = ("benchmark", "report", str(matrix), "--out", str(matrix.parent / "report"), "--json")
    return [
        _code("benchmark", "status", str(matrix)),
        _code("benchmark", "status", str(matrix), "--json"),
        _code(*report),
    ]


def _use_family(family: Path) -> list[int]:
    first = str(family / "hopper-no-foot.xml")
    with contextlib.suppress(MorphkitError):
        first = str(family / load_all(family)[0].file)
    return [
        _code("benchmark", "random", str(family), "--episodes", "1", "--json"),
        _code("tokens", first),
        _code("show", first),
        _code("tokens", str(family)),
        _code("ablate", "hopper", "--remove", "foot", "--output", str(family), "--no-compile"),
    ]


def _use_policy(policy: Path) -> list[int]:
    name, shipped = f"zoo:{policy.name}", policy.parent / "shipped"
    shipped.mkdir()
    policy.rename(shipped / policy.name)
    with mock.patch.object(zoo, "_folder", return_value=shipped):
        codes = [
            _code("zoo"),
            _code("zoo", "--json"),
            _code("show", name),
            _code("evaluate", name, "hopper_3", "--episodes", "1", "--json"),
            _code("coverage", name, "hopper_3", "--json"),
        ]
        with contextlib.suppress(MorphkitError):
            saved_policy.save(saved_policy.load(name), policy.parent / "saved")
    return codes


def _code(*command: str) -> int:
    return printed_by(command)[0]


@cache
def _whole(kind: str) -> Path:
    folder = Path(tempfile.mkdtemp()) / kind
    if kind == "matrix":
        own = folder.with_suffix(".toml")
        own.write_text(SMALL)
        make_matrix(
            folder, tasks=["few"], splits=["few"], seeds=2, states={("few", "limb-former", 1): "failed"}, file=own
        )
    elif kind == "family":
        assert _code("ablate", "hopper", "--all", "--limit", "2", "--no-compile", "--output", str(folder)) == 0
    else:
        shutil.copytree(zoo.find("zoo:hoppers"), folder)
    return folder


def _sign(kind: str, folder: Path) -> None:
    """Make the digests right, as somebody does who makes a folder to deceive."""
    read = {"family": ["manifest.json"], "policy": ["policy.json", "config.json", saved_policy.ARRAYS]}.get(
        kind, ["none"]
    )
    plain = plain_files(folder)  # a pipe would be waited for
    if not all(folder / name in plain for name in read):
        return
    listing = folder / read[0]
    values = json.loads(listing.read_text())
    if kind == "policy":
        values.update(checkpoint.describe(folder / saved_policy.ARRAYS))
        settings = json.loads((folder / "config.json").read_text())
        for robot in settings["robots"]:
            robot["sha256"] = _digest(folder / "robots" / robot["source"])
        (folder / "config.json").write_text(json.dumps(settings))
    else:
        for variant in values["variants"]:
            variant["sha256"] = _digest(folder / variant["file"])
    listing.write_text(json.dumps(values))


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes() if file.is_file() and not file.is_symlink() else b"").hexdigest()
