"""Training of several classifiers of link states, each in a process of one thread, with checkpoints and curves.

A job trains one network on all buildings except its held-out ones. The same jobs in the same folder continue after
their last finished epoch, and give the same weights for any number of processes.
"""

import csv
import io
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TimeElapsedColumn

from robosim.support.checkpoint import Checkpoint
from robosim.support.files import write_whole
from robosim.support.progress import text_column
from robosim.support.reading import reading
from robosim.support.workers import Workers
from robosim.training.generated_links import read_homes
from wireless.linkstate.data import Links, read_links
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.learning.training import Recipe, train


@dataclass(frozen=True, kw_only=True)
class Job:
    """One network."""

    name: str
    data: Path
    """Folder of measurements."""
    held_out: tuple[int, ...]
    """Numbers of buildings outside its training."""
    homes: int
    """Number of generated homes in its training, from OUT/homes."""
    recipe: Recipe
    out: Path
    """Folder of the run."""

    @property
    def checkpoint(self) -> Path:
        """State after each epoch."""
        return self.out / "jobs" / f"{self.name}.pt"

    @property
    def curve(self) -> Path:
        """Table of finished epochs."""
        return self.out / "jobs" / f"{self.name}.csv"


def run_jobs(
    jobs: list[Job], *, workers: int, cluster: str | None = None, console: Console
) -> dict[str, tuple[Any, list[Epoch]]]:
    """Networks and epochs of all jobs, by name, from worker processes or from those of a dask scheduler.

    Each job stores its state in the folder of the run, which processes of a cluster must see.

    Raises:
        KeyboardInterrupt: After Ctrl-C, at once: finished epochs are stored.
        WorkerLost: If a process was killed, after the other networks are trained.
    """
    trained = {}
    with (
        Workers(min(workers, len(jobs)), cluster, what="networks", resumable=True) as pool,
        _epoch_bar(jobs, console),
    ):
        for number, found in pool.run(run_job, [(job,) for job in jobs]):
            trained[jobs[number].name] = found
    return trained


def run_job(job: Job) -> tuple[Any, list[Epoch]]:
    """Train one network, and score it on its held-out buildings after each epoch."""
    links = links_of(job.data)
    held_out = links.within(job.held_out)

    def record(epoch: Epoch) -> None:
        rows = [*_read_curve(job)[: epoch.epoch - 1], asdict(epoch)]
        text = io.StringIO(newline="")
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
        write_whole(job.curve, text.getvalue().encode())

    tokens, state = links.tokens[~held_out], links.state[~held_out]
    if job.homes:
        home_tokens, home_state = read_homes(job.homes, job.out / "homes")
        tokens, state = np.concatenate([tokens, home_tokens]), np.concatenate([state, home_state])
    return train(
        tokens,
        state,
        job.recipe,
        watch=(links.tokens[held_out], links.state[held_out]),
        checkpoint=Checkpoint(job.checkpoint),
        report=record,
    )


@cache
def links_of(data: Path) -> Links:
    """Links of a folder, read once per process."""
    return read_links(data)


def _read_curve(job: Job) -> list[dict[str, Any]]:
    if not job.curve.exists():
        return []
    with reading(job.curve, "a table of epochs", "Delete the folder to train again.") as file:
        rows = list(csv.DictReader(file.read().decode("utf-8").splitlines()))
        if any(set(row) != {each.name for each in fields(Epoch)} for row in rows):
            raise ValueError("other columns")
        return rows


@contextmanager
def _epoch_bar(jobs: list[Job], console: Console) -> Iterator[None]:
    """A bar of finished epochs, which are read from the curves of all processes."""
    ended = threading.Event()
    columns = (SpinnerColumn(), text_column("training"), BarColumn(bar_width=24), MofNCompleteColumn())
    with Progress(
        *columns, text_column("epochs"), TimeElapsedColumn(), console=console, refresh_per_second=2,
        transient=True,
    ) as progress:  # fmt: skip
        bar = progress.add_task("", total=sum(job.recipe.epochs for job in jobs))

        def follow() -> None:
            while not ended.wait(0.5):
                progress.update(bar, completed=sum(len(_read_curve(job)) for job in jobs))

        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
