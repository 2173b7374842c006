"""Networks trained in processes of one thread each, with checkpoints, curves and a progress bar.

A job is one network on all but its held-out buildings. The same jobs in the same folder go on from the last epoch
that was finished, and give the same weights for any number of processes.
"""

import csv
import multiprocessing
from concurrent.futures import Future, ProcessPoolExecutor, wait
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
    TextColumn,
    TimeElapsedColumn,
)

from robosim.made_links import read_homes
from robosim.support.files import whole_file
from robosim.support.reading import reading
from wireless.linkstate.data import Links, read_links
from wireless.linkstate.training import Epoch, Recipe, train


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


def run_jobs(jobs: list[Job], workers: int, console: Console) -> dict[str, tuple[Any, list[Epoch]]]:
    """Networks and epochs of all jobs, by their names."""
    (jobs[0].out / "jobs").mkdir(parents=True, exist_ok=True)
    total = sum(job.recipe.epochs for job in jobs)
    context = multiprocessing.get_context("spawn")
    with (
        ProcessPoolExecutor(min(workers, len(jobs)), mp_context=context) as pool,
        _progress(console) as progress,
    ):
        bar = progress.add_task("training", total=total, note="epochs")
        futures: dict[str, Future[tuple[Any, list[Epoch]]]] = {
            job.name: pool.submit(run_job, job) for job in jobs
        }
        try:
            while wait(futures.values(), timeout=0.5).not_done:
                if any(future.done() and future.exception() for future in futures.values()):
                    break
                progress.update(bar, completed=sum(_epochs_done(job) for job in jobs))
            return {name: future.result() for name, future in futures.items()}
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


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
        checkpoint=job.out / "jobs" / f"{job.name}.pt",
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
    with whole_file(_curve(job)) as partial, open(partial, "w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _epochs_done(job: Job) -> int:
    return len(_read_curve(job))


def _progress(console: Console) -> Progress:
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
        console=console,
        refresh_per_second=2,
        transient=True,
    )
