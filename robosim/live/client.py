"""What goes before viser's client, which has no settings for it: software rendering, phones, files, its title.

On a phone viser's panel is narrower than the window and covers three fifths of it; here it is as wide as the window,
so that tables fit, and leaves more of the space. A file that is dropped onto the page is handed to its button for
files; a browser would leave the page for it else. A row of a table that names an option of a list takes it. The title
of the browser's tab is that of the element with `data-page`. Of files that other windows have opened viser knows no
name, and would report "Uploading undefined" in this one.
"""

import gzip
from functools import lru_cache
from typing import TYPE_CHECKING

from robosim.live.lean import SCRIPT as LEAN

if TYPE_CHECKING:
    from websockets.http11 import Response

#: Share of a phone's height that the panel covers at most.
COVERED = 0.54
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
    const line = document.querySelector('[data-dropped]');
    if (!taker && line)
      line.textContent = 'Files can be opened under Radio, where a single plan is explored: robosim live PLAN.';
    if (!taker || !event.dataTransfer.files.length) return;
    taker.files = event.dataTransfer.files;
    taker.dispatchEvent(new Event('change', {bubbles: true}));
  });
})();</script>"""
NAMED = """<script>new MutationObserver(() => {
  const named = document.querySelector('[data-page]');
  if (named && document.title !== named.dataset.page) document.title = named.dataset.page;
  for (const one of document.querySelectorAll('.mantine-Notification-root'))
    if (one.textContent.startsWith('Uploading undefined')) one.style.display = 'none';
}).observe(document, {subtree: true, childList: true, characterData: true});</script>"""
#: Attributes of a row: the label of a list, and the option that a click takes there.
LIST, OPTION = "data-list", "data-option"
CHOOSE = f"""<style>tr[{OPTION}] {{cursor: pointer}} tr[{OPTION}]:hover {{background: #8883}}</style>
<script>addEventListener('click', event => {{
  const row = event.target.closest('tr[{OPTION}]');
  if (!row) return;
  const name = row.getAttribute('{LIST}'), labels = [...document.querySelectorAll('label')];
  const label = labels.find(one => one.innerText.trim() === name);
  const list = label && document.getElementById(label.htmlFor);
  if (!list) return;
  list.click();
  const end = Date.now() + 3000;
  const take = () => {{
    const options = [...document.querySelectorAll('[role=option]')];
    const wanted = options.find(one => one.innerText.trim() === row.getAttribute('{OPTION}'));
    if (wanted) wanted.click();
    else if (Date.now() < end) setTimeout(take, 30);
  }};
  take();
}});</script>"""


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
    page = page.replace("<title>Viser</title>", "<title>robosim live</title>", 1)
    content = before_client(page, LEAN, NARROW, DROP, NAMED, CHOOSE).encode()
    return gzip.compress(content, mtime=0) if zipped else content
