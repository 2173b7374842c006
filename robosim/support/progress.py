"""Progress of a loop, ended with the block it stands in.

`rich.progress.track` ends its bar when its generator is collected, which can be long after an error: the bar
continues to draw, and another one that starts meanwhile can wait for it forever. Logs get no bars, but an occasional
line. Names of files and plans are printed verbatim: text in brackets is not markup.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

T = TypeVar("T")
#: Interval between progress lines in a log [s].
_LINE_S = 60


def text_column(text: str) -> ProgressColumn:
    """A column of plain text, in which fields of the task are filled in."""
    return TextColumn(text, markup=False)


@contextmanager
def tracked(
    items: Iterable[T], what: str, console: Console | None, total: int | None = None
) -> Iterator[Iterable[T]]:
    """The items, with a bar while the block lasts if the console is a terminal; `total` if `len` does not give it."""
    shown = console is not None and console.is_terminal
    columns = (text_column("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not shown) as progress:
        yield progress.track(items, total=total, description=what)


@contextmanager
def unit_progress(console: Console, what: str, total: int, done: int = 0) -> Iterator[Callable[[str], None]]:
    """A function to call after each unit: moves a bar with the time left, or prints an occasional line in a log.

    `what` names the units, such as "episodes"; `done` of the `total` were done before.
    """
    if console.is_terminal:
        columns = (
            text_column(what),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            text_column("left"),
            TimeRemainingColumn(),
            text_column("{task.description}"),
        )
        with Progress(*columns, console=console, transient=True, speed_estimate_period=600) as progress:
            bar = progress.add_task("", total=total, completed=done)
            yield lambda name: progress.update(bar, advance=1, description=name)
        return
    begin, count, next_line = monotonic(), 0, monotonic() + _LINE_S

    def advance(name: str) -> None:
        nonlocal count, next_line
        count += 1
        if monotonic() < next_line:
            return
        next_line = monotonic() + _LINE_S
        minutes = (monotonic() - begin) / count * (total - done - count) / 60
        console.print(f"{done + count} of {total} {what}, about {minutes:.0f} min left", highlight=False)

    yield advance


def stages_tracked(title: str, console: Console) -> Callable[[range, str], Iterator[int]]:
    """Return a progress display of stages: it iterates over numbers, given them and the stage's name."""

    def watched(numbers: range, stage: str) -> Iterator[int]:
        with tracked(numbers, f"{title}, {stage}", console) as shown:
            yield from shown

    return watched
