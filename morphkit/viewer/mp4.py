"""MP4 files, written by ffmpeg, whose exit code and last words count."""

from __future__ import annotations

import contextlib
import errno
import os
import subprocess
import tempfile
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import IO

import numpy as np

from morphkit.utils.interrupts import Interrupts

_QUALITY = 15  # H.264's constant rate factor: 0 loses nothing, 51 is worst


def encode(frames: Iterable[np.ndarray], path: Path, fps: float, ffmpeg: str) -> None:
    """Write a video in H.264.

    Args:
        frames: At least one picture, uint8 of shape (height, width, 3), all of one size.
        path: The file.
        fps: Frames per second.
        ffmpeg: The program.

    Raises:
        OSError: ffmpeg cannot be run or fails, such as on a full disk. The file may be there and is not whole.
    """
    iterator = iter(frames)
    first = next(iterator)
    height, width = first.shape[:2]
    process: subprocess.Popen[bytes] | None = None
    with tempfile.TemporaryFile() as said:
        try:
            with Interrupts() as interrupts:  # a process that nobody knows would make the file anew
                process = subprocess.Popen(
                    _command(ffmpeg, path, width, height, fps),
                    stdin=subprocess.PIPE,
                    stdout=subprocess.DEVNULL,
                    stderr=said,
                    start_new_session=os.name == "posix",  # Ctrl-C is for us, who end it
                )
            if interrupts.wanted:
                raise KeyboardInterrupt
            assert process.stdin is not None
            with contextlib.suppress(BrokenPipeError), process.stdin as pipe:  # ffmpeg says why it ended
                pipe.write(_bytes(first))
                for frame in iterator:
                    pipe.write(_bytes(frame))
        except BaseException:
            if process is not None:
                process.kill()
            raise
        finally:
            if process is not None:
                process.wait()
        if process.returncode:
            raise OSError(f"ffmpeg: {_reason(said) or f'exit code {process.returncode}'}")


def _command(ffmpeg: str, path: Path, width: int, height: int, fps: float) -> list[str]:
    rate = str(Fraction(fps).limit_denominator(10**6))
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", rate, "-i", "-"]
    # Two pixels are the least that H.264 with this color format can count in.
    picture = ["-vf", "scale=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]
    return [
        ffmpeg,
        "-y",
        "-v",
        "error",
        *source,
        "-an",
        *picture,
        "-c:v",
        "libx264",
        "-crf",
        str(_QUALITY),
        f"file:{path}",
    ]


def _bytes(frame: np.ndarray) -> bytes:
    return np.ascontiguousarray(frame, np.uint8).tobytes()


def _reason(log: IO[bytes]) -> str:
    """What ffmpeg said last, or before that of a full disk."""
    log.seek(0)
    lines = [line.strip() for line in log.read().decode(errors="replace").splitlines() if line.strip()]
    full = [line for line in lines if os.strerror(errno.ENOSPC) in line]
    return next(iter([*full, *reversed(lines)]), "")
