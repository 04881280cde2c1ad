"""Draws docs/images/architecture.svg: the packages in their layers, and the imports between them.

    python tools/draw_architecture.py [--check]

Layers are those of import-linter in pyproject.toml, arrows are the imports in the code; arrows that follow from others
are left out. `--check` writes nothing and exits with 1 where the picture is not the one that would be drawn.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
import tomllib
from html import escape
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import grimp

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
BANDS = {"morphkit_cli": "command line", "morphkit_rl": "learning", "morphkit": "robots"}
FILLS = {"morphkit_cli": "#fdf0d5", "morphkit_rl": "#dcecf7", "morphkit": "#e3f1e3"}
WIDTH, BOX, HEIGHT, GAP, ROW, MARGIN = 1000, 128, 34, 16, 74, 24
_CAPTION = 48

Edges = dict[str, set[str]]


class Box(NamedTuple):
    """A room in the picture, by its center and the top of its box."""

    x: float
    y: float


def layers(package: str) -> list[list[str]]:
    """The rooms of a package, highest layer first; the command line is one room."""
    if package == "morphkit_cli":
        return [[package]]
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract.get("containers") == [package]:
            return [[f"{package}.{name.strip()}" for name in row.split("|")] for row in contract["layers"]]
    raise SystemExit(f"error: pyproject.toml has no layers of {package}")


def imports(rooms: list[str]) -> Edges:
    """Which rooms each room imports."""
    graph = grimp.build_graph(*BANDS, include_external_packages=False)
    room_of = {}
    for module in graph.modules:
        parts = module.split(".")
        room = parts[0] if parts[0] == "morphkit_cli" else ".".join(parts[:2])
        if room in rooms:
            room_of[module] = room
    edges: Edges = {room: set() for room in rooms}
    for module, room in room_of.items():
        targets = {room_of.get(other) for other in graph.find_modules_directly_imported_by(module)}
        edges[room] |= {target for target in targets if target not in (None, room)}
    return edges


def reduced(edges: Edges) -> Edges:
    """The edges without those that follow from others."""
    reach: Edges = {}

    def below(room: str) -> set[str]:
        if room not in reach:
            reach[room] = set().union(*({target} | below(target) for target in edges[room]))
        return reach[room]

    return {
        room: {t for t in targets if not any(t in below(other) for other in targets if other != t)}
        for room, targets in edges.items()
    }


def summary(room: str) -> str:
    """The first sentence of a room's docstring."""
    return (import_module(room).__doc__ or "").strip().splitlines()[0]


def caption(room: str) -> str:
    """What a room is for, as short as fits next to its box."""
    head, colon, rest = summary(room).replace("`", "").rstrip(".").partition(": ")
    text = rest if colon and head.lower() == room.rpartition(".")[2] else head
    return textwrap.shorten(text, _CAPTION, placeholder=" ...")


def draw() -> str:
    """The picture as SVG."""
    places: dict[str, Box] = {}
    bands = []
    y = float(MARGIN)
    for package in BANDS:
        top = y
        y += 22
        for row in layers(package):
            start = WIDTH / 2 - (len(row) * BOX + (len(row) - 1) * GAP) / 2 + BOX / 2
            for number, room in enumerate(row):
                places[room] = Box(start + number * (BOX + GAP), y)
            y += ROW
        bands.append((package, top, y - top - ROW + HEIGHT + 14))
        y += 8
    edges = reduced(imports(list(places)))
    total = y - ROW + HEIGHT + MARGIN
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {total:.0f}" width="{WIDTH}" '
        f'height="{total:.0f}" font-family="system-ui, sans-serif" role="img" aria-labelledby="title">',
        '<title id="title">The packages of morphkit in layers; imports run downwards only</title>',
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="6" markerHeight="6" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#5b6770"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{total:.0f}" rx="8" fill="#ffffff"/>',
    ]
    for package, top, height in bands:
        parts.append(
            f'<rect x="12" y="{top:.0f}" width="{WIDTH - 24}" height="{height:.0f}" rx="8" fill="{FILLS[package]}"/>'
            f'<text x="24" y="{top + 18:.0f}" font-size="13" font-weight="600" fill="#333">{package}</text>'
            f'<text x="24" y="{top + 34:.0f}" font-size="11" fill="#666">{BANDS[package]}</text>'
        )
    for room in places:
        for target in sorted(edges[room], key=lambda each: places[each]):
            a, b = places[room], places[target]
            y0, y1 = a.y + HEIGHT, b.y - 1
            bend = (y1 - y0) / 2
            opacity = 0.85 if b.y - a.y < 1.5 * ROW else 0.35
            parts.append(
                f'<path d="M{a.x:.0f} {y0:.0f}C{a.x:.0f} {y0 + bend:.0f} {b.x:.0f} {y1 - bend:.0f} {b.x:.0f} {y1:.0f}"'
                f' fill="none" stroke="#5b6770" stroke-width="1.1" stroke-opacity="{opacity}" marker-end="url(#head)"/>'
            )
    for room, box in places.items():
        name = room.rpartition(".")[2]
        parts.append(
            f"<g><title>{escape(summary(room))}</title>"
            f'<rect x="{box.x - BOX / 2:.0f}" y="{box.y:.0f}" width="{BOX}" height="{HEIGHT}" rx="6" fill="#ffffff" '
            f'stroke="#8a949c"/><text x="{box.x:.0f}" y="{box.y + 22:.0f}" font-size="14" text-anchor="middle" '
            f'fill="#1d2428">{name}</text></g>'
        )
        if sum(other.y == box.y for other in places.values()) == 1:
            parts.append(
                f'<text x="{box.x + BOX / 2 + 90:.0f}" y="{box.y + 21:.0f}" font-size="11" fill="#555">'
                f"{escape(caption(room))}</text>"
            )
    return "\n".join([*parts, "</svg>", ""])


def main() -> int:
    """Write the picture, or check it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="exit with 1 where the picture is not up to date")
    picture = draw()
    if not parser.parse_args().check:
        PICTURE.write_text(picture, encoding="utf-8")
    elif not PICTURE.is_file() or PICTURE.read_text(encoding="utf-8") != picture:
        print(f"{PICTURE.relative_to(ROOT)} is out of date; run: python tools/draw_architecture.py", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
