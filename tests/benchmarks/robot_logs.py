"""Logs of real robots, mapped with all beams and with few, and made logs at full rate of growing length."""

import resource
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.logs.log_files import read_log
from robosim.logs.log_mapping import LogConfig, LogOdometryConfig, make_log_plan, map_log
from robosim.logs.robot_log import RobotLog
from robosim.logs.trajectory_scores import align_trajectory, compare_trajectories, count_filled_cells
from robosim.plans.floorplan import FREE, OCCUPIED
from tests.benchmarks.drone_logs import RANGE_M, read_drone_log
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.made_logs import make_log
from tests.benchmarks.results import Results
from tests.benchmarks.trial_floors import TRIAL_FLOORS

#: Names of the public logs on the page.
TITLES = {
    "belgioioso": "Belgioioso castle",
    "csail": "MIT CSAIL",
    "fhw": "FHW museum",
    "freiburg-101": "Freiburg, building 101",
    "infinite-corridor": "MIT, infinite corridor",
    "intel": "Intel Research Lab",
    "orebro": "Örebro University",
}


def main(
    logs: Positional[tuple[Path, ...]] = (),
    *,
    beams: tuple[int, ...] = (60, 30, 11),
    made: tuple[int, ...] = (1000, 4000, 16000),
    drone: Path | None = None,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Errors of trajectories against references with all beams and with few, and processor time over scans.

    Args:
        logs: CARMEN logs with reference poses.
        beams: Numbers of beams, in equal steps of those of a log.
        drone: ROS 1 bag of a drone with four rangers; its map is written as a picture.
        made: Numbers of scans of logs that are made on a floor of 1,200 m2, ten scans a second.
        options: Of every benchmark.
    """
    results = Results()
    for path in logs:
        log = read_log(path)
        title = TITLES.get(log.name.removesuffix("-corrected"), log.name)
        _compare(results, title, log)
        for count in beams:
            found = map_log(_thinned(log, count))
            assert log.reference is not None
            error = compare_trajectories(found.poses, log.reference)
            results.add("few beams", title, f"{count} beams", error["rpe_m"], "m", digits=3)
            results.add("few beams", title, f"{count} beams, heading", error["rpe_deg"], "°", digits=2)
    if drone is not None:
        _map_drone(results, drone, Path("runs") / "drone.png")
    for scans in made:
        log = make_log(TRIAL_FLOORS["large-1"](), scans, options.seed)
        assert log.reference is not None
        found = map_log(log)
        off = align_trajectory(found.poses, log.reference) - log.reference
        row = f"{scans} scans"
        results.add(
            "full rate",
            row,
            "ATE",
            1e3 * float(np.sqrt((off[:, :2] ** 2).sum(axis=1).mean())),
            "mm",
            digits=1,
        )
        results.add("full rate", row, "loops", found.loops, digits=0)
        results.add("full rate", row, "time", found.seconds, "s", digits=1)
        results.add("full rate", row, "scans per second", scans / found.seconds, digits=0)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        results.add("full rate", row, "memory", peak, "GB", digits=2)
    return options.finish("robot_logs", results)


def _compare(results: Results, title: str, log: RobotLog) -> None:
    """Odometry, matching alone, and the graph."""
    reference = log.reference
    if reference is None:
        raise ValueError(
            f"{log.file} has no reference poses. Give a log that a mapping program has corrected."
        )
    driven = np.hypot(*np.diff(reference[:, :2], axis=0).T).sum()
    matched, graph = map_log(log, LogConfig(), loops=False), map_log(log)
    error = compare_trajectories(graph.poses, reference)
    for name, value, unit, digits in (
        ("scans", len(log.range_m), "", 0),
        ("driven", driven, "m", 0),
        ("odometry", compare_trajectories(log.odometry(), reference)["rpe_m"], "m", 2),
        ("matching alone", compare_trajectories(matched.poses, reference)["rpe_m"], "m", 2),
        ("graph", error["rpe_m"], "m", 3),
        ("graph, heading", error["rpe_deg"], "°", 2),
        ("graph, ATE", error["ate_m"], "m", 2),
        ("cells", count_filled_cells(log, graph.poses), "", 0),
        ("cells of the reference", count_filled_cells(log, reference), "", 0),
        ("loops", graph.loops, "", 0),
        ("time", graph.seconds, "s", 1),
    ):
        results.add("logs", title, name, value, unit, digits=digits)


def _map_drone(results: Results, bag: Path, picture: Path) -> None:
    """Cells of 5 cm that the rangers fill by the drone's own estimate and by the map; there is no reference."""
    log = read_drone_log(bag)
    odometry = LogOdometryConfig(position_m=0.01, position_per_m=0.03, yaw_rad=0.01, yaw_per_rad=0.05)
    found = map_log(log, LogConfig(range_m=RANGE_M, odometry=odometry))
    plan = make_log_plan(log, found.poses, 0.05, RANGE_M)
    grey = np.full(plan.occupancy.shape, 205, np.uint8)
    grey[plan.occupancy == FREE], grey[plan.occupancy == OCCUPIED] = 255, 0
    picture.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(picture), np.flipud(grey))
    for name, poses in (("odometry", log.odometry()), ("graph", found.poses)):
        results.add("drone", log.name, f"cells, {name}", count_filled_cells(log, poses), "", digits=0)
    results.add("drone", log.name, "loops", found.loops, "", digits=0)
    results.add("drone", log.name, "time", found.seconds, "s", digits=1)


def _thinned(log: RobotLog, beams: int) -> RobotLog:
    """The log with some beams of each scan, in equal steps from the first to the last."""
    some = np.round(np.linspace(0, len(log.bearing_rad) - 1, beams)).astype(int)
    return replace(log, bearing_rad=log.bearing_rad[some], range_m=log.range_m[:, some])
