"""Which shapes of a URDF simulators can make something of; `check` and all that simulates or draws ask here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from morphkit.errors import DescriptionError
from morphkit.formats.poses import numbers

SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
"""Shape -> how many numbers each of its sizes has."""
_THIN = "1e-6"  # m, or as a factor


@dataclass(frozen=True)
class Fault:
    """What is wrong with a visual or collision.

    Attributes:
        rule: Id of the finding.
        element: The lxml element that is wrong.
        text: What is wrong, after "a visual of link 'leg'".
        fate: What becomes of it. What only decorates or has no extent is left out, what is flat is thickened; what
            things would touch, and cannot, is refused.
    """

    rule: str
    element: Any
    text: str
    fate: Literal["left out", "thickened", "refused"]


def shape_of(part: Any) -> Any:
    """The shape of a `<visual>` or `<collision>`, None where it has none."""
    return next((each for each in part.iterfind("geometry/*") if isinstance(each.tag, str)), None)


def shape_fault(part: Any) -> Fault | None:
    """What is wrong with the shape of a `<visual>` or `<collision>`; whether its mesh exists is not asked."""
    shape = shape_of(part)
    if shape is None:
        return _impossible(part, "geometry-missing", part, "has no shape")
    if shape.tag not in SIZES:
        return _impossible(part, "geometry-unknown", shape, f"has the unknown shape <{shape.tag}>")
    wrong = _wrong_size(shape)
    if wrong:
        return _impossible(part, "geometry-impossible", shape, wrong)
    sizes = np.concatenate([np.zeros(0), *(numbers(shape.get(key)) for key in SIZES[shape.tag] if shape.get(key))])
    if sizes.all():
        return None
    decorates = part.tag == "visual"
    rule = "mesh-scale-zero" if shape.tag == "mesh" else "geometry-empty" if decorates else "geometry-size"
    if decorates or not sizes.any():
        return Fault(rule, shape, "has no extent", "left out")
    return Fault(rule, shape, "is flat", "thickened")


def _impossible(part: Any, rule: str, element: Any, text: str) -> Fault:
    if part.tag == "visual":
        return Fault("visual-impossible", element, text, "left out")
    return Fault(rule, element, text, "refused")


def settle_shapes(robot: Any, *, file: str) -> Iterator[str]:
    """Leave out or thicken shapes, in place; yield a sentence for each.

    Args:
        robot: The root element of a URDF.
        file: Its name, for errors.

    Raises:
        DescriptionError: Nothing can be made of a shape that things would touch.
    """
    for part in [part for tag in ("visual", "collision") for part in robot.iterfind(f"link/{tag}")]:
        fault = shape_fault(part)
        what = f"a {part.tag} of link {part.getparent().get('name')!r}"
        if fault is None:
            _write_all_factors(part)
        elif fault.fate == "refused":
            raise DescriptionError(f"{file}:{fault.element.sourceline}: {what} {fault.text}")
        elif fault.fate == "left out":
            part.getparent().remove(part)
            yield f"{what} {fault.text} and was left out"
        else:
            for key in SIZES[fault.element.tag]:
                words = fault.element.get(key, "1 1 1").split()
                fault.element.set(key, " ".join(_THIN if float(word) == 0 else word for word in words))
            _write_all_factors(part)
            yield f"{what} {fault.text} and got a thickness of 1 micrometer"


def _write_all_factors(part: Any) -> None:
    """A mesh's single factor, which some readers take for all three, three times."""
    shape = shape_of(part)
    if shape.tag == "mesh" and len(shape.get("scale", "").split()) == 1:
        shape.set("scale", " ".join([shape.get("scale")] * 3))


def _wrong_size(shape: Any) -> str:
    """What to say of a size that is missing or none; empty where all are right, or zero."""
    for key, count in SIZES[shape.tag].items():
        text = shape.get(key)
        if text is None and shape.tag != "mesh":
            return f"has a <{shape.tag}> without {key}"
        if text is None:
            continue
        try:
            found = numbers(text)
        except ValueError:
            found = np.zeros(0)
        counts = (1, 3) if key == "scale" else (count,)
        if len(found) not in counts or not np.isfinite(found).all() or (key != "scale" and (found < 0).any()):
            sign = "" if key == "scale" else " that is not negative" if count == 1 else " that are not negative"
            expected = f"{'a finite number' if count == 1 else f'{count} finite numbers'}{sign}"
            return f"has a <{shape.tag}> of {key} {text!r}, expected {expected}"
    return ""
