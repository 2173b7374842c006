"""The web server of the page: viser, bound to one address, which serves only its own client.

Each request is checked before it is answered, on HTTP and on the socket alike. A connection with an `Origin` other than
the page's own is rejected (403), so that other pages of a browser cannot use it. The requested `Host` must be a number,
`localhost` or a name of this machine (421 otherwise), so that a name that DNS rebinding leads here cannot be used.
viser's function to share a page through a foreign server is disabled.
"""

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

from robosim.live.client import patch_response
from robosim.support.checks import check_number
from robosim.support.installation import install_command

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)

#: Default address of the page.
HOST, PORT = "127.0.0.1", 8080


def viser_module() -> ModuleType:
    """The module `viser`.

    Raises:
        ValueError: If it is not installed.
    """
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
        own = {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        return bool(name) and (name in own or name.endswith(".localhost"))


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
                logger.warning("Rejected a request for %s.", requested)
                message = (
                    "This page has another name. Open it by its number, such as 127.0.0.1, or give --host."
                )
                return connection.respond(421, message + "\n")
            if not is_same_page(origin, requested):
                logger.warning("Rejected a connection from a page of %s.", origin)
                return connection.respond(403, "Other pages may not connect to this one.\n")
            return None if process_request is None else patch_response(process_request(connection, request))

        return serve(*args, process_request=check, **options)

    with _REPLACING:
        sockets.serve = serve_checked  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            sockets.serve = serve  # type: ignore[misc]
