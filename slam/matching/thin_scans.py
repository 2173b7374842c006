"""Surfaces from scans of few beams, as of a ring of rangers: points of several scans that lie in a line.

The ends of such beams are too far apart for a normal of their own. The ends of recent scans together show walls: a
point lies on a surface if some others near by, seen from the same side, lie in one line with it, and no beam went
through that line between them. Each scan is matched to these surfaces point by point, whatever the orientation.
Reference: Zhou et al., Efficient 2D graph SLAM for sparse sensing, IROS 2022 (lines of several scans).
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from slam.matching.scan_matching import ScanPoints
from slam.poses import to_map

#: Beams farther apart than this on average give no normals [rad].
_THIN_RAD = math.radians(2.0)
#: Points within this are compared [m]; lines have so many of them, within this of it [m], over this length [m].
_NEAR_M, _LEAST, _STRAIGHT_M, _LONG_M = 1.0, 3, 0.04, 0.3
#: Largest angle between a surface's normal and the beam that met it (cosine).
_FACING = 0.2
#: Scans that are compared.
RECENT = 25


def is_thin(bearing_rad: Float[np.ndarray, " w"]) -> bool:
    """Whether beams are too far apart to give normals."""
    return bool(np.diff(bearing_rad).mean() > _THIN_RAD)


def thin_scan(
    bearing_rad: Float[np.ndarray, " w"], range_m: Float[np.ndarray, " w"], max_range_m: float, sigma_m: float
) -> ScanPoints:
    """Ends of beams up to `max_range_m`, with normals to the robot; the range is inf where nothing is met."""
    seen = range_m <= max_range_m
    back = -np.column_stack([np.cos(bearing_rad[seen]), np.sin(bearing_rad[seen])])
    n = len(back)
    return ScanPoints(
        points=-range_m[seen][:, None] * back,
        normals=back,
        weights=np.ones(n),
        sigma_m=np.full(n, sigma_m),
        thin=True,
    )


class RecentPoints:
    """Points of recent scans in one frame, those on surfaces marked."""

    def __init__(self, cell_m: float) -> None:
        """Make it without points; surfaces are entered once per cell [m]."""
        self._cell_m = cell_m
        self._points: list[Float[np.ndarray, "n 2"]] = []
        self._facing: list[Float[np.ndarray, "n 2"]] = []
        self._drawn: list[Bool[np.ndarray, " n"]] = []

    def add(self, pose: Float[np.ndarray, "3"], scan: ScanPoints) -> None:
        """Add a scan at a pose of the frame, whose normals point to the robot."""
        placed = scan.at(pose)
        self._points.append(placed.points)
        self._facing.append(placed.normals)
        self._drawn.append(np.zeros(len(placed.points), bool))
        for each in (self._points, self._facing, self._drawn):
            del each[:-RECENT]

    def move(self, frame: Float[np.ndarray, "3"]) -> None:
        """Continue in another frame, in which this one has a pose."""
        turn = np.array([0.0, 0.0, frame[2]])
        self._points = [to_map(frame, points) for points in self._points]
        self._facing = [to_map(turn, facing) for facing in self._facing]

    def new_surfaces(
        self, through: Callable[[Float[np.ndarray, "n 2"]], Bool[np.ndarray, " n"]]
    ) -> ScanPoints:
        """Surfaces at points that were not on one before; `through` says which of some points beams went through."""
        points, facing = np.concatenate(self._points), np.concatenate(self._facing)
        drawn, pieces = np.concatenate(self._drawn), []
        for k in np.flatnonzero(~drawn):
            line = _line(int(k), points, facing)
            if line is not None:
                pieces.append(self._filled(*line))
                drawn[k] = True
        bounds = np.cumsum([len(each) for each in self._drawn])[:-1]
        self._drawn = list(np.split(drawn, bounds))
        ends = np.concatenate([np.zeros((0, 4)), *pieces])
        ends = ends[~through(ends[:, :2])]
        return ScanPoints(points=ends[:, :2], normals=ends[:, 2:], weights=np.ones(len(ends)))

    def _filled(
        self, start: Float[np.ndarray, "2"], end: Float[np.ndarray, "2"], normal: Float[np.ndarray, "2"]
    ) -> Float[np.ndarray, "n 4"]:
        """Points and normals from one point of a line to another."""
        n = max(int(np.hypot(*(end - start)) / self._cell_m), 1)
        share = (np.arange(n) + 0.5)[:, None] / n
        return np.column_stack([start * (1 - share) + end * share, np.tile(normal, (n, 1))])


def _line(
    k: int, points: Float[np.ndarray, "n 2"], facing: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"], Float[np.ndarray, "2"]] | None:
    """The line of the most points near one of them: from its neighbour on one side to that on the other, and normal."""
    away = points - points[k]
    length = np.hypot(*away.T)
    near = np.flatnonzero((length < _NEAR_M) & (facing @ facing[k] > 0))
    away, length = away[near], length[near]
    far = length > 2 * _STRAIGHT_M
    if far.sum() + 1 < _LEAST:
        return None
    along = away[far] / length[far][:, None]
    aside = np.abs(along[:, :1] * away[:, 1] - along[:, 1:] * away[:, 0])
    on = aside < _STRAIGHT_M
    best = int(on.sum(axis=1).argmax())
    members = away[on[best]]
    if len(members) < _LEAST:
        return None
    middle = members.mean(axis=0)
    values, axes = np.linalg.eigh((members - middle).T @ (members - middle))
    normal, axis = axes[:, 0], axes[:, 1]
    normal = normal if normal @ facing[k] > 0 else -normal
    place = np.sort((members - middle) @ axis)
    origin = float(-middle @ axis)
    if (
        normal @ facing[k] < _FACING
        or place[-1] - place[0] < _LONG_M
        or values[0] > len(members) * (0.5 * _STRAIGHT_M) ** 2
    ):
        return None
    low, high = place[place < origin - 1e-6], place[place > origin + 1e-6]
    ends = [
        points[k] + middle + axis * at
        for at in (low[-1] if len(low) else origin, high[0] if len(high) else origin)
    ]
    return ends[0], ends[1], normal
