"""Calibrating a robot's odometry: each action many times, and what was measured against what was true.

A simulated robot is run here; of a real one, a table says what was measured (`read_runs`), against a motion capture, a
total station, or marks on the floor. `slam.odometry.calibrated` makes of either what a mapper takes.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building, make_building
from robosim.plans.floorplan import FREE
from robosim.plans.formats.plan_array import plan_from_array
from robosim.robot.motion import Physics
from robosim.robot.odometry import NoiseModel
from robosim.support.checks import check_choice
from robosim.support.reading import reading
from robosim.support.text_in import csv_number, csv_rows
from slam.actions import MOVES, PUBLISHED, Action
from slam.odometry import calibrated
from slam.poses import between, wrap


class Runs(NamedTuple):
    """Displacements of each run of each action: x, y [m] and yaw [rad], robot's frame before it."""

    errors: Mapping[Action, Float[np.ndarray, "n 3"]]
    """Measured minus true ones."""
    motions: Mapping[Action, Float[np.ndarray, "n 3"]]
    """True ones."""


#: Side of the open floor [m].
_SIDE_M = 4.0
#: Columns of a table of runs.
COLUMNS = (
    "action",
    "measured_x_m",
    "measured_y_m",
    "measured_yaw_rad",
    "true_x_m",
    "true_y_m",
    "true_yaw_rad",
)
#: Displacements are no larger [m, rad]; turns in degrees mostly are.
_MOST = {name: 7.0 if name.endswith("_rad") else 100.0 for name in COLUMNS[1:]}
#: Error and true motion of each run.
_Samples = dict[Action, list[tuple[np.ndarray, np.ndarray]]]


def open_floor() -> Building:
    """A floor with room for every action in its middle."""
    floor = np.full((80, 80), FREE, np.uint8)
    return make_building(plan_from_array(floor, resolution_m=_SIDE_M / 80, name="open floor"))


def run_actions(world: Physics, noise: NoiseModel, runs: Iterable[object], rng: np.random.Generator) -> Runs:
    """Run each action once for each of `runs` on the open floor."""
    start = np.array([_SIDE_M / 2, _SIDE_M / 2, 0.0])
    samples: _Samples = {action: [] for action in MOVES}
    (backwards,) = rng.spawn(1)  # of its own: the published actions err the same with it and without
    for _ in runs:
        for action in MOVES:
            drawn = backwards if action is Action.BACKWARD else rng
            world.reset(start)
            world.move(noise.actuation(action, drawn))
            motion = between(start, world.pose)
            samples[action].append((noise.sense(action, motion, drawn) - motion, motion))
    return _runs(samples)


def read_runs(path: Path) -> Runs:
    """Runs from a table with `COLUMNS`, a row for each run of forward, left, right or backward.

    Without backward steps, reversed forward steps are used.

    Raises:
        FileError: If the file is damaged, a column is missing, a value is out of range, or an action has fewer than ten
            runs.
    """
    names = [action.name.lower() for action in MOVES]
    samples: _Samples = {action: [] for action in MOVES}
    remedy = f"Give a CSV file with columns {','.join(COLUMNS)}: a row for each run of an action"
    with reading(path, "a table of runs", remedy) as file:
        rows, _ = csv_rows(file.read(), COLUMNS)
        for number, row in rows:
            check_choice(f"action in line {number}", row["action"], names)
            values = np.array([csv_number(row, name, number, -bound, bound) for name, bound in _MOST.items()])
            error = values[:3] - values[3:]
            error[2] = wrap(float(error[2]))
            samples[Action[row["action"].upper()]].append((error, values[3:]))
        runs = _runs(samples)
        calibrated(*runs)  # raises an error, named after the table, if there are too few runs
    return runs


def _runs(samples: _Samples) -> Runs:
    usable = {action: runs for action, runs in samples.items() if runs or action in PUBLISHED}
    errors, motions = (
        {action: np.array([run[k] for run in runs]).reshape(-1, 3) for action, runs in usable.items()}
        for k in (0, 1)
    )
    return Runs(errors, motions)
