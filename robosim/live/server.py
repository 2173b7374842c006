"""The web server of the page: viser, bound to one address, which serves nothing but its own client.

Who asks is looked at before an answer, on HTTP and on the socket alike. Other pages of a browser may not speak to it: a
connection with an `Origin` other than the page's own is refused. Nor may a name that somebody else's server has bent to
this address (DNS rebinding): the `Host` asked for is a number, `localhost`, or a name that is this machine's. viser's
offer to share a page through somebody else's server is taken away.
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

from robosim.live.client import served
from robosim.support.checks import check_number
from robosim.support.installation import install_command

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)

#: The page's address where none is asked for.
HOST, PORT = "127.0.0.1", 8080


def viser_module() -> ModuleType:
    """The library that the page is made with.

    Raises:
        ValueError: If it is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise ValueError(
            f"viser is not installed ({error}). Install it with `{install_command('live')}`, or look without a page: "
            "`robosim trace`, `robosim episode` and `robosim replay` draw pictures."
        ) from error
    return viser


def check_address(host: str, port: int) -> None:
    """See that a page can be served there.

    Args:
        host: Name or number of one of this machine's addresses.
        port: 0 for any that is free.

    Raises:
        ValueError: If it cannot, or another program is there already.
    """
    check_number("port", port, 0, 65535, "a free port, such as 8080, or 0 for any", whole=True)
    try:
        family, kind, _, _, at = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(at)
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
    """Start to serve an empty page.

    Args:
        host: Where.
        port: 0 for any that is free; `get_port` of the server tells which.
        title: Of its panel.

    Raises:
        ValueError: If viser is not installed, or the address cannot be had.
    """
    make = _local(viser_module().ViserServer)
    check_address(host, port)
    os.environ.pop("_VISER_PORT_OVERRIDE", None)  # what was asked for holds
    for talkative in ("websockets.server", "websockets"):
        logging.getLogger(talkative).setLevel(logging.CRITICAL)
    printer = rich.get_console()
    quiet, printer.quiet = (
        printer.quiet,
        True,
    )  # it prints its address in a frame; ours is told by the command
    try:
        with _looked_at(host):
            server: viser.ViserServer = make(host=host, port=port, label=title, verbose=False)
    finally:
        printer.quiet = quiet
    if port and server.get_port() != port:  # somebody was faster
        close_server(server)
        raise ValueError(f"port {port} at {host} is in use by another program. Give another with --port.")
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    return server


def close_server(server: "viser.ViserServer") -> None:
    """Stop to serve, without a word."""
    printer = rich.get_console()
    quiet, printer.quiet = printer.quiet, True
    try:
        server.stop()
    finally:
        printer.quiet = quiet


def same_page(origin: str | None, host: str | None) -> bool:
    """Whether a connection comes from the page itself, or from no page at all.

    Args:
        origin: The header `Origin`, which browsers send.
        host: The header `Host`, which says whom they mean to speak to.
    """
    if origin is None:
        return True
    return bool(host) and urlsplit(origin).netloc == host


def own_name(asked: str | None, host: str) -> bool:
    """Whether a server at a host may be asked for under a name; no name that DNS may bend to it is.

    Args:
        asked: The header `Host`, with or without a port.
        host: What the server was told to listen at.
    """
    try:
        name = (urlsplit(f"//{asked}").hostname or "") if asked else ""
    except ValueError:  # brackets that do not close
        return False
    try:
        ipaddress.ip_address(name.partition("%")[0])
        return True
    except ValueError:
        own = {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        return bool(name) and (name in own or name.endswith(".localhost"))


#: Held while a server is made: what is put in place of a function is put back.
_MAKING = threading.Lock()


@contextmanager
def _looked_at(host: str) -> Iterator[None]:
    """Have a server that is made meanwhile look at who asks, before it answers.

    viser takes no such function; the library that it serves with does.
    """
    from websockets.asyncio import server as sockets

    serve = sockets.serve

    def guarded(*args: Any, process_request: Any = None, **options: Any) -> Any:
        def look(connection: Any, request: Any) -> Any:
            asked, origin = request.headers.get("Host"), request.headers.get("Origin")
            if not own_name(asked, host):
                logger.warning("Somebody asked for %s, and was refused.", asked)
                said = "This page does not go by that name. Open it by its number, such as 127.0.0.1, or give --host."
                return connection.respond(421, said + "\n")
            if not same_page(origin, asked):
                logger.warning("A page of %s wanted to speak to this one, and was refused.", origin)
                return connection.respond(403, "Other pages may not speak to this one.\n")
            return None if process_request is None else served(process_request(connection, request))

        return serve(*args, process_request=look, **options)

    with _MAKING:
        sockets.serve = guarded  # type: ignore[assignment, misc]
        try:
            yield
        finally:
            sockets.serve = serve  # type: ignore[misc]


def _local(make: type["viser.ViserServer"]) -> type["viser.ViserServer"]:
    """The same server, which leads nobody out of this machine."""

    def request_share_url(self: "viser.ViserServer", verbose: bool = True) -> None:
        """No page is shared through somebody else's server, whoever asks."""

    return type("LocalServer", (make,), {"request_share_url": request_share_url})
