"""Many episodes on any number of workers, going on where a run was stopped.

Each episode is written whole once it is done, by this process alone; one whose file is there is not run again. What
an episode comes to depends on its job only, so that the number of workers and the order in which they finish change
nothing. An episode that fails is told and left out; the others go on, and the next run tries it again.
"""

import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Any

import joblib
from joblib.externals.loky.process_executor import BrokenProcessPool
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from robosim.evaluation.episodes import Job, run_job
from robosim.support.files import whole_file


@dataclass(frozen=True)
class Failure:
    """An episode that raised an error instead of ending."""

    job: Job
    error: str
    """Its kind and the first line of its message."""
    trace: str
    """Where it happened."""


def sweep(
    jobs: Sequence[Job], out: Path, *, workers: int, console: Console, cluster: str | None = None
) -> list[Failure]:
    """Run all episodes that are not kept yet, each into its file.

    Args:
        jobs: Episodes, ordered by plan.
        out: Folder of the evaluation.
        workers: Processes at once.
        console: Where progress is shown.
        cluster: Address of a dask scheduler that runs them instead.

    Returns:
        The episodes that failed.
    """
    left = [job for job in jobs if not job.file(out).is_file()]
    failures: list[Failure] = []
    with told_units(console, "episodes", len(jobs), len(jobs) - len(left)) as tell:
        for job, content, failure in in_parallel(_safely, [(job,) for job in left], workers, cluster):
            if failure is None:
                with whole_file(job.file(out)) as partial:
                    partial.write_bytes(content)
            else:
                failures.append(failure)
                console.print(
                    f"{job.name} failed: {failure.error}", highlight=False, markup=False, soft_wrap=True
                )
            tell(job.name)
    return failures


def in_parallel(
    function: Any, calls: Sequence[tuple[Any, ...]], workers: int, cluster: str | None = None
) -> Iterator[Any]:
    """Results of calls as they come, in any order.

    Args:
        function: A function of a module, so that other processes find it.
        calls: Its arguments, for each call.
        workers: Processes at once; one runs them here.
        cluster: Address of a dask scheduler to run them on.

    Raises:
        ValueError: If a cluster is asked for and dask is not installed, or there is none at the address.
        ChildProcessError: If a process was killed, as by a machine that is out of memory.
    """
    jobs = [joblib.delayed(function)(*call) for call in calls]
    if not jobs:
        return
    with _backend(cluster):
        count = -1 if cluster else min(workers, len(jobs))
        # One call at a time: they take seconds, and their order keeps a worker with its plan.
        try:
            yield from joblib.Parallel(n_jobs=count, batch_size=1, return_as="generator_unordered")(jobs)
        except BrokenProcessPool as error:
            raise ChildProcessError(
                f"a worker process died; is there memory for {count}? What is done is kept: give the same command "
                "again, perhaps with fewer --workers."
            ) from error


@contextmanager
def _backend(cluster: str | None) -> Iterator[None]:
    if cluster is None:
        with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
            yield
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise ValueError("--cluster needs dask. Install it with `pip install robosim[cluster]`.") from error
    try:
        client = Client(cluster, timeout="20s")
    except OSError as error:
        raise ValueError(f"cluster is {cluster!r}, where no dask scheduler answers ({error}).") from error
    with client, joblib.parallel_config(backend="dask", client=client):
        yield


def _safely(job: Job) -> tuple[Job, bytes, Failure | None]:
    try:
        return job, run_job(job), None
    except Exception as error:
        line = (str(error).splitlines() or [""])[0]
        return job, b"", Failure(job, f"{type(error).__name__}: {line}", traceback.format_exc())


@contextmanager
def told_units(console: Console, what: str, total: int, done: int) -> Iterator[Any]:
    """Something to call after each unit: moves a bar with the time left, or prints a line now and then in a log."""
    if console.is_terminal:
        columns = (
            TextColumn(what),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.description}"),
        )
        with Progress(*columns, console=console, transient=True, speed_estimate_period=600) as progress:
            bar = progress.add_task("", total=total, completed=done)
            yield lambda name: progress.update(bar, advance=1, description=name)
        return
    begin, count, next_line = monotonic(), 0, monotonic() + 60

    def tell(name: str) -> None:
        nonlocal count, next_line
        count += 1
        if monotonic() < next_line:
            return
        next_line = monotonic() + 60
        spent = monotonic() - begin
        minutes = spent / count * (total - done - count) / 60
        console.print(f"{done + count} of {total} {what}, about {minutes:.0f} min left", highlight=False)

    yield tell
