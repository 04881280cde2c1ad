"""What a run is computed on."""

from __future__ import annotations

import os
import platform
from pathlib import Path


def machine(cpuinfo: Path = Path("/proc/cpuinfo")) -> dict[str, str | int]:
    """Name of the processor, as far as the operating system tells it, and the number of cores that are at hand.

    Args:
        cpuinfo: Where Linux lists its processors.
    """
    try:
        fields = dict(line.split(":", 1) for line in cpuinfo.read_text("utf-8", "replace").splitlines() if ":" in line)
    except OSError:
        fields = {}
    names = {key.strip(): value.strip() for key, value in fields.items()}
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    processor = names.get("model name") or platform.processor() or platform.machine()
    return {"processor": processor[:200], "cores": cores}
