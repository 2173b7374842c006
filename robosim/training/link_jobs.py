"""Networks trained in processes of one thread each, with checkpoints, curves and a progress bar.

A job is one network on all but its held-out buildings. The same jobs in the same folder go on from the last epoch
that was finished, and give the same weights for any number of processes.
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
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TimeElapsedColumn,
)

from robosim.support.checkpoint import Checkpoint
from robosim.support.files import write_whole
from robosim.support.progress import text_column
from robosim.support.reading import reading
from robosim.support.workers import Workers
from robosim.training.made_links import read_homes
from wireless.linkstate.data import Links, read_links
from wireless.linkstate.epoch import Epoch
from wireless.linkstate.learning.training import Recipe, train


@dataclass(frozen=True, kw_only=True)
class Job:
    """One network to train."""

    name: str
    """Of its checkpoint and curves."""
    data: Path
    """Folder of measurements."""
    held_out: tuple[int, ...]
    """Buildings it does not see, by number."""
    homes: int
    """Generated homes that it sees besides, from OUT/homes."""
    recipe: Recipe
    """How it is trained."""
    out: Path
    """Folder of the run."""


def run_jobs(
    jobs: list[Job], *, workers: int, cluster: str | None = None, console: Console
) -> dict[str, tuple[Any, list[Epoch]]]:
    """Networks and epochs of all jobs, by their names.

    Args:
        jobs: Networks to train. Each keeps its state in its folder after every epoch: processes of a cluster have to
            see that folder.
        workers: Processes.
        cluster: Address of a dask scheduler that is used instead.
        console: Where progress is shown.

    Raises:
        KeyboardInterrupt: After Ctrl-C, at once: the epochs that were finished are kept.
        WorkerLost: If a process was killed, when the other networks are trained.
    """
    trained = {}
    with (
        Workers(min(workers, len(jobs)), cluster, what="networks", resumable=True) as pool,
        _epochs_shown(jobs, console),
    ):
        for number, found in pool.run(run_job, [(job,) for job in jobs]):
            trained[jobs[number].name] = found
    return trained


@contextmanager
def _epochs_shown(jobs: list[Job], console: Console) -> Iterator[None]:
    """A bar of the epochs that are finished, looked up now and then."""
    ended = threading.Event()
    with _progress(console) as progress:
        bar = progress.add_task("training", total=sum(job.recipe.epochs for job in jobs), note="epochs")

        def follow() -> None:
            while not ended.wait(0.5):
                progress.update(bar, completed=sum(_epochs_done(job) for job in jobs))

        thread = threading.Thread(target=follow, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def run_job(job: Job) -> tuple[Any, list[Epoch]]:
    """Train one network, watching its held-out buildings."""
    links = links_of(job.data)
    held = links.within(job.held_out)
    done: list[Epoch] = []

    def keep(epoch: Epoch) -> None:
        done.append(epoch)
        _write_curve(job, [*_read_curve(job)[: epoch.epoch - 1], asdict(epoch)])

    tokens, state = links.tokens[~held], links.state[~held]
    if job.homes:
        made_tokens, made_state = read_homes(job.homes, job.out / "homes")
        tokens, state = np.concatenate([tokens, made_tokens]), np.concatenate([state, made_state])
    return train(
        tokens,
        state,
        job.recipe,
        watch=(links.tokens[held], links.state[held]),
        checkpoint=Checkpoint(job.out / "jobs" / f"{job.name}.pt"),
        report=keep,
    )


@cache
def links_of(data: Path) -> Links:
    """Read once a process."""
    return read_links(data)


def _curve(job: Job) -> Path:
    return job.out / "jobs" / f"{job.name}.csv"


def _read_curve(job: Job) -> list[dict[str, Any]]:
    if not _curve(job).exists():
        return []
    with reading(_curve(job), "a table of epochs", "Delete the folder to train anew.") as file:
        rows = list(csv.DictReader(file.read().decode("utf-8").splitlines()))
        if any(set(row) != {each.name for each in fields(Epoch)} for row in rows):
            raise ValueError("other columns")
        return rows


def _write_curve(job: Job, rows: list[dict[str, Any]]) -> None:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)
    write_whole(_curve(job), text.getvalue().encode())


def _epochs_done(job: Job) -> int:
    return len(_read_curve(job))


def _progress(console: Console) -> Progress:
    return Progress(
        SpinnerColumn(),
        text_column("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        text_column("{task.fields[note]}"),
        TimeElapsedColumn(),
        console=console,
        refresh_per_second=2,
        transient=True,
    )
