"""What goes before viser's client: drawing without a graphics card, phones, dropped files."""

import gzip
import http.client

import pytest

from robosim.live.client import CHOOSE, DROP, NARROW, before_client
from robosim.live.lean import TOLD


@pytest.mark.parametrize("coding", ["gzip", "identity"])
def test_the_page_is_served_with_the_script_before_the_clients(page, coding):
    """Whole, as long as its header says, and with nothing of viser's client lost."""
    connection = http.client.HTTPConnection("127.0.0.1", page.server.get_port())
    connection.request("GET", "/", headers={"Accept-Encoding": coding})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    assert answer.status == 200 and int(answer.headers["Content-Length"]) == len(body)
    text = (gzip.decompress(body) if coding == "gzip" else body).decode()
    assert all(0 < text.index(part) < text.index("<title>") for part in (TOLD, NARROW, DROP, CHOOSE))
    assert text.rstrip().endswith("</html>")


def test_what_is_no_page_is_refused():
    with pytest.raises(ValueError, match="no <head>"):
        before_client("nothing", "a part")
