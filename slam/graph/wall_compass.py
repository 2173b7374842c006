"""Directions of walls as a compass: most walls of a building are parallel or perpendicular to each other.

The yaw of matched poses drifts by some tenths of a degree over 30 m, since no view reaches as far. Straight walls of a
submap, modulo a right angle, give its yaw relative to those of all others. The axis of the building is a place very far
away, and its direction from a submap a sighting of the graph: one that contradicts the others loses its weight, and
submaps whose walls deviate from the axis by more than their yaw is uncertain get none.

Left out: buildings with wings of different axes, of which the first counts.
Reference: Coughlan and Yuille, Manhattan world: compass direction from a single image by Bayesian inference, ICCV 1999.
"""

import math

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from slam.graph.least_squares import Sighting
from slam.graph.pose_graph import PoseGraph
from slam.matching.scan_matching import ScanPoints
from slam.poses import wrap

#: Points of a wall are no farther apart [m]; shorter walls do not count [m].
_GAP_M, _SHORT_M = 0.15, 1.0
#: Normals of a wall deviate from the axis by no more than this [rad].
_ALIKE_RAD = math.radians(20.0)
#: Least standard deviation of a point from its wall [m], and largest root mean square of a wall that is straight [m].
_LEAST_M, _ROUGH_M = 0.005, 0.015
#: Standard deviation of walls from the axis, and of all walls of a submap together [rad].
_OF_WALL_RAD, _OF_SUBMAP_RAD = math.radians(0.4), math.radians(0.15)
#: Least length of all walls that make a direction [m].
_LENGTH_M = 2.5
#: Yaws deviate from the axis by no more than so many standard deviations, and by no more than this [rad].
_LIKELY, _FARTHEST_RAD = 2.5, math.radians(3.0)
#: How far away the axis is [m]: from places 100 m apart it is seen in the same direction to 0.006 degrees.
_FAR_M = 1e6


class WallCompass:
    """Adds sightings of the axis of walls to a graph of submaps."""

    def __init__(self) -> None:
        self._place: int | None = None

    def see(self, graph: PoseGraph, number: int, surfaces: ScanPoints) -> float:
        """Add the direction of walls of a submap, if it has any; returns by how much its yaw deviates [rad]."""
        measured = wall_direction(surfaces)
        if measured is None:
            return 0.0
        direction_rad, sigma_rad = measured
        x, y, yaw = graph.poses[number]
        off_rad = 0.0
        if self._place is None:
            axis = yaw + direction_rad
            self._place = graph.add_place(
                np.array([x + _FAR_M * math.cos(axis), y + _FAR_M * math.sin(axis)])
            )
        else:
            away = graph.places[self._place] - [x, y]
            expected = math.atan2(away[1], away[0]) - yaw
            # Modulo a right angle.
            off_rad = float(wrap(4 * (direction_rad - expected)) / 4)
            direction_rad = expected + off_rad
            spread_rad = math.sqrt(graph.uncertainty(number)[0][2, 2] + sigma_rad**2)
            if abs(off_rad) > min(_LIKELY * spread_rad, _FARTHEST_RAD):
                return 0.0
        graph.see(
            Sighting(
                pose=number,
                at=np.zeros(3),
                place=self._place,
                bearing_rad=direction_rad,
                sigma_rad=sigma_rad,
                range_m=_FAR_M,
                sigma_range=1.0,
            )
        )
        return abs(off_rad)


def wall_direction(surfaces: ScanPoints) -> tuple[float, float] | None:
    """Direction of straight walls modulo a right angle, and its standard deviation [rad]; None without walls.

    Normals give it coarsely; then each straight wall by least squares of its points.
    """
    angle = np.arctan2(surfaces.normals[:, 1], surfaces.normals[:, 0])
    if not len(angle):
        return None
    coarse = float(np.angle((surfaces.weights * np.exp(4j * angle)).sum())) / 4
    lines = []
    for axis in coarse + 0.5 * math.pi * np.arange(4):
        along = np.array([-math.sin(axis), math.cos(axis)])
        across = np.array([math.cos(axis), math.sin(axis)])
        alike = np.cos(angle - axis) > math.cos(_ALIKE_RAD)
        lines += _lines(surfaces.points[alike] @ along, surfaces.points[alike] @ across)
    if not lines or sum(length for *_, length in lines) < _LENGTH_M:
        return None
    slope, variance, _ = np.array(lines).T
    variance = variance + _OF_WALL_RAD**2
    turn = 0.0
    for _ in range(5):
        trust = 1 / (variance + (slope - turn) ** 2)
        turn = float((trust * slope).sum() / trust.sum())
    sigma = math.hypot(1 / math.sqrt((1 / variance).sum()), _OF_SUBMAP_RAD)
    return coarse + turn, sigma


def _lines(
    along: Float[np.ndarray, " n"], across: Float[np.ndarray, " n"]
) -> list[tuple[float, float, float]]:
    """Slope [rad], its variance, and length [m] of straight walls: points along an axis and across it [m]."""
    if len(along) < 3:
        return []
    pairs = cKDTree(np.column_stack([along, across])).query_pairs(_GAP_M, output_type="ndarray")
    linked = csr_matrix((np.ones(len(pairs)), pairs.T), shape=(len(along), len(along)))
    n_walls, wall = connected_components(linked, directed=False)
    lines = []
    for k in range(n_walls):
        x, y = along[wall == k], across[wall == k]
        length = float(np.ptp(x))
        if length < _SHORT_M:
            continue
        x, y = x - x.mean(), y - y.mean()
        square = float((x**2).sum())
        slope = float((x * y).sum()) / square
        rough = float(np.sqrt(((y - slope * x) ** 2).mean()))
        if rough < _ROUGH_M:
            # Along the left normal, a positive slope turns the normal clockwise.
            lines.append((-math.atan(slope), max(rough, _LEAST_M) ** 2 / square, length))
    return lines
