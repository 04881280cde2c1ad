"""Boxes and small images in every format, and such with a few changed bytes."""

from __future__ import annotations

import io
import struct
import zipfile
from functools import cache

import numpy as np
import trimesh
from hypothesis import strategies as st

FORMATS = ("stl", "ascii.stl", "obj", "msh", "dae", "zae", "glb", "gltf", "ply", "off", "3mf")
IMAGES = ("png", "bmp", "tga", "jpg", "bin")
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = f"""<robot name="r"><link name="a">{INERTIAL}</link>
<link name="b">{INERTIAL}<collision><geometry><mesh filename="{{}}"/></geometry></collision></link>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>"""
FIELD = """<mujoco><asset><{0} name="x" {1} file="{2}"/></asset>
<worldbody><body name="b"><geom size=".1"/></body></worldbody></mujoco>"""
NUMBERS = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7F800000, 0x7FC00000)
WORDS = (b"99999999", b"-1", b"nan", b"1e999", b"", b"x", b"1e300")


@cache
def whole(kind: str) -> bytes:
    """A box in a format; of glTF the file that holds its buffers too."""
    shape = trimesh.creation.box()
    if kind == "msh":
        counts = struct.pack("<4i", len(shape.vertices), 0, 0, len(shape.faces))
        return counts + shape.vertices.astype("<f4").tobytes() + shape.faces.astype("<i4").tobytes()
    if kind == "gltf":
        return trimesh.Scene([shape]).export(file_type="gltf", merge_buffers=True, embed_buffers=True)["model.gltf"]
    if kind == "zae":
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            archive.writestr("box.dae", whole("dae"))
        return packed.getvalue()
    written = shape.export(file_type={"ascii.stl": "stl_ascii"}.get(kind, kind))
    return written.encode() if isinstance(written, str) else written


@cache
def image(kind: str) -> bytes:
    from PIL import Image

    if kind == "bin":
        return struct.pack("<2i", 4, 4) + np.arange(16, dtype="<f4").tobytes()
    written = io.BytesIO()
    Image.fromarray(np.arange(192, dtype=np.uint8).reshape(8, 8, 3)).save(written, {"jpg": "jpeg"}.get(kind, kind))
    return written.getvalue()


@st.composite
def mutants(draw: st.DrawFn, content: bytes) -> bytes:
    for _ in range(draw(st.sampled_from((1, 1, 2, 4)))):
        at = draw(st.integers(0, max(len(content) - 1, 0)))
        new = draw(
            st.one_of(
                st.binary(min_size=1, max_size=4),
                st.sampled_from(WORDS),
                st.sampled_from(NUMBERS).map(lambda number: struct.pack("<I", number)),
            )
        )
        cut = draw(st.sampled_from((len(new), 0, len(new) + 4, len(content))))
        content = content[:at] + new + content[at + cut :]
    return content
