"""Thousands of decisions in one building: whether the pose drifts, memory grows, or a number becomes NaN or infinite.

The robot explores; when nothing is left to see it goes from one place that it knows to the next, drawn at random. At
every decision pose, odometry and the map around must be finite. Memory of the navigator is what pickling it takes; peak
memory is that of the process, with the simulator and its OpenGL.
"""

import pickle
import resource
from contextlib import closing

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.agent import Agent
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.navigation import make_navigator
from robosim.plans.floorplan import FloorPlan
from robosim.policies.estimates import Estimates
from robosim.policies.goals import GoalPolicy
from robosim.simulator import Observation
from robosim.support.progress import tracked
from robosim.support.stopwatch import Stopwatch
from robosim.world import ROBOT, World
from slam.exploration.explorer import Explorer
from slam.grid import MapEstimate
from tests.benchmarks.harness import DEFAULT, Options, console, plans_of
from tests.benchmarks.mapping import DEFAULT_SETTINGS, Settings
from tests.benchmarks.results import Results

#: Parts of a run, a row each.
PARTS = 10
#: A place counts as reached within this distance [m], and is given up after so many decisions.
REACHED_M, GIVEN_UP = 0.3, 150


def main(
    plan: Positional[str] = "office",
    *,
    settings: OmitArgPrefixes[Settings] = DEFAULT_SETTINGS,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Endurance: thousands of decisions in one building; pose error, memory, and numbers that are not finite.

    docs/results has it with --steps 10000, which takes ten minutes.

    Args:
        plan: Floor plan.
        settings: Mapper, decisions and noise.
        options: Of every benchmark.
    """
    return options.finish("endurance", run(plans_of([plan])[0], settings, options.seed))


def run(plan: FloorPlan, settings: Settings, seed: int) -> Results:
    """Drive, and add a row for each tenth of the decisions."""
    building, config = make_building(plan), settings.simulator
    task = settings.task(reach(building, *config.robot.hull_m), seed)
    navigator = make_navigator(config, mapper=settings.mapper)
    wanderer = Wanderer(navigator.explorer, np.random.default_rng([seed, 2]))
    watch, results, turns = Stopwatch(), Results(), settings.steps // PARTS
    agent = Agent(navigator, wanderer, config.robot, watch=watch)
    with (
        tracked(range(PARTS), "parts", console) as parts,
        closing(World(building, {ROBOT: config}, watch)) as world,
    ):
        sensed = world.reset({ROBOT: task}, np.random.default_rng([seed, 1]))[ROBOT]
        agent.reset(task.start)
        before_s = 0.0
        for number in parts:
            errors_m, not_finite, collisions = [], 0, 0
            for _ in range(turns):
                decision = agent.act(sensed)
                assert decision is not None  # it wanders on
                estimate = decision.estimates
                errors_m.append(float(np.hypot(*(estimate.pose - world.truth(ROBOT).pose)[:2])))
                sensed = world.step({ROBOT: decision.command})[ROBOT]
                motion = world.truth(ROBOT).motion
                not_finite += not _is_finite(estimate.map)
                collisions += motion is not None and motion.collided
            seconds = sum(watch.seconds[stage] for stage in ("mapper", "goal", "planner"))
            values = {
                "not finite": (not_finite, "", 0),
                "pose error, median": (100 * np.median(errors_m), "cm", 1),
                "largest": (100 * np.max(errors_m), "cm", 1),
                "collisions": (collisions, "", 0),
                "a decision": (1000 * (seconds - before_s) / turns, "ms", 1),
                "cells of the map": (int(np.prod(estimate.map.frame.shape)), "", 0),
                "navigator": (len(pickle.dumps(tuple(navigator))) / 1e6, "MB", 1),
                "process, peak": (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3, "MB", 0),
            }
            done = f"{(number + 1) * turns:,} decisions"
            for name, (value, unit, digits) in values.items():
                results.add("endurance", done, name, value, unit, digits=digits, cases=turns)
            before_s = seconds
    return results


class Wanderer(GoalPolicy):
    """A goal policy that explores, and when all is seen goes to places drawn at random."""

    seeks_target = False

    def __init__(self, explorer: Explorer, rng: np.random.Generator) -> None:
        self._explorer, self._rng = explorer, rng
        self._place: Float[np.ndarray, 2] | None = None
        self._left = 0

    def goal(self, sensed: Observation, estimated: Estimates) -> Float[np.ndarray, "2"]:
        """A frontier, or a place."""
        goal = self._explorer.goal(estimated.map) if self._place is None else None
        if goal is None:
            goal = self._place = self._wander(estimated.map)
        return goal

    def _wander(self, estimate: MapEstimate) -> Float[np.ndarray, "2"]:
        """The place that the robot drives to, or a new one among those seen free."""
        self._left -= 1
        place = self._place
        if place is not None and self._left > 0 and np.hypot(*(place - estimate.pose[:2])) > REACHED_M:
            return place
        self._left = GIVEN_UP
        free = np.argwhere(estimate.explored & estimate.known_free)
        row, column = free[self._rng.integers(len(free))]
        return estimate.frame.to_points(np.array([column, row]) + 0.5)


def _is_finite(estimate: MapEstimate) -> bool:
    guess = estimate.anticipated_probability
    maps = (estimate.obstacle_probability,) if guess is None else (estimate.obstacle_probability, guess)
    return bool(np.isfinite(estimate.pose).all() and all(np.isfinite(values.sum()) for values in maps))
