"""A Ray cluster: one on this machine for as long as it is needed, or one that runs already."""

from __future__ import annotations

import logging
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

from morphkit.errors import ConfigError

LOCAL = "local"
"""In place of an address: a cluster on this machine, which ends with the block."""

_ANSWER_S, _HEALTH_S = 5.0, 30.0
_HERE = "127.0.0.1"


@contextmanager
def connected(address: str = LOCAL) -> Iterator[ModuleType]:
    """Be connected to a cluster while the block runs.

    A cluster of this machine has no dashboard, sends no usage statistics, and answers to nobody who has not the token
    that is drawn for it: Ray listens on all interfaces, and whoever gets in can run code.

    Args:
        address: `local`, `auto` for the one that runs on this machine, `HOST:PORT`, or `ray://HOST:PORT`.

    Yields:
        The module `ray`.

    Raises:
        ConfigError: Ray is not installed, or there is no cluster.
    """
    own = address == LOCAL
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if own:  # before Ray is imported, which reads it once
        os.environ |= {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
    try:
        import ray
    except ImportError:
        raise ConfigError('work on a cluster needs Ray: pip install "morphkit[cluster]"') from None
    if not own and address != "auto":
        _require_answer(address)
    options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if own:
        options |= {"include_dashboard": False, "_node_ip_address": _HERE}
    try:
        with _same_signals():
            ray.init(address, **options)
    except (ConnectionError, RuntimeError, ValueError, OSError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise ConfigError(f"no Ray cluster at {address!r}: {reason}") from None
    try:
        yield ray
    finally:
        ray.shutdown()


def _require_answer(address: str) -> None:
    """Raise ConfigError where nothing listens at an address; Ray would ask for minutes."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal():
        raise ConfigError(f"{address!r} is no address of a Ray cluster; expected HOST:PORT, ray://HOST:PORT or auto")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWER_S).close()
        if not address.startswith("ray://"):
            words = [sys.executable, "-m", "ray.scripts.scripts", "health-check", "--address", address]
            subprocess.run(words, timeout=_HEALTH_S, check=True, capture_output=True)
    except (OSError, OverflowError, subprocess.SubprocessError) as error:
        reason = str(error) if isinstance(error, OSError | OverflowError) else "something else listens there"
        raise ConfigError(f"no Ray cluster answers at {address}: {reason}") from None


@contextmanager
def _same_signals() -> Iterator[None]:
    """Keep the handlers of signals, of which Ray replaces some."""
    kinds = (signal.SIGINT, signal.SIGTERM) if threading.current_thread() is threading.main_thread() else ()
    before = {kind: signal.getsignal(kind) for kind in kinds}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
