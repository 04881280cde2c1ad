"""The page on the architecture names things that exist, and its picture is that of the code."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_every_step_of_the_traced_example_exists() -> None:
    steps = re.findall(r"^\| [^|]+ \| `([\w.]+)` `(\w+)` \|$", PAGE, re.MULTILINE)
    assert len(steps) >= 14
    for module, name in steps:
        assert hasattr(importlib.import_module(module), name), f"{module} has no {name}"


def test_every_room_of_the_table_exists() -> None:
    rows = PAGE.split("## Find the room", 1)[1].split("##", 1)[0]
    rooms = [name for row in rows.splitlines() for name in re.findall(r"`(morphkit\w*/\w+)`", row)]
    assert len(rooms) >= 14
    for room in rooms:
        assert (ROOT / room / "__init__.py").is_file(), room


def test_the_picture_is_that_of_the_imports() -> None:
    command = [sys.executable, "tools/draw_architecture.py", "--check"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr


def test_packages_stay_small_enough_to_be_found() -> None:
    for package, most in (("morphkit", 18), ("morphkit_rl", 12)):
        rooms = {
            path.stem
            for path in (ROOT / package).iterdir()
            if path.suffix == ".py" or (path.is_dir() and (path / "__init__.py").is_file())
        } - {"__init__"}
        assert len(rooms) <= most, sorted(rooms)


def test_no_module_is_long() -> None:
    for folder in ("morphkit", "morphkit_rl", "cli"):
        for path in (ROOT / folder).rglob("*.py"):
            assert len(path.read_text(encoding="utf-8").splitlines()) <= 300, path


def test_the_reference_has_every_public_name() -> None:
    for package in ("morphkit", "morphkit_rl"):
        page = (ROOT / "docs" / "api" / f"{package}.md").read_text(encoding="utf-8")
        shown = {line.rpartition(".")[2] for line in page.splitlines() if line.startswith("::: ")}
        assert shown | {"__version__", "families"} == {
            *importlib.import_module(package).__all__,
            "__version__",
            "families",
        }
