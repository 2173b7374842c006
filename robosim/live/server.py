"""The web server of the page: viser, bound to one address, which serves only its own client.

Each request is checked before it is answered, on HTTP and on the socket alike. A connection with an `Origin` other than
the page's own is rejected (403), so that other pages of a browser cannot use it. The requested `Host` must be a number,
`localhost` or a name of this machine (421 otherwise), so that a name that DNS rebinding leads here cannot be used.
viser's function to share a page through a foreign server is disabled.

Scripts and styles go before viser's client, which has no settings for them.

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


import errno
import ipaddress
import logging
import os
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import rich

from robosim.support.checks import check_number
from robosim.support.installation import install_command

if TYPE_CHECKING:
    import viser


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
    """Viser's client with parts of a page before its own; ValueError if the page has no head."""
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


logger = logging.getLogger(__name__)

#: Default address of the page.
HOST, PORT = "127.0.0.1", 8080


def viser_module() -> ModuleType:
    """The module `viser`; ValueError if it is not installed."""
    try:
        import viser
    except ImportError as error:
        raise ValueError(
            f"viser is not installed ({error}). Install it with `{install_command('live')}`, or use commands without "
            "a page: `robosim trace`, `robosim episode` and `robosim replay` draw pictures."
        ) from error
    return viser


def check_address(host: str, port: int) -> None:
    """Check that a page can be served at an address of this machine; port 0 stands for any free one.

    Raises:
        ValueError: If it cannot, or if another program uses the port.
    """
    check_number("port", port, 0, 65535, "a free port, such as 8080, or 0 for any", whole=True)
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, UnicodeError) as error:
        number = getattr(error, "errno", None)
        if number == errno.EADDRINUSE:
            raise ValueError(
                f"port {port} at {host} is in use by another program. Give another, such as --port {port + 1}, or "
                "--port 0 for any that is free."
            ) from None
        if number == errno.EACCES:
            raise ValueError(f"port {port} needs root. Give one above 1023, such as --port {PORT}.") from None
        raise ValueError(
            f"host is {host!r}, which is no address of this machine ({error}). Give 127.0.0.1, or 0.0.0.0 for all."
        ) from None


def open_server(host: str, port: int, title: str) -> "viser.ViserServer":
    """Serve an empty page; port 0 stands for any free one.

    Raises:
        ValueError: If viser is not installed, or the address cannot be used.
    """
    viser_server = viser_module().ViserServer
    # The page is never shared through a foreign server.
    local_server = type(
        "LocalServer", (viser_server,), {"request_share_url": lambda self, verbose=True: None}
    )
    check_address(host, port)
    os.environ.pop("_VISER_PORT_OVERRIDE", None)  # it would override the port
    for name in ("websockets.server", "websockets"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with _quiet_console(), _checked_requests(host):
        server: viser.ViserServer = local_server(host=host, port=port, label=title, verbose=False)
    if port and server.get_port() != port:  # another program was faster
        close_server(server)
        raise ValueError(f"port {port} at {host} is in use by another program. Give another with --port.")
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    return server


def close_server(server: "viser.ViserServer") -> None:
    """Stop a server without printing."""
    with _quiet_console():
        server.stop()


def is_same_page(origin: str | None, host: str | None) -> bool:
    """Whether a connection comes from the page itself, or from no page, by its headers `Origin` and `Host`."""
    if origin is None:
        return True
    return bool(host) and urlsplit(origin).netloc == host


def is_own_name(requested: str | None, host: str) -> bool:
    """Whether a server at `host` answers requests with the header `Host` (with or without a port).

    A number cannot be rebound by DNS; of names, only those of this machine and `host` itself are accepted.
    """
    try:
        name = (urlsplit(f"//{requested}").hostname or "") if requested else ""
    except ValueError:  # brackets that do not close
        return False
    try:
        ipaddress.ip_address(name.partition("%")[0])
        return True
    except ValueError:
        known_hosts = {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        return bool(name) and (name in known_hosts or name.endswith(".localhost"))


@contextmanager
def _quiet_console() -> Iterator[None]:
    """Suppress what viser prints; the command prints the address."""
    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


#: Held while `serve` of websockets is replaced.
_REPLACING = threading.Lock()


@contextmanager
def _checked_requests(host: str) -> Iterator[None]:
    """Servers that are created within the block check requests; viser has no argument for it, websockets has."""
    from websockets.asyncio import server as sockets

    serve = sockets.serve

    def serve_checked(*args: Any, process_request: Any = None, **options: Any) -> Any:
        def check(connection: Any, request: Any) -> Any:
            requested, origin = request.headers.get("Host"), request.headers.get("Origin")
            if not is_own_name(requested, host):
                logger.warning(f"Rejected a request for {requested}.")
                message = (
                    "This page has another name. Open it by its number, such as 127.0.0.1, or give --host."
                )
                return connection.respond(421, message + "\n")
            if not is_same_page(origin, requested):
                logger.warning(f"Rejected a connection from a page of {origin}.")
                return connection.respond(403, "Other pages may not connect to this one.\n")
            return None if process_request is None else patch_response(process_request(connection, request))

        return serve(*args, process_request=check, **options)

    with _REPLACING:
        sockets.serve = serve_checked  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            sockets.serve = serve  # type: ignore[misc]
