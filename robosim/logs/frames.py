"""Frames of a bag: transforms between parents and children over time, and the place of any frame in another.

Poses between the times of a transform are interpolated, linear in place and along the smaller angle; before the first
and after the last they are those. A transform that never changes is static. REP 105 names the frames: map, odom,
base_link, base_footprint.
"""

import math
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from robosim.support.reading import FileError

#: A transform that changes by less is static [m or component of a quaternion].
_STATIC = 1e-6
#: Lengths of quaternions differ from 1 by no more; places no farther [m]; a robot is tipped by no more [rad].
_OFF_UNIT, _FARTHEST_M, MOST_TIPPED = 0.05, 1e8, math.radians(20)

Places = Float[np.ndarray, "n 4 4"]


class Frames:
    """Transforms by the child's frame. The first parent of a frame counts."""

    def __init__(self) -> None:
        self._rows: dict[str, tuple[str, array[float]]] = {}
        self._edges: dict[str, tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 7"]]] = {}
        self.other_parents: dict[str, set[str]] = {}
        """Parents that do not count, by child."""

    def add(self, message: Any, time_s: float) -> None:
        """Add transforms of a message; those without a time are of the time of recording [s]."""
        for transform in message.transforms:
            parent, child = frame_name(transform.header.frame_id), frame_name(transform.child_frame_id)
            if parent == child:
                continue  # as tf2 does
            known, rows = self._rows.setdefault(child, (parent, array("d")))
            if known != parent:
                self.other_parents.setdefault(child, set()).add(parent)
                continue
            place, turn = transform.transform.translation, transform.transform.rotation
            stamp = stamp_s(transform.header) or time_s
            rows.extend((stamp, place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))

    def __contains__(self, frame: str) -> bool:
        return frame in self.names()

    def names(self) -> list[str]:
        """All frames."""
        return sorted({*self._rows, *(parent for parent, _ in self._rows.values())})

    def chain(self, frame: str) -> list[str]:
        """A frame, its parent, and so on up to the root."""
        chain = [frame]
        while chain[-1] in self._rows and self._rows[chain[-1]][0] not in chain:
            chain.append(self._rows[chain[-1]][0])
        return chain

    def is_moving(self, child: str) -> bool:
        """Whether the transform of a frame in its parent changes."""
        values = self._edge(child)[1]
        turns = np.where(values[:, 3:] @ values[0, 3:] < 0, -1.0, 1.0)
        values = np.column_stack([values[:, :3], values[:, 3:] * turns[:, None]])
        return not bool((np.abs(values - values[0]) <= _STATIC).all())

    def moving(self, target: str, source: str) -> list[str]:
        """Children of the transforms between two frames that change."""
        up, down = self._path(target, source)
        return [child for child in (*up, *down) if self.is_moving(child)]

    def is_connected(self, target: str, source: str) -> bool:
        """Whether transforms lead from a frame to another."""
        return self.chain(target)[-1] == self.chain(source)[-1]

    def times(self, target: str, source: str) -> Float[np.ndarray, " n"]:
        """Times at which a transform between two frames changes, while all that do are known [s]."""
        stamps = [self._edge(child)[0] for child in self.moving(target, source)]
        first, last = max(each[0] for each in stamps), min(each[-1] for each in stamps)
        times = np.unique(np.concatenate(stamps))
        return times[(times >= first) & (times <= last)]

    def places(self, target: str, source: str, times: Float[np.ndarray, " n"]) -> Places:
        """Place of a frame in another at some times [s]; FileError if one is impossible."""
        up, down = self._path(target, source)
        place = np.broadcast_to(np.eye(4), (len(times), 4, 4))
        for child in up:
            place = self._places(child, times) @ place
        for child in down:
            place = np.linalg.inv(self._places(child, times)) @ place
        return np.array(place)

    def tree(self) -> Iterator[tuple[int, str, str]]:
        """Yield depth, name and kind (root, static or moving) of all frames, parents first."""
        children: dict[str, list[str]] = {}
        for child, (parent, _) in sorted(self._rows.items()):
            children.setdefault(parent, []).append(child)
        waiting = [(0, root) for root in sorted(set(children) - set(self._rows), reverse=True)]
        while waiting:
            depth, name = waiting.pop()
            kind = "root" if not depth else "moving" if self.is_moving(name) else "static"
            yield depth, name, kind
            waiting += [(depth + 1, child) for child in reversed(children.get(name, []))]

    def _path(self, target: str, source: str) -> tuple[list[str], list[str]]:
        """Children from a source up to the common ancestor, and from it down to a target."""
        to_target, to_source = self.chain(target), self.chain(source)
        common = next(frame for frame in to_source if frame in to_target)
        return to_source[: to_source.index(common)], to_target[: to_target.index(common)][::-1]

    def _edge(self, child: str) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 7"]]:
        if child not in self._edges:
            rows = np.array(self._rows[child][1]).reshape(-1, 8)
            times, first = np.unique(rows[:, 0], return_index=True)
            self._edges[child] = times, rows[first, 1:]
        return self._edges[child]

    def _places(self, child: str, times: Float[np.ndarray, " n"]) -> Places:
        stamps, values = self._edge(child)
        name = f"the transform from {self._rows[child][0]} to {child}"
        if not self.is_moving(child):
            stamps, values = stamps[:1], values[:1]
        whole = matrices(name, stamps, values)
        if len(stamps) == 1:
            return np.broadcast_to(whole, (len(times), 4, 4))
        at = np.clip(times, stamps[0], stamps[-1])
        places = np.tile(np.eye(4), (len(times), 1, 1))
        places[:, :3, :3] = Slerp(stamps, Rotation.from_matrix(whole[:, :3, :3]))(at).as_matrix()
        places[:, :3, 3] = np.column_stack([np.interp(at, stamps, column) for column in values[:, :3].T])
        return places


def matrices(name: str, times: Float[np.ndarray, " n"], values: Float[np.ndarray, "n 7"]) -> Places:
    """Places with quaternions (x y z, qx qy qz qw) as matrices; FileError if one is NaN, too far, or no rotation."""
    length = np.linalg.norm(values[:, 3:], axis=1)
    with np.errstate(invalid="ignore"):
        is_place = (np.abs(values[:, :3]) <= _FARTHEST_M).all(axis=1)
        is_turn = np.abs(length - 1) <= _OFF_UNIT
    for good, what in (
        (is_place, f"numbers within {_FARTHEST_M:g} m"),
        (is_turn, "a quaternion of length 1"),
    ):
        if not good.all():
            k = int(good.argmin())
            shown = ", ".join(f"{value:.4g}" for value in values[k])
            raise FileError(
                f"{name} is ({shown}) at {times[k]:.6f} s, expected {what}. Record it again, or leave odometry away by "
                "--odometry-topic none."
            )
    places = np.tile(np.eye(4), (len(values), 1, 1))
    places[:, :3, :3] = Rotation.from_quat(values[:, 3:]).as_matrix()
    places[:, :3, 3] = values[:, :3]
    return places


def planar(places: Places) -> Float[np.ndarray, "n 3"]:
    """x, y [m] and yaw [rad] of places."""
    return np.column_stack([places[:, 0, 3], places[:, 1, 3], np.arctan2(places[:, 1, 0], places[:, 0, 0])])


def frame_name(name: str) -> str:
    """A frame's name, which ROS 1 may begin with a slash."""
    return name.lstrip("/")


def stamp_s(header: Any) -> float:
    """Time of a header [s]."""
    return float(header.stamp.sec + 1e-9 * header.stamp.nanosec)
