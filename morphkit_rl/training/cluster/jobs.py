"""Calls of a function as Ray tasks: lost ones are repeated, and Ctrl-C lets all stop at a checkpoint."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from morphkit.errors import MorphkitError

RETRIES = 10
"""How often a call is repeated whose node or process was lost."""
LOOK_S = 2.0
"""Time between two looks at calls that are not over, s."""

_STOP_S = 120.0


@dataclass(frozen=True, slots=True)
class Resources:
    """What a call needs of a node.

    Attributes:
        cpus: Cores; also the threads that PyTorch uses.
        gpus: GPUs.
    """

    cpus: float = 1
    gpus: float = 0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a call.

    Attributes:
        number: Which it is.
        value: What it returned.
        error: Why it failed; empty where it did not.
    """

    number: int
    value: Any = None
    error: str = ""


def run_jobs(
    ray: ModuleType,
    function: Callable[[Any], Any],
    arguments: Sequence[Any],
    resources: Resources,
    watch: Callable[[], None] = lambda: None,
) -> Iterator[Outcome]:
    """Call a function once for each argument, as many at a time as the cluster has room for.

    Args:
        ray: What `connected` gave.
        function: What to call; errors of morphkit become outcomes. It has to go on where a lost call stopped.
        arguments: One a call.
        resources: What each call needs.
        watch: Called every `LOOK_S` seconds.

    Yields:
        Outcomes, as calls end.

    Raises:
        KeyboardInterrupt: Ctrl-C; all calls that had begun got it, too, and have ended.
    """
    task = ray.remote(
        num_cpus=resources.cpus, num_gpus=resources.gpus, max_retries=RETRIES, scheduling_strategy="SPREAD"
    )(_attempt)
    calls = {task.remote(function, argument): number for number, argument in enumerate(arguments)}
    try:
        while calls:
            ended, _ = ray.wait(list(calls), timeout=LOOK_S)
            watch()
            for each in ended:
                yield _outcome(ray, each, calls.pop(each))
    except BaseException:
        for each in calls:
            ray.cancel(each)
        ray.wait(list(calls), num_returns=len(calls), timeout=_STOP_S) if calls else None
        raise


def _attempt(function: Callable[[Any], Any], argument: Any) -> tuple[Any, str]:
    """On a node: the value, or why there is none. Other errors are faults of the program and reach Ray."""
    try:
        return function(argument), ""
    except (MorphkitError, OSError) as error:
        return None, str(error)


def _outcome(ray: ModuleType, call: Any, number: int) -> Outcome:
    try:
        return Outcome(number, *ray.get(call))
    except ray.exceptions.RayError as error:  # lost too often, or a fault of the program
        lines = str(error).strip().splitlines() or [type(error).__name__]
        return Outcome(number, error=lines[-1])
