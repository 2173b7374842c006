"""The page's server: where it may be, what it serves, and to whom it speaks."""

import http.client
import socket
import sys

import pytest

from robosim.live.server import check_address, same_page, viser_module


def test_a_port_in_use_is_one_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ValueError) as refused:
            check_address("127.0.0.1", port)
    assert str(refused.value) == (
        f"port {port} at 127.0.0.1 is in use by another program. Give another, such as --port {port + 1}, or --port 0 "
        "for any that is free."
    )


@pytest.mark.parametrize(
    ("host", "port", "words"),
    [
        ("127.0.0.1", 70000, "port is 70000, expected a whole number from 0 to 65535"),
        ("127.0.0.1", -1, "port is -1"),
        ("192.0.2.1", 0, "host is '192.0.2.1', which is no address of this machine"),
        ("no such host", 0, "host is 'no such host', which is no address of this machine"),
    ],
)
def test_an_address_that_cannot_be_had_is_one_line(host, port, words):
    with pytest.raises(ValueError) as refused:
        check_address(host, port)
    assert words in str(refused.value) and "\n" not in str(refused.value)


def test_without_viser_the_fix_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ValueError, match=r"pip install robosim\[live\]"):
        viser_module()


@pytest.mark.parametrize(
    ("origin", "host", "same"),
    [
        (None, "localhost:8080", True),
        ("http://localhost:8080", "localhost:8080", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:8081", "localhost:8080", False),
        ("https://example.org", "localhost:8080", False),
        ("null", "localhost:8080", False),
        ("http://localhost:8080", None, False),
    ],
)
def test_only_the_page_itself_may_speak_to_it(origin, host, same):
    assert same_page(origin, host) is same


def get(page, path: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", page.server.get_port(), timeout=30)
    try:
        connection.putrequest("GET", path, skip_accept_encoding=True)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_nothing_but_the_page_is_served(page):
    status, content = get(page, "/")
    assert status == 200 and b"<html" in content
    for path in (
        "/../../../../../../etc/passwd",
        "/%2e%2e/%2e%2e/__init__.py",
        "//etc/passwd",
        "/../index.tsx",
    ):
        status, content = get(page, path)
        assert status == 404 and b"root:" not in content


def test_a_foreign_page_is_refused_and_the_own_one_heard(page):
    """A connection of another page is closed before it is told anything; one without an origin is served."""
    import viser
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Origin, Subprotocol

    def first_word(origin: str) -> object:
        protocol = [Subprotocol(f"viser-v{viser.__version__}")]
        url = f"ws://127.0.0.1:{page.server.get_port()}"
        with connect(url, origin=Origin(origin), subprotocols=protocol, max_size=None) as connection:
            return connection.recv(timeout=30)

    assert first_word(f"http://127.0.0.1:{page.server.get_port()}")
    with pytest.raises(ConnectionClosed) as closed:
        first_word("https://example.org")
    assert closed.value.rcvd.code == 1008


def test_it_cannot_be_shared_through_other_servers(page):
    from viser import _messages

    assert _messages.ShareUrlRequest not in page.server._websock_server._incoming_handlers
