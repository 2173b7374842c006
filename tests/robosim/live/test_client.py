"""Scripts before viser's client."""

import gzip
import http.client

import pytest

from robosim.live.client import CHOOSE, DROP, PHONE, SOFTWARE_NOTICE, TITLE, before_client


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
