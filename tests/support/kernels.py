"""Whether there are compiled kernels on this machine."""

from __future__ import annotations

import pytest

from morphkit_rl.kernels import library

LOAD = library.load
"""As it was before any test replaced it."""

compiled = pytest.mark.skipif(LOAD() is None, reason="no C++ compiler, or a processor without AVX2")
