"""What goes before viser's client, which has no settings for it: drawing by software, phones, dropped files.

On a phone viser's panel is narrower than the window and covers three fifths of it; here it is as wide as the window,
so that tables fit, and leaves more of the space. A file that is dropped onto the page is handed to its button for
files; a browser would leave the page for it else.
"""

import gzip
from functools import lru_cache
from typing import TYPE_CHECKING

from robosim.live.lean import SCRIPT as LEAN
from robosim.live.scenery import COVERED

if TYPE_CHECKING:
    from websockets.http11 import Response

#: viser's panel at the lower border, told by what it asks for itself.
_PANEL = 'div[style*="max-height: 60%"]'
NARROW = f"""<style>@media (max-width: 36em) {{
  {_PANEL} {{width: 100vw !important; max-height: {100 * COVERED:.0f}% !important}}
  {_PANEL} div[style*="width: 20em"] {{width: 100vw !important}}
}}</style>"""
DROP = """<script>(() => {
  addEventListener('dragover', event => event.preventDefault());
  addEventListener('drop', event => {
    event.preventDefault();
    const taker = document.querySelector('input[type=file]');
    if (!taker || !event.dataTransfer.files.length) return;
    taker.files = event.dataTransfer.files;
    taker.dispatchEvent(new Event('change', {bubbles: true}));
  });
})();</script>"""


def before_client(page: str, *parts: str) -> str:
    """Viser's client with parts of a page before its own.

    Raises:
        ValueError: If it is no page.
    """
    head = page.find("<head>")
    if head < 0:
        raise ValueError("page has no <head>, expected viser's client.")
    at = head + len("<head>")
    return page[:at] + "".join(parts) + page[at:]


def served(response: "Response | None") -> "Response | None":
    """An answer of viser's server; where it is the client, with what goes before it."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    response.body = _served_body(bytes(response.body or b""), zipped)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))
    return response


@lru_cache(maxsize=2)
def _served_body(body: bytes, zipped: bool) -> bytes:
    page = (gzip.decompress(body) if zipped else body).decode()
    content = before_client(page, LEAN, NARROW, DROP).encode()
    return gzip.compress(content, mtime=0) if zipped else content
