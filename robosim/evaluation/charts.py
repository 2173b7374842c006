"""Charts of an evaluation: arrival rates, relative arrival times, SPL."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from robosim.evaluation.search_scores import CLASSES, Estimate, Summary
from wireless.support.counting import counted

#: Okabe and Ito's colours, in the order that policies come in.
_COLOURS = ("#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#999999")
#: Relative arrival times are drawn up to here.
_LONGEST = 5.0


def arrival_chart(summaries: Sequence[Summary]) -> Figure:
    """Arrival rates by difficulty, a bar for each policy."""
    return _bars(summaries, "arrival_rate", "arrived within the steps allowed", percent=True)


def spl_chart(summaries: Sequence[Summary]) -> Figure:
    """Mean SPL by difficulty, a bar for each policy."""
    return _bars(summaries, "spl", "success weighted by path length (SPL)", percent=False)


def time_chart(scored: Sequence[Mapping[str, Any]], bar: str = "oracle") -> Figure:
    """Distribution of the arrival time relative to `bar`, a panel for each class; episodes without arrival count."""
    column = {"oracle": "relative_time", "shortest": "limit_time"}[bar]
    figure, panels = plt.subplots(1, 3, figsize=(11, 3.8), sharey=True, layout="constrained")
    colours = _colours(row["policy"] for row in scored)
    for axes, name in zip(panels, CLASSES, strict=True):
        own = [row for row in scored if row["difficulty"] == name and not np.isnan(row[column])]
        for policy, colour in colours.items():
            times = np.sort([row[column] for row in own if row["policy"] == policy])
            # The bar itself with one seed is 1 by definition.
            if len(times) and not (policy == bar and (times == 1).all()):
                _cdf(axes, times, colour, policy)
        least = 0.4 if bar == "oracle" and "shortest" in colours else 0.8
        axes.set(xlim=(least, _LONGEST), ylim=(0, 1.02), xlabel=f"arrival time / {_WHOSE[bar]}")
        axes.set_title(
            f"{name}, {counted(len({(row['plan'], row['task']) for row in own}), 'task')}", fontsize=10
        )
        axes.axvline(1, color="0.6", lw=0.8, ls=":")
        _plain_axes(axes)
    panels[0].set_ylabel("episodes that have arrived")
    panels[0].yaxis.set_major_formatter(PercentFormatter(1))
    handles, labels = panels[-1].get_legend_handles_labels()
    if handles:
        panels[-1].legend(handles, labels, loc="lower right", fontsize=8, frameon=False)
    return figure


_WHOSE = {"oracle": "oracle's", "shortest": "that of shortest"}


def _bars(summaries: Sequence[Summary], what: str, label: str, *, percent: bool) -> Figure:
    figure, axes = plt.subplots(figsize=(8.5, 3.8), layout="constrained")
    colours = _colours(summary.policy for summary in summaries)
    groups = [name for name in (*CLASSES, "all") if any(s.difficulty == name for s in summaries)]
    width = 0.8 / len(colours)
    for place, (policy, colour) in enumerate(colours.items()):
        own = {s.difficulty: s for s in summaries if s.policy == policy}
        x = [groups.index(name) + (place - (len(colours) - 1) / 2) * width for name in own]
        values: list[Estimate] = [getattr(summary, what) for summary in own.values()]
        heights = np.array([v.value for v in values])
        spread = np.array([[v.value - v.low, v.high - v.value] for v in values]).T
        axes.bar(x, heights, 0.92 * width, color=colour, label=policy, alpha=0.9)
        axes.errorbar(x, heights, np.maximum(spread, 0), fmt="none", ecolor="0.35", lw=1, capsize=2)
    tasks = [next(s.tasks for s in summaries if s.difficulty == name) for name in groups]
    names = [f"{name}\n{counted(count, 'task')}" for name, count in zip(groups, tasks, strict=True)]
    axes.set_xticks(range(len(groups)), names)
    axes.set(ylim=(0, 1.04), ylabel=label)
    if percent:
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    _plain_axes(axes)
    axes.grid(axis="x", visible=False)
    figure.legend(loc="outside upper center", ncols=min(len(colours), 8), fontsize=8, frameon=False)
    return figure


def _cdf(axes: Axes, times: np.ndarray, colour: str, label: str) -> None:
    """Share of all episodes that have arrived by each time."""
    finite = times[np.isfinite(times)]
    share = np.arange(1, len(finite) + 1) / len(times)
    x = np.concatenate([[0], finite, [max(_LONGEST, finite.max(initial=0))]])
    y = np.concatenate([[0], share, share[-1:] if len(share) else [0]])
    axes.step(x, y, where="post", color=colour, lw=1.6, label=label)


def _plain_axes(axes: Axes) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="0.92", lw=0.8)
    axes.set_axisbelow(True)


def _colours(policies: Any) -> dict[str, str]:
    return {policy: _COLOURS[place % len(_COLOURS)] for place, policy in enumerate(dict.fromkeys(policies))}
