"""The server of the page: addresses, content, rejected requests, and scripts before viser's client."""

import gzip
import http.client
import socket
import sys

import pytest

from robosim.live.server import (
    CHOOSE,
    DROP,
    PHONE,
    SOFTWARE_NOTICE,
    TITLE,
    before_client,
    check_address,
    is_own_name,
    is_same_page,
    viser_module,
)


def test_a_port_in_use_is_one_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ValueError) as raised:
            check_address("127.0.0.1", port)
    assert str(raised.value) == (
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
def test_a_bad_address_is_one_line(host, port, words):
    with pytest.raises(ValueError) as raised:
        check_address(host, port)
    assert words in str(raised.value) and "\n" not in str(raised.value)


def test_without_viser_the_remedy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(ValueError, match=r"pip install .*\[live\]"):
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
def test_only_the_page_itself_may_connect(origin, host, same):
    assert is_same_page(origin, host) is same


@pytest.mark.parametrize(
    ("requested", "own"),
    [
        ("127.0.0.1:8080", True),
        ("192.168.1.7:8080", True),
        ("[::1]:8080", True),
        ("[fe80::1%eth0]:8080", True),
        ("localhost", True),
        ("LocalHost:9000", True),
        ("robot.localhost:8080", True),
        ("lab-pc:8080", True),
        (socket.gethostname(), True),
        ("example.org:8080", False),
        ("localhost.example.org", False),
        ("127.0.0.1.example.org:8080", False),
        ("[::1", False),
        ("", False),
        (None, False),
    ],
)
def test_only_its_own_names_are_answered(requested, own):
    """Names that DNS may rebind are rejected; numbers and the value of --host are accepted."""
    assert is_own_name(requested, "lab-pc") is own


def get(page, path: str, host: str = "localhost") -> tuple[int, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", page.server.get_port(), timeout=30)
    try:
        connection.putrequest("GET", path, skip_accept_encoding=True, skip_host=True)
        connection.putheader("Host", host)
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


def test_a_foreign_page_is_rejected(page):
    """A connection from another page or under another name gets no message."""
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect
    from websockets.typing import Origin, Subprotocol

    def first_word(origin: str, host: str = "127.0.0.1") -> object:
        protocol = [Subprotocol(f"viser-v{viser.__version__}")]
        url = f"ws://127.0.0.1:{page.server.get_port()}"
        url = url.replace("127.0.0.1", host)
        with (
            socket.create_connection(("127.0.0.1", page.server.get_port())) as line,
            connect(
                url, sock=line, origin=Origin(origin), subprotocols=protocol, max_size=None
            ) as connection,
        ):
            return connection.recv(timeout=30)

    assert first_word(f"http://127.0.0.1:{page.server.get_port()}")
    with pytest.raises(InvalidStatus) as raised:
        first_word("https://example.org")
    assert raised.value.response.status_code == 403
    foreign = f"example.org:{page.server.get_port()}"
    with pytest.raises(InvalidStatus) as raised:
        first_word(f"http://{foreign}", "example.org")
    assert raised.value.response.status_code == 421


def test_a_rebound_name_is_rejected(page):
    """DNS rebinding: a request for a foreign name at our address gets nothing of the page."""
    status, content = get(page, "/", "example.org:8080")
    assert status == 421 and b"<html" not in content and b"127.0.0.1" in content
    assert get(page, "/", "127.0.0.1:1")[0] == 200, "as through a forwarded port"


def test_it_cannot_be_shared_through_other_servers(page, monkeypatch):
    """A request of a window opens no tunnel."""
    opened = []
    monkeypatch.setattr("viser._tunnel.ViserTunnel.__init__", lambda self, *given: opened.append(given))
    assert page.server.request_share_url() is None and page.server.request_share_url(verbose=False) is None
    assert opened == []


@pytest.mark.parametrize("coding", ["gzip", "identity"])
def test_scripts_precede_the_client(page, coding):
    """The body is complete and as long as its header says."""
    connection = http.client.HTTPConnection("127.0.0.1", page.server.get_port())
    connection.request("GET", "/", headers={"Accept-Encoding": coding})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    assert answer.status == 200 and int(answer.headers["Content-Length"]) == len(body)
    text = (gzip.decompress(body) if coding == "gzip" else body).decode()
    assert all(
        0 < text.index(part) < text.index("<title>") for part in (SOFTWARE_NOTICE, PHONE, DROP, TITLE, CHOOSE)
    )
    assert text.rstrip().endswith("</html>")


def test_a_page_without_a_head_is_rejected():
    with pytest.raises(ValueError, match="no <head>"):
        before_client("nothing", "a part")
