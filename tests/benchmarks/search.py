"""An evaluation of searches, compared with the published one: steps over the oracle's, arrivals, and what was followed.

Tasks are classed by the steps of the oracle. Arrivals that lead on: how much shorter the rest of the route is ten
decisions after the robot began to follow an arrival, by the link state that it believed in, and where `los-or-first`
explores although a path of higher order would be strong enough to follow. A robot follows where it has just set its
goal as far ahead as the published system does; that a goal of the explorer may by chance lie as far ahead is left
out.
Reference: arXiv 2110.14789. Its numbers come from other plans and tasks.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import BuildingConfig
from robosim.evaluation.episodes import read_job_episode, read_job_head, scene
from robosim.evaluation.evaluate import place_of
from robosim.evaluation.search_scores import CLASSES, bootstrap, by_plan, score, steps_of, summarise
from robosim.evaluation.suite import Suite, read_suite
from robosim.policies.arrival import FollowConfig
from robosim.policies.goals import SEEKERS
from robosim.recording.episode_file import RecordedEpisode
from robosim.robot.robots import RobotConfig
from robosim.support.from_dict import from_dict
from robosim.support.reading import FileError, shown
from robosim.support.run_folder import SETTINGS
from robosim.support.text_in import read_json
from slam.hull import Outline
from tests.benchmarks.harness import DEFAULT, Options, ratio_interval
from tests.benchmarks.results import Results
from wireless.paths import LinkState

#: Relative arrival times of los-or-first read off the published curves: median and 80 %, for each class.
PUBLISHED_TIMES = ((1.55, 2.0), (2.3, 3.6), (2.2, 3.4))
#: Its published arrivals [%], for each class.
PUBLISHED_ARRIVALS = (100, 100, 94)
#: Policies that follow by one rule, and decisions after which the robot is looked at again.
FOLLOWERS, LATER = ("snr", "los", "los-or-first"), 10
EXPLORED = "higher order, exploring instead"
#: How far a goal may be off the distance ahead [m]; places are stored in single precision.
SLACK_M = 0.01


def main(evaluation: Positional[Path], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Searches of `robosim evaluate`: steps over the oracle's by policy, with the published ones; what was followed.

    An evaluation that is still running is read as far as it is.

    Args:
        evaluation: Folder of `robosim evaluate`.
        options: Of every benchmark.
    """
    results = Results()
    scored = score(rows_of(evaluation))
    for one in summarise(scored):
        if one.policy == "oracle":
            continue
        for name, value, digits in (
            ("median", one.time_median, 2), ("80 %", one.time_p80, 2), ("SPL", one.spl, 2),
            ("over shortest", one.limit_median, 2),
        ):  # fmt: skip
            if np.isnan(value.value):  # none of the tasks was done by `shortest`
                continue
            spread = (value.low, value.high)
            results.add(
                name, one.policy, one.difficulty, value.value, digits=digits, spread=spread, cases=one.tasks
            )
        rate = tuple(100 * part for part in one.arrival_rate)
        results.add(
            "arrived", one.policy, one.difficulty, rate[0], "%", digits=1, spread=rate[1:], cases=one.tasks
        )
        rows = [
            row
            for row in scored
            if row["policy"] == one.policy and one.difficulty in ("all", row["difficulty"])
        ]
        bumps, driven = (sum(row[name] for row in rows) for name in ("collisions", "path_length_m"))
        results.add(
            "bumps in 100 m", one.policy, one.difficulty, 100 * bumps / driven, digits=1, cases=one.tasks
        )
    add_estimates(scored, results)
    published = "published, los-or-first"
    for difficulty, (median, p80), arrived in zip(CLASSES, PUBLISHED_TIMES, PUBLISHED_ARRIVALS, strict=True):
        results.add("median", published, difficulty, median, digits=2)
        results.add("80 %", published, difficulty, p80, digits=2)
        results.add("arrived", published, difficulty, arrived, "%", digits=0)
    add_ratios(scored, results)
    add_spl_ratios(scored, results)
    settings = read_json(evaluation / SETTINGS, "settings of an evaluation")["settings"]["episode"]
    building = from_dict(BuildingConfig, settings["building"], "building")
    robot = from_dict(RobotConfig, settings["simulator"]["robot"], "robot")
    suite = read_suite(evaluation / "suite.yaml")
    for name, metres in progress(evaluation, scored, suite, building, robot.hull_m).items():
        share = 100 * np.mean(np.array(metres) > 0)
        results.add("followed", name, "nearer after 10 decisions", share, "%", digits=0, cases=len(metres))
        results.add("followed", name, "by", np.mean(metres), "m", digits=2, cases=len(metres))
    results.figures = {"search_times": times(scored)}
    return options.finish("search", results)


def rows_of(evaluation: Path) -> list[dict[str, Any]]:
    """Rows of the episodes of tasks that the oracle has done too, policies in their order.

    Raises:
        FileError: If there is no episode of the oracle.
    """
    rows = [read_job_head(file).row for file in sorted((evaluation / "episodes").glob("*/*.npz"))]
    judged = {(row["plan"], row["task"]) for row in rows if row["policy"] == "oracle"}
    if not judged:
        raise FileError(
            f"{shown(evaluation)}: no episode of the oracle. Expected a folder of `robosim evaluate`."
        )
    known = [row for row in rows if (row["plan"], row["task"]) in judged]
    return sorted(known, key=lambda row: (place_of(row["policy"]), row["plan"], row["task"], row["repeat"]))


def add_estimates(scored: Sequence[Mapping[str, Any]], results: Results) -> None:
    """Errors of the position at the end of searches, and the share of link states that are right during them."""
    for policy in dict.fromkeys(row["policy"] for row in scored):
        rows = [row for row in scored if row["policy"] == policy]
        for table, name, column, unit, quantile in (
            ("pose at the end", "median", "position_error_last_m", "cm", 0.5),
            ("pose at the end", "95 %", "position_error_last_m", "cm", 0.95),
            ("link states during searches", "right", "link_state_accuracy", "%", None),
        ):
            values = 100 * np.array([[row.get(column, np.nan)] for row in rows], float)
            value, *spread = bootstrap(by_plan(values, [row["plan"] for row in rows]), quantile)
            if np.isfinite(value):
                results.add(table, policy, name, value, unit, digits=1, spread=spread, cases=len(rows))


def add_ratios(scored: Sequence[Mapping[str, Any]], results: Results) -> None:
    """Geometric means of steps over those of `snr`, `fused` and the oracle, by difficulty, where both arrive."""
    classes = {(row["plan"], row["task"]): row["difficulty"] for row in scored}
    policies = list(dict.fromkeys(row["policy"] for row in scored))
    steps = {policy: steps_of(scored, policy) for policy in policies}
    for policy in policies:
        for other in ("snr", "fused", "oracle"):
            if other not in policies or other == policy:
                continue
            for name in ("all", *CLASSES):
                ratios = [
                    (key[0], own / steps[other][key])
                    for key, own in steps[policy].items()
                    if name in ("all", classes[key])
                    and 0 < steps[other].get(key, np.inf) < np.inf
                    and 0 < own < np.inf
                ]
                if ratios:
                    plans, values = zip(*ratios, strict=True)
                    results.add_ratio(f"steps over {other}", policy, name, np.array(values), plans)


def add_spl_ratios(scored: Sequence[Mapping[str, Any]], results: Results) -> None:
    """Mean SPL over the mean of `shortest` on the same tasks, by difficulty; intervals by bootstrap over plans."""
    spl: dict[str, dict[tuple[str, int], list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in scored:
        spl[row["policy"]][row["plan"], row["task"]].append(row["spl"])
    classes = {(row["plan"], row["task"]): row["difficulty"] for row in scored}
    for policy, name in product(spl, ("all", *CLASSES)):
        keys = [
            key for key in spl[policy] if key in spl.get("shortest", {}) and name in ("all", classes[key])
        ]
        if policy == "shortest" or not keys:
            continue
        means, limits = (np.array([np.mean(spl[of][key]) for key in keys]) for of in (policy, "shortest"))
        plans = [key[0] for key in keys]
        of_plan, limit_of_plan = (
            np.nansum(by_plan(each[:, None], plans), axis=1) for each in (means, limits)
        )
        value, spread = ratio_interval(of_plan, limit_of_plan)
        results.add("SPL over shortest", policy, name, value, digits=2, spread=spread, cases=len(keys))


def progress(
    evaluation: Path,
    rows: Sequence[Mapping[str, Any]],
    suite: Suite,
    building: BuildingConfig,
    hull_m: tuple[float, float, Outline],
) -> dict[str, list[float]]:
    """How much shorter the rest of the route is later [m], by link state, and of exploring under `EXPLORED`.

    Args:
        evaluation: Folder of the evaluation.
        rows: Its episodes.
        suite: What was searched.
        building: How plans became buildings.
        hull_m: Radius, height and outline of the robot [m].
    """
    gained: dict[str, list[float]] = defaultdict(list)
    for row in sorted((r for r in rows if r["policy"] in FOLLOWERS), key=lambda r: (r["plan"], r["task"])):
        name = f"{row['plan']}/{row['task']:03d}-{row['policy']}-{row['repeat']}.npz"
        episode = read_job_episode(evaluation / "episodes" / name)
        _, places = scene(suite.plans[row["plan"]], suite.reader, building, hull_m)
        travel = places.travel_m(np.array(row["target"]))
        left = np.array([places.remaining_m(travel, pose[:2]) for pose in episode.poses])
        for followed, metres in _gains(episode, left, explores=row["policy"] == "los-or-first"):
            gained[followed].append(metres)
    order = [words_of(state) for state in LinkState if state != LinkState.OUTAGE] + [EXPLORED]
    return {name: gained[name] for name in order if name in gained}


def words_of(state: LinkState) -> str:
    """Name of a link state in tables."""
    return "line of sight" if state == LinkState.LOS else state.name.lower().replace("_", " ")


def _gains(
    episode: RecordedEpisode, left: Float[np.ndarray, " n"], *, explores: bool
) -> list[tuple[str, float]]:
    """How much shorter the rest of the route is later, with what the robot followed at the time."""
    follow, found = FollowConfig(), []
    for i, (estimated, snr_db) in enumerate(zip(episode.link_states.tolist(), episode.snr_db, strict=True)):
        if snr_db < follow.min_snr_db:
            continue
        state = LinkState(estimated)
        same_goal = i > 0 and np.array_equal(episode.goals[i], episode.goals[i - 1])
        ahead_m = float(np.hypot(*(episode.goals[i] - episode.estimates[i, :2])))
        follows = abs(ahead_m - follow.ahead_m) < SLACK_M
        metres = float(left[i] - left[min(i + LATER, len(left) - 1)])
        if follows and not same_goal:
            found.append((words_of(state), metres))
        elif explores and not follows and state == LinkState.HIGHER_ORDER:
            found.append((EXPLORED, metres))
    return found


#: Okabe and Ito's colours, in the order that policies come in, and the greatest relative time drawn.
COLOURS, LONGEST = (
    ("#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#999999"),
    5.0,
)


def times(scored: Sequence[dict[str, Any]]) -> Figure:
    """Distributions of arrival times over the oracle's, a panel for each class; episodes without arrival count.

    Diamonds are the published medians and 80th percentiles.
    """
    figure, panels = plt.subplots(1, 3, figsize=(11, 3.8), sharey=True, layout="constrained")
    policies = [name for name in dict.fromkeys(row["policy"] for row in scored) if name in SEEKERS]
    for axes, name, published in zip(panels, CLASSES, PUBLISHED_TIMES, strict=True):
        rows = [row for row in scored if row["difficulty"] == name and not np.isnan(row["relative_time"])]
        for place, policy in enumerate(policies):
            ratios = np.sort([row["relative_time"] for row in rows if row["policy"] == policy])
            # The oracle's with one seed are 1 by definition.
            if len(ratios) and not (policy == "oracle" and (ratios == 1).all()):
                finite = ratios[np.isfinite(ratios)]
                share = np.arange(1, len(finite) + 1) / len(ratios)
                x = [0, *finite, max(LONGEST, finite.max(initial=0))]
                y = [0, *share, *(share[-1:] if len(share) else [0])]
                axes.step(x, y, where="post", color=COLOURS[place % len(COLOURS)], lw=1.6, label=policy)
        least = 0.4 if "shortest" in policies else 0.8
        axes.set(xlim=(least, LONGEST), ylim=(0, 1.02), xlabel="arrival time / oracle's")
        axes.set_title(f"{name}, {len({(row['plan'], row['task']) for row in rows})} tasks", fontsize=10)
        axes.axvline(1, color="0.6", lw=0.8, ls=":")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="0.92", lw=0.8)
        axes.plot(published, [0.5, 0.8], "D", mfc="white", mec="black", ms=5, zorder=4)
    panels[0].set_ylabel("episodes that have arrived")
    panels[0].yaxis.set_major_formatter(PercentFormatter(1))
    panels[-1].legend(loc="lower right", fontsize=8, frameon=False)
    return figure
