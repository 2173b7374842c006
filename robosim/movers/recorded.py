"""Movers that follow a recording: a crowd of a public pedestrian data set, or another robot's trajectory.

They do not react to the robot. A body is there from its first to its last time; in between its pose is linear.
"""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from jaxtyping import Float
from pyarrow import csv

from robosim.movers.mover import Body, Surroundings
from robosim.support.checks import FARTHEST
from robosim.support.reading import FileError, reading, shown
from robosim.support.tum import read_tum
from wireless.support.columns import numbers, parquet_table, values

logger = logging.getLogger(__name__)
#: Most bodies of a recording, and time after which its first one is late [s].
_MOST, _LATE_S = 1000, 60.0
#: No body in a building is faster [m/s].
_FASTEST_MPS = 30.0
#: Another robot [m].
_ROBOT = Body(radius_m=0.2, height_m=0.5, look="cylinder")


class Track(NamedTuple):
    """Poses of one body over time."""

    time_s: Float[np.ndarray, " n"]
    """Rising."""
    poses: Float[np.ndarray, "n 3"]
    """x [m], y [m], yaw [rad], which is not wrapped."""


class Recorded:
    """Bodies that follow recorded tracks."""

    def __init__(self, tracks: Sequence[Track], body: Body, name: str = "recording") -> None:
        for times, poses in tracks:
            speed_mps = np.hypot(*np.diff(poses[:, :2], axis=0).T) / np.diff(times)
            if (speed_mps > _FASTEST_MPS).any():
                k = int(speed_mps.argmax())
                fastest = f"{speed_mps[k]:.4g} m/s at {times[k]:g} s, expected {_FASTEST_MPS:g} m/s at most"
                raise FileError(f"{name}: a body moves at {fastest}. Give seconds and metres.")
        self.bodies: Sequence[Body] = (body,) * len(tracks)
        self._tracks, self._name = tracks, name

    def resized(self, body: Body) -> "Recorded":
        """Return the tracks with bodies of another size."""
        return Recorded(self._tracks, body, self._name)

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """Time 0 of the recording is that of the episode; ValueError if all of it is outside of the building."""
        low, high = np.reshape(surroundings.building.free.bounds, (2, 2))
        places = np.vstack([track.poses[:, :2] for track in self._tracks])
        if not ((places >= low) & (places <= high)).all(axis=1).any():
            first, last = places.min(axis=0).round(2), places.max(axis=0).round(2)
            raise ValueError(
                f"{self._name}: its places are from {first} to {last} m, outside of the building from {low.round(2)} "
                f"to {high.round(2)} m. Give them in the plan's frame."
            )

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses at a time; see `robosim.movers.mover.Mover`."""
        return np.array(
            [
                [np.interp(time_s, times, column, left=np.nan, right=np.nan) for column in poses.T]
                for times, poses in self._tracks
            ]
        )


def read_trajectory(path: Path) -> Recorded:
    """Another robot on a trajectory (.tum), from its first time on; FileError if the file is damaged."""
    times, poses = read_tum(path)
    poses[:, 2] = np.unwrap(poses[:, 2])
    return Recorded([Track(times - times[0], poses)], _ROBOT, shown(path))


def read_crowd(path: Path) -> Recorded:
    """A crowd from a .csv or .parquet file.

    It has a row for each person and time: time [s], id, x [m], y [m] in the plan's frame, and, if it is known,
    heading [rad]; else people face where they walk.

    Raises:
        FileError: If the file is damaged, a column is missing, times of a body are equal, or there are more than 1,000
            bodies.
    """
    remedy = "Give columns time [s], id, x [m], y [m] and, if known, heading [rad]"
    with reading(path, "a recorded crowd", remedy) as file:
        table = csv.read_csv(file) if path.suffix == ".csv" else parquet_table(file)
        columns = {
            name: numbers(table, name, pa.float64(), -FARTHEST, FARTHEST) for name in ("time", "x", "y")
        }
        names = values(table, "id", pa.string())
        heading = (
            numbers(table, "heading", pa.float64(), -100, 100) if "heading" in table.column_names else None
        )
        bodies, body = np.unique(names, return_inverse=True)
        if not 0 < len(bodies) <= _MOST:
            raise ValueError(f"it has {len(bodies)} different ids, expected 1 to {_MOST}")
        tracks = []
        for k, name in enumerate(bodies):
            samples = np.flatnonzero(body == k)
            samples = samples[np.argsort(columns["time"][samples], kind="stable")]
            times, xy = (
                columns["time"][samples],
                np.column_stack([columns["x"][samples], columns["y"][samples]]),
            )
            if (np.diff(times) <= 0).any():
                again = times[1:][np.diff(times) <= 0][0]
                raise ValueError(f"id {name} has two rows at time {again:g}")
            yaw = _facing(xy) if heading is None else np.unwrap(heading[samples])
            tracks.append(Track(times, np.column_stack([xy, yaw])))
    first, last = columns["time"].min(), columns["time"].max()
    if first > _LATE_S or last < 0:
        logger.warning(
            "%s: its people are there from %g to %g s, but episodes begin at 0 s. Subtract the first time.",
            shown(path),
            first,
            last,
        )
    return Recorded(tracks, Body(), shown(path))


def _facing(xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """Directions of the steps that follow [rad]; of the steps before where a person stands."""
    if len(xy) == 1:
        return np.zeros(1)
    steps = np.diff(xy, axis=0)
    steps = steps[np.maximum.accumulate(np.where(steps.any(axis=1), np.arange(len(steps)), 0))]
    return np.unwrap(np.arctan2(*steps[:, ::-1].T))[[*range(len(steps)), -1]]
