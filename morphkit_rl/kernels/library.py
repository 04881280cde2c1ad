"""Compiles the kernels when they are first wanted, once a user and processor, and keeps them in the user's cache.

Kernels only save time: without a compiler, or where anything else is missing, PyTorch's own operations do the same.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import itertools
import logging
import os
import platform
import shlex
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import resources
from pathlib import Path

import torch
from torch import Tensor

from morphkit.utils.cache_dir import cache_dir
from morphkit.utils.private_folder import private_file, private_folder

logger = logging.getLogger(__name__)

SWITCH = "MORPHKIT_KERNELS"
"""Environment variable; `0` keeps to PyTorch's operations."""

STEP = 16
"""Widths of vectors that kernels compute on are multiples of this."""

_SOURCES = (
    *("encoder_layer.cpp", "cross_attention.cpp", "mlp.cpp", "norm.cpp"),
    *("limb_tokens.cpp", "limb_layer.cpp", "actuator_heads.cpp", "perceptron_critic.cpp"),
    *("categorical.cpp", "adam.cpp"),
)
_HEADERS = ("packing.h", "tiles.h", "product.h", "rows.h", "layer.h")
_FLAGS = ("-std=c++17", "-O3", "-march=native", "-fPIC", "-fno-math-errno")
_TIMEOUT_S = 180
_OPENING = threading.Lock()
_SUSPENDED = ContextVar("suspended", default=False)


@functools.cache
def load() -> ctypes.CDLL | None:
    """The compiled kernels; None where they are switched off, or cannot be made or loaded."""
    if os.environ.get(SWITCH) == "0" or not _suits_processor():
        return None
    try:
        with _OPENING:  # Who comes second finds what the first has made.
            return _open()
    except (OSError, ValueError, subprocess.SubprocessError) as error:
        logger.info("computing without compiled kernels: %s", error)
        return None


def prepare() -> threading.Thread:
    """Begin to make the kernels while something else is done; `load` waits for them.

    Returns:
        The thread that does it.
    """
    thread = threading.Thread(target=load, name="morphkit-kernels")
    thread.start()
    return thread


@functools.cache
def function(name: str, dtype: torch.dtype) -> Callable[..., None] | None:
    """The kernel of that name for a precision; None where there is none."""
    return getattr(load(), f"{name}_{str(dtype).removeprefix('torch.')}", None)


def bound(name: str, dtype: torch.dtype, *arguments: object) -> Callable[[], None]:
    """The kernel of that name for a precision with its arguments, which stay alive with it."""
    kernel = function(name, dtype)
    assert kernel is not None
    return functools.partial(kernel, *arguments)


def takes(x: Tensor, name: str, dtype: torch.dtype | None = None) -> bool:
    """Whether the kernel can compute on `x`, in its own precision or that of `dtype`."""
    fits = x.device.type == "cpu" and x.numel() > 0 and not _SUSPENDED.get()
    return fits and function(name, dtype or x.dtype) is not None


def is_suspended() -> bool:
    """Whether PyTorch's operations are to be kept to for the moment."""
    return _SUSPENDED.get()


@contextmanager
def suspended() -> Iterator[None]:
    """Keep to PyTorch's operations, which alone can be traced and exported."""
    token = _SUSPENDED.set(True)
    try:
        yield
    finally:
        _SUSPENDED.reset(token)


def edges(spans: Sequence[slice], length: int) -> tuple[int, ...] | None:
    """Where consecutive slices of a sequence begin, and its length; None where they are not all of it in order."""
    found = (0, *(span.stop for span in spans))
    fits = found[-1] == length and found[:-1] == tuple(span.start for span in spans) and list(found) == sorted({*found})
    return found if fits else None


@functools.lru_cache(maxsize=64)
def sequence_starts(edges: tuple[int, ...], batch: int) -> Tensor:
    """Row of the first token of every robot in every sample, and the number of rows."""
    starts = torch.arange(batch)[:, None] * edges[-1] + torch.tensor(edges[:-1])
    return torch.cat([starts.ravel(), torch.tensor([batch * edges[-1]])])


@functools.lru_cache(maxsize=256)
def integers(*values: int) -> ctypes.Array[ctypes.c_int64]:
    """The numbers as an array that a kernel reads."""
    return (ctypes.c_int64 * len(values))(*values)


def pointer(tensor: Tensor) -> ctypes.c_void_p:
    """Where a tensor's numbers lie, for as long as this is kept."""
    address = ctypes.c_void_p(tensor.data_ptr())
    address.tensor = tensor  # type: ignore[attr-defined]
    return address


def pointers(tensors: Sequence[Tensor]) -> ctypes.Array[ctypes.c_void_p]:
    """Where several tensors' numbers lie, for as long as this is kept."""
    addresses = (ctypes.c_void_p * len(tensors))(*[tensor.data_ptr() for tensor in tensors])
    addresses.tensors = tensors  # type: ignore[attr-defined]
    return addresses


class ThreadGradients:
    """Gradients of parameters, to which each thread adds its own.

    Args:
        parameters: Float32 tensors.
        wanted: Whether there is anything to do.

    Attributes:
        pointers: Where each thread's gradient of each parameter lies; None where they are not wanted.
    """

    def __init__(self, parameters: Sequence[Tensor], wanted: bool):
        self._parameters = parameters
        self._sizes = [parameter.numel() for parameter in parameters]
        self._sums = torch.zeros(torch.get_num_threads(), sum(self._sizes)) if wanted else None
        self.pointers = None
        if self._sums is not None:
            places = _places(len(self._sums), *self._sizes)
            base = self._sums.data_ptr()
            self.pointers = (ctypes.c_void_p * len(places))(*[base + place for place in places])

    def add_up(self) -> list[Tensor | None]:
        """The gradients; None for each where they are not wanted."""
        if self._sums is None:
            return [None for _ in self._parameters]
        sums = self._sums[0] if len(self._sums) == 1 else self._sums.sum(0)
        return [g.view_as(p) for g, p in zip(sums.split(self._sizes), self._parameters, strict=True)]


@functools.lru_cache(maxsize=256)
def _places(threads: int, *sizes: int) -> list[int]:
    """Byte at which each thread's part of each size begins, in float32 numbers that follow each other."""
    return [4 * place for place in itertools.accumulate(sizes * threads, initial=0)][:-1]


def _suits_processor() -> bool:
    return platform.system() == "Linux" and torch.backends.cpu.get_cpu_capability() in ("AVX2", "AVX512")


def _open() -> ctypes.CDLL:
    """The library, from the cache or just made."""
    compiler = shlex.split(os.environ.get("CXX", "")) or [shutil.which("g++") or shutil.which("c++") or ""]
    if not shutil.which(compiler[0]):
        raise FileNotFoundError("there is no C++ compiler")
    package = resources.files(__package__)
    texts = {name: package.joinpath(name).read_bytes() for name in (*_SOURCES, *_HEADERS)}
    processor = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
    native = [line for line in processor if line.startswith(("model name", "flags"))]
    key = hashlib.sha256(b"\0".join([*texts.values(), *map(str.encode, (*native, *compiler, *_FLAGS))])).hexdigest()
    try:
        # Others may write to the cache folder: what is run lies in a folder of its own, and no path leads there twice.
        with private_folder(cache_dir() / f"kernels-{os.geteuid()}") as kept:
            try:
                return _load_kept(kept, key)
            except OSError:
                _compile(compiler, texts, Path(f"/proc/self/fd/{kept}"), key)
                return _load_kept(kept, key)
    except OSError:  # Nothing can be kept there: make it for this process.
        with tempfile.TemporaryDirectory(prefix="morphkit-") as folder:
            return ctypes.CDLL(str(_compile(compiler, texts, Path(folder), key)))


def _load_kept(folder: int, key: str) -> ctypes.CDLL:
    """Load the library that was made of the sources with digest `key`, and is still as it was made.

    Raises:
        OSError: There is none.
    """
    for name in os.listdir(folder):
        source, _, digest = name.removeprefix("kernels-").removesuffix(".so").partition("-")
        if source == key:
            with private_file(folder, name) as file:
                with open(file, "rb", closefd=False) as stream:
                    same = hashlib.file_digest(stream, "sha256").hexdigest() == digest
                if same:
                    return ctypes.CDLL(f"/proc/self/fd/{folder}/{name}")
    raise FileNotFoundError(f"no kernels of {key}")


def _compile(compiler: Sequence[str], texts: dict[str, bytes], target: Path, key: str) -> Path:
    """Make the library and move it into `target`, so that nobody ever sees a part of it.

    Its name says what it was made of and what it holds.
    """
    with tempfile.TemporaryDirectory(prefix="making-", dir=target) as name:
        folder = Path(name)
        product = folder / "kernels.so"
        for source, text in texts.items():
            (folder / source).write_bytes(text)
        # OpenMP's own library is not linked: its functions must be those that PyTorch has loaded.
        _run([[*compiler, *_FLAGS, "-fopenmp", "-c", source] for source in _SOURCES], folder)
        objects = [f"{Path(source).stem}.o" for source in _SOURCES]
        _run([[*compiler, "-shared", *objects, "-o", product.name]], folder)
        product.chmod(0o700)
        file = target / f"kernels-{key}-{hashlib.sha256(product.read_bytes()).hexdigest()}.so"
        return product.replace(file)


def _run(commands: Sequence[Sequence[str]], folder: Path) -> None:
    """Run commands side by side.

    Raises:
        subprocess.SubprocessError: One failed, or they took too long.
    """
    deadline = time.monotonic() + _TIMEOUT_S
    quiet = subprocess.DEVNULL
    running = [
        subprocess.Popen(c, cwd=folder, stdin=quiet, stdout=quiet, stderr=quiet, process_group=0) for c in commands
    ]
    try:
        for process in running:
            if process.wait(max(deadline - time.monotonic(), 0)):
                raise subprocess.CalledProcessError(process.returncode, process.args)
    finally:
        for process in running:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)  # with what the compiler has started
                process.wait()
