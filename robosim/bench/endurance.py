"""Going on and on: thousands of decisions in one building, and whether anything runs away.

The robot explores; when nothing is left to see it goes from one place that it knows to the next, drawn at random. At
every decision pose, odometry and the map around must be finite. What the navigator holds is what pickling it takes;
peak memory is that of the process, with the simulator, its OpenGL and PyTorch.
"""

import pickle
import resource
import sys
import time
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table
from rich.text import Text

from robosim.bench.slam_plan import SlamSettings
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.navigation import Navigator, make_navigator
from robosim.plans.floorplan import FloorPlan
from robosim.simulator import Simulator
from robosim.support.files import write_json
from robosim.support.progress import told_units
from slam.actions import Action
from slam.grid import MapEstimate

#: Rows of the table.
PARTS = 10
#: A place counts as reached within this distance [m], and is given up after so many decisions.
REACHED_M, GIVEN_UP = 0.3, 150


@dataclass(eq=False)
class _Part:
    """Some decisions in a row."""

    errors_m: list[float]
    seconds: list[float]
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
    task = settings.task(reach(building, config.robot.radius_m), plan.name)
    navigator = make_navigator(config, mapper=settings.mapper)
    wanderer = _Wanderer(navigator, np.random.default_rng([settings.seed, 2]))
    rows = []
    with closing(Simulator(building, config)) as simulator, told_units(console, "parts", PARTS, 0) as tell:
        view = simulator.reset(task, np.random.default_rng([settings.seed, 1]))
        navigator.mapper.reset(task.start)
        action: Action | None = None
        for k in range(PARTS):
            part = _Part([], [])
            for _ in range(settings.steps * k // PARTS, settings.steps * (k + 1) // PARTS):
                begin = time.perf_counter()
                estimate = navigator.mapper.update(view.depth, action, view.odometry)
                action = wanderer.act(estimate)
                part.seconds.append(time.perf_counter() - begin)
                part.errors_m.append(float(np.hypot(*(estimate.pose - simulator.pose)[:2])))
                part.not_finite += not _finite(estimate)
                view, motion = simulator.step(action)
                part.collisions += motion.collided
            rows.append(_row(part, settings.steps * (k + 1) // PARTS, navigator, estimate))
            tell(f"{rows[-1]['decisions']} decisions")
    write_json(out / "endurance.json", {"plan": plan.name, "settings": asdict(settings), "parts": rows})
    return _table(plan.name, rows)


class _Wanderer:
    """Explores, and when all is seen goes to places drawn at random."""

    def __init__(self, navigator: Navigator, rng: np.random.Generator) -> None:
        self._navigator, self._rng = navigator, rng
        self._place: Float[np.ndarray, 2] | None = None
        self._left = 0

    def act(self, estimate: MapEstimate) -> Action:
        """The next action."""
        goal = self._navigator.explorer.goal(estimate) if self._place is None else None
        if goal is None:
            goal = self._place = self._wander(estimate)
        plan = self._navigator.planner.plan(estimate, goal)
        return self._navigator.controller.act(estimate.pose, plan)

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
