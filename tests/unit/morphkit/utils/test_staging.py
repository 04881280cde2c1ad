"""What is written appears whole or not at all, even if the process is killed; leftovers go with the next run."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import pytest
import trimesh

import morphkit
from morphkit.conversion.convert import Conversion, convert
from morphkit.conversion.write import write_conversion
from morphkit.errors import OutputError
from morphkit.families.write import write_family
from morphkit.utils import staging
from morphkit.utils.staging import clear_leftovers, stage, staged_folder

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs fork and SIGKILL")

STEPS = {"open", "os.rename", "os.mkdir", "os.remove", "os.rmdir", "shutil.rmtree", "ctypes.dlsym"}
ROBOT = """<robot name="r"><link name="base">
  <inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><mesh filename="part.stl"/></geometry></collision>
  {more}</link></robot>
"""
MORE = '<visual><geometry><mesh filename="more.stl"/></geometry></visual>'


def killed_before(step: int, work: Callable[[], object]) -> bool:
    """Do `work` in a process that SIGKILL ends before its `step`-th access to files; whether it came to that."""
    child = os.fork()
    if child == 0:
        seen = 0

        def count(event: str, _: object) -> None:
            nonlocal seen
            if event in STEPS:
                seen += 1
                if seen == step:
                    os.kill(os.getpid(), signal.SIGKILL)

        try:
            sys.addaudithook(count)
            work()
        except BaseException:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0
    return os.WIFSIGNALED(status)


def kills(folder: Path, work: Callable[[], object], prepare: Callable[[], object]) -> Iterator[int]:
    """Kill `work` before each of its steps, after `prepare` each time, and let an hour pass; until it comes to its end.

    `folder` is where it works.
    """
    for step in range(1, 1000):
        prepare()
        if not killed_before(step, work):
            assert step > 10
            return
        for name in hidden(folder):
            os.utime(folder / name, (time.time() - 3600, time.time() - 3600))
        yield step
    raise AssertionError("it does not end")


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def hidden(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".")]


def empty(folder: Path) -> None:
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


@pytest.fixture(scope="module")
def conversions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Conversion, Conversion]:
    """Two robots whose meshes have the same names and other contents."""
    made = []
    for name, size, more in (("first", 0.1, MORE), ("second", 0.2, "")):
        folder = tmp_path_factory.mktemp(name)
        trimesh.creation.box((size, size, size)).export(folder / "part.stl")
        trimesh.creation.icosphere(radius=size, subdivisions=1).export(folder / "more.stl")
        (folder / "r.urdf").write_text(ROBOT.format(more=more))
        made.append(convert(morphkit.load(folder / "r.urdf")))
    return made[0], made[1]


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_killed_conversion_leaves_the_old_model_or_the_new_one(
    tmp_path: Path, conversions: tuple[Conversion, Conversion], order: tuple[int, int]
) -> None:
    old, new = (conversions[index] for index in order)
    expected = []
    for name, conversion in (("a", old), ("b", new)):
        write_conversion(conversion, tmp_path / name / "out.xml")
        expected.append(files(tmp_path / name))
    folder = tmp_path / "c"
    folder.mkdir()
    path = folder / "out.xml"

    def prepare() -> None:
        empty(folder)
        write_conversion(old, path)

    found = set()
    for _ in kills(folder, lambda: write_conversion(new, path, force=True), prepare):
        mujoco.MjModel.from_xml_path(str(path))
        text = path.read_bytes()
        state = [each["out.xml"] for each in expected].index(text)
        found.add(state)
        assert expected[state].items() <= files(folder).items()
        write_conversion(new, path, force=True)
        assert files(folder) == expected[1]
        assert not hidden(folder)
    assert found == {0, 1}


def test_a_killed_first_conversion_leaves_nothing_that_is_in_the_way(
    tmp_path: Path, conversions: tuple[Conversion, Conversion]
) -> None:
    first, second = conversions
    write_conversion(second, tmp_path / "b" / "out.xml")
    folder = tmp_path / "c"
    folder.mkdir()
    path = folder / "out.xml"
    found = set()
    for _ in kills(folder, lambda: write_conversion(first, path), lambda: empty(folder)):
        found.add(path.exists())
        if path.exists():
            mujoco.MjModel.from_xml_path(str(path))
            with pytest.raises(OutputError, match="--force"):
                write_conversion(second, path)
            write_conversion(second, path, force=True)
        else:
            write_conversion(second, path)
        assert files(folder) == files(tmp_path / "b")
        assert not hidden(folder)
    assert found == {True, False}


@pytest.mark.parametrize("swaps", [True, False])
def test_a_killed_run_leaves_the_old_folder_or_the_new_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, swaps: bool
) -> None:
    if not swaps:
        monkeypatch.setattr(staging, "_exchange", lambda *_: False)
    folder = tmp_path / "out"

    def prepare() -> None:
        empty(tmp_path)
        folder.mkdir()
        (folder / "old").write_text("old")

    def work() -> None:
        with staged_folder(folder) as content:
            (content / "new").write_text("new")
            (content / "more").write_text("more")

    for _ in kills(tmp_path, work, prepare):
        if swaps:
            assert files(folder) in ({"old": b"old"}, {"new": b"new", "more": b"more"})
        clear_leftovers(folder)
        assert files(folder) in ({"old": b"old"}, {"new": b"new", "more": b"more"})
        work()
        assert files(folder) == {"new": b"new", "more": b"more"}
        assert not hidden(tmp_path)


def test_what_a_killed_ablation_leaves_goes_with_the_next(tmp_path: Path) -> None:
    out = tmp_path / "out"
    # It takes seconds, so that it is killed long before its end however late this process looks.
    command = [sys.executable, "-m", "morphkit_cli.main", "ablate", "quadruped", "--all", "-o", str(out)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not list(tmp_path.glob(".out-*/content/manifest.json")):
            time.sleep(0.002)
        process.kill()
        assert process.stdout is not None
        process.stdout.read()  # A worker that was just being forked leaves the lock before the pipe.
    assert process.returncode == -signal.SIGKILL
    assert not out.exists()
    assert len(hidden(tmp_path)) == 1
    write_family(morphkit.load("cheetah"), [], out)
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_only_what_is_surely_left_goes(tmp_path: Path) -> None:
    place = tmp_path / "out"
    other = tmp_path / "out-more"
    (tmp_path / ".out-mine.morphkit").mkdir()
    (tmp_path / ".out-mine.morphkit" / "precious").write_text("x")
    (tmp_path / ".out-signed.morphkit").mkdir()
    (tmp_path / ".out-signed.morphkit" / "lock").write_text("something else")
    with stage(place) as living:
        (tmp_path / ".out-link.morphkit").symlink_to(living)
        child = os.fork()  # another process, which writes to the same place
        if child == 0:
            clear_leftovers(place)
            with stage(place):
                pass
            os._exit(0)
        assert os.waitpid(child, 0)[1] == 0
        assert living.is_dir()
        assert killed_before(8, lambda: write_and_wait(other))
        clear_leftovers(place)
        assert len(hidden(tmp_path)) == 5
        clear_leftovers(other)
        assert sorted(hidden(tmp_path)) == sorted(
            [".out-link.morphkit", ".out-mine.morphkit", ".out-signed.morphkit", living.name]
        )
    assert (tmp_path / ".out-mine.morphkit" / "precious").read_text() == "x"


def test_a_process_that_outlives_its_killed_parent_keeps_no_stage(tmp_path: Path) -> None:
    place = tmp_path / "out"
    heard, said = os.pipe()
    until, end = os.pipe()
    parent = os.fork()
    if parent == 0:
        with stage(place):
            if os.fork() == 0:
                os.close(end)
                os.write(said, b"child")
                os.read(until, 1)
                os._exit(0)
            os.write(said, b"parent")
            signal.pause()
    words = b""
    while len(words) < len(b"childparent"):
        words += os.read(heard, 100)
    clear_leftovers(place)
    assert len(hidden(tmp_path)) == 1
    os.kill(parent, signal.SIGKILL)
    os.waitpid(parent, 0)
    clear_leftovers(place)
    assert not hidden(tmp_path)
    for pipe in (heard, said, until, end):
        os.close(pipe)


def write_and_wait(place: Path) -> None:
    with stage(place) as own:
        for number in range(20):
            (own / str(number)).write_text("x")


def test_a_failed_run_leaves_nothing(tmp_path: Path) -> None:
    def fail() -> None:
        with staged_folder(tmp_path / "new" / "out") as content:
            (content / "file").write_text("x")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert not list(tmp_path.iterdir())


def test_a_file_in_the_place_of_the_meshes_is_refused(
    tmp_path: Path, conversions: tuple[Conversion, Conversion]
) -> None:
    (tmp_path / "out_assets").write_text("mine")
    with pytest.raises(OutputError, match="is no folder"):
        write_conversion(conversions[0], tmp_path / "out.xml", force=True)
    assert files(tmp_path) == {"out_assets": b"mine"}
