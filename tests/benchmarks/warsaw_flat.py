"""Raw runs of a robot without encoders and with a slow lidar in a real flat, mapped and compared with its plan.

Commands with their times and nominal speeds are the odometry. The lidar turns twice a second, so that the robot turns
by up to 40 degrees within a scan. The plan is the polygon of the free floor without furniture: its edges are cut into
stretches of half a metre, and the wall of a stretch is the strongest line of beam ends within 0.3 m of it. Furniture
farther inside does not count; furniture that stands nearer counts as an error.
Data: Kolakowski, Sensors 21, 6270, 2021 (CC BY 4.0).
"""

import gzip
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.optimize import least_squares
from tyro.conf import OmitArgPrefixes, Positional

from robosim.logs.beam_times import OdometryTrack
from robosim.logs.log_mapping import LogConfig, LogOdometryConfig, Mapped, make_log_plan, map_log
from robosim.logs.robot_log import RobotLog
from robosim.logs.trajectory_scores import alignment, count_filled_cells, ends_of_beams
from robosim.support.reading import read_bytes, reading
from slam.poses import between, compose, to_map
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results

RUNS = ("calib3", "calib4")
#: Nominal speeds by command: ahead [m/s], turning [rad/s]. The base follows a command so much later [s].
SPEEDS = {
    "forward": (0.28, 0.0),
    "reverse": (-0.28, 0.0),
    "left": (0.0, np.pi / 2 / 1.2),
    "right": (0.0, -np.pi / 2 / 1.1),
    "stop": (0.0, 0.0),
}
_LATENCY_S, _STEP_S = 0.1, 0.02
#: Pose of the lidar on the base [m], and time of its turn [s]: a scan's time is that of its last beam.
_LIDAR, _TURN_S = np.array([0.14, 0.01, 0.0]), 0.515
#: Scans of fewer beams are remains of a turn. Nearer beams end at the robot [m]; farther ones hit nothing.
_LEAST_BEAMS, _NEAREST_M, _FARTHEST_M = 300, 0.2, 12.0
#: Commanded motion errs by a quarter or more.
CONFIG = LogConfig(odometry=LogOdometryConfig(position_per_m=0.3, yaw_per_rad=0.25), range_m=10.0)
#: Stretches of walls, how far their lines are searched for, and how far points of a line lie from it [m].
_STRETCH_M, _NEAR_M, _LINE_M = 0.5, 0.3, 0.05
#: Fewest points of a stretch, and most points that align the map.
_LEAST_POINTS, _ALIGNED = 300, 4000
#: Shades of free, occupied and unknown cells.
_SHADES = np.array([1.0, 0.0, 0.8])


def main(folder: Positional[Path], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Errors of walls and poses in a real flat, with scans corrected for the motion of the robot and without.

    Args:
        folder: The data set: calib3_scan.txt.gz, calib3_motion.txt, the same of calib4, layout.csv, calibration_df.csv.
        options: Of every benchmark.
    """
    results = Results()
    with reading(folder / "layout.csv", "the corners of a flat") as file:
        floor = shapely.Polygon(np.loadtxt(file, delimiter=",", skiprows=1))
    for run in RUNS:
        log = read_run(folder, run)
        reference = read_reference(folder / "calibration_df.csv", log.times)
        for name, each in (("corrected", log), ("as measured", replace(log, beam_s=None))):
            mapped = map_log(each, CONFIG)
            place = _place(mapped, reference, floor)
            _add(results, f"{run}, {name}", mapped, place, reference, floor)
            results.figures[f"{run}-{name.replace(' ', '-')}"] = _draw(mapped, place, reference, floor)
    return options.finish("warsaw_flat", results)


def read_run(folder: Path, run: str) -> RobotLog:
    """A run as a log of the lidar, whose bearings differ from scan to scan; FileError if a file is damaged."""
    path = folder / f"{run}_scan.txt.gz"
    with reading(path, "scans of a lidar", "Give records of time, [angles], [distances]") as file:
        text = gzip.decompress(file.read()).decode("ascii")
        records = [
            (float(time), np.array(angles.split(), float), np.array(far.split(), float))
            for time, angles, far in re.findall(r"([\d.]+)\s*\n\[([^\]]*)\]\s*\n\[([^\]]*)\]", text)
        ]
        records = [record for record in records if len(record[1]) >= _LEAST_BEAMS]
        if len(records) < 2:
            raise ValueError(f"{len(records)} scans of {_LEAST_BEAMS} beams in it, expected two at least")
    times = np.array([time for time, _, _ in records])
    shape = len(records), max(len(angles) for _, angles, _ in records)
    bearing_rad, range_m, late_s = np.full(shape, 2 * np.pi), np.full(shape, np.nan), np.zeros(shape)
    for k, (_, angles, far) in enumerate(records):
        order, n = np.argsort(angles, kind="stable"), len(angles)
        bearing_rad[k, :n], range_m[k, :n] = np.radians(angles[order] / 1e3), far[order] / 100
        late_s[k, :n] = _TURN_S * (bearing_rad[k, :n] / (2 * np.pi) - 1)
    range_m = np.where(range_m < _NEAREST_M, np.nan, np.where(range_m > _FARTHEST_M, np.inf, range_m))
    track = read_commands(folder / f"{run}_motion.txt", times)
    return RobotLog(
        name=run,
        bearing_rad=bearing_rad,
        range_m=range_m,
        displacement=np.array([np.zeros(3), *(between(a, b) for a, b in pairwise(track.at(times)))]),
        known=np.ones(len(times), bool),
        times=times,
        beam_s=late_s,
        track=track,
        file=path,
    )


def read_commands(path: Path, times: Float[np.ndarray, " n"]) -> OdometryTrack:
    """Poses of the lidar by commands from a second before the first time to a second after the last [s]."""
    rows = [line.split(",") for line in read_bytes(path, "commands").decode("ascii").split()]
    begin = np.array([float(row[0]) for row in rows]) + _LATENCY_S
    speeds = np.array([SPEEDS["stop"], *(SPEEDS[row[1]] for row in rows)])
    own = np.arange(times[0] - 1, times[-1] + 1, _STEP_S)
    pose, poses = np.zeros(3), []
    for ahead, turn in speeds[np.searchsorted(begin, own, "right")]:
        poses.append(compose(pose, _LIDAR))
        pose = compose(pose, np.array([ahead, 0.0, turn]) * _STEP_S)
    return OdometryTrack(times=own, poses=np.array(poses))


def read_reference(path: Path, times: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Published poses x, y [m], yaw [rad] at some times [s], moved from the tag to the lidar; NaN where there is none.

    Their heading points backwards.
    """
    with reading(path, "poses of the tag") as file:
        rows = np.genfromtxt(file, delimiter=",", skip_header=1)
    own = rows[:, 1] / 1e9
    x, y, yaw = rows[:, 2], rows[:, 4], np.unwrap(rows[:, 3]) + np.pi
    poses = np.column_stack([np.interp(times, own, part) for part in (x, y, yaw)])
    k = np.clip(np.searchsorted(own, times), 1, len(own) - 1)
    poses[(times < own[k - 1]) | (own[k] - own[k - 1] > 1)] = np.nan
    return np.array([compose(pose, _LIDAR) for pose in poses])


def _place(mapped: Mapped, reference: Float[np.ndarray, "n 3"], floor: shapely.Polygon) -> np.ndarray:
    """Pose of the map in the frame of the plan: near the reference, and fitted to the edges of the floor."""
    known = np.isfinite(reference[:, 0])
    start = alignment(mapped.poses[known], reference[known])
    ends = ends_of_beams(mapped.log, mapped.poses)
    ends = ends[:: len(ends) // _ALIGNED + 1]

    def away(pose: Float[np.ndarray, "3"]) -> Float[np.ndarray, " m"]:
        return np.asarray(shapely.distance(floor.exterior, shapely.points(to_map(pose, ends))))

    for width_m in (0.3, 0.1, 0.05):
        start = least_squares(away, start, loss="cauchy", f_scale=width_m).x
    return np.asarray(start)


def wall_errors(
    points: Float[np.ndarray, "n 2"], corners: Float[np.ndarray, "k 2"]
) -> Float[np.ndarray, " m"]:
    """Distances [m] of the strongest lines of points to stretches of a polygon's edges, those that have lines.

    Corners and points are x, y [m] in the frame of the plan; distances are positive to the left of the edge.
    """
    found = []
    for start, end in pairwise(corners):
        length = float(np.hypot(*(end - start)))
        along = (end - start) / length
        aside = (points - start) @ np.array([-along[1], along[0]])
        stretch = np.floor((points - start) @ along / length * max(round(length / _STRETCH_M), 1))
        for number in range(max(round(length / _STRETCH_M), 1)):
            own = aside[(stretch == number) & (np.abs(aside) < _NEAR_M)]
            if len(own) >= _LEAST_POINTS:
                close = np.abs(own[:, None] - np.linspace(-_NEAR_M, _NEAR_M, 121)) < _LINE_M / 2
                middle = np.linspace(-_NEAR_M, _NEAR_M, 121)[close.sum(axis=0).argmax()]
                found.append(np.median(own[np.abs(own - middle) < _LINE_M]))
    return np.array(found)


def _add(
    results: Results,
    row: str,
    mapped: Mapped,
    place: Float[np.ndarray, "3"],
    reference: Float[np.ndarray, "n 3"],
    floor: shapely.Polygon,
) -> None:
    """Errors of walls, points and poses, and what needs no reference: the number of cells that beams fill."""
    points = to_map(place, ends_of_beams(mapped.log, mapped.poses))
    walls = 100 * np.abs(wall_errors(points, np.array(floor.exterior.coords)))
    away = 100 * np.asarray(shapely.distance(floor.exterior, shapely.points(points[::5])))
    poses = np.array([compose(place, pose) for pose in mapped.poses])
    off = 100 * np.hypot(*(poses - reference)[:, :2].T)
    off = off[np.isfinite(off)]
    for name, value, unit, digits in (
        ("wall, median", np.median(walls), "cm", 1),
        ("wall, 90 %", np.percentile(walls, 90), "cm", 1),
        ("stretches within 10 cm", 100 * np.mean(walls < 10), "%", 0),
        ("stretches", len(walls), "", 0),
        ("all points, median", np.median(away), "cm", 1),
        ("all points, 90 %", np.percentile(away, 90), "cm", 1),
        ("pose, median", np.median(off), "cm", 1),
        ("pose, 90 %", np.percentile(off, 90), "cm", 1),
        ("cells", count_filled_cells(mapped.log, mapped.poses), "", 0),
        ("loops", mapped.loops, "", 0),
        ("time", mapped.seconds, "s", 1),
    ):
        results.add("flat", row, name, float(value), unit, digits=digits)


def _draw(
    mapped: Mapped, place: Float[np.ndarray, "3"], reference: Float[np.ndarray, "n 3"], floor: shapely.Polygon
) -> Figure:
    """The map with the plan, the trajectory and the published poses over it."""
    poses = np.array([compose(place, pose) for pose in mapped.poses])
    plan = make_log_plan(mapped.log, poses, CONFIG.resolution_m, CONFIG.range_m)
    ny, nx = plan.occupancy.shape
    x, y = plan.origin[:2]
    extent = (x, x + nx * plan.resolution_m, y, y + ny * plan.resolution_m)
    figure = Figure(figsize=(9, 8), layout="compressed")
    axes = figure.subplots()
    axes.imshow(_SHADES[plan.occupancy], origin="lower", extent=extent, cmap="gray", vmin=0, vmax=1)
    for line, colour, name in (
        (np.array(floor.exterior.coords), "tab:red", "free floor of the plan"),
        (poses, "tab:blue", "lidar"),
        (reference, "tab:green", "published poses"),
    ):
        axes.plot(line[:, 0], line[:, 1], color=colour, lw=1, label=name)
    axes.set(xlabel="x [m]", ylabel="y [m]", xlim=(-1, 10), ylim=(-1, 8), aspect="equal")
    axes.legend(loc="lower right")
    return figure
