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
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import BuildingConfig
from robosim.evaluation.ablations import place_of
from robosim.evaluation.charts import arrival_chart, time_chart
from robosim.evaluation.episodes import read_job_episode, read_job_head, scene
from robosim.evaluation.search_scores import CLASSES, bootstrap, score, steps_of, summarise
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
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results
from wireless.paths import LinkState

#: Arrival rates that were published: easy, moderate, hard.
PUBLISHED_RATES = {"snr": (0.97, 0.88, 0.77), "los": (0.98, 0.96, 0.82), "los-or-first": (1.0, 1.0, 0.94)}
#: Relative arrival times of los-or-first read off the published curves: median and 80 %, for each class.
PUBLISHED_TIMES = ((1.55, 2.0), (2.3, 3.6), (2.2, 3.4))
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
    for name, column in (("median", 0), ("80 %", 1)):
        for place, difficulty in enumerate(CLASSES):
            results.add(name, "published, los-or-first", difficulty, PUBLISHED_TIMES[place][column], digits=2)
    add_ratios(scored, results)
    settings = read_json(evaluation / SETTINGS, "settings of an evaluation")["settings"]["episode"]
    building = from_dict(BuildingConfig, settings["building"], "building")
    robot = from_dict(RobotConfig, settings["simulator"]["robot"], "robot")
    suite = read_suite(evaluation / "suite.yaml")
    for name, metres in progress(evaluation, scored, suite, building, robot.hull_m).items():
        share = 100 * np.mean(np.array(metres) > 0)
        results.add("followed", name, "nearer after 10 decisions", share, "%", digits=0, cases=len(metres))
        results.add("followed", name, "by", np.mean(metres), "m", digits=2, cases=len(metres))
    results.figures = {"search_times": times(scored), "search_arrivals": arrivals(scored)}
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
                    np.log(own / steps[other][key])
                    for key, own in steps[policy].items()
                    if name in ("all", classes[key])
                    and 0 < steps[other].get(key, np.inf) < np.inf
                    and 0 < own < np.inf
                ]
                if ratios:
                    value, low, high = np.exp(bootstrap(np.array(ratios)[:, None], None))
                    results.add(
                        f"steps over {other}",
                        policy,
                        name,
                        value,
                        digits=2,
                        spread=(low, high),
                        cases=len(ratios),
                    )


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


def arrivals(scored: Sequence[dict[str, Any]]) -> Figure:
    """Arrival rates by difficulty; diamonds are the published ones."""
    summaries = [one for one in summarise(scored) if one.policy in SEEKERS]
    figure = arrival_chart(summaries)
    policies = list(dict.fromkeys(one.policy for one in summaries))
    groups = [name for name in CLASSES if any(one.difficulty == name for one in summaries)]
    x, y = [], []
    for policy, rates in PUBLISHED_RATES.items():
        if policy in policies:
            aside = (policies.index(policy) - (len(policies) - 1) / 2) * 0.8 / len(policies)
            x += [groups.index(name) + aside for name in groups]
            y += [rates[CLASSES.index(name)] for name in groups]
    figure.axes[0].plot(x, y, "D", mfc="white", mec="black", ms=5, zorder=4)
    return figure


def times(scored: Sequence[dict[str, Any]]) -> Figure:
    """Distributions of relative arrival times; diamonds are the published medians and 80th percentiles."""
    figure = time_chart([row for row in scored if row["policy"] in SEEKERS])
    for axes, (median, most) in zip(figure.axes, PUBLISHED_TIMES, strict=True):
        axes.plot([median, most], [0.5, 0.8], "D", mfc="white", mec="black", ms=5, zorder=4)
    return figure
