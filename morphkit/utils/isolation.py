"""A call in a process of its own, with limits on memory and processor time."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable
from functools import partial
from typing import TypeVar

from morphkit.errors import MorphkitError
from morphkit.utils import worker_pool
from morphkit.utils.process_limits import Limits, is_bounded, is_want_of_memory

_WALL_FACTOR, _WALL_S = 20.0, 60.0
T = TypeVar("T")


def in_worker() -> bool:
    """Whether this process is a worker of another, whose limits hold."""
    return multiprocessing.current_process().daemon or is_bounded()


def run_isolated(call: Callable[[], T], limits: Limits, *, problem: Callable[[str], MorphkitError]) -> T:
    """The result of `call()` in a process of its own; in a worker, which has its own limits, it is called directly.

    Args:
        call: Both it and its result have to be picklable. Warnings are swallowed.
        limits: What it may take.
        problem: Makes an error of the reason why there is no result: the limits did not suffice, or the process died.

    Raises:
        MorphkitError: That of `problem`, or that of `call`.
    """
    if in_worker():
        return call()
    wall = _WALL_S + _WALL_FACTOR * limits.seconds
    ((_, result),) = worker_pool.run(partial(_answering, call), [None], timeout_s=wall, limits=limits)
    if isinstance(result, worker_pool.Failure):
        raise problem(result.reason)
    if isinstance(result, MorphkitError):
        raise result
    return result


def _answering(call: Callable[[], T]) -> Callable[[None], T | MorphkitError]:
    def answer(_: None) -> T | MorphkitError:
        warnings.simplefilter("ignore")
        try:
            return call()
        except MorphkitError as error:
            if is_want_of_memory(error):
                raise MemoryError from error
            return error

    return answer
