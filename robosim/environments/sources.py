"""Sources of plans for an environment, and the buildings made from them, each built once for all robots of a process.

An environment is given one of

- a floor plan, its file, the name of a shipped one, a folder of plans, or several of these;
- a suite file: then the tasks are the suite's;
- "homes" or "homes:500": that many generated homes (`robosim.generator`); or `GeneratedHomes(...)`.

Plans are read on first use, and cached. A building holds walls for robots and rays, the places that a robot can reach,
a world to clone, and shortest drives to targets. The most recently used buildings are cached.

The guide along the shortest drive turns to the nearby place from which the remaining drive is shortest, and drives
there. Collected trajectories mix in random actions, so that they show how to return to the route, as in DART (Laskey et
al., Noise injection for robust imitation learning, CoRL 2017).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.building.building import make_building
from robosim.building.reach import Reach, reach
from robosim.drawing.plan_view import building_rings
from robosim.evaluation.suite import Suite, is_suite, read_suite
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.parts import CLASSIFIER
from robosim.plans.files import find_plans, read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link_state import Classifier
from robosim.simulator import SimulatorConfig
from robosim.support.checks import SEED, Range, checked
from robosim.support.parts import Part
from robosim.task.tasks import make_task
from robosim.world import ROBOT, World
from slam.actions import TURN_RAD, Action
from slam.poses import wrap

#: Cached plans.
_CACHED = 256


class TaskSpec(NamedTuple):
    """A plan, and what a source specifies of the task in it; the rest is drawn."""

    plan: FloorPlan
    start: Float[np.ndarray, "3"] | None = None
    """x [m], y [m], yaw [rad] in `map`."""
    target: Float[np.ndarray, "2"] | None = None


@runtime_checkable
class Source(Protocol):
    """Plans, or tasks in plans, by number."""

    def __len__(self) -> int:
        """Number of plans or tasks."""

    def task_spec(self, number: int) -> TaskSpec:
        """Plan and task of a number."""


@dataclass(frozen=True, kw_only=True)
@checked
class GeneratedHomes:
    """Generated homes."""

    count: Annotated[int, Range(1, 10_000_000, "homes")] = 100
    """Different homes."""
    seed: Annotated[int, SEED] = 0
    """Seed of the first home; the others follow it."""
    config: GeneratorConfig = field(default_factory=GeneratorConfig)
    """Kind of building."""

    def __len__(self) -> int:
        return self.count

    def task_spec(self, number: int) -> TaskSpec:
        """A home without a task."""
        return TaskSpec(_home(self.seed + number, self.config))


class _Plans:
    """Floor plans and their files."""

    def __init__(self, plans: Sequence[FloorPlan | Path]) -> None:
        self._plans = plans

    def __len__(self) -> int:
        return len(self._plans)

    def task_spec(self, number: int) -> TaskSpec:
        plan = self._plans[number]
        return TaskSpec(plan if isinstance(plan, FloorPlan) else _plan_of(plan))


class _Tasks:
    """Tasks of a suite."""

    def __init__(self, suite: Suite) -> None:
        suite.check_places()
        self._suite = suite

    def __len__(self) -> int:
        return len(self._suite.tasks)

    def task_spec(self, number: int) -> TaskSpec:
        task = self._suite.tasks[number]
        x, y, yaw_deg = task.start
        plan = _plan_of(self._suite.plans[task.plan], self._suite.reader)
        return TaskSpec(plan, np.array([x, y, np.radians(yaw_deg)]), np.array(task.target))


def source_of(plan: object) -> Source:
    """The source for the argument `plan` of an environment; ValueError or MapError if there is none."""
    if isinstance(plan, Source):
        return plan
    if isinstance(plan, str) and plan.partition(":")[0] == "homes":
        count = plan.partition(":")[2]
        if count and not count.isdecimal():
            raise ValueError(f"plan is {plan!r}, expected homes, or a number of them such as homes:500.")
        return GeneratedHomes(count=int(count)) if count else GeneratedHomes()
    if isinstance(plan, str | Path) and is_suite(plan):
        return _Tasks(read_suite(plan))
    several = [plan] if isinstance(plan, str | Path | FloorPlan) else plan
    if not isinstance(several, Sequence) or not several:
        raise ValueError(
            f"plan is {plan!r}, expected a floor plan, a file, a folder, a suite, or several plans."
        )
    plans: list[FloorPlan | Path] = []
    for entry in several:
        plans += [entry] if isinstance(entry, FloorPlan) else find_plans([entry])
    return _Plans(plans)


@lru_cache(_CACHED)
def _home(seed: int, config: GeneratorConfig) -> FloorPlan:
    return generate_plan(seed, config=config)


@lru_cache(_CACHED)
def _plan_of(file: Path, reader: str = "auto") -> FloorPlan:
    return read_plan(file, reader=reader)


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
        self.reach = places = reach(self.building, *config.robot.hull_m)
        building = self.building
        # The cached functions do not refer to this object, so that it is freed with its last reference.
        self._world = cache(
            lambda names: World(building, dict.fromkeys(names, config), uses_radio=uses_radio)
        )
        self._travel_m = lru_cache(_DRIVES)(lambda x, y: places.travel_m(np.array([x, y])))
        self._targets = cache(lambda count: _draw_targets(places, count))
        self._classifier: tuple[Part, Classifier] | None = None

    @cached_property
    def rings(self) -> list[Float[np.ndarray, "_ 2"]]:
        """Outlines for pictures [m]."""
        return building_rings(self.building)

    def world(self, names: tuple[str, ...] = (ROBOT,)) -> World:
        """Return a world of other robots of these names, alone in the building."""
        return self._world(names).clone()

    def classifier(self, classifier: Part) -> Classifier:
        """The link-state classifier, one for all robots: its results for tables are cached with it."""
        if self._classifier is None or self._classifier[0] != classifier:
            self._classifier = classifier, CLASSIFIER.make(classifier, field="link_states")
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
    for old in [place for place in _recent if place.uses_radio][:-_WITH_RADIO] or _recent[:-_BUILDINGS]:
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
