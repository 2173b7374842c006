"""Progress of a long run over links: a bar with its rate, and the links of an earlier run."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID
from rich.text import Text

from robosim.support.progress import text_column


class LinkProgress:
    """Counts finished links and shows them in a bar."""

    def __init__(self, progress: Progress, bar: TaskID, out: Path):
        self._progress, self._bar, self._out = progress, bar, out
        self._start = time.perf_counter()
        self.found: int | None = None
        """Links of earlier runs."""
        self.done = 0
        """Links of this run and of earlier ones."""

    def report(self, done: int, total: int) -> None:
        """Set the number of finished links; the first call gives those of earlier runs."""
        if self.found is None:
            self.found = done
            if done > 0:
                line = f"{self._out} holds {done} of the {total} links; resuming from there."
                self._progress.console.print(Text(line))
        self.done = done
        left = timedelta(seconds=round((total - done) / self.rate)) if self.new else "?"
        self._progress.update(self._bar, completed=done, note=f"{self.rate:.0f} links/s, {left} left")

    @property
    def new(self) -> int:
        """Links of this run."""
        return self.done - (self.found or 0)

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return time.perf_counter() - self._start

    @property
    def rate(self) -> float:
        """Links of this run per second."""
        return self.new / self.seconds


@contextmanager
def link_progress(console: Console, total: int, out: Path) -> Iterator[LinkProgress]:
    """A bar while links are traced."""
    columns = (
        SpinnerColumn(),
        text_column("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        text_column("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, refresh_per_second=4) as progress:
        yield LinkProgress(progress, progress.add_task("links", total=total, note=""), out)
