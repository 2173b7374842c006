"""The published figures of the search, drawn from the episodes of an evaluation.

Arrival rates by difficulty, the distributions of relative arrival times in three panels, and a representative
example: one start, two policies, where following the strongest path gets stuck. The example is found by rule: of all
tasks that start with every path of higher order, and that the one policy does sooner than the other, the one in which
the other stays longest in one place. Published numbers are marked beside ours; they come from other plans and tasks.
Reference: arXiv 2110.14789.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.drawing.gallery import Picture, write_index
from robosim.evaluation.ablations import place_of
from robosim.evaluation.charts import arrival_chart, time_chart
from robosim.evaluation.episode_file import Episode, read_episode, read_head
from robosim.evaluation.scores import CLASSES, score, summarise
from robosim.evaluation.suite import Suite, read_suite
from robosim.plans.files import read_plan
from robosim.policies.goals import SEEKERS
from robosim.robot.robots import RobotConfig
from robosim.support.colours import STATE_COLOURS, TARGET, TRUE, css
from robosim.support.figures import save_figure
from robosim.support.from_dict import from_dict
from robosim.support.reading import FileError, naming, shown
from robosim.support.run_folder import SETTINGS, read_settings
from robosim.support.text_in import check_object
from robosim.task.tasks import ARRIVAL_M
from tests.benchmarks.following import progress, told
from wireless.paths import LinkState
from wireless.support.counting import counted

#: Arrival rates that were published: easy, moderate, hard.
PUBLISHED_RATES = {"snr": (0.97, 0.88, 0.77), "los": (0.98, 0.96, 0.82), "los-or-first": (1.0, 1.0, 0.94)}
#: Relative arrival times of los-or-first read off the published curves: median and 80 %, for each class.
PUBLISHED_TIMES = ((1.55, 2.0), (2.3, 3.6), (2.2, 3.4))
#: A robot stays in one place as long as it goes no farther than this from it [m].
STAY_M = 1.0
_SUITE = "suite.yaml"


@dataclass(frozen=True, eq=False)
class Example:
    """One start, two policies."""

    stuck: Episode
    better: Episode
    stay: tuple[int, int]
    """Decision from which the first stayed in one place, and for how many."""


def draw_search(
    results: Path, out: Path, follower: str = "snr", better: str = "los-or-first"
) -> tuple[Path, list[str]]:
    """Draw the figures from a folder of `robosim evaluate`, finished or not.

    Args:
        results: That folder.
        out: Folder for the pictures and the page that shows them.
        follower: Policy of the example that gets stuck.
        better: Policy beside it.

    Returns:
        The page, and what is to be said beside it.

    Raises:
        ValueError: If the folder holds no evaluation, or no episode of the oracle.
    """
    rows = score(_rows(results))
    tasks = len({(row["plan"], row["task"]) for row in rows})
    figures = [
        ("search_arrival", _arrival(rows), "Arrival rates by difficulty", _ARRIVAL_CAPTION),
        ("search_times", _times(rows), "Arrival time relative to the oracle's", _TIMES_CAPTION),
    ]
    if any(row["policy"] == "shortest" for row in rows):
        own = [row for row in rows if row["policy"] in SEEKERS]
        figures.append(
            (
                "search_limit",
                time_chart(own, "shortest"),
                "Arrival time relative to the shortest way's",
                _LIMIT_CAPTION,
            )
        )
    plans = len({row["plan"] for row in rows})
    notes = [f"{counted(len(rows), 'episode')} of {counted(tasks, 'task')} in {counted(plans, 'plan')}."]
    notes += _following(results, rows)
    example = find_example(results, rows, follower, better)
    if example is None:
        notes.append(
            f"No example: no task starts with all paths of higher order and is done sooner by {better} than by "
            f"{follower}."
        )
    else:
        figure = example_figure(_building(results, example.stuck.head.row["plan"]), example)
        figures.append(
            ("search_example", figure, "A start from which following gets stuck", _EXAMPLE_CAPTION)
        )
    pictures = []
    for name, figure, title, caption in figures:
        save_figure(figure, out / f"{name}.png")
        pictures.append(Picture(name=f"{name}.png", title=title, caption=caption))
    return write_index(out, "The search, as published and as measured", pictures, notes), notes


_ARRIVAL_CAPTION = (
    "Part of the tasks in which the robot came within 0.3 m of the target within the steps allowed, with 95 % "
    "intervals. Diamonds: the published rates of the same policies, on other tasks."
)
_TIMES_CAPTION = (
    "Part of the episodes that had arrived by a time; episodes that never arrive count, so that curves may end below "
    "100 %. Diamonds: median and 80th percentile of los-or-first as read off the published curves, on other tasks."
)
_LIMIT_CAPTION = (
    "The same relative to a robot that knows target, building and pose and drives the shortest way, which is the "
    "physical limit."
)
_EXAMPLE_CAPTION = (
    "One start and two policies. Dots: the true link state at each decision. The circle marks where the first policy "
    "stayed longest."
)


def _rows(results: Path) -> list[dict[str, Any]]:
    """Rows of the kept episodes of tasks that the oracle has done too, policies in their order."""
    files = sorted((results / "episodes").glob("*/*.npz"))
    if not files or not os.path.lexists(results / _SUITE):
        raise FileError(f"{shown(results)}: no episodes. Expected a folder of `robosim evaluate`.")
    plans = _suite(results).plans
    rows = [read_head(file).row for file in files]
    if foreign := [row["plan"] for row in rows if row["plan"] not in plans]:
        raise FileError(
            f"{shown(results / _SUITE)}: has no plan {foreign[0]!r}, of which there are episodes."
        )
    judged = {(row["plan"], row["task"]) for row in rows if row["policy"] == "oracle"}
    kept = [row for row in rows if (row["plan"], row["task"]) in judged]
    if not kept:
        raise FileError(f"{shown(results)}: no episode of the oracle yet. Let `robosim evaluate` go on.")
    return sorted(kept, key=lambda row: (place_of(row["policy"]), row["plan"], row["task"], row["repeat"]))


def _following(results: Path, rows: Sequence[dict[str, Any]]) -> list[str]:
    """Whether arrivals that were followed led on."""
    config, hull_m = _scenes(results)
    found = progress(results, rows, _suite(results), config, hull_m)
    return ["Following an arrival, by the link state believed in:", *told(found)] if found else []


def _arrival(rows: Sequence[dict[str, Any]]) -> Figure:
    summaries = [s for s in summarise(rows) if s.policy in SEEKERS]
    figure = arrival_chart(summaries)
    axes = figure.axes[0]
    policies = list(dict.fromkeys(s.policy for s in summaries))
    groups = [name for name in CLASSES if any(s.difficulty == name for s in summaries)]
    x, y = [], []
    for policy, rates in PUBLISHED_RATES.items():
        if policy in policies:
            aside = (policies.index(policy) - (len(policies) - 1) / 2) * 0.8 / len(policies)
            x += [groups.index(name) + aside for name in groups]
            y += [rates[CLASSES.index(name)] for name in groups]
    axes.plot(x, y, "D", mfc="white", mec="black", ms=5, zorder=4)
    return figure


def _times(rows: Sequence[dict[str, Any]]) -> Figure:
    figure = time_chart([row for row in rows if row["policy"] in SEEKERS])
    for axes, (median, p80) in zip(figure.axes, PUBLISHED_TIMES, strict=True):
        axes.plot([median, p80], [0.5, 0.8], "D", mfc="white", mec="black", ms=5, zorder=4)
    return figure


def find_example(
    results: Path, scored: Sequence[dict[str, Any]], follower: str, better: str
) -> Example | None:
    """The representative example, see above; None if there is none.

    Args:
        results: Folder of the evaluation.
        scored: Rows with relative times.
        follower: Policy that is to get stuck.
        better: Policy that is to do better.
    """
    times = {(row["policy"], row["plan"], row["task"], row["repeat"]): row["relative_time"] for row in scored}
    found: Example | None = None
    for (policy, *task), time in times.items():
        if policy != follower or not times.get((better, *task), np.inf) < time:
            continue
        plan, number, repeat = task
        stuck, other = (
            read_episode(results / "episodes" / plan / f"{number:03d}-{name}-{repeat}.npz")
            for name in (follower, better)
        )
        if not len(stuck.links) or stuck.links[0, 0] != LinkState.HIGHER_ORDER:
            continue
        stay = longest_stay(stuck.poses[:, :2], STAY_M)
        if found is None or stay[1] > found.stay[1]:
            found = Example(stuck, other, stay)
    return found


def longest_stay(places: Float[np.ndarray, "n 2"], radius_m: float) -> tuple[int, int]:
    """From where on a robot stayed longest near a place of its way: index of that place, and how many followed.

    Args:
        places: x, y at each decision [m].
        radius_m: How far it may go from the place [m].
    """
    best = (0, 0)
    for i in range(len(places)):
        if len(places) - i - 1 <= best[1]:
            break
        away = np.hypot(*(places[i:] - places[i]).T) > radius_m
        stayed = int(np.argmax(away)) - 1 if away.any() else len(away) - 1
        if stayed > best[1]:
            best = (i, stayed)
    return best


def example_figure(building: Building, example: Example) -> Figure:
    """Both episodes from above, side by side.

    Args:
        building: Where they were.
        example: The two.
    """
    west, south, east, north = building.free.bounds
    upright = (north - south + 1) / (east - west + 1)
    # Panels as tall as they are wide times that, or their titles end up outside of the picture.
    width = min(6.2, 8.8 / upright)
    figure, panels = plt.subplots(
        1, 2, figsize=(2 * width, width * upright + 1.2), sharey=True, layout="constrained"
    )
    for axes, episode in zip(panels, (example.stuck, example.better), strict=True):
        axes.set_aspect("equal")
        axes.set(xlim=(west - 0.5, east + 0.5), ylim=(south - 0.5, north + 0.5), xlabel="x [m]")
        building.draw_walls(axes)
        _draw_way(axes, episode)
    panels[0].set_ylabel("y [m]")
    first, stayed = example.stay
    centre = example.stuck.poses[first, :2]
    panels[0].add_patch(Circle(tuple(centre), STAY_M, fill=False, color="black", lw=1.2, ls="--"))
    panels[0].annotate(
        f"stays {counted(stayed, 'decision')}",
        centre,
        (0, 28),
        textcoords="offset points",
        ha="center",
        fontsize=9,
    )
    handles = [
        Line2D(
            [],
            [],
            marker="o",
            ls="",
            color=css(STATE_COLOURS[state]),
            label=state.name.lower().replace("_", " "),
        )
        for state in LinkState
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


def _draw_way(axes: Axes, episode: Episode) -> None:
    row, steps = episode.head.row, len(episode.links)
    axes.plot(*episode.poses[:, :2].T, color="0.6", lw=1)
    if steps:
        colours = [css(STATE_COLOURS[LinkState(int(state))]) for state in episode.links[:, 0]]
        x, y = episode.poses[:steps, :2].T
        axes.scatter(x, y, c=colours, s=14, zorder=3)
    axes.plot(*episode.poses[0, :2], "o", mfc="none", mec=TRUE, mew=2, ms=12, zorder=4)
    axes.plot(*row["target"], "*", color=TARGET, mec="k", ms=16, zorder=4)
    axes.add_patch(Circle(tuple(row["target"]), ARRIVAL_M, fill=False, color=TARGET, lw=0.8))
    ended = "arrived" if row["arrived"] else row["ended"]
    axes.set_title(
        f"{row['plan']} {row['task']}, {row['policy']}: {ended} after {counted(row['steps'], 'step')}",
        fontsize=10,
        parse_math=False,
    )


def _building(results: Path, plan: str) -> Building:
    """The building of a plan, made as its episodes had it."""
    config, _ = _scenes(results)
    suite = _suite(results)
    return make_building(read_plan(suite.plans[plan], reader=suite.reader), config=config)


def _suite(results: Path) -> Suite:
    return read_suite(results / _SUITE)


def _scenes(results: Path) -> tuple[BuildingConfig, tuple[float, float]]:
    """How plans became buildings, and radius and height of the robot [m]."""
    settings = read_settings(results, "evaluate")
    with naming(results / SETTINGS, "the settings of an evaluation"):
        episode = check_object(settings["episode"], ("building", "simulator"))
        robot = from_dict(RobotConfig, check_object(episode["simulator"], ("robot",))["robot"], "robot")
        return from_dict(BuildingConfig, episode["building"], "building"), robot.hull_m
