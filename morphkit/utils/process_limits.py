"""Limits of a process on memory and processor time, for work on files from strangers (not on Windows)."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from morphkit.errors import ConfigError

SECONDS = 8.0
"""Processor time that reading or compiling a robot may take, s, besides what its meshes take."""
MEMORY = 5 * 2**28
"""Memory that it may take, bytes, besides what its meshes take."""
BYTES_A_SECOND = 2**20
"""What is read of meshes in a second at least."""
MEMORY_A_BYTE = 32
"""Memory that a byte of the largest mesh takes at most, with its hull."""
KEPT_A_BYTE = 16
"""Memory that a byte of another mesh takes at most once it was read."""
MOST_KEPT = 2**26
"""Bytes of the other meshes that count."""
FACTOR = "MORPHKIT_LIMITS"
"""Variable of the environment by which both limits are multiplied."""
ADVICE = f"if you trust the file, allow ten times as much with {FACTOR}=10"
_WANT_OF_MEMORY = (
    *("could not allocate", "bad_alloc", "cannot allocate", "unable to allocate", "unknown exception"),
    "failed to map segment",
)
_bounded = False


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a process.

    Attributes:
        seconds: Processor time of each task, s.
        memory: Address space that it may take besides what it has at its start, bytes.
    """

    seconds: float
    memory: int

    @classmethod
    def for_meshes(cls, total: int, largest: int) -> Limits:
        """Limits for a robot.

        Args:
            total: Bytes of all its meshes, once for each scale.
            largest: Bytes of the largest.

        Raises:
            ConfigError: MORPHKIT_LIMITS is no positive number.
        """
        factor = _factor()
        memory = MEMORY + MEMORY_A_BYTE * largest + KEPT_A_BYTE * min(total - largest, MOST_KEPT)
        return cls(factor * (SECONDS + total / BYTES_A_SECOND), int(factor * memory))

    def bound_memory(self) -> None:
        """Set the limit on the memory of this process, now and for good; its death leaves no core file."""
        global _bounded
        _bounded = True
        if os.name != "posix":
            return
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if sys.platform == "linux":
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            most = pages * resource.getpagesize() + self.memory
            resource.setrlimit(resource.RLIMIT_AS, (most, most))

    def bound_next_task(self) -> None:
        """Let this process have so much more processor time from now on; then it dies of SIGXCPU."""
        if os.name != "posix":
            return
        import resource

        used = resource.getrusage(resource.RUSAGE_SELF)
        _, hard = resource.getrlimit(resource.RLIMIT_CPU)
        soft = int(used.ru_utime + used.ru_stime + self.seconds) + 1
        if hard == resource.RLIM_INFINITY or soft < hard:
            resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))


def is_bounded() -> bool:
    """Whether this process has its limits already, which those that it starts would inherit."""
    return _bounded


def is_want_of_memory(error: Exception) -> bool:
    """Whether an exception says that there was not enough memory, in whatever words its library has for that."""
    return isinstance(error, MemoryError) or any(words in str(error).lower() for words in _WANT_OF_MEMORY)


def _factor() -> float:
    text = os.environ.get(FACTOR, "1")
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e6:
        raise ConfigError(f"{FACTOR} is {text!r}; expected a positive number")
    return value
