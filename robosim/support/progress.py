"""Progress of a loop, ended with the block it stands in.

`rich.progress.track` ends its bar when its generator is collected, which after an error may be long after: the bar
goes on drawing, and another one begun meanwhile can wait for it for ever. Logs get no bars.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

T = TypeVar("T")


@contextmanager
def tracked(
    items: Iterable[T], what: str, console: Console | None, total: int | None = None
) -> Iterator[Iterable[T]]:
    """The items, with a bar while the block lasts.

    Args:
        items: What is gone through.
        what: What the bar is called.
        console: Where it is shown, if that is a terminal; None for nowhere.
        total: Number of items, if it cannot be asked for.
    """
    shown = console is not None and console.is_terminal
    with Progress(console=console, transient=True, disable=not shown) as progress:
        yield progress.track(items, total=total, description=what)
