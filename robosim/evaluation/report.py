"""The page of an evaluation: one HTML file with its pictures inside, which opens anywhere and needs nothing else."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from robosim.evaluation.plain_names import plain_name
from robosim.evaluation.scores import Estimate, Summary
from robosim.support.files import whole_file

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1080px; margin: 2em auto; padding: 0 1em }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px }
td, th { padding: .2em .8em; text-align: right; border-bottom: 1px solid #eee; white-space: nowrap }
th { border-bottom: 1px solid #999; font-weight: 600 }
td:first-child, th:first-child, td.name, .list th { text-align: left }
tr.first td { border-top: 1px solid #999 }
img { max-width: 100% } figure { margin: 1em 0 } figcaption { color: #555; font-size: 13px }
section { border-top: 1px solid #ccc; margin-top: 1.5em } h3 { font-size: 1em } .lost { color: #a33 }
code { font: 12px/1.4 ui-monospace, monospace; background: #f5f5f5; overflow-wrap: anywhere; padding: .1em .3em }
.wide { overflow-x: auto } .warn { color: #a33 } small { color: #777 }
"""


@dataclass(frozen=True)
class TaskEpisode:
    """An episode of a task, as the page tells it."""

    cells: Sequence[str]
    """As `TASK_HEADS`."""
    arrived: bool
    goals: str
    """Of how many decisions the goal was what, in words."""
    command: str
    """What to type to run it again."""


@dataclass(frozen=True)
class TaskPage:
    """One task, as the page shows it."""

    title: str
    what: str
    """Which policy did what, in a line."""
    episodes: Sequence[TaskEpisode]
    picture: Path | None
    """The ways of two policies; None for tasks beyond the first ones."""


#: What is told of each episode of a task.
TASK_HEADS = (
    "policy", "arrived", "actions", "x oracle", "way [m]", "shortest [m]", "SPL", "floor seen [%]", "collisions",
)  # fmt: skip


@dataclass(frozen=True)
class Page:
    """What the page tells."""

    title: str
    lead: Sequence[str]
    """Lines on what was run."""
    warnings: Sequence[str]
    summaries: Sequence[Summary]
    pictures: Sequence[tuple[Path, str]]
    """PNG files and captions."""
    means: Mapping[str, Mapping[str, float]]
    """By policy: means of the table's columns."""
    seconds: Mapping[str, Mapping[str, float]]
    """By policy: mean seconds of an episode by stage."""
    decisions_per_s: Mapping[str, float]
    """By policy: decisions a second, over the time of all stages but making the scene."""
    order: str
    """In which order tasks stand."""
    tasks: Sequence[TaskPage]


def write_report(page: Page, path: Path) -> None:
    """Write the page; pictures become part of it."""
    parts = [
        f"<h1>{escape(page.title)}</h1>",
        *(f"<p>{escape(line)}</p>" for line in page.lead),
        *(f'<p class="warn">{escape(line)}</p>' for line in page.warnings),
        "<h2>Summary</h2>",
        _summary_table(page.summaries),
        "<p><small>Brackets are 95 % intervals: Wilson's for arrival, bootstrap over tasks for the rest. Times are "
        "steps relative to the oracle's on the same task, and x shortest the median relative to a robot that knows the "
        "building, where that was run; never: fewer episodes than that arrive.</small></p>",
        *(_figure(picture, caption) for picture, caption in page.pictures),
        f"<h2>Task by task</h2><p>{escape(page.order)}</p>",
        _task_list(page.tasks),
        *(_task(number, task) for number, task in enumerate(page.tasks)),
        "<h2>Where the time goes</h2><p>Mean seconds of an episode, by stage.</p>",
        _wide_table(page.seconds, "{:.2f}"),
        "<p>Decisions a second, without the time that making building, robot and radio ready takes: "
        + escape(", ".join(f"{policy} {rate:.1f}" for policy, rate in page.decisions_per_s.items()))
        + ".</p>",
        "<h2>Means of all episodes</h2>",
        _wide_table(page.means, "{:.3g}"),
    ]
    body = "\n".join(parts)
    head = f'<meta charset="utf-8"><title>{escape(page.title)}</title><style>{_STYLE}</style>'
    with whole_file(path) as partial:
        partial.write_text(
            f'<!doctype html>\n<html lang="en"><head>{head}</head>\n<body>\n{body}\n</body></html>\n',
            encoding="utf-8",
        )


def summary_rows(summaries: Sequence[Summary]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Heads and lines of the summary table; with times relative to `shortest` where that was run."""
    limit = any(not np.isnan(summary.limit_median.value) for summary in summaries)
    heads = (
        "policy",
        "tasks are",
        "tasks",
        "arrived %",
        "rel. time, median",
        "rel. time, 80 %",
        *(["x shortest, median"] if limit else []),
        "mean SPL",
    )
    lines = [
        (
            summary.policy,
            summary.difficulty,
            str(summary.tasks),
            _percent(summary.arrival_rate),
            _times(summary.time_median),
            _times(summary.time_p80),
            *([_times(summary.limit_median)] if limit else []),
            "{:.3f} [{:.3f}, {:.3f}]".format(*summary.spl),
        )
        for summary in summaries
    ]
    return heads, lines


def _percent(rate: Estimate) -> str:
    return "{:.1f} [{:.1f}, {:.1f}]".format(*(100 * value for value in rate))


def _times(time: Estimate) -> str:
    value, low, high = ("-" if np.isnan(v) else "never" if np.isinf(v) else f"{v:.2f}" for v in time)
    return f"{value} [{low}, {high}]"


def _summary_table(summaries: Sequence[Summary]) -> str:
    rows, before = [], None
    heads, lines = summary_rows(summaries)
    for policy, name, *cells in lines:
        first = ' class="first"' if before is not None and before != policy else ""
        before = policy
        rows.append(
            f'<tr{first}><td>{escape(policy)}</td><td class="name">{name}</td>'
            + "".join(f"<td>{cell}</td>" for cell in cells)
            + "</tr>"
        )
    return _table(heads, rows)


def _wide_table(columns: Mapping[str, Mapping[str, float]], form: str) -> str:
    """A table with a column for each policy and a line for each name."""
    names = list(dict.fromkeys(name for values in columns.values() for name in values))
    rows = [
        f"<tr><td>{escape(plain_name(name))}</td>"
        + "".join(
            f"<td>{form.format(values[name]) if name in values else ''}</td>" for values in columns.values()
        )
        + "</tr>"
        for name in names
    ]
    return _table(("", *columns), rows)


def _table(heads: Sequence[str], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    return f'<div class="wide"><table><tr>{head}</tr>\n' + "\n".join(rows) + "</table></div>"


def _figure(picture: Path, caption: str) -> str:
    return f"<figure>{_image(picture, caption)}<figcaption>{escape(caption)}</figcaption></figure>"


def _task_list(tasks: Sequence[TaskPage]) -> str:
    rows = [
        f'<tr><td><a href="#task-{number}">{escape(task.title)}</a></td><td class="name">{escape(task.what)}</td></tr>'
        for number, task in enumerate(tasks)
    ]
    return f'<div class="list">{_table(("task", "in short"), rows)}</div>'


def _task(number: int, task: TaskPage) -> str:
    """A task: its picture, all its episodes, and how to run each again."""
    rows = []
    for episode in task.episodes:
        lost = "" if episode.arrived else ' class="lost"'
        name, *cells = map(escape, episode.cells)
        rows.append(f"<tr{lost}><td>{name}</td>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>")
    image = _image(task.picture, task.title) if task.picture else ""
    told = "".join(
        f"<li><b>{escape(episode.cells[0])}</b>: {escape(episode.goals)}<br><code>{escape(episode.command)}</code></li>"
        for episode in task.episodes
    )
    return (
        f'<section id="task-{number}"><h3>{escape(task.title)}</h3><p>{escape(task.what)}</p>{image}'
        f"{_table(TASK_HEADS, rows)}<details><summary>Goals, and how to run each again</summary><ul>{told}</ul>"
        "</details></section>"
    )


def _image(path: Path, text: str) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<img alt="{escape(text)}" src="data:image/png;base64,{data}">'
