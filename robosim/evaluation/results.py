"""What an evaluation leaves to be read: tables, pictures, and the page that shows them.

All of it is made anew from the kept episodes at the end of every run. `episodes.parquet` is the same for the same
seed, byte for byte; `timing.parquet` is not.
"""

import io
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from robosim.drawing.plots import save_figure
from robosim.episode import EpisodeConfig
from robosim.evaluation.charts import arrival_chart, episode_picture, spl_chart, time_chart
from robosim.evaluation.episode_file import read_episode
from robosim.evaluation.episodes import Job
from robosim.evaluation.report import FailedEpisode, Page, write_report
from robosim.evaluation.scores import Summary
from robosim.evaluation.sweep import Failure
from robosim.support.assets import shipped_plans
from robosim.support.files import plain, whole_file, write_json, write_whole
from robosim.support.progress import told_units
from robosim.support.workers import Workers

#: Episodes without arrival that the page shows with their pictures; all are listed.
_PICTURES = 60
_IDENTITY = ("plan", "task", "policy", "repeat", "seed")


@dataclass(frozen=True)
class Evaluation:
    """What an evaluation came to; jobs, rows and timing go together."""

    jobs: list[Job]
    rows: list[dict[str, Any]]
    """One an episode, scored."""
    timing: list[dict[str, Any]]
    """Seconds of each episode by stage."""
    summaries: list[Summary]
    errors: list[Failure]
    """Episodes that raised an error instead of ending."""
    foreign: int
    """Episodes that other code or other versions of packages have run."""

    @property
    def warnings(self) -> list[str]:
        """What a reader must know before trusting the numbers."""
        lines = [f"{f.job.name} failed and is left out: {f.error}" for f in self.errors]
        if self.foreign:
            lines.append(
                f"{self.foreign} of {len(self.rows)} episodes were run by other code or other versions of packages. "
                "Delete the folder `episodes` to run all of them anew."
            )
        return lines


def replay_command(job: Job, options: str) -> str:
    """What to type to run an episode again, with its video."""
    plan = next((name for name, file in shipped_plans().items() if file == job.plan_file), str(job.plan_file))
    start, target = (",".join(f"{v!r}" for v in place) for place in (job.task.start, job.task.target))
    words = f"--start {start} --target {target} --goal {job.policy} --seed {job.config.seed} {options}"
    reader = "" if job.reader == "auto" else f" --reader {job.reader}"
    return f"robosim episode {shlex.quote(plan)} {words}".strip() + reader


def write_results(
    result: Evaluation, out: Path, *, config: EpisodeConfig, options: str, workers: int, console: Console
) -> None:
    """Write tables, pictures and the page.

    Args:
        result: What to write.
        out: Folder of the evaluation.
        config: How episodes ran, but for policy and seed.
        options: What is typed after `robosim episode` for the same configuration.
        workers: Processes that draw.
        console: Where progress is shown.
    """
    write_parquet(result.rows, out / "episodes.parquet")
    timing = [
        {**{k: row[k] for k in _IDENTITY}, **seconds}
        for row, seconds in zip(result.rows, result.timing, strict=True)
    ]
    write_parquet(timing, out / "timing.parquet")
    write_json(out / "summary.json", {"summary": [_finite(vars(summary)) for summary in result.summaries]})
    charts = [
        ("arrival", arrival_chart(result.summaries), "Arrival rates by difficulty."),
        (
            "relative_time",
            time_chart(result.rows),
            "Episodes that have arrived by a time; a curve that ends below 100 % never gets higher.",
        ),
        ("spl", spl_chart(result.summaries), "Mean success weighted by path length."),
    ]
    if any(row["policy"] == "shortest" for row in result.rows):
        about = "The same relative to a robot that knows building and pose: the physical limit."
        charts.insert(2, ("limit_time", time_chart(result.rows, "shortest"), about))
    for name, figure, _ in charts:
        save_figure(figure, out / f"{name}.png")
    pictures = [(out / f"{name}.png", caption) for name, _, caption in charts]
    failed = _draw_failed(result, out, options, workers, console)
    write_report(_page(result, config, pictures, failed), out / "report.html")


def _page(
    result: Evaluation,
    config: EpisodeConfig,
    pictures: list[tuple[Path, str]],
    failed: list[FailedEpisode],
) -> Page:
    policies = list(dict.fromkeys(row["policy"] for row in result.rows))
    own = {p: [i for i, row in enumerate(result.rows) if row["policy"] == p] for p in policies}
    tasks, plans = {(row["plan"], row["task"]) for row in result.rows}, {row["plan"] for row in result.rows}
    lead = (
        f"{len(tasks)} tasks in {len(plans)} floor plans, {len(result.rows)} episodes. "
        f"Physics {config.simulator.physics}, camera {config.simulator.camera}, noise level "
        f"{config.simulator.noise.level:g}, at most {config.max_steps} steps."
    )
    return Page(
        title=f"Evaluation of {', '.join(policies)}",
        lead=[lead],
        warnings=result.warnings,
        summaries=result.summaries,
        pictures=pictures,
        means={p: _means([result.rows[i] for i in own[p]]) for p in policies},
        seconds={p: _means([result.timing[i] for i in own[p]]) for p in policies},
        failed=failed,
    )


def write_parquet(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write rows; a column that one row lacks is null there."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.Table.from_pylist([{name: row.get(name) for name in names} for row in map(plain, rows)])
    with whole_file(path) as partial:
        pq.write_table(table, partial)


def _draw_failed(
    result: Evaluation, out: Path, options: str, workers: int, console: Console
) -> list[FailedEpisode]:
    """Episodes without arrival, the first of them with pictures; each plan's are drawn in one process."""
    failed = [(job, row) for job, row in zip(result.jobs, result.rows, strict=True) if not row["arrived"]]
    by_plan: dict[Path, list[Job]] = {}
    for job, _ in failed[:_PICTURES]:
        by_plan.setdefault(job.plan_file, []).append(job)
    drawn: dict[str, Path] = {}
    with (
        Workers(min(workers, len(by_plan) or 1), what="pictures") as pool,
        told_units(console, "plans with failures", len(by_plan)) as tell,
    ):
        for _, pictures in pool.run(_draw, [(own, out) for own in by_plan.values()]):
            for name, content in pictures.items():
                drawn[name] = out / "failures" / f"{name.replace('/', '-')}.png"
                write_whole(drawn[name], content)
            tell("")
    return [
        FailedEpisode(
            job.name,
            f"{row['difficulty']}: {row['ended']} after {row['steps']} steps, "
            f"{row['final_distance_m']:.1f} m from the target",
            replay_command(job, options),
            drawn.get(job.name),
        )
        for job, row in failed
    ]


def _draw(jobs: list[Job], out: Path) -> dict[str, bytes]:
    """Pictures of episodes of one plan, by their names."""
    building, _ = jobs[0].scene()
    return {job.name: _small(episode_picture(building, read_episode(job.file(out)))) for job in jobs}


def _small(figure: Figure) -> bytes:
    """A picture in few colours, since a page may hold many."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=70)
    plt.close(figure)
    few = Image.open(drawn).convert("RGB").quantize(192, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(small, format="png", optimize=True)
    return small.getvalue()


def _means(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Means of the columns that hold numbers, over the rows that have one."""
    means = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row[name] for row in rows if isinstance(row.get(name), (bool, int, float))]
        finite = [float(value) for value in values if np.isfinite(value)]
        if finite and name not in _IDENTITY:
            means[name] = float(np.mean(finite))
    return means


def _finite(value: Any) -> Any:
    """Estimates as dictionaries, infinite as null: never."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if hasattr(value, "_asdict"):
        return _finite(value._asdict())
    return None if isinstance(value, float) and not np.isfinite(value) else value
