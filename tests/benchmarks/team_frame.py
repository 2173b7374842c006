"""Relative starts of two robots that do not know them, estimated from the radio between them, against the truth.

Both explore with a map of their own, from starts some metres apart with random headings. A pair counts as in sight if
the direct path was free at five measurements. A merge is wrong if its error is more than three times the bar.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import make_building
from robosim.building.reach import Reach, reach
from robosim.entrants import Entrant
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.radio.link import RadioLink
from robosim.task.tasks import Task, make_task
from robosim.team.team_config import TeamConfig, robot_names
from tests.benchmarks.harness import DEFAULT, Options, run_units
from tests.benchmarks.results import Results
from wireless.paths import LinkState

#: Largest errors by band [m, degrees]; Wi-Fi measures round-trip times with this deviation [m].
_BARS = {"28ghz": (0.10, 1.0), "wifi-5": (0.5, 3.0)}
_RANGE_SIGMA_M = 0.5
#: Travel between both starts [m].
_NEAREST_M, _FARTHEST_M = 2.0, 8.0
#: Measurements in line of sight of a pair that counts as in sight.
_IN_SIGHT = 5


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    pairs: int = 13,
    steps: int = 150,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Errors of estimated relative starts, by band.

    Args:
        plans: Floor plans, by name or file.
        pairs: Pairs of robots on each plan and band.
        steps: Decisions of a pair.
        options: Of every benchmark.
    """
    units = {
        f"{plan} {band} {pair}": (plan, band, options.seed + pair, steps)
        for plan in plans
        for band in _BARS
        for pair in range(pairs)
    }
    runs = run_units(run_pair, units, options.folder("team_frame"), workers=options.workers)
    results = Results()
    for band, (most_m, most_deg) in _BARS.items():
        mine = [run for name, run in runs.items() if units[name][1] == band]
        seen = [run for run in mine if run["in_sight"] >= _IN_SIGHT]
        known = [run for run in mine if run["errors"]]
        errors = np.array([error for run in known for error in run["errors"]]).reshape(-1, 4)
        distance_m, turn_deg = np.hypot(*errors[:, :2].T), np.degrees(np.abs(errors[:, 2]))
        wrong = (distance_m > 3 * most_m) | (turn_deg > 3 * most_deg)
        add = results.add
        add("frame", band, "pairs", len(mine), digits=0)
        add("frame", band, "in sight", len(seen), digits=0)
        add("frame", band, "of them known", sum(bool(run["errors"]) for run in seen), digits=0)
        add("frame", band, "known", len(known), digits=0)
        add("frame", band, "wrong", int(wrong.sum()), digits=0)
        if len(errors):
            for part in (50, 95):
                add("frame", band, f"error, {part} %", float(np.percentile(distance_m, part)), "m", digits=3)
                add("frame", band, f"turn, {part} %", float(np.percentile(turn_deg, part)), "°", digits=2)
            within = (distance_m <= most_m) & (turn_deg <= most_deg)
            add("frame", band, "within the bar", 100 * float(within.mean()), "%", digits=0)
            add("frame", band, "squared error", float(errors[:, 3].mean() / 3), "variances", digits=2)
    return options.finish("team_frame", results)


def run_pair(plan: str, band: str, seed: int, steps: int) -> dict[str, Any]:
    """Let two robots explore; errors of relative starts with their squares in variances, and lines of sight."""
    building = make_building(read_plan(plan))
    config = EpisodeConfig(
        goal="explore",
        explorer="nearest",
        mapper="classical",
        seed=seed,
        max_steps=steps,
        team=TeamConfig(robots="2", starts="unknown"),
    ).in_band(band)
    radio = config.simulator.radio
    radio = radio if band == "28ghz" else replace(radio, range_sigma_m=_RANGE_SIGMA_M)
    simulator = replace(config.simulator, physics="kinematic", camera="plan", radio=radio)
    config = replace(config, simulator=simulator)
    places = reach(building, *simulator.robot.hull_m)
    tasks = tasks_apart(places, np.random.default_rng(seed))
    entrants = {
        name: Entrant(task, config, places) for name, task in zip(robot_names(2), tasks, strict=True)
    }
    team = run_team(building, entrants)
    covariances = [known.covariance for frames in team.frames.values() for known in frames.values()]
    link, in_sight = RadioLink(building, replace(radio, engine="live")), 0
    logs = [np.array(log.poses) for log in team.robots.values()]
    for first, second in zip(*(poses[:: config.team.every, :2] for poses in logs), strict=False):
        link.place(first)
        in_sight += link.trace(second).link_state()[0, 0] == LinkState.LOS
    return {
        "in_sight": int(in_sight),
        "errors": [
            (*error.tolist(), float(error @ np.linalg.solve(covariance, error)))
            for error, covariance in zip(team.frame_errors(), covariances, strict=True)
        ],
    }


def tasks_apart(places: Reach, rng: np.random.Generator) -> list[Task]:
    """Tasks of two robots whose starts are some metres apart, with random headings."""
    task = make_task(places, rng)
    travel_m = places.travel_m(task.start[:2])
    is_free = (travel_m >= _NEAREST_M) & (travel_m <= _FARTHEST_M) & places.roomy
    starts = places.plan.centres(is_free)
    other = starts[rng.integers(len(starts))]
    headings = rng.uniform(-np.pi, np.pi, 2)
    return [
        replace(task, start=np.array([*xy, yaw]))
        for xy, yaw in zip((task.start[:2], other), headings, strict=True)
    ]
