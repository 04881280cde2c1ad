"""Pictures and films of a robot description as it is: its start pose, and its joints swinging one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np

from morphkit.errors import ConfigError
from morphkit.simulation.inspection_model import Mechanics
from morphkit.viewer.joint_sliders import Dial, dials, pose, swing
from morphkit.viewer.media import import_viewer
from morphkit.viewer.render import model_frames

FPS = 12.0
"""Pictures of a film a second."""
_SECONDS = 12.0  # How long a film is, as far as that gives each joint a time that the eye can follow.
_FEWEST, _MOST = 8, 45  # frames a joint
_BAR = 0.13  # Height of the caption, as a share of that of the picture

Shot = tuple[Dial, float]
"""What moves, and its value."""


def portrait(mechanics: Mechanics, *, width: int = 960, height: int = 720) -> np.ndarray:
    """The robot in its start pose, uint8, shape (height, width, 3).

    Raises:
        DependencyError: No OpenGL; the message says which system packages to install.
    """
    return next(iter(_frames(mechanics, pose(mechanics, {})[None], [()], width, height)))


def swing_shots(mechanics: Mechanics) -> list[Shot]:
    """What a film of all joints shows, picture by picture: every joint swings through its range, one after the other.

    Raises:
        ConfigError: The robot has no joint to swing.
    """
    moving = dials(mechanics)
    if not moving:
        raise ConfigError(f"{mechanics.description.file}: no joint to swing; --png draws it in its start pose")
    steps = int(np.clip(FPS * _SECONDS / len(moving), _FEWEST, _MOST))
    return [(dial, value) for dial in moving for value in swing(dial, steps)]


def film(mechanics: Mechanics, shots: Sequence[Shot], *, width: int = 400, height: int = 360) -> Iterator[np.ndarray]:
    """Draw shots, each with the joint's name and value below it; the limb that moves stands out in color.

    Yields:
        Pictures, uint8, shape (height, width, 3), `FPS` a second.

    Raises:
        DependencyError: No OpenGL, or the extra `viewer` is not installed.
    """
    import_viewer("PIL.Image")
    bar = int(_BAR * height)
    states = np.array([pose(mechanics, {dial.name: value}) for dial, value in shots])
    limbs = {dial.limb for dial, _ in shots}
    bodies = {limb: [body for body, owner in mechanics.limb_of.items() if owner == limb] for limb in limbs}
    frames = _frames(mechanics, states, [bodies[dial.limb] for dial, _ in shots], width, height - bar)
    for (dial, value), frame in zip(shots, frames, strict=True):
        yield np.concatenate([frame, _caption(dial, value, width, bar)])


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


def _caption(dial: Dial, value: float, width: int, height: int) -> np.ndarray:
    """Limb, joint and value, and where in the joint's range that is."""
    picture = import_viewer("PIL.Image").new("RGB", (width, height), (38, 44, 54))
    draw = import_viewer("PIL.ImageDraw").Draw(picture)
    font, pad, line = _font(max(8, int(0.34 * height))), int(0.3 * height), 0.30 * height
    name = dial.name if dial.limb == dial.name else f"{dial.limb}: {dial.name}"
    digits = 0 if dial.unit == "°" else 2
    draw.text((pad, line), name, font=font, fill=(240, 240, 240), anchor="lm")
    draw.text((width - pad, line), f"{value:.{digits}f} {dial.unit}", font=font, fill=(242, 140, 80), anchor="rm")
    left, right, y = pad, width - pad, int(0.72 * height)
    share = (value - dial.low) / (dial.high - dial.low) if dial.high > dial.low else 0.5
    at, radius = left + min(max(share, 0.0), 1.0) * (right - left), max(2, height // 9)
    draw.line((left, y, right, y), fill=(110, 118, 130), width=max(1, height // 22))
    draw.ellipse((at - radius, y - radius, at + radius, y + radius), fill=(242, 108, 41))
    return np.asarray(picture)


@cache
def _font(size: int) -> Any:
    return import_viewer("PIL.ImageFont").load_default(size)
