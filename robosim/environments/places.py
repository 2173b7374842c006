"""Buildings in which the robots of a process search, each built once and shared; and a guide along the shortest drive.

A building holds walls for robots and rays, the places that a robot can reach, a simulator to clone, and shortest drives
to targets. The most recently used buildings are cached.

The guide turns to the nearby place from which the remaining drive is shortest, and drives there. Collected trajectories
mix in random actions, so that they show how to return to the route, as in DART (Laskey et al., Noise injection for
robust imitation learning, CoRL 2017).
"""

from functools import cache, cached_property, lru_cache

import numpy as np
from jaxtyping import Float

from robosim.building.building import make_building
from robosim.building.reach import Reach, reach
from robosim.drawing.plan_view import building_rings
from robosim.parts import CLASSIFIER
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link_state import Classifier
from robosim.simulator import Simulator, SimulatorConfig
from robosim.support.parts import Part
from robosim.task.tasks import make_task
from slam.actions import TURN_RAD, Action
from slam.poses import wrap

#: Distance of the next place [m].
_AHEAD_M = 0.6
#: Turns are steps, so directions within this count as ahead.
_STRAIGHT_RAD = 0.75 * TURN_RAD
#: Cached buildings; those among them with a radio, whose tables take some 25 MB for each place of a transmitter; cached
#: drives of each building.
_BUILDINGS, _WITH_RADIO, _DRIVES = 128, 32, 64
#: Seed of the places for targets, whatever the environment's seed, so that tables of radio can be cached.
_POOL_SEED = 28


class Place:
    """A building with everything that is computed once for it."""

    def __init__(self, plan: FloorPlan, config: SimulatorConfig, *, uses_radio: bool) -> None:
        """Build it."""
        self.plan, self.config, self.uses_radio = plan, config, uses_radio
        self.building = make_building(plan)
        self.reach = places = reach(self.building, config.robot.radius_m, config.robot.height_m)
        self._simulator = Simulator(self.building, config, uses_radio=uses_radio)
        # The cached functions do not refer to this object, so that it is freed with its last reference.
        self._travel_m = lru_cache(_DRIVES)(lambda x, y: places.travel_m(np.array([x, y])))
        self._targets = cache(lambda count: _draw_targets(places, count))
        self._classifier: tuple[Part, Classifier] | None = None

    @cached_property
    def rings(self) -> list[Float[np.ndarray, "_ 2"]]:
        """Outlines for pictures [m]."""
        return building_rings(self.building)

    def simulator(self) -> Simulator:
        """A simulator for another robot."""
        return self._simulator.clone()

    def classifier(self, part: Part) -> Classifier:
        """The link-state classifier, one for all robots: its results for tables are cached with it."""
        if self._classifier is None or self._classifier[0] != part:
            self._classifier = part, CLASSIFIER.make(part, field="link_states")
        return self._classifier[1]

    def travel_m(self, target: Float[np.ndarray, "2"]) -> Float[np.ndarray, "ny nx"]:
        """`Reach.travel_m`, cached for repeated targets."""
        return self._travel_m(float(target[0]), float(target[1]))

    def targets(self, count: int) -> Float[np.ndarray, "count 2"]:
        """Places for targets, the same ones in every process."""
        return self._targets(count)


def _draw_targets(places: Reach, count: int) -> Float[np.ndarray, "count 2"]:
    rng = np.random.default_rng(_POOL_SEED)
    return np.array([make_task(places, rng).target for _ in range(count)])


_recent: list[Place] = []


def shared_place(plan: FloorPlan, config: SimulatorConfig, *, uses_radio: bool) -> Place:
    """The building of a plan, from the cache if it is there."""
    for place in reversed(_recent):
        # By identity: plans are large to compare, and sources return the same object again.
        if place.plan is plan and place.config == config and place.uses_radio == uses_radio:
            _recent.remove(place)
            _recent.append(place)
            return place
    place = Place(plan, config, uses_radio=uses_radio)
    _recent.append(place)
    for old in [one for one in _recent if one.uses_radio][:-_WITH_RADIO] or _recent[:-_BUILDINGS]:
        _recent.remove(old)
    return place


def route_action(place: Place, pose: Float[np.ndarray, "3"], target: Float[np.ndarray, "2"]) -> Action:
    """The next action along the shortest drive from a true pose to a target."""
    plan, travel = place.plan, place.travel_m(target)
    column, row = plan.to_cells(pose[:2]) - 0.5
    reach = _AHEAD_M / plan.resolution_m
    corner = np.maximum(np.floor([row - reach, column - reach]), 0).astype(int)
    end = np.maximum(np.ceil([row + reach, column + reach]) + 1, 0).astype(int)
    cells = np.argwhere(np.isfinite(travel[corner[0] : end[0], corner[1] : end[1]])) + corner
    gap = np.hypot(cells[:, 0] - row, cells[:, 1] - column)
    # A place whose remaining drive is shorter by more than the gap lies behind a wall.
    saved = place.reach.remaining_m(travel, pose[:2]) - travel[cells[:, 0], cells[:, 1]]
    cells = cells[(gap <= reach) & (saved <= (gap + 1) * plan.resolution_m)]
    if not len(cells):  # the robot stands between cells: straight to the target
        goal = target
    else:
        best = cells[np.argmin(travel[cells[:, 0], cells[:, 1]])]
        goal = plan.to_map(best[::-1] + 0.5)
    turn = wrap(float(np.arctan2(goal[1] - pose[1], goal[0] - pose[0]) - pose[2]))
    if abs(turn) <= _STRAIGHT_RAD:
        return Action.FORWARD
    return Action.LEFT if turn > 0 else Action.RIGHT
