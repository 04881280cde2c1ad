"""The name that a user may have meant."""

from __future__ import annotations

import time

from morphkit.utils.suggest import did_you_mean, did_you_mean_or_list


def test_the_nearest_name_is_offered_whatever_its_case() -> None:
    assert did_you_mean("lefttfoot", ["LeftFoot", "right"]) == "; did you mean 'LeftFoot'?"
    assert did_you_mean("x", ["LeftFoot"]) == ""
    assert did_you_mean_or_list("x", ["LeftFoot", "right"]) == "; there is LeftFoot, right"


def test_long_and_many_names_take_no_long_time() -> None:
    started = time.process_time()
    did_you_mean("a" * 10**6, (f"b{number}" for number in range(10**6)))
    assert time.process_time() - started < 5
