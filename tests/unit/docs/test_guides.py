"""The guides of docs/guides, done: what a page says is applied to a copy of the project, and its example run there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
GUIDES = sorted((ROOT / "docs" / "guides").glob("*.md"))
BLOCK = r"\n\n```\w+\n(.*?)```"
NEW = re.compile(rf"^New file `([^`]+)`:{BLOCK}", re.MULTILINE | re.DOTALL)
INSERT = re.compile(rf"^In `([^`]+)`, after `([^`]+)`:{BLOCK}", re.MULTILINE | re.DOTALL)
APPEND = re.compile(rf"^At the end of `([^`]+)`:{BLOCK}", re.MULTILINE | re.DOTALL)
TRY = re.compile(r"^Try it:\n\n```python\n(.*?)```\n\n```text\n(.*?)```", re.MULTILINE | re.DOTALL)
FOLDERS = {
    "morphkit": "morphkit",
    "morphkit_rl": "morphkit_rl",
    "cli": "morphkit_cli",
    "robots": "morphkit_robots",
    "zoo": "morphkit_zoo",
}


def copied(file: str, into: Path) -> Path:
    """Where a file of the project is in the copy, under the name that its package is installed under."""
    folder, _, rest = file.partition("/")
    return into / FOLDERS[folder] / rest


def apply(page: str, into: Path) -> int:
    """Do what a page says; how many edits that were."""
    for file, text in NEW.findall(page):
        path = copied(file, into)
        assert not path.exists(), f"{file} exists already"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    for file, anchor, text in INSERT.findall(page):
        path = copied(file, into)
        lines = path.read_text().splitlines(keepends=True)
        places = [number for number, line in enumerate(lines) if line.rstrip("\n") == anchor]
        assert places, f"{file} has no line {anchor!r}"
        lines.insert(places[0] + 1, text)
        path.write_text("".join(lines))
    for file, text in APPEND.findall(page):
        path = copied(file, into)
        path.write_text(path.read_text() + text)
    return len(NEW.findall(page)) + len(INSERT.findall(page)) + len(APPEND.findall(page))


def test_there_are_six_guides() -> None:
    names = {path.stem.removeprefix("add-a-") for path in GUIDES}
    assert names == {"limb-sensor", "method", "task", "finding", "robot", "command"}


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_a_guide_does_what_it_says(guide: Path, tmp_path: Path) -> None:
    page = guide.read_text(encoding="utf-8")
    for folder, installed in FOLDERS.items():
        shutil.copytree(ROOT / folder, tmp_path / installed, ignore=shutil.ignore_patterns("__pycache__"))
    assert apply(page, tmp_path) > 0
    (example, expected), *others = TRY.findall(page)
    assert not others
    (tmp_path / "example.py").write_text(example)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-P", "example.py"],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout == expected


@pytest.mark.parametrize("guide", GUIDES, ids=lambda path: path.stem)
def test_the_files_that_a_guide_names_exist(guide: Path) -> None:
    rows = re.findall(r"^\| ([^|]*`[^|]*) \|", guide.read_text(encoding="utf-8"), re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert len(named) >= 3
    for name in named:
        if "NAME" not in name and "/" in name:
            assert (ROOT / name).exists(), name
