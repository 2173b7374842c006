"""Tasks of a target search: where the robot starts, and where the target stands.

Start and target are places that the robot's hull can reach, one from the other. The shortest drive between them is
stored with the task, since success weighted by path length (SPL, Anderson et al. 2018) is measured against it.
"""

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int

from robosim.building.reach import Reach
from robosim.plans.floorplan import MapError
from robosim.support.checks import FARTHEST, check_number

logger = logging.getLogger(__name__)

#: The robot has arrived once its true position is this near to the target [m].
ARRIVAL_M = 0.3

#: A target this far from free space still counts as on its edge [m].
ON_EDGE_M = 1e-6

#: Targets tried before a building counts as too small for the requested distance.
_TRIES = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Anchor:
    """A transmitter that is not the target; its name distinguishes it from the target and from others."""

    name: str
    """Name of the transmitter."""
    place: Float[np.ndarray, "2"]
    """Where it stands in `map` [m]."""
    known: bool = True
    """Whether the robot knows where it stands."""


@dataclass(frozen=True, eq=False)
class Task:
    """A search in a building."""

    start: Float[np.ndarray, "3"]
    """Pose of the robot at first: x [m], y [m], yaw [rad] in `map`."""
    target: Float[np.ndarray, "2"]
    """Where the target stands in `map` [m]."""
    shortest_m: float
    """Length of the shortest drive that ends within the arrival radius [m]."""
    anchors: tuple[Anchor, ...] = ()
    """Other transmitters."""


def with_anchors(task: Task, reach: Reach, anchors: Sequence[Anchor]) -> Task:
    """A task in a building with other transmitters; MapError if one is in a wall, ValueError for names that clash."""
    names = [anchor.name for anchor in anchors]
    for anchor in anchors:
        x, y = anchor.place
        what = f"the transmitter {anchor.name!r}"
        for value in (x, y):
            check_number(f"the place of {what}", float(value), -FARTHEST, FARTHEST, "m")
        if not anchor.name or anchor.name == "target" or names.count(anchor.name) > 1:
            raise ValueError(f"{what} needs a name of its own, other than 'target'.")
        if reach.free.distance(shapely.Point(x, y)) > ON_EDGE_M:
            raise _better(
                reach, f"{what} {_at(anchor.place)} is in a wall, or outside of the building", anchor.place
            )
    return replace(task, anchors=tuple(anchors))


def make_task(
    reach: Reach,
    rng: np.random.Generator,
    *,
    start: Float[np.ndarray, "3"] | None = None,
    target: Float[np.ndarray, "2"] | None = None,
    min_path_m: float = 3.0,
    max_path_m: float = math.inf,
) -> Task:
    """A task with what is given, the rest drawn evenly over the floor.

    The drawn place lies at least `min_path_m` and at most `max_path_m` of driving from the other end. In a building
    without two such places the farthest pair found is taken, and a warning logged. A robot begins where it has room to
    turn, as far as there is such a place.

    Raises:
        MapError: If the hull fits nowhere or not at the start, cannot drive from there to the target, or that is
            in a wall.
    """
    reach.check_room()
    _check_places(reach, start, target)
    start, target = (None if place is None else np.array(place, float) for place in (start, target))
    fixed = target if target is not None else start[:2] if start is not None else None
    if fixed is not None and start is not None and target is not None:
        return Task(start, target, _shortest_m(reach, start, target))
    places = reach.indoors if start is not None else reach.roomy
    anchor, other, distance = _draw_pair(reach, rng, fixed, (min_path_m, max_path_m), places)
    if distance < min_path_m:
        logger.warning(
            "%s: no two places %.1f m of path apart were found; the task is %.1f m long.",
            reach.plan.name,
            min_path_m,
            distance,
        )
    if start is None:
        start = np.array([*other, rng.uniform(-np.pi, np.pi)])
        target = anchor
    else:
        target = other
    return Task(start, target, max(distance - ARRIVAL_M, 0.0))


def _draw_pair(
    reach: Reach,
    rng: np.random.Generator,
    fixed: np.ndarray | None,
    path_m: tuple[float, float],
    places: Bool[np.ndarray, "ny nx"],
) -> tuple[np.ndarray, np.ndarray, float]:
    """Two points of one part and the drive between them [m], what is drawn indoors under nothing; `given` is first."""
    # A target inside a table is no realistic task.
    clear = reach.indoors & ~reach.overhung
    clear = clear if clear.any() else reach.indoors
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    for _ in range(1 if fixed is not None else _TRIES):
        anchor = fixed if fixed is not None else _centre(reach, _draw_cell(clear, rng))
        travel = reach.travel_m(anchor)
        if (np.isfinite(travel) & clear).any():
            travel[~clear] = np.inf
        far = np.isfinite(travel) & (travel >= path_m[0]) & (travel <= path_m[1])
        far = far & places if (far & places).any() else far
        if far.any():
            cell = _draw_cell(far, rng)
            return anchor, _centre(reach, cell), float(travel[tuple(cell)])
        reached = np.where(np.isfinite(travel), travel, -1.0)
        cell = np.array(np.unravel_index(np.argmax(reached), travel.shape))
        if best is None or reached.max() > best[0]:
            best = float(reached.max()), anchor, _centre(reach, cell)
    assert best is not None  # the loop runs at least once
    return best[1], best[2], best[0]


def _draw_cell(cells: Bool[np.ndarray, "ny nx"], rng: np.random.Generator) -> Int[np.ndarray, "2"]:
    """Row and column of one of some cells."""
    until = np.cumsum(cells.sum(axis=1))
    number = rng.integers(until[-1])
    row = int(np.searchsorted(until, number, side="right"))
    columns = np.flatnonzero(cells[row])
    return np.array([row, columns[number - until[row]]])


def _shortest_m(reach: Reach, start: np.ndarray, target: np.ndarray) -> float:
    """Length of the shortest drive from a start to within the arrival radius of a target [m]."""
    travel = reach.travel_m(start[:2])
    reached = np.isfinite(travel)
    gap = np.hypot(*(reach.plan.centres(reached) - target).T)
    near = gap <= _near_m(reach)
    if not near.any():
        raise MapError(
            f"{reach.plan.name}: no path for a hull of radius {reach.radius_m} m from the start "
            f"({start[0]:g}, {start[1]:g}) m to the target ({target[0]:g}, {target[1]:g}) m. Choose both in "
            "one part of the floor (`robosim plan` draws the parts), or a smaller robot."
        )
    return float(travel[reached][near].min())


def _near_m(reach: Reach) -> float:
    """Distance of cells that count as near a target [m]: the arrival radius, but at least half a cell's diagonal."""
    return max(ARRIVAL_M, reach.plan.resolution_m * math.sqrt(0.5))


def _check_places(reach: Reach, start: np.ndarray | None, target: np.ndarray | None) -> None:
    """Raise an error that suggests a better place if start or target cannot be where they are asked to be."""
    for what, place, count in (("start", start, 3), ("target", target, 2)):
        if place is not None and not (np.shape(place) == (count,) and (np.abs(place[:2]) <= FARTHEST).all()):
            raise ValueError(
                f"{what} is {place}, expected {count} numbers, the first two up to {FARTHEST:g} m."
            )
    if start is not None:
        check_number("yaw of the start", float(start[2]), -2 * np.pi, 2 * np.pi, "rad: a turn to either side")
    hull = f"the robot's hull (radius {reach.radius_m} m)"
    if start is not None and not reach.part_at(start[:2]):
        raise _better(reach, f"{hull} does not fit at the start {_at(start)}", start[:2])
    if target is not None and reach.free.distance(shapely.Point(target)) > ON_EDGE_M:
        raise _better(reach, f"the target {_at(target)} is in a wall, or outside of the building", target)
    if target is not None and not reach.part_near(target, _near_m(reach)):
        raise _better(reach, f"{hull} cannot come within {ARRIVAL_M} m of the target {_at(target)}", target)


def _better(reach: Reach, problem: str, point: Float[np.ndarray, "2"]) -> MapError:
    """An error that names the nearest point that would do."""
    nearest = _centre(reach, np.array(reach.nearest_cell(point)[0]))
    return MapError(
        f"{reach.plan.name}: {problem}. The nearest place where the hull can be is ({nearest[0]:.2f}, "
        f"{nearest[1]:.2f}) m."
    )


def _at(point: np.ndarray) -> str:
    return f"({point[0]:g}, {point[1]:g}) m"


def _centre(reach: Reach, cell: np.ndarray) -> np.ndarray:
    """Point of `map` at the centre of a cell (row, column)."""
    return reach.plan.to_map(np.array([cell[1] + 0.5, cell[0] + 0.5]))
