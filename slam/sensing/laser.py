"""Scans of a planar laser scanner (2D lidar): one turn of its beams at one height, all at once.

A returned beam ended at a surface. A missing return alone gives no information, since dark, shiny, grazed and distant
surfaces return nothing. Where several neighbours in a row are missing, they are assumed clear up to the range of the
nearer of the two adjacent returns: along a grazed wall this is before the wall, in a hall nearly the scanner's range.
Left out: the robot's motion within one turn of the scanner, tilt.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from slam.sensing.projection import BETWEEN, ONE_SURFACE_M

#: So many beams in a row have to miss before they count as clear.
_MISSING = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class LaserScan:
    """A turn of a planar laser scanner above the robot's middle line."""

    bearing_rad: Float[np.ndarray, " n"]
    """Directions of the beams in the robot's frame [rad], rising in equal steps, counter-clockwise, 0 ahead."""
    range_m: Float[np.ndarray, " n"]
    """How far each beam went [m]; inf where nothing came back."""
    max_range_m: float
    """Farther surfaces are not measured [m]."""
    height_m: float
    """Height of the beams above the floor [m]."""
    ahead_m: float = 0.0
    """How far the scanner is ahead of the robot's centre [m]; bearings are from there."""

    @cached_property
    def hit(self) -> Bool[np.ndarray, " n"]:
        """Beams that ended at a surface."""
        return np.isfinite(self.range_m)

    @property
    def step_rad(self) -> float:
        """Angle between neighbouring beams [rad]."""
        return float(self.bearing_rad[1] - self.bearing_rad[0])

    @property
    def all_around(self) -> bool:
        """Whether the last beam is the first one's neighbour."""
        return bool(abs(len(self.bearing_rad) * self.step_rad - 2 * np.pi) < 0.5 * self.step_rad)

    def nearest(self, bearing_rad: Float[np.ndarray, "*any"]) -> Int[np.ndarray, "*any"]:
        """Number of the beam nearest to each bearing in the robot's frame [rad]; -1 outside of the fan."""
        n, first = len(self.bearing_rad), self.bearing_rad[0] - 0.5 * self.step_rad
        beam = ((np.asarray(bearing_rad) - first) % (2 * np.pi) / self.step_rad).astype(np.intp)
        # Rounding: the last turn of a full circle is the last beam's.
        return np.where(beam < n, beam, n - 1 if self.all_around else -1)

    @cached_property
    def clear_m(self) -> Float[np.ndarray, " n"]:
        """Free distance along each beam [m]; 0 where it is unknown."""
        side = _MISSING // 2
        ends = np.pad(~self.hit, side, mode="wrap" if self.all_around else "edge")
        missing = np.lib.stride_tricks.sliding_window_view(ends, _MISSING).all(axis=1)
        hits, n = np.flatnonzero(self.hit), len(self.range_m)
        if not len(hits):
            return np.full(n, self.max_range_m)
        place = np.searchsorted(hits, np.arange(n))
        before, after = (
            (np.take(hits, place - 1, mode="wrap"), np.take(hits, place, mode="wrap"))
            if self.all_around
            else (hits[np.maximum(place - 1, 0)], hits[np.minimum(place, len(hits) - 1)])
        )
        nearer_m = np.minimum(self.range_m[before], self.range_m[after])
        return np.where(self.hit, self.range_m, np.where(missing, nearer_m, 0.0))

    def without(self, beams: Bool[np.ndarray, " n"]) -> "LaserScan":
        """The scan with some beams that nothing came back from."""
        return replace(self, range_m=np.where(beams, np.inf, self.range_m)) if beams.any() else self

    def dense(self, range_m: float) -> Float[np.ndarray, "m 2"]:
        """Points (x forward, y left) [m] within a range, with others in between where neighbours are near."""
        points = np.where(self.hit, self.range_m, 0.0)[:, None] * np.column_stack(
            [np.cos(self.bearing_rad), np.sin(self.bearing_rad)]
        )
        after = np.roll(np.arange(len(points)), -1)
        used = self.hit & (self.range_m <= range_m)
        apart_m = np.hypot(*(points[after] - points).T)
        joined = used & used[after] & (apart_m < ONE_SURFACE_M)
        if not self.all_around:
            joined[-1] = False
        share = np.arange(BETWEEN) / BETWEEN
        lines = points[:, None] * (1 - share)[:, None] + points[after][:, None] * share[:, None]
        return lines[(share == 0) & used[:, None] | joined[:, None]]
