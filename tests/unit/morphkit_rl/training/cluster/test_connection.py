"""Clusters that are not there: one clear line, soon."""

from __future__ import annotations

import signal
import socket
import sys
from collections.abc import Iterator

import pytest

from morphkit.errors import ConfigError
from morphkit_rl.training.cluster import connection


def test_ray_is_asked_for_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ConfigError, match=r"pip install .morphkit\[cluster\]"), connection.connected():
        pass


@pytest.fixture
def closed_port() -> Iterator[int]:
    with socket.socket() as taken:  # bound, but nobody listens
        taken.bind(("127.0.0.1", 0))
        yield taken.getsockname()[1]


@pytest.mark.parametrize("address", ["nonsense", "host:", ":6379", "ray://host", "host:port"])
def test_what_is_no_address_is_said_to_be_none(address: str) -> None:
    with pytest.raises(ConfigError, match="is no address of a Ray cluster"):
        connection._require_answer(address)


@pytest.mark.parametrize("scheme", ["", "ray://"])
def test_an_address_where_nothing_answers_is_refused_at_once(scheme: str, closed_port: int) -> None:
    with pytest.raises(ConfigError, match=f"no Ray cluster answers at {scheme}127.0.0.1:{closed_port}: .*refused"):
        connection._require_answer(f"{scheme}127.0.0.1:{closed_port}")


def test_signals_are_handled_as_before() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with connection._same_signals():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    assert signal.getsignal(signal.SIGTERM) == before
