"""Picture and video files: every pixel, the right speed, and whole or not there."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import ConfigError, DependencyError, OutputError
from morphkit.viewer import media, render
from morphkit.viewer.mp4 import encode


@pytest.mark.parametrize(("fps", "kept", "left"), [(125.0, 20, 25.0), (25.0, 100, 25.0), (30.0, 100, 30.0)])
def test_resample_keeps_the_speed(fps: float, kept: int, left: float) -> None:
    states, new = render.resample(np.arange(100.0)[:, None], fps)
    assert (len(states), new) == (kept, left)
    assert states[1, 0] / fps == pytest.approx(1 / new)


def frames(count: int = 10, size: tuple[int, int] = (48, 64)) -> np.ndarray:
    """A white square that moves over black."""
    result = np.zeros((count, *size, 3), np.uint8)
    for index in range(count):
        result[index, 10:20, 4 * index : 4 * index + 10] = 255
    return result


def test_png_keeps_every_pixel(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    media.write_png(picture, tmp_path / "new" / "a.png")
    np.testing.assert_array_equal(np.array(image.open(tmp_path / "new" / "a.png")), picture)


@pytest.mark.parametrize("fps", [25.0, 30.0, 125.0])
def test_gif_lasts_as_long_as_the_states(fps: float, tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    gif = image.open(media.write_video(iter(frames()), tmp_path / "a.gif", fps))
    total = 0
    for index in range(gif.n_frames):
        gif.seek(index)
        total += gif.info["duration"]
    assert total / 1000 == pytest.approx(10 / fps, abs=0.04)
    assert gif.size == (64, 48)
    assert gif.info["loop"] == 0
    shown = np.array(gif.convert("RGB"))
    assert np.abs(shown.astype(int) - frames()[9]).mean() < 5


def test_mp4_has_all_frames_at_the_right_speed(tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio.v2")
    pytest.importorskip("imageio_ffmpeg")
    path = media.write_video(frames(), tmp_path / "a.mp4", 25.0)
    with imageio.get_reader(path) as reader:
        data = reader.get_meta_data()
        pictures_back = [np.asarray(picture) for picture in reader]
    assert (data["fps"], data["size"], len(pictures_back)) == (25.0, (64, 48), 10)
    assert np.abs(pictures_back[9].astype(int) - frames()[9]).mean() < 8


def test_another_ending_is_refused_before_any_frame_is_drawn(tmp_path: Path) -> None:
    def never() -> Iterator[np.ndarray]:
        raise AssertionError("a frame was drawn")
        yield

    with pytest.raises(ConfigError, match=r"must end in \.gif or \.mp4, not in '\.avi'"):
        media.write_video(never(), tmp_path / "a.avi", 25.0)
    with pytest.raises(ConfigError, match=r"must end in \.gif or \.mp4"):
        media.check_video_path(tmp_path / "video")


@pytest.mark.parametrize(("count", "fps"), [(0, 25.0), (3, 0.0), (3, float("nan"))])
def test_a_video_of_nothing_is_refused(count: int, fps: float, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="frame"):
        media.write_video(frames(count), tmp_path / "a.gif", fps)


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_a_failure_half_way_leaves_the_old_file_and_nothing_else(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(b"old")

    def some() -> Iterator[np.ndarray]:
        yield from frames(3)
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        media.write_video(some(), path, 25.0)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"


@pytest.fixture
def small_files() -> Iterator[None]:
    """No file grows beyond 20 kB, as on a full disk."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
@pytest.mark.parametrize("old", [b"", b"old"])
def test_a_video_that_does_not_fit_is_an_error_and_leaves_nothing(
    suffix: str, old: bytes, tmp_path: Path, small_files: None
) -> None:
    path = tmp_path / f"a.{suffix}"
    if old:
        path.write_bytes(old)
    noise = np.random.default_rng(0).integers(0, 256, (12, 64, 64, 3), dtype=np.uint8)
    with pytest.raises(OutputError, match=rf"cannot write {path}: ."):
        media.write_video(noise, path, 25.0)
    assert [entry.read_bytes() for entry in tmp_path.iterdir()] == [old] * bool(old)


def test_what_ffmpeg_says_of_a_full_disk_is_told(tmp_path: Path) -> None:
    ffmpeg = tmp_path / "ffmpeg"
    ffmpeg.write_text("#!/bin/sh\ncat > /dev/null\necho 'out: No space left on device' >&2\necho end >&2\nexit 228\n")
    ffmpeg.chmod(0o755)
    with pytest.raises(OSError, match=r"^ffmpeg: out: No space left on device$"):
        encode(frames(), tmp_path / "a.mp4", 25.0, str(ffmpeg))
    ffmpeg.write_text("#!/bin/sh\nexit 3\n")
    with pytest.raises(OSError, match=r"^ffmpeg: exit code 3$"):
        encode(frames(200, (480, 640)), tmp_path / "a.mp4", 25.0, str(ffmpeg))


def test_an_odd_size_is_made_even(tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio.v2")
    path = media.write_video(frames(3, (33, 31)), tmp_path / "a.mp4", 24000 / 1001)
    with imageio.get_reader(path) as reader:
        assert reader.get_meta_data()["size"] == (32, 34)


def test_a_folder_that_cannot_be_made_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        media.write_png(frames()[0], tmp_path / "file" / "a.png")


@pytest.mark.parametrize(
    ("module", "name"), [("PIL.Image", "a.gif"), ("PIL.Image", "a.mp4"), ("imageio_ffmpeg", "a.mp4")]
)
def test_a_missing_package_names_the_extra(
    module: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DependencyError, match=r'pip install "morphkit\[viewer\]"'):
        media.check_video_path(tmp_path / name)
