"""Trajectory and map of a log, by the tracker and graph that simulated robots use."""

import logging
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from time import process_time
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robosim.logs.beam_times import OdometryTrack
from robosim.logs.robot_log import RobotLog
from robosim.plans.floorplan import FREE, MAX_CELLS, OCCUPIED, UNKNOWN, FloorPlan
from robosim.support.checks import Range, checked
from robosim.support.reading import FileError
from slam.graph.submaps import View
from slam.graph.tracker import Tracker
from slam.graph.tracker_config import TrackerConfig
from slam.matching.line_odometry import line_odometry, points_of_walls, refine_poses
from slam.matching.lines import Ends
from slam.matching.scan_matching import MatchConfig, ScanPoints, points_of_beams
from slam.matching.thin_scans import is_thin, thin_scan
from slam.poses import Pose, Poses, between, compose, to_map

logger = logging.getLogger(__name__)

#: A beam that hit nothing is free as far as this [m].
_NOTHING_M = 10.0
#: Largest angle between beams for which drift is given [rad].
_DENSE_RAD = math.radians(2.0)
#: With more between beams, displacements come from lines of many scans, and maps are doubtful [rad].
_SPARSE_RAD = math.radians(4.0)
#: Least time between scans for errors of odometry, and that of the whole constant part [s].
_LEAST_S, _WHOLE_S = 0.05, 0.6
#: Trajectories that correct scans without odometry, each made of the scans that the one before corrects.
_PASSES = 2


@dataclass(frozen=True, kw_only=True)
@checked
class LogOdometryConfig:
    """Errors of odometry between two scans. Standard deviations: a constant part, and one that grows.

    The constant part is that of 0.6 s or more, and less where scans follow each other faster.
    """

    position_m: Annotated[float, Range(1e-6, 10, "m")] = 0.04
    """Standard deviation of the place, constant part [m]."""
    position_per_m: Annotated[float, Range(0, 10)] = 0.05
    """Standard deviation of the place, for each metre driven."""
    yaw_rad: Annotated[float, Range(1e-6, math.pi, "rad")] = 0.05
    """Standard deviation of the heading, constant part [rad]."""
    yaw_per_rad: Annotated[float, Range(0, 10)] = 0.15
    """Standard deviation of the heading, for each radian turned."""
    unknown_m: Annotated[tuple[float, float], Range(1e-3, 100, "m")] = (1.0, 0.2)
    """Without odometry: of the place ahead, and to the side [m]."""
    unknown_rad: Annotated[float, Range(1e-3, 2 * math.pi, "rad")] = 0.45
    """The same for the turn [rad]."""

    def predicted(
        self, displacement: Pose | None, time_s: float, last: Pose
    ) -> tuple[Pose, Float[np.ndarray, "3 3"]]:
        """Displacement over a time and its covariance.

        If it is not known, it is one standard deviation ahead; where scans follow each other fast, the last one again,
        and its standard deviation is less.
        """
        fraction = min(max(time_s, _LEAST_S) / _WHOLE_S, 1.0)
        if displacement is None:
            deviation = fraction * np.array([*self.unknown_m, self.unknown_rad])
            ahead = np.array([self.unknown_m[0], 0.0, 0.0])
            return last if fraction < 1 else ahead, np.diag(deviation**2)
        place_m = fraction * self.position_m + self.position_per_m * math.hypot(
            displacement[0], displacement[1]
        )
        turn_rad = fraction * self.yaw_rad + self.yaw_per_rad * abs(displacement[2])
        return displacement, np.diag([place_m**2, place_m**2, turn_rad**2])


#: Random part of the errors of odometry between scans of few beams, whose systematic part is estimated: x, y, yaw.
_WITHOUT_BIAS = np.array([1.0, 1.0, 0.5])
#: Errors of displacements by lines of scans of few beams.
_LINE_ODOMETRY = LogOdometryConfig(position_m=0.02, position_per_m=0.02, yaw_rad=0.02, yaw_per_rad=0.04)
#: Settings of the tracker for such scans. Submaps bend with the displacements: fits of them deviate from references by
#: 0.05 m to 0.12 m and 0.5 to 1.5 degrees (medians of four logs with 30 and with 11 beams).
_SUBMAP_ERROR, _TOGETHER_M, _TOGETHER_RAD = 1.5, 0.1, math.radians(2.0)


@dataclass(frozen=True, kw_only=True)
@checked
class LogConfig:
    """Settings of mapping a log."""

    odometry: LogOdometryConfig = field(default_factory=LogOdometryConfig)
    """Errors of odometry."""
    resolution_m: Annotated[float, Range(0.005, 0.5, "m")] = 0.05
    """Side of a map cell [m]."""
    range_m: Annotated[float, Range(1, 1000, "m")] = 25.0
    """Farther points are not matched [m]."""
    sigma_m: Annotated[float, Range(1e-4, 1, "m")] = 0.02
    """Standard deviation of a point from its surface [m]."""
    drift_m: Annotated[float, Range(0, 10, "m")] = 0.02
    """Drift of matched poses, in addition to the errors of matches, per square root of a metre driven [m]: a real
    robot's scans lie a metre apart, and are taken as it moves. It grows with the angle between beams above 2
    degrees."""
    drift_rad: Annotated[float, Range(0, math.pi, "rad")] = math.radians(0.3)
    """The same for their turn [rad]."""

    def tracker(self, loops: bool, step_rad: float) -> TrackerConfig:
        """Settings of the tracker for scans of beams so far apart [rad]."""
        growth = max(step_rad / _DENSE_RAD, 1.0)
        match = MatchConfig(
            max_range_m=self.range_m, sigma_m=self.sigma_m, outlier_m=3 * self.sigma_m, iterations=12
        )
        tracker = TrackerConfig(
            cell_m=self.resolution_m,
            loops=loops,
            match=match,
            drift_m=growth * self.drift_m,
            drift_rad=growth * self.drift_rad,
        )
        if step_rad <= _SPARSE_RAD:
            return tracker
        return replace(
            tracker, submap_error=_SUBMAP_ERROR, together_m=_TOGETHER_M, together_rad=_TOGETHER_RAD
        )


#: A log, and poses of its robot or laser at each scan: x [m], y [m], yaw [rad].
Run = tuple[RobotLog, Float[np.ndarray, "_ 3"]]
#: Ends of beams, and displacements of odometry with standard deviations.
_Lines = tuple[Ends, tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Mapped:
    """Trajectory of a log."""

    log: RobotLog
    """The log, with scans corrected for the motion between their beams."""
    poses: Float[np.ndarray, "n 3"]
    """Pose of the robot at each scan: x [m], y [m], yaw [rad]; the first is (0, 0, 0)."""
    loops: int
    """Number of closed loops."""
    seconds: float
    """Processor time [s]."""
    tracker: Tracker
    """Submaps and their graph, by which maps can be joined; poses are those of the laser, from (0, 0, 0)."""
    lines: _Lines | None
    """Ends of beams and odometry, by which poses of scans of few beams are adjusted to lines; None for other scans."""

    def robot_poses(self, laser_poses: Poses, origin: Pose) -> Poses:
        """Poses of the robot, of those of the laser in a frame at a pose (`origin`): x, y [m], yaw [rad]."""
        if self.lines is not None:
            laser_poses = refine_poses(laser_poses, *self.lines)
        back = between(self.log.mount, np.zeros(3))
        return np.array([compose(compose(origin, pose), back) for pose in laser_poses])


def check_reach(log: RobotLog, range_m: float) -> None:
    """Raise FileError if no beam hits anything within a range [m], or odometry jumps farther than scans overlap."""
    if not (log.range_m < range_m).any():
        raise FileError(
            f"{log.file or log.name}: none of its beams hits anything within --range-m, {range_m:g} m. Are "
            "its ranges in metres?"
        )
    step_m = np.hypot(log.displacement[:, 0], log.displacement[:, 1])
    if step_m.max() > 2 * range_m:
        raise FileError(
            f"{log.file or log.name}: odometry goes {step_m.max():.0f} m up to scan {step_m.argmax() + 1}, where scans "
            f"of {range_m:g} m have nothing in common. Are its poses in metres? If so, give a larger --range-m."
        )


def map_log(
    log: RobotLog,
    config: LogConfig = LogConfig(),
    *,
    loops: bool = True,
    watched: Callable[[range, str], Iterable[int]] = lambda numbers, _: numbers,
) -> Mapped:
    """Estimate the pose of each scan; without `loops` each is matched to those before, without a graph.

    `watched` is a progress display: it iterates over numbers, given them and their name.

    Raises:
        FileError: If no beam hits anything, or odometry jumps farther than scans overlap.
        ValueError: If poses make a map of too many cells.
    """
    begin, robot, log = process_time(), log, log.seen_from(log.mount)
    check_reach(log, config.range_m)
    log = _corrected(log, config, watched)
    _map_grid([(log, log.odometry())], config.resolution_m, config.range_m)
    is_sparse, step_deg = log.step_rad() > _SPARSE_RAD, math.degrees(log.step_rad())
    if is_sparse:
        logger.warning(
            f"{log.file or log.name}: beams are {step_deg:.0f} degrees apart. Maps of scans with more than "
            f"{math.degrees(_SPARSE_RAD):g} between beams often come apart: look at map.png before you use them."
        )
    thin, lines = is_thin(log.beams()[0]), None
    if is_sparse and log.known[1:].all():
        log, lines = _with_line_odometry(log, config, lambda numbers: watched(numbers, "lines"))
        config = replace(config, odometry=_LINE_ODOMETRY)
    tracker, bearings = Tracker(config.tracker(loops, log.step_rad())), log.beams()
    step_s = np.diff(log.times, prepend=log.times[0])
    last = np.zeros(3)
    for k in watched(range(len(log.range_m)), "scans"):
        scan, view = scan_points(bearings[k], log.range_m[k], config, thin)
        displacement, covariance = config.odometry.predicted(
            log.displacement[k] if log.known[k] else None, float(step_s[k]), last
        )
        if k == 0:
            displacement, covariance = np.zeros(3), 1e-8 * np.eye(3)
        before = tracker.pose
        if not tracker.update(scan, view, displacement, covariance):
            last = between(before, tracker.pose)
    tracker.finish(lambda numbers: watched(numbers, "loops"))
    log = replace(log, mount=robot.mount, displacement=robot.displacement, track=robot.track)
    mapped = Mapped(
        log=log,
        poses=tracker.poses(),
        loops=tracker.closed,
        seconds=process_time() - begin,
        tracker=tracker,
        lines=lines if loops else None,
    )
    poses = mapped.robot_poses(mapped.poses, robot.mount)
    return replace(mapped, poses=poses, seconds=process_time() - begin)


def _corrected(log: RobotLog, config: LogConfig, watched: Callable[[range, str], Iterable[int]]) -> RobotLog:
    """The log with scans as from one pose each; without odometry the motion is that of a first trajectory."""
    track = None
    for _ in range(_PASSES if log.moving().any() else 0):
        poses = map_log(log.corrected(track), config, loops=False, watched=watched).poses
        track = OdometryTrack(times=log.times, poses=poses)
    return log.corrected(track)


def scan_points(
    bearing_rad: Float[np.ndarray, " w"], range_m: Float[np.ndarray, " w"], config: LogConfig, thin: bool
) -> tuple[ScanPoints, View]:
    """Points of a scan, and how far it saw."""
    if thin:
        scan = thin_scan(bearing_rad, range_m, config.range_m, config.sigma_m)
    else:
        scan = points_of_beams(bearing_rad, range_m, config.range_m, config.resolution_m, config.sigma_m)
    return scan, _view(bearing_rad, range_m, config.range_m)


def _view(bearing_rad: Float[np.ndarray, " w"], range_m: Float[np.ndarray, " w"], farthest_m: float) -> View:
    """Range that each beam saw: zero where nothing was measured."""
    seen = np.where(range_m < farthest_m, range_m, -_NOTHING_M)
    return View(bearing_rad=bearing_rad, range_m=np.where(np.isnan(range_m), 0.0, seen))


def _with_line_odometry(
    log: RobotLog, config: LogConfig, watched: Callable[[range], Iterable[int]]
) -> tuple[RobotLog, _Lines]:
    """The log with displacements by lines; ends of beams, and displacements of odometry with standard deviations."""
    ends = Ends.of(log.beams(), log.range_m, config.range_m)
    step_s = np.diff(log.times, prepend=log.times[0])
    covariances = [
        config.odometry.predicted(step, float(time_s), np.zeros(3))[1]
        for step, time_s in zip(log.displacement, step_s, strict=True)
    ]
    deviation = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)) * _WITHOUT_BIAS
    poses, motion = line_odometry(ends, log.displacement, deviation, watched)
    steps = [between(pose, next_one) for pose, next_one in pairwise(poses)]
    return replace(log, displacement=np.array([np.zeros(3), *steps])), (ends, motion)


def _map_grid(
    runs: Sequence[Run], resolution_m: float, range_m: float
) -> tuple[Float[np.ndarray, "2"], tuple[int, int]]:
    """Lower left corner [m], columns and rows of a map of beams within the range [m]; poses are the laser's."""
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for log, poses in runs:
        low, high = np.minimum(low, poses[:, :2].min(axis=0)), np.maximum(high, poses[:, :2].max(axis=0))
        for _, ends, _ in _beams(log, poses, range_m):
            low, high = np.minimum(low, ends.min(axis=0)), np.maximum(high, ends.max(axis=0))
    low, high = low - 0.5, high + 0.5
    nx, ny = np.ceil((high - low) / resolution_m)
    if nx * ny > MAX_CELLS:
        names = ", ".join(str(log.file or log.name) for log, _ in runs)
        raise ValueError(
            f"{names}: its map is {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m, which is "
            f"{nx:.0f} x {ny:.0f} cells of {resolution_m:g} m, more than {MAX_CELLS}. Are its poses in metres? If so, "
            "give a larger --resolution-m."
        )
    return low, (int(nx), int(ny))


def _beams(
    log: RobotLog, poses: Poses, range_m: float
) -> Iterator[tuple[Pose, Float[np.ndarray, "w 2"], Bool[np.ndarray, " w"]]]:
    """Pose of each scan, ends of its beams in `map` [m], and which hit something; the others end at the laser."""
    for pose, bearing, ranges in zip(poses, log.beams(), log.range_m, strict=True):
        directions = np.column_stack([np.cos(bearing), np.sin(bearing)])
        hit = ranges < range_m
        yield pose, to_map(pose, np.where(hit, ranges, 0.0)[:, None] * directions), hit


def make_log_plan(log: RobotLog, poses: Poses, resolution_m: float, range_m: float) -> FloorPlan:
    """The map of scans at poses of the robot, see `make_plan`."""
    return make_plan([(log, poses)], log.name, resolution_m, range_m)


def make_plan(runs: Sequence[Run], name: str, resolution_m: float, range_m: float) -> FloorPlan:
    """The map of the scans of several logs at poses of their robots in one frame.

    A cell is occupied if beams ended in more than a quarter of those that reached it.

    Scans of few beams end at few cells of a wall: there the lines of several scans are occupied, where not more than
    three times as many beams went through.
    """
    runs = [(log, log.laser_poses(poses)) for log, poses in runs]
    low, (nx, ny) = _map_grid(runs, resolution_m, range_m)
    passed, hit, reached = (np.zeros((ny, nx), np.uint16) for _ in range(3))
    for log, poses in runs:
        thin = is_thin(log.beams()[0])
        for pose, places, is_hit in _beams(log, poses, range_m):
            # A beam that hit nothing spans no area: the outline passes by the laser there.
            laser = ((pose[:2] - low) / resolution_m).astype(np.int32)
            outline = ((places - low) / resolution_m).astype(np.int32)
            x0, y0 = np.minimum(outline.min(axis=0), laser)
            x1, y1 = np.maximum(outline.max(axis=0), laser) + 1
            seen = np.zeros((y1 - y0, x1 - x0), np.uint8)
            cv2.fillPoly(seen, [outline - [x0, y0]], 1)
            cells = outline[is_hit] - [x0, y0]
            window = (slice(y0, y1), slice(x0, x1))
            beams = seen
            if thin:
                beams = np.zeros_like(seen)
                cv2.polylines(beams, [np.array([laser - [x0, y0], end]) for end in cells], False, 1)
            ended = np.zeros_like(seen)
            ended[cells[:, 1], cells[:, 0]] = 1
            passed[window] += seen | beams | ended
            reached[window] += beams | ended
            hit[window] += ended
        if thin:
            ends = Ends.of(log.beams(), log.range_m, range_m)
            walls = ((points_of_walls(poses, ends, resolution_m) - low) / resolution_m).astype(int)
            for counts in (hit, reached):
                np.add.at(counts, (walls[:, 1], walls[:, 0]), 1)
            passed = np.maximum(passed, hit)
    cells = np.full((ny, nx), UNKNOWN, np.uint8)
    cells[passed > 0] = FREE
    cells[hit > 0.25 * reached] = OCCUPIED
    cells[passed == 0] = UNKNOWN
    return FloorPlan(
        occupancy=cells, resolution_m=resolution_m, origin=(float(low[0]), float(low[1]), 0.0), name=name
    )
