"""Networks and optimizers as named arrays, and back; what does not fit is refused before anything is taken over."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import torch
from torch import nn

from morphkit.errors import CheckpointError
from morphkit_rl.models.vocabulary import Vocabulary

_ADAM = {"step", "exp_avg", "exp_avg_sq"}


def require_shapes(
    arrays: Mapping[str, np.ndarray], expected: Mapping[str, np.ndarray], origin: Path, *, exactly: bool = False
) -> None:
    """Refuse arrays that lack one of the expected, or one whose shape or, if `exactly`, kind of numbers is another.

    Raises:
        CheckpointError: That is so.
    """
    for name, array in expected.items():
        found = arrays.get(name)
        if found is None:
            raise CheckpointError(f"{origin}: damaged: it lacks {name!r}")
        if found.shape != array.shape or (
            found.dtype != array.dtype if exactly else found.dtype.kind != array.dtype.kind
        ):
            raise CheckpointError(
                f"{origin}: does not fit the run: {name} is {found.dtype} {found.shape}, "
                f"expected {array.dtype} {array.shape}"
            )


def require_sizes(
    settings: Iterable[object], vocabulary: Vocabulary, arrays: Mapping[str, np.ndarray], origin: Path
) -> None:
    """Refuse sizes of networks that the saved arrays cannot be of, before networks of such sizes take up memory.

    Args:
        settings: Dataclasses of sizes.
        vocabulary: What the networks were made for.
        arrays: The networks' parameters.
        origin: Where they come from, for messages.

    Raises:
        CheckpointError: A size is greater than all there is.
    """
    longest = max((size for array in arrays.values() for size in array.shape), default=0)
    most = max(longest, len(arrays))
    for part in (*settings, vocabulary):
        for each in dataclasses.fields(part):  # type: ignore[arg-type]
            value = getattr(part, each.name)
            if isinstance(value, int) and value > (len(arrays) if each.name.endswith("layers") else most):
                raise CheckpointError(f"{origin}: made for another method or size: {each.name} is {value} in the run")


def module_arrays(networks: Mapping[str, nn.Module]) -> dict[str, np.ndarray]:
    """Parameters of several networks under `network/parameter`."""
    return {
        f"{name}/{key}": value.detach().cpu().numpy()
        for name, network in networks.items()
        for key, value in network.state_dict().items()
    }


def load_modules(networks: Mapping[str, nn.Module], arrays: Mapping[str, np.ndarray], origin: Path) -> None:
    """Fill networks from `module_arrays`.

    Raises:
        CheckpointError: The parameters are those of another network.
    """
    for name, network in networks.items():
        prefix = f"{name}/"
        part = {key[len(prefix) :]: torch.from_numpy(a) for key, a in arrays.items() if key.startswith(prefix)}
        try:
            network.load_state_dict(part)
        except (RuntimeError, TypeError) as error:
            reason = textwrap.shorten(str(error), 300, placeholder=" ...")
            raise CheckpointError(f"{origin}: made for another method or size: {reason}") from None


def optimizer_arrays(optimizers: Mapping[str, torch.optim.Optimizer]) -> dict[str, np.ndarray]:
    """State of several optimizers under `optimizer/parameter number/name`."""
    return {
        f"{name}/{number}/{key}": value.detach().cpu().numpy()
        for name, optimizer in optimizers.items()
        for number, state in optimizer.state_dict()["state"].items()
        for key, value in state.items()
    }


def load_optimizers(
    optimizers: Mapping[str, torch.optim.Optimizer], arrays: Mapping[str, np.ndarray], origin: Path
) -> None:
    """Fill optimizers from `optimizer_arrays`.

    Raises:
        CheckpointError: The state is that of other networks, or makes no sense.
    """
    states: dict[str, dict[int, dict[str, torch.Tensor]]] = {name: {} for name in optimizers}
    for key, array in arrays.items():
        name, _, rest = key.partition("/")
        number, _, field = rest.partition("/")
        if name not in states or not (number.isascii() and number.isdecimal()) or field not in _ADAM:
            raise CheckpointError(f"{origin}: damaged: {key[:80]!a} belongs to no optimizer of the run")
        states[name].setdefault(int(number), {})[field] = torch.from_numpy(array)
    for name, optimizer in optimizers.items():
        parameters = [each for group in optimizer.param_groups for each in group["params"]]
        for place, state in states[name].items():
            if place >= len(parameters) or not _is_adam(state, parameters[place]):
                raise CheckpointError(f"{origin}: does not fit the run: parameter {place} of optimizer {name}")
    for name, optimizer in optimizers.items():
        optimizer.load_state_dict({**optimizer.state_dict(), "state": states[name]})


def _is_adam(state: Mapping[str, torch.Tensor], parameter: torch.Tensor) -> bool:
    """Whether Adam can go on from a state; arrays without an axis are saved with one."""
    shapes = {"step": (1,), "exp_avg": tuple(parameter.shape) or (1,), "exp_avg_sq": tuple(parameter.shape) or (1,)}
    if {key: tuple(value.shape) or (1,) for key, value in state.items()} != shapes:
        return False
    if not all(value.is_floating_point() for value in state.values()):
        return False
    return bool(state["step"].item() >= 1 and (state["exp_avg_sq"] >= 0).all())
