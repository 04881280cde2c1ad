"""Robots of a few kilobytes that would take gigabytes or minutes."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

from tests.support.small_robots import INERTIA

LEG = '<body name="leg" pos="0 0 -.2"><joint name="hip" axis="0 1 0"/><geom size=".03"/></body>'


def mjcf(assets: str = "", geom: str = 'size=".1"', more: str = "") -> str:
    """A robot of two limbs with assets, attributes of its torso's geom and more in its torso."""
    torso = f'<body name="torso" pos="0 0 1"><geom {geom}/>{LEG}{more}</body>'
    return (
        f"<mujoco><asset>{assets}</asset><worldbody>{torso}</worldbody>"
        '<actuator><motor joint="hip"/></actuator></mujoco>'
    )


def png(width: int, height: int, *, rows: int = 0) -> bytes:
    """A gray PNG that states a size and has so many rows of it."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes((width + 1) * rows))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


def doubling_dae(times: int, faces: int = 4) -> str:
    """A COLLADA file of one tetrahedron, its faces given over and over, that is shown 2^times times."""
    corners = " ".join(("0 1 2", "0 1 3", "0 2 3", "1 2 3")[face % 4] for face in range(faces))
    doubled = "".join(f'<node id="n{i}">' + 2 * f'<instance_node url="#n{i + 1}"/>' + "</node>" for i in range(times))
    params = "".join(f'<param name="{axis}" type="float"/>' for axis in "XYZ")
    return (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><unit meter="1"/></asset>'
        '<library_geometries><geometry id="g"><mesh><source id="p">'
        '<float_array id="a" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common>'
        f'<accessor source="#a" count="4" stride="3">{params}</accessor></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f'<triangles count="{faces}"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles>'
        "</mesh></geometry></library_geometries>"
        f'<library_nodes>{doubled}<node id="n{times}"><instance_geometry url="#g"/>'
        '</node></library_nodes><library_visual_scenes><visual_scene id="s"><node id="r"><instance_node url="#n0"/>'
        '</node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


def urdf_with_mesh(mesh: str) -> str:
    """A URDF of two links, the first of which needs a mesh for contacts."""
    inertial = f'<inertial><mass value="1"/>{INERTIA}</inertial>'
    shape = f'<geometry><mesh filename="{mesh}"/></geometry>'
    return (
        f'<robot name="r"><link name="torso">{inertial}<visual>{shape}</visual><collision>{shape}</collision></link>'
        f'<link name="leg">{inertial}</link><joint name="hip" type="revolute"><parent link="torso"/>'
        '<child link="leg"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="5"/></joint></robot>'
    )


def write_all(folder: Path) -> list[Path]:
    """Write each robot into a folder of its own; the robots' files."""
    fields = "".join(f'<hfield name="h{i}" nrow="8000" ncol="8000" size="1 1 1 1"/>' for i in range(16))
    textures = "".join(f'<texture name="t{i}" type="2d" builtin="flat" width="8000" height="8000"/>' for i in range(24))
    picture = '<texture name="t" type="2d" file="large.png"/><material name="m" texture="t"/>'
    grid = '<flexcomp name="f" type="grid" count="27 27 27" spacing=".05 .05 .05" dim="3" radius=".01"/>'
    texts = {
        "fields": mjcf(fields),
        "textures": mjcf(textures),
        "picture": mjcf(picture, 'size=".1" material="m"'),
        "picture_field": mjcf('<hfield name="h" file="large.png" size="1 1 1 1"/>', 'type="hfield" hfield="h"'),
        "flexcomp": mjcf(more=grid),
        "builtin": mjcf('<mesh name="c" builtin="cone" params="1000000 1"/>', 'type="mesh" mesh="c"'),
    }
    robots = []
    for name, text in texts.items():
        (folder / name).mkdir(parents=True)
        robots.append(folder / name / "r.xml")
        robots[-1].write_text(text)
        if "large.png" in text:
            (folder / name / "large.png").write_bytes(png(30_000, 30_000, rows=30_000))
    (folder / "mesh").mkdir()
    (folder / "mesh" / "m.dae").write_text(doubling_dae(26))
    robots.append(folder / "mesh" / "r.urdf")
    robots[-1].write_text(urdf_with_mesh("m.dae"))
    return robots
