"""Attributes of numbers, multiplied in place; what is not multiplied stays as it is written."""

from __future__ import annotations

from typing import Any

import numpy as np

from morphkit.errors import AblationError
from morphkit.formats.poses import numbers, text


def multiply(element: Any, attribute: str, factor: Any, value: str | None = None) -> None:
    """Write an attribute's numbers times `factor`; without numbers nothing is written.

    Args:
        element: The element.
        attribute: The attribute.
        factor: One factor, or one for each of the first numbers.
        value: What counts for the attribute where that is not what the element has, such as a default.
    """
    value = element.get(attribute, "") if value is None else value
    if value.strip():
        multiply_values(element, attribute, factor, read(element, attribute, value))


def multiply_values(element: Any, attribute: str, factor: Any, values: Any) -> None:
    """Write `values` times `factor`, see `multiply`, into an attribute, unless both are the same."""
    values = np.array(values, dtype=float, ndmin=1)
    factors = np.ones(len(values))
    given = np.atleast_1d(factor)[: len(values)]
    factors[: len(given) if np.ndim(factor) else None] = given
    if np.any(values * factors != values):
        element.set(attribute, text(values * factors))


def read(element: Any, attribute: str, value: str) -> np.ndarray:
    """The numbers of an attribute.

    Raises:
        AblationError: They are none.
    """
    try:
        return numbers(value)
    except ValueError:
        raise AblationError(
            f"line {element.sourceline}: {attribute}={value!r} in <{element.tag}> cannot be scaled: expected numbers"
        ) from None
