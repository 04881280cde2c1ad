"""Pictures and films of a robot description as it is: its start pose, and its joints swinging one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from morphkit.errors import ConfigError
from morphkit.mechanics import Mechanics
from morphkit.pictures import import_viewer
from morphkit.posing import Dial, dials, pose, swing
from morphkit.rendering import model_frames

FPS = 15.0
_SECONDS = 8.0  # How long a film is, as far as that gives each joint a time that the eye can follow.
_FEWEST, _MOST = 8, 45  # frames a joint
_BAR = 0.13  # Height of the caption, as a share of that of the picture


def portrait(mechanics: Mechanics, *, width: int = 960, height: int = 720) -> np.ndarray:
    """The robot in its start pose, uint8, shape (height, width, 3).

    Raises:
        DependencyError: No OpenGL; the message says which system packages to install.
    """
    return next(iter(_frames(mechanics, pose(mechanics, {})[None], [()], width, height)))


def swing_frames(mechanics: Mechanics, *, width: int = 400, height: int = 340) -> Iterator[np.ndarray]:
    """Film every joint as it swings through its range, one after the other, with its name and value below.

    Yields:
        Pictures, uint8, shape (height, width, 3), `FPS` a second; the limb that moves stands out in colour.

    Raises:
        ConfigError: The robot has no joint to swing.
        DependencyError: No OpenGL, or the extra `viewer` is not installed.
    """
    import_viewer("PIL.Image")
    moving = dials(mechanics)
    if not moving:
        raise ConfigError(f"{mechanics.description.file}: no joint to swing; --png draws the robot as it stands")
    steps = int(np.clip(FPS * _SECONDS / len(moving), _FEWEST, _MOST))
    shots = [(dial, value) for dial in moving for value in swing(dial, steps)]
    states = np.array([pose(mechanics, {dial.name: value}) for dial, value in shots])
    bodies = {dial.limb: [body for body, limb in mechanics.limb_of.items() if limb == dial.limb] for dial in moving}
    frames = _frames(mechanics, states, [bodies[dial.limb] for dial, _ in shots], width, height)
    for (dial, value), frame in zip(shots, frames, strict=True):
        yield _captioned(frame, dial, value)


def _frames(mechanics: Mechanics, states: np.ndarray, marked: Any, width: int, height: int) -> Iterator[np.ndarray]:
    return model_frames(
        mechanics.model,
        states,
        root=mechanics.root,
        base=mechanics.morphology.base,
        width=width,
        height=height,
        still=True,
        marked=marked,
    )


def _captioned(frame: np.ndarray, dial: Dial, value: float) -> np.ndarray:
    """Write limb, joint and value over the lower edge of a picture, with a gauge of the joint's range."""
    image, draw_on = import_viewer("PIL.Image"), import_viewer("PIL.ImageDraw")
    height, width = frame.shape[:2]
    bar = int(_BAR * height)
    picture = image.fromarray(frame).convert("RGB")
    draw = draw_on.Draw(picture)
    top = height - bar
    draw.rectangle((0, top, width, height), fill=(38, 44, 54))
    font = _font(max(8, int(0.34 * bar)))
    pad = int(0.3 * bar)
    draw.text(
        (pad, top + 0.30 * bar),
        f"{dial.limb}: {dial.name}" if dial.limb != dial.name else dial.name,
        font=font,
        fill=(240, 240, 240),
        anchor="lm",
    )
    draw.text(
        (width - pad, top + 0.30 * bar),
        f"{value:.{0 if dial.unit == '°' else 2}f} {dial.unit}",
        font=font,
        fill=(242, 140, 80),
        anchor="rm",
    )
    y, left, right = top + int(0.72 * bar), pad, width - pad
    share = (value - dial.low) / (dial.high - dial.low) if dial.high > dial.low else 0.5
    at = left + min(max(share, 0.0), 1.0) * (right - left)
    thick = max(1, bar // 22)
    draw.line((left, y, right, y), fill=(110, 118, 130), width=thick)
    radius = max(2, bar // 9)
    draw.ellipse((at - radius, y - radius, at + radius, y + radius), fill=(242, 108, 41))
    return np.asarray(picture)


@cache
def _font(size: int) -> Any:
    return import_viewer("PIL.ImageFont").load_default(size)
