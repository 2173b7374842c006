"""Going on and on: thousands of decisions in one building, and whether anything runs away.

The robot explores; when nothing is left to see it goes from one place that it knows to the next, drawn at random. At
every decision pose, odometry and the map around must be finite. What the navigator holds is what pickling it takes;
peak memory is that of the process, with the simulator, its OpenGL and PyTorch.
"""

import pickle
import resource
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode import Turn, drive
from robosim.navigation import Navigator, make_navigator
from robosim.plans.floorplan import FloorPlan
from robosim.policies.belief import TargetBelief
from robosim.policies.situation import Situation
from robosim.simulator import Simulator
from robosim.support.files import write_json
from robosim.support.progress import told_units
from robosim.support.stopwatch import Stopwatch
from slam.exploration.explorer import Explorer
from slam.grid import MapEstimate
from tests.benchmarks.slam_plan import SlamSettings

#: Rows of the table.
PARTS = 10
#: A place counts as reached within this distance [m], and is given up after so many decisions.
REACHED_M, GIVEN_UP = 0.3, 150


@dataclass(eq=False)
class _Part:
    """Some decisions in a row."""

    errors_m: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    not_finite: int = 0
    collisions: int = 0


def run(plan: FloorPlan, settings: SlamSettings, *, out: Path, console: Console) -> Table:
    """Drive, write `endurance.json`, and return the table.

    Args:
        plan: Where.
        settings: Mapper, number of decisions, seed and noise.
        out: Folder for the file.
        console: Where progress is shown.
    """
    building = make_building(plan)
    config = settings.simulator
    task = settings.task(reach(building, config.robot.radius_m, config.robot.height_m), plan.name)
    navigator = make_navigator(config, mapper=settings.mapper)
    wanderer = Wanderer(navigator.explorer, np.random.default_rng([settings.seed, 2]))
    watch, rng = Stopwatch(), np.random.default_rng([settings.seed, 1])
    with told_units(console, "parts", PARTS, 0) as tell:
        tally = _Tally(settings.steps, navigator, watch, tell)
        with closing(Simulator(building, config)) as simulator:
            drive(simulator, navigator, wanderer, task, rng, tally.judge, watch=watch)
    write_json(out / "endurance.json", {"plan": plan.name, "settings": asdict(settings), "parts": tally.rows})
    return _table(plan.name, tally.rows)


class _Tally:
    """Looks on, and makes a row of each part."""

    def __init__(
        self, steps: int, navigator: Navigator, watch: Stopwatch, tell: Callable[[str], None]
    ) -> None:
        self._ends = [steps * (k + 1) // PARTS for k in range(PARTS)]
        self._navigator, self._watch, self._tell = navigator, watch, tell
        self._part, self._decisions, self._before_s = _Part(), 0, 0.0
        self.rows: list[dict[str, Any]] = []

    def judge(self, turn: Turn) -> bool:
        """Take in a turn; whether there are more to come."""
        part = self._part
        if turn.motion is not None:
            so_far_s = sum(self._watch.seconds[stage] for stage in ("mapper", "goal", "planner"))
            part.seconds.append(so_far_s - self._before_s)
            self._before_s = so_far_s
            part.collisions += turn.motion.collided
            self._decisions += 1
        while len(self.rows) < PARTS and self._decisions == self._ends[len(self.rows)]:
            self.rows.append(_row(part, self._decisions, self._navigator, turn.estimate))
            self._tell(f"{self._decisions} decisions")
            part = self._part = _Part()
        part.errors_m.append(float(np.hypot(*(turn.estimate.pose - turn.pose)[:2])))
        part.not_finite += not _finite(turn.estimate)
        return len(self.rows) < PARTS


class Wanderer:
    """A goal policy that explores, and when all is seen goes to places drawn at random."""

    seeks_target, uses_radio, uses_camera = False, False, False
    belief: TargetBelief | None = None

    def __init__(self, explorer: Explorer, rng: np.random.Generator) -> None:
        self._explorer, self._rng = explorer, rng
        self._place: Float[np.ndarray, 2] | None = None
        self._left = 0

    def goal(self, situation: Situation) -> Float[np.ndarray, "2"]:
        """A frontier, or a place."""
        goal = self._explorer.goal(situation.estimate) if self._place is None else None
        if goal is None:
            goal = self._place = self._wander(situation.estimate)
        return goal

    def _wander(self, estimate: MapEstimate) -> Float[np.ndarray, "2"]:
        """The place on the way, or a new one among those seen free."""
        self._left -= 1
        place = self._place
        if place is not None and self._left > 0 and np.hypot(*(place - estimate.pose[:2])) > REACHED_M:
            return place
        self._left = GIVEN_UP
        free = np.argwhere(estimate.explored & estimate.known_free)
        row, column = free[self._rng.integers(len(free))]
        return estimate.frame.to_points(np.array([column, row]) + 0.5)


def _finite(estimate: MapEstimate) -> bool:
    guess = estimate.anticipated_probability
    maps = (estimate.obstacle_probability,) if guess is None else (estimate.obstacle_probability, guess)
    return bool(np.isfinite(estimate.pose).all() and all(np.isfinite(values.sum()) for values in maps))


def _row(part: _Part, decisions: int, navigator: Navigator, estimate: MapEstimate) -> dict[str, Any]:
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "decisions": decisions,
        "not_finite": part.not_finite,
        "pose_error_median_m": float(np.median(part.errors_m)),
        "pose_error_most_m": float(np.max(part.errors_m)),
        "collisions": part.collisions,
        "ms": 1000 * float(np.median(part.seconds)),
        "cells": int(np.prod(estimate.frame.shape)),
        "held_bytes": held_bytes(navigator),
        "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit,
    }


def held_bytes(navigator: Navigator) -> int:
    """Memory that a navigator holds: map, marks, plans and all that it remembers."""
    return len(pickle.dumps(tuple(navigator)))


def _table(name: str, rows: list[dict[str, Any]]) -> Table:
    table = Table(title=Text(f"{rows[-1]['decisions']:,} decisions in {name}", "table.title"))
    for column in ("decisions", "not finite", "pose error: median [cm]", "most [cm]", "collisions"):
        table.add_column(column, justify="right")
    for column in ("ms a decision", "map cells", "navigator [MB]", "process, peak [MB]"):
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(
            f"{row['decisions']:,}",
            str(row["not_finite"]),
            f"{100 * row['pose_error_median_m']:.1f}",
            f"{100 * row['pose_error_most_m']:.1f}",
            str(row["collisions"]),
            f"{row['ms']:.1f}",
            f"{row['cells']:,}",
            f"{row['held_bytes'] / 1e6:.1f}",
            f"{row['peak_bytes'] / 1e6:.0f}",
        )
    return table
