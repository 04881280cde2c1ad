"""What a file may make MuJoCo allocate in all, and how large its images may be."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats.budgets import image_size
from morphkit.readers import read
from morphkit.registry import load
from morphkit.simulation import image_files
from morphkit.simulation.build import build_simulation, compile_plain
from morphkit.simulation.inspection_model import load_mechanics
from tests.support.heavy_robots import mjcf, png

PICTURE = '<texture name="t" type="2d" file="p.png"/><material name="m" texture="t"/>'


def robot(assets: str) -> Description:
    return Description("r", "r.xml", "mjcf", mjcf(assets).encode())


@pytest.mark.parametrize(
    ("one", "several"),
    [
        ('<hfield name="h{}" nrow="8000" ncol="8000" size="1 1 1 1"/>', 2),
        ('<texture name="t{}" type="2d" builtin="flat" width="8000" height="8000"/>', 2),
        ('<texture name="t{}" type="skybox" builtin="flat" width="3000" height="3000"/>', 2),
        ('<texture name="t{}" builtin="flat" width="3000" height="3000"/>', 2),
        ('<texture name="t{}" builtin="flat" width="3000" height="30"/>', 2),
    ],
)
def test_sums_over_a_file(one: str, several: int) -> None:
    read(robot(one.format(0)))
    with pytest.raises(DescriptionError, match=r"r\.xml:1: the file asks for more than 67,108,864 numbers in all"):
        read(robot("".join(map(one.format, range(several)))))


@pytest.mark.parametrize(
    ("kind", "params", "fine"),
    [("cone", "{} 1", 2000), ("plate", "{0} {0}", 44), ("supersphere", "{} 1 1", 44), ("sphere", "{}", 3)],
)
def test_built_in_meshes(kind: str, params: str, fine: int) -> None:
    mesh = '<mesh name="c" builtin="{}" params="{}"/>'
    read(robot(mesh.format(kind, params.format(fine))))
    with pytest.raises(DescriptionError, match=r"r\.xml:1: <mesh builtin=.* the limit is 2,000"):
        read(robot(mesh.format(kind, params.format(10 * fine))))


def test_image_size() -> None:
    assert image_size(png(30_000, 20_000)) == (30_000, 20_000)
    ktx = b"\xabKTX 11\xbb\r\n\x1a\n" + struct.pack("<8I", 0x04030201, 0, 0, 0, 0, 0, 70_000, 9)
    assert image_size(ktx) == (70_000, 9)
    assert image_size(struct.pack("<ii", 4, 4) + bytes(48)) is None
    assert image_size(png(4, 4)[:20]) is None


def test_large_images_are_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "r.xml"
    path.write_text(mjcf(PICTURE, 'size=".1" material="m"'))
    (tmp_path / "p.png").write_bytes(png(30_000, 30_000))
    (note,) = load_mechanics(load(path)).notes
    assert note.startswith("texture 't' was left out:")
    assert note.endswith("p.png: 30,000 x 30,000 pixels, more than the limit of 67,108,864")
    path.write_text(mjcf('<hfield name="h" file="p.png" size="1 1 1 1"/>', 'type="hfield" hfield="h"'))
    with pytest.raises(AssetError, match="30,000 x 30,000 pixels"):
        build_simulation(load(path))


def test_images_of_a_robot_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image_files, "ALL_PIXELS", 100)
    (tmp_path / "p.png").write_bytes(png(9, 9, rows=9))
    (tmp_path / "q.png").write_bytes(png(9, 9, rows=9))
    path = tmp_path / "r.xml"
    path.write_text(mjcf("".join(f'<texture name="{each}" type="2d" file="{each}.png"/>' for each in "pq")))
    (note,) = load_mechanics(load(path)).notes
    assert "texture 'q' was left out" in note


def test_textures_are_read_only_where_something_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "r.xml"
    path.write_text(mjcf(PICTURE, 'size=".1" material="m"'))
    (tmp_path / "p.png").write_bytes(png(40, 50, rows=50))
    drawn, plain = (build_simulation(load(path), drawn=each).model for each in (True, False))
    assert (drawn.tex_width[0], drawn.tex_height[0]) == (40, 50)
    assert (plain.tex_width[0], plain.tex_height[0]) == (8, 8)
    (tmp_path / "p.png").write_bytes(b"no image")
    assert compile_plain(load(path)).ntex == 1
