"""Small robots that ask for much: large assets, meshes that multiply, bodies that are made by the thousand."""

from __future__ import annotations

from pathlib import Path

from hypothesis import strategies as st

from morphkit.errors import MorphkitError
from morphkit.readers import read
from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from morphkit.tokens.spec import token_spec
from tests.fuzz.target import explained
from tests.support.heavy_robots import doubling_dae, mjcf, png, urdf_with_mesh

MOST_LIMBS = 3000
"""Of a robot whose tokens are listed."""
sizes = st.sampled_from((0, 1, 2, 7, 30, 200, 1500, 8000, 30_000, 10**6, 2**31, 10**12))
counts = st.sampled_from((0, 1, 2, 3, 9, 27, 60, 400, 10**5))


@st.composite
def assets(draw: st.DrawFn) -> str:
    """One asset, with sizes of any order."""
    one, other, number = draw(sizes), draw(sizes), draw(st.integers(0, 10**6))
    kind = draw(st.sampled_from(("cone", "plate", "wedge", "supersphere", "supertorus", "sphere", "hemisphere")))
    picture = draw(st.sampled_from(("skybox", "cube", "2d")))
    return draw(
        st.sampled_from(
            (
                f'<hfield name="h{number}" nrow="{one}" ncol="{other}" size="1 1 1 1"/>',
                f'<texture name="t{number}" type="{picture}" builtin="flat" width="{one}" height="{other}"/>',
                f'<texture name="t{number}" type="2d" file="p.png"/>',
                f'<mesh name="m{number}" builtin="{kind}" params="{one} {other} 1 1"/>',
            )
        )
    )


@st.composite
def expanders(draw: st.DrawFn) -> str:
    """Something that makes bodies, maybe within itself."""
    x, y, z = draw(counts), draw(counts), draw(counts)
    inner = draw(st.one_of(st.just('<body><joint/><geom size=".1"/></body>'), st.just("<site/>"), expanders()))
    dim = draw(st.integers(1, 3))
    return draw(
        st.sampled_from(
            (
                f'<replicate count="{x}" offset="1 0 0">{inner}</replicate>',
                f'<flexcomp name="f" type="grid" count="{x} {y} {z}" spacing=".1 .1 .1" dim="{dim}" radius=".01"/>',
                f'<composite type="cable" count="{x} 1 1" curve="s" size="1"><geom size=".01"/></composite>',
            )
        )
    )


@st.composite
def examples(draw: st.DrawFn) -> dict[str, bytes]:
    """A robot and its files."""
    if draw(st.integers(0, 3)) == 0:
        return {
            "robot.urdf": urdf_with_mesh("m.dae").encode(),
            "m.dae": doubling_dae(draw(st.integers(0, 40))).encode(),
        }
    every = "".join(draw(st.lists(assets(), max_size=6)))
    more = "".join(draw(st.lists(expanders(), max_size=2)))
    picture = png(draw(sizes) % 2**32, draw(sizes) % 2**32, rows=0)
    return {"robot.xml": mjcf(every, more=more).encode(), "p.png": picture}


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """Read, tokenize and simulate; how far it got."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    robot = folder / next(name for name in files if name.startswith("robot."))
    try:
        morphology = read(load(robot))
        if len(morphology.limbs) < MOST_LIMBS:
            token_spec(morphology)
        build_simulation(load(robot))
    except MorphkitError as error:
        return explained(error, "refused")
    return "simulated"
