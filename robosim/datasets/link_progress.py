"""How far a long run over links is: a bar with its rate, and what was found from a run before."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn
from rich.text import Text

from robosim.support.progress import text_column


class LinkProgress:
    """Counts links as they are done."""

    def __init__(self, show: Callable[[int, str], None], say: Callable[[str], None], out: Path):
        self._show, self._say, self._out = show, say, out
        self._start = time.perf_counter()
        self.found: int | None = None
        """Links that were there at first."""
        self.done = 0
        """Links that are there."""

    def report(self, done: int, total: int) -> None:
        """Note how many links are done; the first call says how many were there already."""
        if self.found is None:
            self.found = done
            if done > 0:
                self._say(f"{self._out} holds {done} of the {total} links; going on from there.")
        self.done = done
        left = timedelta(seconds=round((total - done) / self.rate)) if self.new else "?"
        self._show(done, f"{self.rate:.0f} links/s, {left} left")

    @property
    def new(self) -> int:
        """Links done by this run."""
        return self.done - (self.found or 0)

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return time.perf_counter() - self._start

    @property
    def rate(self) -> float:
        """Links a second."""
        return self.new / self.seconds


@contextmanager
def link_progress(console: Console, total: int, out: Path) -> Iterator[LinkProgress]:
    """A bar while links are worked on.

    Args:
        console: Where it is shown.
        total: Number of links.
        out: Folder of results, for what is said.
    """
    columns = (
        SpinnerColumn(),
        text_column("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        text_column("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, refresh_per_second=4) as progress:
        bar = progress.add_task("links", total=total, note="")
        yield LinkProgress(
            lambda done, note: progress.update(bar, completed=done, note=note),
            lambda line: progress.console.print(Text(line)),
            out,
        )
