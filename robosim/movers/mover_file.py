"""Movers of a building as a YAML file: doors that open and close, recorded crowds, trolleys and robots on trajectories.

    - door: [3.0, 2.0]          # x, y of the hinge [m], in the frame of the plan
      width_m: 0.9
      closed_deg: 90            # direction of the leaf from the hinge when it is closed, counter-clockwise from +x
      open_deg: 0
      open_s: [[5, 15], [30, 60]]    # intervals in which it is open
    - crowd: people.csv         # time [s], id, x [m], y [m] and, if known, heading [rad]; relative to this file
    - trajectory: trolley.tum
      radius_m: 0.3
      height_m: 1.0

A door swings in two seconds, and stops while a robot is in its path. Its leaf is a row of posts; left out are its
thickness and what it is made of: the radio meets the posts as it meets people.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float

from robosim.movers.mover import Body, Group, Mover, Surroundings
from robosim.movers.recorded import Recorded, read_crowd, read_trajectory
from robosim.support.checks import FARTHEST, Range, checked
from robosim.support.from_dict import from_dict
from robosim.support.reading import reading, shown
from robosim.support.text_in import check_object, parse_yaml

#: Most movers of a file; radius of the posts of a leaf [m], and time of a swing [s].
_MOST, _POST_M, _SWING_S = 100, 0.03, 2.0
#: Space between the robot and a leaf that stops for it [m].
_SPACE_M = 0.05


@dataclass(frozen=True, kw_only=True)
@checked
class DoorConfig:
    """A door leaf and when it is open."""

    door: Annotated[tuple[float, float], Range(-FARTHEST, FARTHEST, "m")]
    """Place of the hinge in the plan's frame [m]."""
    width_m: Annotated[float, Range(0.1, 10, "m")] = 0.9
    """Length of the leaf [m]."""
    height_m: Annotated[float, Range(0.1, 10, "m")] = 2.0
    """Height of the leaf [m]."""
    closed_deg: Annotated[float, Range(-360, 360, "degrees")] = 0.0
    """Direction of the closed leaf from its hinge, counter-clockwise from +x [deg]."""
    open_deg: Annotated[float, Range(-360, 360, "degrees")] = 90.0
    """Direction of the open leaf [deg]."""
    open_s: tuple[tuple[float, float], ...] = ()
    """Intervals in which it is open, begin and end [s]; closed at other times."""

    def __post_init__(self) -> None:
        for begin, end in self.open_s:
            if not begin < end > 0:
                raise ValueError(
                    f"open_s is {begin:g} to {end:g} s, expected a begin before the end, after 0."
                )


class Door:
    """A leaf that swings about its hinge."""

    def __init__(self, config: DoorConfig, name: str = "") -> None:
        self.config, self._name = config, name
        count = max(2, math.ceil(config.width_m / (2 * _POST_M)))
        self._along_m = (np.arange(count) + 0.5) * config.width_m / count
        self.bodies: Sequence[Body] = (
            Body(radius_m=_POST_M, height_m=config.height_m, look="cylinder"),
        ) * count

    def reset(self, surroundings: Surroundings, rng: np.random.Generator) -> None:
        """As open as it is at time 0; ValueError if the hinge is outside of the building."""
        (x, y), width_m = self.config.door, self.config.width_m
        west, south, east, north = surroundings.building.free.bounds
        if not (west - width_m <= x <= east + width_m and south - width_m <= y <= north + width_m):
            raise ValueError(
                f"{self._name}door is at ({x:g}, {y:g}) m, outside of the building from ({west:g}, {south:g}) to "
                f"({east:g}, {north:g}) m."
            )
        self._time_s, self._share = 0.0, float(self._is_open(0.0))
        self._others = surroundings.others
        widest_m = max(surroundings.robot_radius_m, self._others[:, 2].max(initial=0.0))
        self._space_m = widest_m + _POST_M + _SPACE_M

    def poses(self, time_s: float, robot: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
        """Poses of the posts; see `robosim.movers.mover.Mover`."""
        step = (time_s - self._time_s) / _SWING_S * (1 if self._is_open(time_s) else -1)
        share = min(max(self._share + step, 0.0), 1.0)
        if share != self._share and self._gap_m(share, robot) >= min(
            self._space_m, self._gap_m(self._share, robot)
        ):
            self._share = share
        self._time_s = time_s
        return self._posts(self._share)

    def _is_open(self, time_s: float) -> bool:
        return any(begin <= time_s < end for begin, end in self.config.open_s)

    def _gap_m(self, share: float, robot: Float[np.ndarray, "3"]) -> float:
        """Distance of the nearest robot's centre from the nearest post."""
        robots = np.vstack([robot[:2], self._others[:, :2]])
        return float(np.hypot(*(self._posts(share)[:, None, :2] - robots).T).min())

    def _posts(self, share: float) -> Float[np.ndarray, "n 3"]:
        config = self.config
        angle = math.radians(config.closed_deg + share * (config.open_deg - config.closed_deg))
        x, y = config.door
        along = self._along_m
        return np.column_stack(
            [x + along * math.cos(angle), y + along * math.sin(angle), np.full(len(along), angle)]
        )


def mover_of_file(path: Path) -> Mover:
    """A crowd from a .csv or .parquet file, another robot from a .tum file, or the movers that a .yaml file lists.

    Raises:
        FileError: If the file, or one that it names, is damaged, or an entry makes no sense.
    """
    path = Path(path)
    if path.suffix == ".tum":
        return read_trajectory(path)
    if path.suffix != ".yaml":
        return read_crowd(path)
    with reading(path, "movers", "Give a list of entries with one of door, crowd or trajectory") as file:
        entries = parse_yaml(file.read())
        if not isinstance(entries, list) or not 0 < len(entries) <= _MOST:
            raise ValueError(f"it holds no list of 1 to {_MOST} entries")
        movers = []
        for number, entry in enumerate(entries, 1):
            try:
                movers.append(_mover(check_object(entry), path.parent, f"{shown(path)}: entry {number}: "))
            except ValueError as error:
                raise ValueError(f"entry {number}: {error}") from error
        return Group(movers)


def _mover(entry: dict[str, Any], folder: Path, name: str) -> Mover:
    if "door" in entry:
        return Door(from_dict(DoorConfig, entry), name)
    for kind, read in (("crowd", read_crowd), ("trajectory", read_trajectory)):
        if isinstance(entry.get(kind), str):
            size = {key: value for key, value in entry.items() if key != kind}
            recorded: Recorded = read(folder / entry[kind])
            return (
                recorded.resized(from_dict(Body, {**vars(recorded.bodies[0]), **size})) if size else recorded
            )
    raise ValueError(f"it has the keys {', '.join(map(str, entry))[:80]}, expected door, crowd or trajectory")
