"""Tasks and configurations of the robots of an episode; those of a team start close together."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.building.reach import Reach, reach
from robosim.episode_config import EpisodeConfig
from robosim.plans.floorplan import MapError
from robosim.support.checks import check_some
from robosim.task.tasks import ARRIVAL_M, Task
from robosim.world import ROBOT

#: Space between the hulls of two robots at their starts [m].
_GAP_M = 0.3
#: Least distance from the target at which a robot has not arrived [m].
_FARTHER_M = math.nextafter(ARRIVAL_M, math.inf)


class Entrant(NamedTuple):
    """Task, configuration and reach of a robot of an episode."""

    task: Task
    """From where to where."""
    config: EpisodeConfig
    """How it searches."""
    reach: Reach
    """Places that its hull can reach; coverage is counted over them."""


def make_entrants(building: Building, places: Reach, task: Task, config: EpisodeConfig) -> dict[str, Entrant]:
    """The robots of a configuration by name, each with its own task.

    Args:
        building: Where.
        places: What the hull of the first robot can reach there.
        task: Of the first robot; the others start near it, and have the same target.
        config: How, with the team.

    Raises:
        MapError: If there is no room for all robots at the start.
        ValueError: If there is no robot of a name.
    """
    team = config.team
    if team.size == 1:
        return {ROBOT: Entrant(task, config, places)}
    configs = [config] * team.size
    if team.models:
        configs = [config.of_robot(robot) for robot in config.robots]
    reaches = {configs[0].simulator.robot.hull_m: places}
    for hull_m in {config.simulator.robot.hull_m for config in configs} - set(reaches):
        reaches[hull_m] = reach(building, *hull_m)
    by_robot = [reaches[config.simulator.robot.hull_m] for config in configs]
    entrants = map(Entrant, tasks_near(task, by_robot), configs, by_robot)
    return dict(zip(team.names, entrants, strict=True))


def check_entrants(building: Building, entrants: Mapping[str, Entrant]) -> None:
    """Raise ValueError unless there are robots, whose reach is in this building."""
    check_some("entrants", entrants, "a robot or more")
    for name, entrant in entrants.items():
        plan = entrant.reach.plan
        if plan is not building.plan and plan.digest() != building.plan.digest():
            raise ValueError(
                f"reach of {name} is in {plan.name!r}, another plan than that of the building, {building.plan.name!r}. "
                "Take reach(building, ...)."
            )


def tasks_near(task: Task, reaches: Sequence[Reach]) -> list[Task]:
    """Tasks of several robots: that of the first, and others from starts near it with the same target.

    Raises:
        MapError: If there is no room for so many.
    """
    to_target_m = cache(lambda places: places.travel_m(task.target))
    tasks = [task]
    for start, places in zip(starts_near(task, reaches)[1:], reaches[1:], strict=True):
        shortest_m = places.remaining_m(to_target_m(places), start[:2]) - ARRIVAL_M
        tasks.append(replace(task, start=start, shortest_m=max(shortest_m, 0.0)))
    return tasks


def starts_near(task: Task, reaches: Sequence[Reach]) -> list[Float[np.ndarray, "3"]]:
    """Starts of several robots: that of the first, and the nearest places with room for the hulls of the others.

    No other robot starts where it has arrived.

    Raises:
        MapError: If there is no room for so many.
    """
    start = task.start
    from_start_m = cache(lambda places: places.travel_m(start[:2]))
    starts = [start]
    for places in reaches[1:]:
        travel_m = from_start_m(places)
        is_free = np.isfinite(travel_m) & places.roomy
        gaps_m = [places.hull.turning_m + room.hull.turning_m + _GAP_M for room in reaches[: len(starts)]]
        for place, gap_m in zip((task.target, *starts), (_FARTHER_M, *gaps_m), strict=True):
            apart_m = np.hypot(*(places.plan.centres(is_free) - place[:2]).T)
            is_free[is_free] = apart_m >= gap_m
        if not is_free.any():
            raise MapError(
                f"{places.plan.name}: there is room for {len(starts)} of {len(reaches)} robots at the start "
                f"({start[0]:g}, {start[1]:g}) m. Take fewer robots."
            )
        place = places.plan.centres(is_free)[travel_m[is_free].argmin()]
        starts.append(np.array([*place, start[2]]))
    return starts
