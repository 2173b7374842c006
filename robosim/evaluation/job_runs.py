"""Runs many episodes on any number of workers, and resumes a run that was stopped.

Each episode is written whole when it is done, by this process alone; an episode whose file exists is not run again. A
result depends on its job only, not on the number of workers or the order in which they finish. An episode that fails is
reported and left out; the others go on, and the next run tries it again.
"""

import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.text import Text

from robosim.evaluation.episodes import Job, run_job
from robosim.support.files import write_whole
from robosim.support.parts import place_in_part
from robosim.support.progress import unit_progress
from robosim.support.workers import Workers


@dataclass(frozen=True)
class Failure:
    """An episode that raised an error."""

    job: Job
    error: str
    """Its kind and the first line of its message."""
    trace: str
    """Where it happened."""


def run_jobs(
    jobs: Sequence[Job], out: Path, *, workers: int, console: Console, cluster: str | None = None
) -> list[Failure]:
    """Run all episodes, ordered by plan, whose file does not exist yet; returns those that failed.

    Raises:
        WorkerLost: If a process was killed, when the others are done.
    """
    left = [job for job in jobs if not job.file(out).is_file()]
    failures: list[Failure] = []
    with (
        Workers(min(workers, len(left) or 1), cluster, what="episodes") as pool,
        unit_progress(console, "episodes", len(jobs), len(jobs) - len(left)) as advance,
    ):
        for _, (job, content, failure) in pool.run(_safely, [(job,) for job in left]):
            if failure is None:
                write_whole(job.file(out), content)
            else:
                failures.append(failure)
                console.print(Text(f"{job.name} failed: {failure.error}"), soft_wrap=True)
            advance(job.name)
    return failures


def _safely(job: Job) -> tuple[Job, bytes, Failure | None]:
    try:
        return job, run_job(job), None
    except Exception as error:
        line = (str(error).splitlines() or [""])[0]
        place = place_in_part(error)
        words = f"{type(error).__name__}: {line}{place and f' ({place})'}"
        return job, b"", Failure(job, words, traceback.format_exc())
