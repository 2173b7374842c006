"""Relative starts of two robots that do not know them, estimated from the radio between them, against the truth.

Both explore with a map of their own, from starts some metres apart with random headings. A pair counts as in sight if
the direct path, at Wi-Fi also through walls, was the strongest at five occasions. A merge is wrong if its error is more
than three times the bar. Pairs whose radio receives nothing, but which exchange all that they know, match their maps.

Also the error of the place of a target after one measurement of one robot, and of two at once, all in line of sight,
from directions that differ by 15 degrees or more, on a map that is known. It is the mean distance over the belief of
`fused`, and the distance of the belief's peak.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import make_building
from robosim.building.reach import Reach, reach
from robosim.entrants import Entrant
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.policies.belief import TargetBelief
from robosim.radio.link import RadioLink
from robosim.radio.measurement import Interpreter
from robosim.task.tasks import Task, make_task
from robosim.team.team_config import TeamConfig, robot_names
from slam.grid import GridFrame, MapEstimate
from tests.benchmarks.harness import DEFAULT, Options, run_units
from tests.benchmarks.results import Results
from wireless.paths import LinkState

#: Largest errors by band [m, degrees]; Wi-Fi measures round-trip times with this deviation [m].
_BARS = {"28ghz": (0.10, 1.0), "wifi-5": (0.5, 3.0), "maps": (0.10, 1.0)}
_RANGE_SIGMA_M = 0.5
#: Power of pairs whose radio receives nothing [dBm].
_SILENT_DBM = -100.0
#: Travel between both starts [m].
_NEAREST_M, _FARTHEST_M = 2.0, 8.0
#: Farthest robots from a target [m], and least angle at which two directions cross.
_AROUND_M, _CROSSING_RAD = 6.0, np.radians(15.0)
#: Measurements in line of sight of a pair that counts as in sight.
_IN_SIGHT = 5


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    bands: tuple[str, ...] = tuple(_BARS),
    pairs: int = 13,
    steps: int = 150,
    steps_of_maps: int = 400,
    places: int = 20,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Errors of estimated relative starts, by band.

    Args:
        plans: Floor plans, by name or file.
        bands: Bands of `wireless.bands`; maps: pairs without radio, which match their maps.
        pairs: Pairs of robots on each plan and band.
        steps: Decisions of a pair.
        steps_of_maps: Decisions of a pair that matches maps.
        places: Targets on each plan.
        options: Of every benchmark.
    """
    units = {
        f"{plan} {band} {pair}": (plan, band, options.seed + pair, steps_of_maps if band == "maps" else steps)
        for plan in plans
        for band in bands
        for pair in range(pairs)
    }
    runs = run_units(run_pair, units, options.folder("team_frame"), workers=options.workers)
    results = Results()
    for band in bands:
        most_m, most_deg = _BARS[band]
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
    geometries = {f"{plan} target": (plan, options.seed, places) for plan in plans}
    crossed = run_units(cross_directions, geometries, options.folder("team_frame"), workers=options.workers)
    every = np.concatenate(list(crossed.values()))
    for name, rows in {
        **{name.removesuffix(" target"): r for name, r in crossed.items()},
        "all": every,
    }.items():
        row = Path(name).name  # with its ending: files may have the names of shipped plans
        results.add("target", row, "geometries", len(rows), digits=0)
        for k, column in enumerate(("belief, one", "belief, two", "peak, one", "peak, two")):
            results.add("target", row, column, float(rows[:, k].mean()), "m", digits=2)
    return options.finish("team_frame", results)


def cross_directions(plan: str, seed: int, count: int) -> Float[np.ndarray, "n 4"]:
    """Errors of a target's place in random geometries [m]: mean over the belief of one robot and of two, peaks."""
    building, config, rng = make_building(read_plan(plan)), EpisodeConfig(), np.random.default_rng(seed)
    places = reach(building, *config.simulator.robot.hull_m)
    link = RadioLink(building, config.simulator.radio)
    interpreter = Interpreter(link, config.link_states)
    centres, free = places.plan.centres(places.roomy), building.plan.free
    frame = GridFrame(
        origin_xy=tuple(building.plan.origin[:2]),
        resolution_m=building.plan.resolution_m,
        shape=building.plan.shape,
    )
    rows: list[list[float]] = []
    while len(rows) < count:
        target = centres[rng.integers(len(centres))]
        link.place(target)
        away_m = np.hypot(*(centres - target).T)
        around = centres[(away_m >= 1.0) & (away_m <= _AROUND_M)]
        if not len(around):
            continue
        ends = around[rng.integers(len(around), size=2)]
        azimuth = np.arctan2(*(target - ends).T[::-1])
        is_crossing = abs(np.sin(azimuth[0] - azimuth[1])) >= np.sin(_CROSSING_RAD)
        if not is_crossing or any(link.trace(end).link_state()[0, 0] != LinkState.LOS for end in ends):
            continue
        belief, errors = TargetBelief(ends[0]), []
        for end in ends:
            pose = np.array([*end, rng.uniform(-np.pi, np.pi)])
            known = MapEstimate(
                frame=frame,
                obstacle_probability=np.where(free, 0.05, 0.95).astype(np.float32),
                explored=free,
                blocked=np.zeros_like(free),
                pose=pose,
            )
            belief.add_received(interpreter.interpret(link.measure(pose, rng), pose), known)
            probability, away = belief.probability(), np.hypot(*np.moveaxis(belief.centres - target, -1, 0))
            errors.append([float((probability * away).sum()), float(away.ravel()[probability.argmax()])])
        rows.append(np.transpose(errors).ravel().tolist())
    return np.array(rows)


def run_pair(plan: str, band: str, seed: int, steps: int) -> dict[str, Any]:
    """Errors of relative starts of two robots that explore, their squares in variances, and lines of sight."""
    building = make_building(read_plan(plan))
    config = EpisodeConfig(
        goal="explore",
        explorer="nearest",
        mapper="classical",
        seed=seed,
        max_steps=steps,
        team=TeamConfig(robots="2", starts="unknown", exchange="perfect" if band == "maps" else "radio"),
    ).in_band("28ghz" if band == "maps" else band)
    radio = config.simulator.radio
    if band == "wifi-5":
        radio = replace(radio, range_sigma_m=_RANGE_SIGMA_M)
    elif band == "maps":
        radio = replace(radio, sounding=replace(radio.sounding, tx_power_dbm=_SILENT_DBM))
    simulator = replace(config.simulator, physics="kinematic", camera="plan", radio=radio)
    config = replace(config, simulator=simulator)
    places = reach(building, *simulator.robot.hull_m)
    tasks = tasks_apart(places, np.random.default_rng(seed))
    entrants = {name: Entrant(task, config, places) for name, task in zip(robot_names(2), tasks, strict=True)}
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
