"""Compiles the kernels when they are first wanted, once a user and processor, and keeps them in the user's cache.

Kernels only save time: without a compiler, or where anything else is missing, PyTorch's own operations do the same.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from importlib import resources
from pathlib import Path

import platformdirs
import torch
from torch import Tensor

logger = logging.getLogger(__name__)

SWITCH = "MORPHKIT_KERNELS"
"""Environment variable; `0` keeps to PyTorch's operations."""

STEP = 16
"""Widths of vectors that kernels compute on are multiples of this."""

_SOURCES = ("encoder_layer.cpp", "cross_attention.cpp", "mlp.cpp")
_HEADERS = ("product.h", "rows.h")
_FLAGS = ("-std=c++17", "-O3", "-march=native", "-fPIC")
_TIMEOUT_S = 120


@functools.cache
def load() -> ctypes.CDLL | None:
    """The compiled kernels; None where they are switched off, or cannot be made or loaded."""
    if os.environ.get(SWITCH, "1") == "0" or not _suits_processor():
        return None
    try:
        return ctypes.CDLL(str(_compiled()))
    except (OSError, subprocess.SubprocessError, ModuleNotFoundError) as error:
        logger.info("computing without compiled kernels: %s", error)
        return None


@functools.cache
def function(name: str, dtype: torch.dtype) -> Callable[..., None] | None:
    """The kernel of that name for tensors of a type; None where there is none."""
    return getattr(load(), f"{name}_{str(dtype).removeprefix('torch.')}", None)


def takes(x: Tensor, name: str, dtype: torch.dtype | None = None) -> bool:
    """Whether the kernel can compute on `x`, in its own precision or that of `dtype`."""
    return x.device.type == "cpu" and x.numel() > 0 and function(name, dtype or x.dtype) is not None


def edges(spans: Sequence[slice], length: int) -> tuple[int, ...] | None:
    """Where consecutive slices of a sequence begin, and its length; None where they are not all of it in order."""
    found = (0, *(span.stop for span in spans))
    fits = found[-1] == length and found[:-1] == tuple(span.start for span in spans) and list(found) == sorted({*found})
    return found if fits else None


@functools.lru_cache(maxsize=256)
def integers(*values: int) -> ctypes.Array[ctypes.c_int64]:
    """The numbers as an array that a kernel reads."""
    return (ctypes.c_int64 * len(values))(*values)


def pointer(tensor: Tensor) -> ctypes.c_void_p:
    """Where a tensor's numbers lie."""
    return ctypes.c_void_p(tensor.data_ptr())


def pointers(tensors: Sequence[Tensor]) -> ctypes.Array[ctypes.c_void_p]:
    """Where several tensors' numbers lie."""
    return (ctypes.c_void_p * len(tensors))(*[tensor.data_ptr() for tensor in tensors])


def gradients_of_threads(
    parameters: Sequence[Tensor], wanted: bool
) -> tuple[Callable[[], list[Tensor | None]], ctypes.Array[ctypes.c_void_p] | None]:
    """Room for the parameters' gradients, to which each thread adds its own.

    Returns:
        What gives the sums over all threads, None for each where they are not wanted; and where each thread's lie.
    """
    if not wanted:
        return lambda: [None for _ in parameters], None
    sizes = [parameter.numel() for parameter in parameters]
    sums = torch.zeros(torch.get_num_threads(), sum(sizes))

    def add_up() -> list[Tensor | None]:
        flat = sums.sum(0).split(sizes)
        return [gradient.view_as(parameter) for gradient, parameter in zip(flat, parameters, strict=True)]

    return add_up, pointers([share for thread in sums for share in thread.split(sizes)])


def _suits_processor() -> bool:
    return platform.system() == "Linux" and torch.backends.cpu.get_cpu_capability() == "AVX512"


def _compiled() -> Path:
    """The library, from the cache or just made."""
    compiler = os.environ.get("CXX") or shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        raise FileNotFoundError("there is no C++ compiler")
    folder = resources.files(__package__)
    texts = {name: folder.joinpath(name).read_bytes() for name in (*_SOURCES, *_HEADERS)}
    processor = Path("/proc/cpuinfo").read_text().split("\n\n")[0]
    flags = next((line for line in processor.splitlines() if line.startswith("flags")), "")
    key = hashlib.sha256(b"\0".join([*texts.values(), flags.encode(), compiler.encode(), *map(str.encode, _FLAGS)]))
    name = f"kernels-{key.hexdigest()[:16]}.so"
    try:
        cache = Path(os.environ.get("MORPHKIT_CACHE") or platformdirs.user_cache_dir("morphkit")).expanduser()
        cache.mkdir(parents=True, exist_ok=True)
        file = cache / name
        return file if file.is_file() else _compile(compiler, texts, file)
    except PermissionError:
        pass
    return _compile(compiler, texts, Path(tempfile.mkdtemp(prefix="morphkit-")) / name)


def _compile(compiler: str, texts: dict[str, bytes], file: Path) -> Path:
    """Make the library beside `file` and move it there, so that nobody ever sees a part of it."""
    with tempfile.TemporaryDirectory(prefix="kernels-", dir=file.parent) as name:
        folder = Path(name)
        for source, text in texts.items():
            (folder / source).write_bytes(text)
        # OpenMP's own library is not linked: its functions must be those that PyTorch has loaded.
        for command in (
            [compiler, *_FLAGS, "-fopenmp", "-c", *_SOURCES],
            [compiler, "-shared", *(source.replace(".cpp", ".o") for source in _SOURCES), "-o", file.name],
        ):
            subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=_TIMEOUT_S)
        (folder / file.name).replace(file)
    return file
