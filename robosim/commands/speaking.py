"""How commands speak: for a person to `console`, for a program by `tell`.

A command hands its result to `tell`, which prints it if the command line says --json, and nothing else is printed then.
"""

import json
import logging
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from robosim.support.files import plain

#: A pipe has no width; tables should not be cut for it. Names from outside are printed as they are, so that nothing in
#: brackets is taken for markup, nor :smile: for a picture; what is to be bold says so by its style.
console = Console(width=None if sys.stdout.isatty() else 150, markup=False, emoji=False)
#: Whether results are printed for programs.
_as_json = False


@contextmanager
def speaking(*, quiet: bool, as_json: bool) -> Iterator[None]:
    """How commands speak inside of the block.

    Args:
        quiet: Whether nothing is printed but errors.
        as_json: Whether results, and nothing else, are printed to standard output, as JSON.
    """
    global _as_json
    level, before = logging.getLogger().level, (console.quiet, _as_json)
    console.quiet, _as_json = quiet or as_json, as_json
    if quiet:
        logging.getLogger().setLevel(logging.ERROR)
    try:
        yield
    finally:
        console.quiet, _as_json = before
        logging.getLogger().setLevel(level)


def tell(result: Mapping[str, Any], out: Path | None = None) -> None:
    """Hand over the result of a command: once, at its end, for programs that read it.

    Args:
        result: What it found. Arrays become lists, and not-a-number null.
        out: The folder it wrote to, if it did.
    """
    if _as_json:
        told = {**result} if out is None else {**result, "out": str(out)}
        sys.stdout.write(json.dumps(plain(told), allow_nan=False) + "\n")
        # A command that goes on, as a page does, is read while it does.
        sys.stdout.flush()


def tell_file(path: Path, **more: Any) -> None:
    """Hand over what a JSON file holds that the command has just written, and perhaps more."""
    tell({**json.loads(path.read_bytes()), **more}, path.parent)
