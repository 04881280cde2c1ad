"""Robots with a mesh or an image of which some bytes are wrong, in every format."""

from __future__ import annotations

from pathlib import Path

from hypothesis import strategies as st

from morphkit.conversion.convert import convert
from morphkit.errors import MorphkitError
from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from tests.fuzz.target import explained
from tests.support.mutated_shapes import FIELD, FORMATS, IMAGES, URDF, image, mutants, whole


@st.composite
def examples(draw: st.DrawFn) -> dict[str, bytes]:
    """A robot, and its shape or image after one to four changes."""
    kind = draw(st.sampled_from((*FORMATS, *IMAGES)))
    if kind in FORMATS:
        return {"robot.urdf": URDF.format(f"m.{kind}").encode(), f"m.{kind}": draw(mutants(whole(kind)))}
    asset, more = draw(st.sampled_from((("hfield", 'size="1 1 1 1"'), ("texture", 'type="2d"'))))
    return {"robot.xml": FIELD.format(asset, more, f"i.{kind}").encode(), f"i.{kind}": draw(mutants(image(kind)))}


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """Simulate, and convert what is a URDF; how far it got."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    robot = folder / next(name for name in files if name.startswith("robot."))
    try:
        build_simulation(load(robot))
        if robot.suffix == ".urdf":
            convert(load(robot), thorough=False)
    except MorphkitError as error:
        return explained(error, "refused")
    return "simulated"
