"""Scripts and styles that go before viser's client, which has no settings for them.

- Software rendering: without a graphics card the browser draws on the cores that trace rays, and antialiasing makes
  a frame half as slow again. It is off there, and one line replaces viser's notice, which covers the plan and takes
  clicks.
- Phones: the panel is as wide as the window, so that tables fit, and leaves more of the scene than viser's.
- Dropped files: they go to the upload button; the browser would leave the page for them.
- Rows of a table: a click on one that names an option of a list selects that option.
- Titles: the browser's tab has the title in the element with `data-page`. viser does not know the names of files that
  other windows upload, and its notice "Uploading undefined" is hidden.
"""

import gzip
from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from websockets.http11 import Response

#: Notice of a page that is drawn by software.
SOFTWARE_NOTICE = "No graphics card: drawn by software, without smooth edges"
SOFTWARE = (
    """<style>#webgl-software-rendering{display:none}</style>
<script>(() => {
  const make = HTMLCanvasElement.prototype.getContext;
  const probe = make.call(document.createElement('canvas'), 'webgl2');
  const info = probe && probe.getExtension('WEBGL_debug_renderer_info');
  const renderer = info ? String(probe.getParameter(info.UNMASKED_RENDERER_WEBGL)) : '';
  if (probe) probe.getExtension('WEBGL_lose_context')?.loseContext();
  if (!/swiftshader|llvmpipe|softpipe|software/i.test(renderer)) return;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return make.call(this, kind, String(kind).startsWith('webgl') ? {...options, antialias: false} : options);
  };
  addEventListener('DOMContentLoaded', () => {
    const line = document.createElement('div');
    line.textContent = '"""
    + SOFTWARE_NOTICE
    + """';
    line.style.cssText = 'position:fixed;left:.6em;top:.4em;z-index:2;pointer-events:none;'
      + 'font:11px system-ui,sans-serif;color:#666';
    document.body.append(line);
  });
})();</script>"""
)
#: Largest share of a phone's height that the panel covers.
COVERED = 0.54
#: viser's panel at the lower border, recognised by its own style.
_PANEL = 'div[style*="max-height: 60%"]'
PHONE = f"""<style>@media (max-width: 36em) {{
  {_PANEL} {{width: 100vw !important; max-height: {100 * COVERED:.0f}% !important}}
  {_PANEL} div[style*="width: 20em"] {{width: 100vw !important}}
}}</style>"""
DROP = """<script>(() => {
  addEventListener('dragover', event => event.preventDefault());
  addEventListener('drop', event => {
    event.preventDefault();
    const input = document.querySelector('input[type=file]');
    const line = document.querySelector('[data-dropped]');
    if (!input && line)
      line.textContent = 'Files can be opened under Radio, on the page of a single plan: robosim live PLAN.';
    if (!input || !event.dataTransfer.files.length) return;
    input.files = event.dataTransfer.files;
    input.dispatchEvent(new Event('change', {bubbles: true}));
  });
})();</script>"""
TITLE = """<script>new MutationObserver(() => {
  const named = document.querySelector('[data-page]');
  if (named && document.title !== named.dataset.page) document.title = named.dataset.page;
  for (const one of document.querySelectorAll('.mantine-Notification-root'))
    if (one.textContent.startsWith('Uploading undefined')) one.style.display = 'none';
}).observe(document, {subtree: true, childList: true, characterData: true});</script>"""
#: Attributes of a row: the label of a list, and the option that a click selects there.
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
        ValueError: If the page has no head.
    """
    start, head, rest = page.partition("<head>")
    if not head:
        raise ValueError("page has no <head>, expected viser's client.")
    return start + head + "".join(parts) + rest


def patch_response(response: "Response | None") -> "Response | None":
    """Put the scripts before the client, if the answer of viser's server is the client."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    response.body = _patch_body(
        bytes(response.body or b""), response.headers.get("Content-Encoding") == "gzip"
    )
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))
    return response


@lru_cache(maxsize=2)
def _patch_body(body: bytes, zipped: bool) -> bytes:
    page = (gzip.decompress(body) if zipped else body).decode()
    page = page.replace("<title>Viser</title>", "<title>robosim live</title>", 1)
    content = before_client(page, SOFTWARE, PHONE, DROP, TITLE, CHOOSE).encode()
    return gzip.compress(content, mtime=0) if zipped else content
