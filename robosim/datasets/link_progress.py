"""Progress of a long run over links: a bar, and the links of an earlier run."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TimeRemainingColumn
from rich.text import Text

from robosim.support.progress import text_column


class LinkProgress:
    """Counts finished links and shows them in a bar."""

    def __init__(self, progress: Progress, bar: TaskID, out: Path) -> None:
        self._progress, self._bar, self._out = progress, bar, out
        self._start, self._done = time.perf_counter(), 0
        self._found: int | None = None

    def report(self, done: int, total: int) -> None:
        """Set the number of finished links; the first call gives those of earlier runs."""
        if self._found is None:
            self._found = done
            if done > 0:
                line = f"{self._out} holds {done} of the {total} links; resuming from there."
                self._progress.console.print(Text(line))
        self._done = done
        self._progress.update(self._bar, completed=done)

    def timing(self) -> dict[str, float]:
        """Number of links of this run, and seconds since its start."""
        return {"links": self._done - (self._found or 0), "seconds": time.perf_counter() - self._start}


@contextmanager
def link_progress(console: Console, total: int, out: Path) -> Iterator[LinkProgress]:
    """A bar while links are traced."""
    bars = (SpinnerColumn(), text_column("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn())
    columns = (*bars, TimeRemainingColumn())
    with Progress(*columns, console=console, refresh_per_second=4, speed_estimate_period=600) as progress:
        yield LinkProgress(progress, progress.add_task("links", total=total), out)
