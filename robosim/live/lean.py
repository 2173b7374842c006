"""Drawing that keeps up where a browser has no graphics card, and says so.

Such a browser draws on the same cores that trace rays, and a frame that is smoothed along edges (multisampling) takes
it half as long again. viser's client has no setting for that: a few lines of script that go before it ask for a space
without, there only. In place of viser's own notice, which lies over the plan and takes clicks, one line tells it.
"""

import gzip
from functools import lru_cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from websockets.http11 import Response

#: What a page says that draws so.
TOLD = "No graphics card: drawn by software, without smooth edges"
_SCRIPT = (
    """<style>#webgl-software-rendering{display:none}</style>
<script>(() => {
  const make = HTMLCanvasElement.prototype.getContext;
  const probe = make.call(document.createElement('canvas'), 'webgl2');
  const told = probe && probe.getExtension('WEBGL_debug_renderer_info');
  const renderer = told ? String(probe.getParameter(told.UNMASKED_RENDERER_WEBGL)) : '';
  if (probe) probe.getExtension('WEBGL_lose_context')?.loseContext();
  if (!/swiftshader|llvmpipe|softpipe|software/i.test(renderer)) return;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return make.call(this, kind, String(kind).startsWith('webgl') ? {...options, antialias: false} : options);
  };
  addEventListener('DOMContentLoaded', () => {
    const line = document.createElement('div');
    line.textContent = '"""
    + TOLD
    + """';
    line.style.cssText = 'position:fixed;left:.6em;top:.4em;z-index:2;pointer-events:none;'
      + 'font:11px system-ui,sans-serif;color:#666';
    document.body.append(line);
  });
})();</script>"""
)


def lean(page: str) -> str:
    """Viser's client with the script before its own.

    Raises:
        ValueError: If it is no page.
    """
    head = page.find("<head>")
    if head < 0:
        raise ValueError("page has no <head>, expected viser's client.")
    at = head + len("<head>")
    return page[:at] + _SCRIPT + page[at:]


def lean_response(response: "Response | None") -> "Response | None":
    """An answer of viser's server; where it is the client, with the script."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    response.body = _lean_body(bytes(response.body or b""), zipped)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))
    return response


@lru_cache(maxsize=2)
def _lean_body(body: bytes, zipped: bool) -> bytes:
    page = lean((gzip.decompress(body) if zipped else body).decode()).encode()
    return gzip.compress(page, mtime=0) if zipped else page
