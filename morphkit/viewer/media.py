"""Picture and video files; each is written under a temporary name and then renamed."""

from __future__ import annotations

import importlib
import itertools
import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from morphkit.errors import ConfigError, DependencyError
from morphkit.utils.atomic_write import write_output
from morphkit.viewer.mp4 import encode
from morphkit.viewer.render import render_frames, start_reach

if TYPE_CHECKING:
    from morphkit.simulation.build import Simulation

_GIF_FPS = 50.0  # Viewers slow faster ones down.
_GIF_COLORS = 192
_NAME_HEIGHT = 30  # pixels


def write_png(picture: np.ndarray, path: Path) -> Path:
    """Write a picture, uint8 of shape (height, width, 3), as PNG.

    Raises:
        ConfigError: The file's name does not end in .png.
        OutputError: The file cannot be written.
        DependencyError: The extra `viewer` is not installed.
    """
    path = Path(path)
    check_picture_path(path)
    image = import_viewer("PIL.Image")
    return write_output(path, lambda target: image.fromarray(picture).save(target, format="PNG"))


def check_picture_path(path: Path) -> None:
    """Raise what `write_png` would raise for this file name, before any work is done.

    Raises:
        ConfigError: The file's name does not end in .png.
        DependencyError: The extra `viewer` is not installed.
    """
    _check_suffix(Path(path), (".png",))
    import_viewer("PIL.Image")


def check_video_path(path: Path) -> None:
    """Raise what `write_video` would raise for this file name, before any work is done.

    Raises:
        ConfigError: The file's name ends neither in .gif nor in .mp4.
        DependencyError: What writes such files is not installed.
    """
    _check_suffix(Path(path), (".gif", ".mp4"))
    import_viewer("PIL.Image")
    if Path(path).suffix.lower() == ".mp4":
        try:
            import_viewer("imageio_ffmpeg").get_ffmpeg_exe()
        except RuntimeError as error:
            raise DependencyError(f"MP4 needs ffmpeg ({error}): apt-get install ffmpeg, or write a .gif") from None


def write_video(frames: Iterable[np.ndarray], path: Path, fps: float) -> Path:
    """Write a video, as GIF or MP4 (H.264) by the ending of its name.

    Args:
        frames: Pictures, uint8 of shape (height, width, 3); an iterator is read one picture at a time.
        path: The file; one of that name is replaced.
        fps: Frames per second. A GIF shows at most 50: of more, some are left out.

    Raises:
        ConfigError: The name ends in something else, there are no frames, or fps is not positive.
        OutputError: The file cannot be written.
        DependencyError: The extra `viewer` is not installed.
    """
    path = Path(path)
    check_video_path(path)
    if not (math.isfinite(fps) and fps > 0):
        raise ConfigError(f"a video needs a positive number of frames per second, got {fps}")
    iterator = iter(frames)
    first = next(iterator, None)
    if first is None:
        raise ConfigError(f"{path}: a video needs at least one frame")
    every = itertools.chain([first], iterator)
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    return write_output(path, lambda target: write(every, target, fps))


def family_sheet(
    simulations: Sequence[Simulation], path: Path, *, columns: int | None = None, width: int = 360, height: int = 280
) -> Path:
    """Write one PNG that shows several bodies side by side, in their start poses, to one scale, with their names.

    Args:
        simulations: The bodies, in the order of the sheet.
        path: The PNG file; one of that name is replaced.
        columns: Bodies in a row; default: about as many as makes the sheet 3 : 2.
        width: Width of a body's picture, pixels.
        height: Height of a body's picture, pixels.

    Raises:
        ConfigError: No bodies, or the name does not end in .png.
        OutputError: The file cannot be written.
        DependencyError: No OpenGL, or the extra `viewer` is not installed.
    """
    path = Path(path)
    _check_suffix(path, (".png",))
    if not simulations:
        raise ConfigError(f"{path}: a family sheet needs at least one body")
    import_viewer("matplotlib")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = columns or min(len(simulations), math.ceil(math.sqrt(1.2 * len(simulations))))
    rows = math.ceil(len(simulations) / columns)
    reach = max(start_reach(simulation) for simulation in simulations)
    size = (columns * width / 100, rows * (height + _NAME_HEIGHT) / 100)
    figure = Figure(figsize=size, dpi=100, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    for axis, simulation in itertools.zip_longest(figure.subplots(rows, columns, squeeze=False).flat, simulations):
        axis.set_axis_off()
        if simulation is not None:
            axis.imshow(next(iter(render_frames(simulation, width=2 * width, height=2 * height, reach=reach))))
            name = textwrap.fill(simulation.description.name, max(10, width // 8))
            axis.set_title(name, fontsize=10, parse_math=False)
    return write_output(path, lambda target: figure.savefig(target, format="png"))


def _check_suffix(path: Path, allowed: tuple[str, ...]) -> None:
    if path.suffix.lower() not in allowed:
        raise ConfigError(f"{path}: the name must end in {' or '.join(allowed)}, not in {path.suffix or 'nothing'!r}")


def import_viewer(module: str) -> Any:
    """Import a module of the extra `viewer`; DependencyError where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise DependencyError(
            f'pictures, films and the browser need {module}: pip install "morphkit[viewer]" ({error})'
        ) from None


def _write_gif(frames: Iterable[np.ndarray], path: Path, fps: float) -> None:
    image = import_viewer("PIL.Image")
    step = math.ceil(fps / _GIF_FPS - 1e-9)
    # One palette for all frames, without dithering: what does not move costs no bytes.
    pictures: list[Any] = []
    palette = None
    for frame in itertools.islice(frames, 0, None, step):
        full = image.fromarray(frame)
        if palette is None:
            palette = full.quantize(_GIF_COLORS, dither=image.Dither.NONE)
        pictures.append(full.quantize(palette=palette, dither=image.Dither.NONE))
    ends = np.round(np.arange(len(pictures) + 1) * 100 * step / fps).astype(int) * 10  # GIF counts in 10 ms.
    durations = np.maximum(20, np.diff(ends)).tolist()
    pictures[0].save(
        path, format="GIF", save_all=True, append_images=pictures[1:], duration=durations, loop=0, disposal=1
    )


def _write_mp4(frames: Iterable[np.ndarray], path: Path, fps: float) -> None:
    encode(frames, path, fps, import_viewer("imageio_ffmpeg").get_ffmpeg_exe())
