"""Keeps other sites' pages from the viewer: a browser lets every page connect to sockets on this machine."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from contextlib import contextmanager

from morphkit.errors import DependencyError

OWN_PAGES = re.compile(r"https?://(127\.0\.0\.1|localhost|\[::1\])(:\d+)?")
"""Origins that may connect: pages from this machine, on whatever port, since an SSH tunnel may end on another."""


@contextmanager
def own_pages_only() -> Iterator[None]:
    """Make a viser server that starts in the block refuse connections whose origin is not one of `OWN_PAGES`.

    viser has no option for it; websockets, by which it listens, has.

    Raises:
        DependencyError: The server did not start by way of websockets: it would not be protected.
    """
    from websockets.asyncio import server

    serve = server.serve
    used = False

    @functools.wraps(serve, updated=())
    def guarded(*args: object, **kwargs: object) -> object:
        nonlocal used
        used = True
        return serve(*args, **{**kwargs, "origins": [OWN_PAGES]})  # type: ignore[arg-type]

    server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not used:
        raise DependencyError(
            'this version of viser cannot be kept from pages of other sites: pip install "viser==1.1.1"'
        )
