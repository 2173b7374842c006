"""Files of an evaluation: tables, charts, pictures of tasks, and the page that shows them.

All of them are written again from the recorded episodes at the end of every run. `episodes.parquet` is the same for the
same seed, byte for byte; `timing.parquet` is not.
"""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from matplotlib.figure import Figure
from PIL import Image
from rich.console import Console

from robosim.episode import EpisodeConfig
from robosim.evaluation.charts import arrival_chart, spl_chart, time_chart
from robosim.evaluation.comparison import Compared, compared
from robosim.evaluation.report import IDENTITY, Evaluation, write_report
from robosim.evaluation.rows import read_job_episode
from robosim.evaluation.task_pictures import trajectories_figure
from robosim.support.figures import save_figure
from robosim.support.files import plain, whole_file, write_json, write_whole
from robosim.support.progress import unit_progress
from robosim.support.workers import Workers

#: Tasks that the page shows with a picture, the worst first; all are listed.
_PICTURES = 60
#: Pictures that a process draws at once.
_AT_ONCE = 5


def write_results(
    result: Evaluation, out: Path, *, config: EpisodeConfig, options: str, workers: int, console: Console
) -> None:
    """Write tables, charts, pictures and the page; `options` are those of `robosim episode` for `config`."""
    write_parquet(result.rows, out / "episodes.parquet")
    identities = [{name: row[name] for name in IDENTITY} for row in result.rows]
    timing = [{**one, **seconds} for one, seconds in zip(identities, result.timing, strict=True)]
    write_parquet(timing, out / "timing.parquet")
    write_json(out / "summary.json", {"summary": [_finite(vars(summary)) for summary in result.summaries]})
    figures = {
        "arrival": (arrival_chart(result.summaries), "Arrival rates by difficulty."),
        "relative_time": (
            time_chart(result.rows),
            "Episodes that have arrived by a time; a curve that ends below 100 % never gets higher.",
        ),
    }
    if any(row["policy"] == "shortest" for row in result.rows):
        caption = "The same relative to a robot that knows building and pose: the physical limit."
        figures["limit_time"] = time_chart(result.rows, "shortest"), caption
    figures["spl"] = spl_chart(result.summaries), "Mean success weighted by path length."
    for name, (figure, _) in figures.items():
        save_figure(figure, out / f"{name}.png")
    charts = [(out / f"{name}.png", caption) for name, (_, caption) in figures.items()]
    tasks = compared(result.rows)
    pictures = _draw_tasks(result, tasks[:_PICTURES], out, workers, console)
    write_report(result, out, config=config, options=options, charts=charts, tasks=tasks, pictures=pictures)


def write_parquet(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write rows; a column that one row lacks is null there."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.Table.from_pylist([{name: row.get(name) for name in names} for row in map(plain, rows)])
    with whole_file(path) as partial:
        pq.write_table(table, partial)


def _draw_tasks(
    result: Evaluation, tasks: list[Compared], out: Path, workers: int, console: Console
) -> dict[Compared, Path]:
    """Pictures of tasks, each of the one or two episodes that are compared."""
    files = [
        [result.jobs[i].file(out) for i in (task.subject, task.rival) if i is not None] for task in tasks
    ]
    calls = [(files[first : first + _AT_ONCE],) for first in range(0, len(files), _AT_ONCE)]
    drawn: dict[Compared, Path] = {}
    with (
        Workers(min(workers, len(calls) or 1), what="pictures") as pool,
        unit_progress(console, "pictures of tasks", len(calls)) as advance,
    ):
        for number, pictures in pool.run(_draw, calls):
            for task, content in zip(tasks[number * _AT_ONCE :], pictures, strict=False):
                path = out / "tasks" / f"{task.plan}-{task.task:03d}-{task.repeat}.png"
                write_whole(path, content)
                drawn[task] = path
            advance("")
    return drawn


def _draw(files: list[list[Path]]) -> list[bytes]:
    return [_small(trajectories_figure([read_job_episode(file) for file in some])) for some in files]


def _small(figure: Figure) -> bytes:
    """A picture in few colours, since a page may hold many."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=85)
    plt.close(figure)
    few = Image.open(drawn).convert("RGB").quantize(192, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(small, format="png", optimize=True)
    return small.getvalue()


def _finite(value: Any) -> Any:
    """Estimates as dictionaries, infinite as null: never."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if hasattr(value, "_asdict"):
        return _finite(value._asdict())
    return None if isinstance(value, float) and not np.isfinite(value) else value
