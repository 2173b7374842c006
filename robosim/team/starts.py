"""Starts of a team: close together, as robots that are carried to a door and switched on."""

from dataclasses import replace

import numpy as np

from robosim.building.reach import Reach
from robosim.plans.floorplan import MapError
from robosim.task.tasks import ARRIVAL_M, Task

#: Space between the hulls of two robots at their starts [m].
_GAP_M = 0.3


def starts_near(task: Task, reach: Reach, count: int) -> list[Task]:
    """Tasks of several robots: the first as given, the others at the nearest free places, with the same heading.

    The shortest drive of each is its own.

    Raises:
        MapError: If there is no room for so many.
    """
    travel_m = reach.travel_m(task.start[:2])
    is_free = np.isfinite(travel_m) & reach.roomy
    places = reach.plan.centres(is_free)[np.argsort(travel_m[is_free], kind="stable")]
    starts: list[np.ndarray] = [task.start[:2]]
    apart_m = 2 * reach.radius_m + _GAP_M
    for place in places:
        if len(starts) == count:
            break
        if all(np.hypot(*(place - other)) >= apart_m for other in starts):
            starts.append(place)
    if len(starts) < count:
        raise MapError(
            f"{reach.plan.name}: there is room for {len(starts)} robots at the start, not for {count}."
        )
    to_target_m = reach.travel_m(task.target)

    def task_at(place: np.ndarray) -> Task:
        shortest_m = max(reach.remaining_m(to_target_m, place) - ARRIVAL_M, 0.0)
        return replace(task, start=np.array([*place, task.start[2]]), shortest_m=shortest_m)

    return [task, *(task_at(place) for place in starts[1:])]
