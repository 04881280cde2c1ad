"""Broken files, some hundred of them; `make fuzz` tries more for minutes. Below are the files that it found."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings

from tests.fuzz.strategies import broken_files
from tests.fuzz.target import attempt

JOINTED = "<joint/><geom size='.1'/>"
FOUND = {
    "empty name": f"<mujoco><worldbody><body name='a'><geom size='1'/><body name='b'>{JOINTED}</body>"
    f"<body name=''>{JOINTED}<body name='c'>{JOINTED}</body></body></body></worldbody></mujoco>",
}


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(source=broken_files())
def test_a_broken_file_is_read_and_cut_or_refused(source: bytes) -> None:
    attempt(source)


@pytest.mark.parametrize("name", FOUND)
def test_found_by_the_fuzzer(name: str) -> None:
    for seed in range(6):  # what is cut depends on the bytes
        attempt(FOUND[name].encode() + b"\n" * seed)
