"""What the browser viewer keeps out: names that are more than text, and pages of other sites."""

from __future__ import annotations

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
    visit = partial(connect, f"ws://{address.netloc}", origin=origin, subprotocols=[protocol], proxy=None)
    if accepted:
        with visit(max_size=None) as page:
            assert page.recv(timeout=10)
    else:
        with pytest.raises(InvalidStatus) as refused:
            visit()
        assert refused.value.response.status_code == 403


def test_a_viser_that_cannot_be_guarded_is_refused() -> None:
    pytest.importorskip("viser")
    with pytest.raises(DependencyError, match="other sites"), own_pages_only():
        pass
