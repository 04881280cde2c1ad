"""Work that may cost much is done in a process with limits, other work is not."""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.errors import AssetError, ConfigError, DescriptionError
from morphkit.families.build import compile_problem
from morphkit.formats.isolation import compiling, expanding, isolated
from morphkit.readers import read
from morphkit.registry import load, shipped
from morphkit.simulation.build import build_simulation
from morphkit.simulation.mesh_files import read_for_mujoco
from morphkit.utils import isolation, worker_pool
from morphkit.utils.process_limits import Limits
from tests.support.heavy_robots import doubling_dae, mjcf, urdf_with_mesh

GRID = '<flexcomp name="f" type="grid" count="{0} {0} {0}" spacing=".05 .05 .05" dim="3" radius=".01"/>'
ROBOT = Description("r", "r.xml", "mjcf", mjcf().encode())


@pytest.fixture(autouse=True)
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork even while there are threads of a test runner."""
    monkeypatch.setattr(worker_pool, "_context", lambda: multiprocessing.get_context("fork"))


def robot(text: str) -> Description:
    return Description("r", "r.xml", "mjcf", text.encode())


def test_small_robots_are_worked_on_directly() -> None:
    for description in shipped():
        assert expanding(description) is None
        assert compiling(description) is None


@pytest.mark.parametrize(
    "text",
    [
        mjcf(more=GRID.format(3)),
        mjcf(more='<replicate count="2"><site/></replicate>'),
        mjcf('<hfield name="h" nrow="3000" ncol="3000" size="1 1 1 1"/>'),
        mjcf(more=20_000 * "<site/>"),
    ],
)
def test_others_have_limits(text: str) -> None:
    assert compiling(robot(text)) is not None


def test_meshes_count(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(urdf_with_mesh("m.stl"))
    (tmp_path / "m.stl").write_bytes(bytes(84))
    assert compiling(load(tmp_path / "r.urdf")) is None
    with (tmp_path / "m.stl").open("wb") as file:
        file.truncate(2**25)
    limits = compiling(load(tmp_path / "r.urdf"))
    assert limits == Limits.for_meshes(2**25, 2**25)
    assert limits.memory > Limits.for_meshes(0, 0).memory
    (tmp_path / "m.dae").write_text(doubling_dae(1))
    (tmp_path / "r.urdf").write_text(urdf_with_mesh("m.dae"))
    assert compiling(load(tmp_path / "r.urdf")) is not None


def test_results_are_the_same_in_another_process(monkeypatch: pytest.MonkeyPatch) -> None:
    text = mjcf(more=GRID.format(2))
    apart = build_simulation(robot(text), base="fixed")
    monkeypatch.setattr(isolation, "in_worker", lambda: True)
    here = build_simulation(robot(text), base="fixed")
    assert apart.morphology == here.morphology
    assert apart.tokens == here.tokens
    assert (apart.model.body_pos == here.model.body_pos).all()
    assert apart.description.folder is None


def hungry(description: Description) -> int:
    return len(bytearray(2**30))


def busy(description: Description) -> None:
    while True:
        pass


def refusing(description: Description) -> None:
    raise AssetError("no mesh")


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (hungry, DescriptionError, r"r\.xml: cannot be used: it needs more than 0\.1 GiB of memory; .*MORPHKIT_LIMITS"),
        (
            busy,
            DescriptionError,
            r"r\.xml: cannot be used: it took more than 0\.6 s of processor time; .*LIMITS",
        ),
        (refusing, AssetError, "^no mesh$"),
    ],
)
def test_limits_end_in_an_error(call: Callable[[Description], None], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        isolated(call, ROBOT, Limits(seconds=0.6, memory=2**27))


@pytest.mark.parametrize("text", ["0", "-1", "nan", "much"])
def test_the_factor_has_to_be_a_number(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MORPHKIT_LIMITS", text)
    with pytest.raises(ConfigError, match="MORPHKIT_LIMITS"):
        Limits.for_meshes(0, 0)


def test_a_mesh_counts_once_for_each_scale(tmp_path: Path) -> None:
    mesh = '<visual><geometry><mesh filename="m.stl" scale="{0} 1 1"/></geometry></visual>'
    (tmp_path / "m.stl").write_bytes(bytes(2**25))
    (tmp_path / "r.urdf").write_text(f'<robot name="r"><link name="a">{mesh.format(1)}{mesh.format(1)}</link></robot>')
    assert compiling(load(tmp_path / "r.urdf")) == Limits.for_meshes(2**25, 2**25)
    (tmp_path / "s.urdf").write_text(f'<robot name="r"><link name="a">{mesh.format(1)}{mesh.format(2)}</link></robot>')
    assert compiling(load(tmp_path / "s.urdf")) == Limits.for_meshes(2**26, 2**25)


def test_meshes_that_multiply(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(urdf_with_mesh("m.dae"))
    (tmp_path / "m.dae").write_text(doubling_dae(2))
    _, content = read_for_mujoco(tmp_path / "m.dae")
    assert len(content) == 84 + 50 * 4 * 2**2
    (tmp_path / "m.dae").write_text(doubling_dae(26))
    with pytest.raises(AssetError, match=r"m\.dae: shows its shapes 67,108,864 times; the limit is 2,000"):
        read_for_mujoco(tmp_path / "m.dae")
    read(load(tmp_path / "r.urdf"))  # which needs no meshes
    with pytest.raises(AssetError, match="shows its shapes"):
        build_simulation(load(tmp_path / "r.urdf"))
    cycle = doubling_dae(2).replace("#n2", "#n0")
    (tmp_path / "m.dae").write_text(cycle)
    with pytest.raises(AssetError, match="shows itself"):
        read_for_mujoco(tmp_path / "m.dae")


def test_meshes_that_need_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "m.dae").write_text(doubling_dae(10, faces=4000))
    monkeypatch.setenv("MORPHKIT_LIMITS", "0.001")
    with pytest.raises(AssetError, match=r"m\.dae: cannot be read as a mesh: .* MORPHKIT_LIMITS=10"):
        read_for_mujoco(tmp_path / "m.dae")


def test_what_multiplies_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MORPHKIT_LIMITS", "0.05")
    with pytest.raises(DescriptionError, match=r"r\.xml: cannot be used: it took more than 0\.4 s"):
        read(robot(mjcf(more=GRID.format(27))))


def test_workers_that_compile_variants_have_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MORPHKIT_LIMITS", "0.1")
    field = '<hfield name="h" nrow="8000" ncol="8000" size="1 1 1 1"/>'
    assert "MORPHKIT_LIMITS" in compile_problem(robot(mjcf(field, 'type="hfield" hfield="h"')))
    assert not compile_problem(ablate(ROBOT, remove=["leg"]).description)


def test_a_process_with_limits_starts_no_other() -> None:
    """One that starts under the limits of another has no memory left to import anything."""
    call = (
        "import os; from morphkit.errors import DescriptionError; from morphkit.utils.isolation import run_isolated;"
        "from morphkit.utils.process_limits import Limits; limits = Limits(9.0, 2**30); limits.bound_memory();"
        "print(os.getpid() == run_isolated(os.getpid, limits, problem=DescriptionError))"
    )
    done = subprocess.run([sys.executable, "-c", call], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
