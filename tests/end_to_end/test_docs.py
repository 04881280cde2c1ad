"""What the documentation shows is what the tool prints."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from .conftest import Run

DOCS = Path(__file__).parents[2] / "docs"
ROW = re.compile(r"^\| (\w+) \| `(\w+)` \| ([a-z ]+) \|$", re.MULTILINE)


@pytest.mark.parametrize("robot", ["cheetah", "walker", "humanoid_2d", "hopper"])
def test_table_of_canonical_names(morphkit: Run, robot: str) -> None:
    shown = {raw: plain for name, raw, plain in ROW.findall((DOCS / "tokens.md").read_text()) if name == robot}
    spec = json.loads(morphkit("tokens", robot, "--naming", "canonical", "--format", "json").stdout)
    texts = {s["limb"]: s["text"].removesuffix(" angle") for s in spec["sensors"] if s["quantity"] == "angle"}
    assert shown == texts


def test_shown_cut_is_what_is_printed(morphkit: Run) -> None:
    shown = (DOCS / "ablation.md").read_text().split("--remove foot\n", 1)[1].split("```", 1)[0]
    assert morphkit("ablate", "cheetah", "--remove", "foot").stdout == shown


def test_shown_family_is_what_is_printed(morphkit: Run) -> None:
    shown = (DOCS / "ablation.md").read_text().split("cheetah --all\n", 1)[1].split("```", 1)[0]
    start, end = shown.split("...\n")
    printed = morphkit("ablate", "cheetah", "--all").stdout
    assert printed.startswith(start)
    assert printed.endswith(end)


def test_shown_dry_run_is_what_is_printed(morphkit: Run) -> None:
    arguments = "ablate quadruped --remove FL_calf --mirror --dry-run"
    shown = (DOCS / "ablation.md").read_text().split(f"{arguments}\n", 1)[1].split("```", 1)[0]
    start, end = shown.split("...\n")
    printed = morphkit(*arguments.split()).stdout
    assert printed.startswith(start)
    assert printed.endswith(end)


def test_shown_count_of_distinct_bodies_is_what_is_made(morphkit: Run) -> None:
    printed = morphkit("ablate", "walker", "--all", "--skip-mirrored", "--json", "--dry-run").stdout
    made = [each for each in json.loads(printed)["variants"] if "mirrors" not in each]
    assert (
        f"{len(made)} of the walker's {len(json.loads(printed)['variants'])} are left"
        in (DOCS / "ablation.md").read_text()
    )


def test_shown_tokens_are_what_is_printed(morphkit: Run) -> None:
    shown = (DOCS / "tokens.md").read_text().split("$ morphkit tokens cheetah\n", 1)[1].split("...", 1)[0]
    assert morphkit("tokens", "cheetah").stdout.startswith(shown)
