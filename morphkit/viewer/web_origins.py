"""Who may look: those with the token, from pages of this machine. A browser lets every page connect to sockets here."""

from __future__ import annotations

import asyncio
import functools
import hmac
import logging
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from morphkit.errors import DependencyError

_HERE = r"(127\.0\.0\.1|localhost|\[::1\])(:\d+)?"
OWN_PAGES = re.compile(f"https?://{_HERE}")
"""Origins that may connect: pages from this machine, on whatever port, since an SSH tunnel may end on another."""
OWN_HOSTS = re.compile(_HERE)
"""Names by which the server may be called; another site's name that leads here is not among them."""
COOKIE = "morphkit-token"
_FORBIDDEN = "The address has no token, or a wrong one: open the address that morphkit printed.\n"
_logger = logging.getLogger(__name__)


@contextmanager
def own_pages_only(token: str) -> Iterator[None]:
    """Guard a viser server that starts in the block.

    It answers requests by a name of `OWN_HOSTS` only, with `token` in the address or in the cookie that a page with the
    token in its address gets; and connections only of a page of `OWN_PAGES`. What is malformed is not printed.

    viser has no options for it; websockets, by which it listens, has.

    Raises:
        DependencyError: The server did not start by way of websockets: it would not be protected.
    """
    from websockets.asyncio import server

    serve = server.serve
    used = False

    @functools.wraps(serve, updated=())
    def guarded(*args: object, **kwargs: Any) -> object:
        nonlocal used
        used = True
        asyncio.get_running_loop().set_exception_handler(_note)
        quiet = _logger.getChild("server")
        quiet.setLevel(logging.CRITICAL + 1)  # websockets reports every malformed frame with a traceback
        request = functools.partial(_answer, token, kwargs.get("process_request"))
        return serve(*args, **{**kwargs, "origins": [OWN_PAGES], "process_request": request, "logger": quiet})  # type: ignore[arg-type]

    server.serve = guarded  # type: ignore[assignment,misc]
    try:
        yield
    finally:
        server.serve = serve  # type: ignore[misc]
    if not used:
        raise DependencyError(
            'this version of viser cannot be kept from pages of other sites: pip install "viser==1.1.1"'
        )


def _answer(token: str, process: Callable[..., Any] | None, connection: Any, request: Any) -> Any:
    """Refuse a request, or let viser answer it."""
    hosts = request.headers.get_all("Host")
    if len(hosts) != 1 or OWN_HOSTS.fullmatch(hosts[0].strip().lower()) is None:
        return connection.respond(403, "Call this server by the name in the address that morphkit printed.\n")
    asked = _asked_token(request.path)
    if not any(hmac.compare_digest(each.encode(), token.encode()) for each in (asked, *_cookies(request.headers))):
        return connection.respond(403, _FORBIDDEN)
    if request.headers.get("Upgrade") and not _speaks_viser(request.headers):
        return connection.respond(400, "This is no page of this server.\n")  # viser would print what it says of itself
    answer = process(connection, request) if process is not None else None
    if answer is not None and asked:
        answer.headers["Set-Cookie"] = f"{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict"
        answer.headers["Referrer-Policy"] = "no-referrer"
    return answer


def unprinted(callback: Callable[[Any], None]) -> Callable[[Any], None]:
    """`callback`, whose errors become one line: a browser may have sent any value."""

    @functools.wraps(callback)
    def called(event: Any) -> None:
        try:
            callback(event)
        except Exception as error:
            _logger.warning("what a browser asked for failed: %s: %s", type(error).__name__, ascii(str(error)))

    return called


def _speaks_viser(headers: Any) -> bool:
    import viser

    offered = [word.strip() for header in headers.get_all("Sec-WebSocket-Protocol") for word in header.split(",")]
    return offered == [f"viser-v{viser.__version__}"]


def _asked_token(path: str) -> str:
    try:
        return parse_qs(urlsplit(path).query).get("token", [""])[0]
    except ValueError:
        return ""


def _cookies(headers: Any) -> Iterator[str]:
    """Tokens in cookies; of servers on several ports each has its own."""
    for header in headers.get_all("Cookie"):
        try:
            found = SimpleCookie(header)
        except CookieError:
            continue
        if COOKIE in found:
            yield found[COOKIE].value


def _note(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    _logger.debug("a browser sent what makes no sense: %s", context.get("message"))
