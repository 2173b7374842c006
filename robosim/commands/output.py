"""Output of commands: text for people on `console`, one JSON object for programs by `emit_result`."""

import json
import logging
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from robosim.support.files import plain

#: A pipe has no width, and tables must not be cut for it. Names from outside are printed literally: neither brackets
#: nor :smile: are markup.
console = Console(width=None if sys.stdout.isatty() else 150, markup=False, emoji=False)
#: Whether results are printed for programs.
_as_json = False


@contextmanager
def output_mode(*, quiet: bool, as_json: bool) -> Iterator[None]:
    """Choose what commands print inside of the block.

    Args:
        quiet: Whether only errors are printed.
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


def emit_result(result: Mapping[str, Any], out: Path | None = None) -> None:
    """Print the result of a command for programs, if --json is given; once, at the end of the command.

    Args:
        result: What the command found. Arrays become lists, and NaN null.
        out: The folder with its files, if there is one.
    """
    if _as_json:
        content = {**result} if out is None else {**result, "out": str(out)}
        sys.stdout.write(json.dumps(plain(content), allow_nan=False) + "\n")
        sys.stdout.flush()  # a command that serves a page does not end


def emit_result_file(path: Path, **more: Any) -> None:
    """Print the content of a JSON file that the command has written, and perhaps more, as `emit_result` does."""
    emit_result({**json.loads(path.read_bytes()), **more}, path.parent)
