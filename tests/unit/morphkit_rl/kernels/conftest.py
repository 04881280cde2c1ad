"""Kernels as they are made for different processors, on different numbers of threads."""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Iterator

import pytest
import torch

from morphkit_rl.kernels import library
from tests.support.kernels import LOAD

KINDS = {
    "": (torch.float32, torch.bfloat16),
    " -mno-avx512f": (torch.float32,),
    " -mno-amx-bf16": (torch.bfloat16,),
}
"""Options of the compiler, the latter for processors with less than most servers have, and the precisions to test."""


@pytest.fixture(params=[1, 3], ids="{}-threads".format)
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@functools.cache
def made_with(options: str) -> ctypes.CDLL | None:
    """Kernels compiled with these options, once for all tests even where nothing can be kept."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CXX", os.environ.get("CXX", "g++") + options)
        return LOAD.__wrapped__()


@pytest.fixture(params=[(options, dtype) for options, dtypes in KINDS.items() for dtype in dtypes], ids=str)
def precision(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[torch.dtype]:
    options, dtype = request.param
    if options:
        monkeypatch.setattr(library, "load", functools.partial(made_with, options))
    library.function.cache_clear()
    if dtype == torch.bfloat16 and library.function("layer_forward", dtype) is None:
        pytest.skip("a processor without bfloat16")
    yield dtype
    library.function.cache_clear()
