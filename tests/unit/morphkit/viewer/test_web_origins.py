"""What the browser viewer keeps out: names that are more than text, and pages of other sites."""

from __future__ import annotations

import contextlib
import http.client
import re
import socket
import sys
from collections.abc import Iterator
from functools import partial
from urllib.parse import urlsplit

import pytest

from morphkit.errors import DependencyError
from morphkit.registry import load
from morphkit.viewer.web import HOST, BrowserViewer
from morphkit.viewer.web_markdown import fenced, plain_text
from morphkit.viewer.web_origins import own_pages_only


def msgpack(value: object) -> bytes:
    return bytes(pytest.importorskip("msgspec").msgpack.encode(value))


@pytest.mark.parametrize("name", ["{alert(1)}", "<b>x</b>", "a_b*c", "[x](http://y)", "`x`", "a\n# b"])
def test_names_stay_text_in_markdown(name: str) -> None:
    text = plain_text(name)
    assert "\n" not in text
    assert not re.search(r"(?<!\\)[`*_{}\[\]<>#]", text)
    assert text.replace("\\", "") == " ".join(name.split())


def test_code_cannot_end_its_block() -> None:
    assert fenced("a").splitlines() == ["```", "a", "```"]
    assert fenced("a\n````\n{b}").splitlines() == ["`````", "a", "````", "{b}", "`````"]


@pytest.fixture(scope="module")
def viewer() -> Iterator[BrowserViewer]:
    pytest.importorskip("viser")
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    shown = BrowserViewer(load("cheetah_3_balanced"), command=["morphkit"], port=port)
    yield shown
    shown.close()


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        ("http://127.0.0.1:{port}", True),
        ("http://localhost:9000", True),
        ("https://example.com", False),
        ("http://127.0.0.1.example.com", False),
        ("http://localhost:80@example.com", False),
        ("null", False),
        (None, False),
    ],
)
def test_only_pages_from_this_machine_can_connect(viewer: BrowserViewer, origin: str | None, accepted: bool) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    address = urlsplit(viewer.url)
    protocol = f"viser-v{sys.modules['viser'].__version__}"
    origin = origin and origin.format(port=address.port)
    visit = partial(
        connect, f"ws://{address.netloc}/?{address.query}", origin=origin, subprotocols=[protocol], proxy=None
    )
    if accepted:
        with visit(max_size=None) as page:
            assert page.recv(timeout=10)
    else:
        with pytest.raises(InvalidStatus) as refused:
            visit()
        assert refused.value.response.status_code == 403


def fetch(viewer: BrowserViewer, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of an answer to a browser."""
    connection = http.client.HTTPConnection(urlsplit(viewer.url).netloc, timeout=10)
    with contextlib.closing(connection):
        connection.request("GET", path, headers={"Accept-Encoding": "identity", **headers})
        answer = connection.getresponse()
        return answer.status, dict(answer.headers), answer.read()


def test_the_address_has_a_token(viewer: BrowserViewer) -> None:
    token = urlsplit(viewer.url).query
    assert re.fullmatch(r"token=[\w-]{32}", token)
    status, headers, body = fetch(viewer, f"/?{token}")
    assert (status, b"<html" in body[:2000].lower()) == (200, True)
    cookie = headers["Set-Cookie"]
    assert cookie.endswith("; Path=/; HttpOnly; SameSite=Strict")
    assert fetch(viewer, "/", Cookie=f"other=1; {cookie.split(';')[0]}")[0] == 200
    for wrong in ("/", "/?token=", f"/?{token}a", f"/?{token[:-1]}", "/?token=%00%ff", "/index.html", f"/{token}"):
        status, headers, body = fetch(viewer, wrong)
        assert (status, "Set-Cookie" in headers) == (403, False)
        assert b"open the address that morphkit printed" in body
    for cookie in ("morphkit-token=a", "morphkit-token", 'morphkit-token="', "[]=1; morphkit-token=\xff"):
        assert fetch(viewer, "/", Cookie=cookie)[0] == 403


def test_a_socket_needs_the_token_too(viewer: BrowserViewer) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    address = urlsplit(viewer.url)
    protocol = f"viser-v{sys.modules['viser'].__version__}"
    visit = partial(connect, f"ws://{address.netloc}", origin=f"http://{address.netloc}", proxy=None, max_size=None)
    cookie = f"morphkit-token={address.query.partition('=')[2]}"
    with visit(subprotocols=[protocol], additional_headers={"Cookie": cookie}) as page:
        assert page.recv(timeout=10)
    for protocols, headers, status in (
        ([protocol], {}, 403),
        ([protocol], {"Cookie": cookie[:-1]}, 403),
        (["viser-v\x1b[31m"[:7] + "0"], {"Cookie": cookie}, 400),
        (None, {"Cookie": cookie}, 400),
    ):
        with pytest.raises(InvalidStatus) as refused:
            visit(subprotocols=protocols, additional_headers=headers)
        assert refused.value.response.status_code == status


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1", 200),
        ("localhost:9000", 200),
        ("[::1]:8080", 200),
        ("LOCALHOST", 200),
        ("example.com", 403),
        ("example.com:8080", 403),
        ("127.0.0.1.example.com", 403),
        ("localhost@example.com", 403),
        ("", 403),
    ],
)
def test_the_server_goes_by_its_own_names_only(viewer: BrowserViewer, host: str, status: int) -> None:
    assert fetch(viewer, f"/?{urlsplit(viewer.url).query}", Host=host)[0] == status


def test_what_is_malformed_prints_no_traceback(
    viewer: BrowserViewer, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    from websockets.sync.client import connect

    address = urlsplit(viewer.url)
    protocol = f"viser-v{sys.modules['viser'].__version__}"
    uuids = list(viewer._server.gui._gui_input_handle_from_uuid)
    updates = [
        {"value": "no number"},
        {"value": "nan"},
        {"nothing": 1},
        {"value": None},
        {"value": [1]},
        {"update_cb": 3},
    ]
    frames: list[bytes | str] = [
        *(b"", b"\xff", b"\x81", b"not msgpack", bytes(1000), "text", msgpack({}), msgpack([]), msgpack(3)),
        *(msgpack({"type": kind}) for kind in ("NoMessage", "GuiUpdateMessage", "SceneNodeClickMessage", 3)),
        *(
            msgpack({"type": "GuiUpdateMessage", "uuid": uuid, "updates": each})
            for uuid in uuids[:4]
            for each in updates
        ),
        msgpack({"type": "GuiUpdateMessage", "uuid": "none", "updates": {}}),
    ]
    for frame in frames:
        with connect(
            f"ws://{address.netloc}/?{address.query}",
            origin=f"http://{address.netloc}",
            subprotocols=[protocol],
            proxy=None,
            max_size=None,
        ) as page:
            page.send(frame)
            with contextlib.suppress(TimeoutError, Exception):
                page.recv(timeout=0.05)
    for request in (
        b"\0\xff\r\n\r\n",
        b"GET / HTTP/9\r\n\r\n",
        b"GET /?token=[ HTTP/1.1\r\nHost: [\r\n\r\n",
        b"\x16\x03\x01",
    ):
        with socket.create_connection((HOST, address.port or 0), timeout=5) as wire:
            wire.sendall(request)
            wire.shutdown(socket.SHUT_WR)
            with contextlib.suppress(ConnectionError):
                wire.recv(1000)
    assert fetch(viewer, f"/?{address.query}")[0] == 200
    said = "".join(capfd.readouterr()) + caplog.text
    assert "Traceback" not in said
    assert "Task" not in said


def test_a_viser_that_cannot_be_guarded_is_refused() -> None:
    pytest.importorskip("viser")
    with pytest.raises(DependencyError, match="other sites"), own_pages_only("a"):
        pass
