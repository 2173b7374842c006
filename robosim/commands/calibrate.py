"""`robosim calibrate`."""

from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Annotated

import numpy as np
from rich.table import Table
from tyro.conf import Positional

from robosim.commands.episode_config import DEFAULT_START, DEFAULTS, Base, Settings
from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import results_folder
from robosim.robot.calibration import open_floor, read_runs, run_actions
from robosim.robot.robots import write_robot
from robosim.support.checks import SEED, Range


def calibrate(
    measured: Positional[Path | None] = None,
    *,
    runs: Annotated[int, Range(10, 1_000_000, "runs of each action")] = 1000,
    seed: Annotated[int, SEED] = 0,
    base: Base = DEFAULT_START,
    settings: Settings = DEFAULTS,
    out: Path | None = None,
) -> None:
    """Measure the errors of a robot's odometry, action by action: mean and covariance.

    Writes robot.json, the robot with these errors, for --robot of other commands, and odometry.png. A simulated robot
    runs on an open floor and is compared with its true motions. For a real robot, give a table of measured and true
    motions (by motion capture, total station or marks on the floor), one row per run of an action.

    Example: robosim calibrate --robot locobot --noise.level 2 --out out/locobot

    Args:
        measured: Table of runs of a real robot (.csv) with columns action (forward, left, right, and optionally
            backward), measured_x_m, measured_y_m, measured_yaw_rad, true_x_m, true_y_m, true_yaw_rad: in the robot's
            frame before the action.
        runs: Runs of each action of a simulated robot.
        seed: Seed of its noise.
        base: Values that the options below start from.
        settings: Robot, noise and physics.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.drawing.odometry_errors import draw_errors
    from robosim.parts import PHYSICS
    from robosim.support.progress import tracked
    from slam.mapping.odometry import calibrated

    simulator = settings.simulator
    with results_folder(out, "calibrate") as folder:
        if measured is not None:
            done = read_runs(measured)
        else:
            world = PHYSICS.make(simulator.physics, open_floor(), robot=simulator.robot)
            with tracked(range(runs), "runs of each action", console) as numbers:
                done = run_actions(world, simulator.noise, numbers, np.random.default_rng(seed))
        found = calibrated(*done)
        write_robot(folder / "robot.json", replace(simulator.robot, odometry=found))
        draw_errors(done, folder / "odometry.png")
    table = Table("action", "runs", "mean x, y [mm]", "yaw [deg]", "std x, y [mm]", "yaw [deg] ")
    rows = []
    for action, errors in done.errors.items():
        error = found.of_actions[action]
        mean, std = np.array(error.mean), np.sqrt(np.diag(error.covariance))
        name, count = action.name.lower(), len(errors)
        rows.append({"action": name, "runs": count, "mean": mean, "std": std})
        cells = [f"{1000 * v[0]:.2f}, {1000 * v[1]:.2f}" for v in (mean, std)]
        turns = [f"{round(np.degrees(v[2]), 3) + 0.0:.3f}" for v in (mean, std)]  # no -0.000
        table.add_row(name, str(count), cells[0], turns[0], cells[1], turns[1])
    emit_result({"odometry": rows}, folder)
    console.print(table)
    console.print(f"Wrote robot.json and odometry.png in {folder}")
    console.print(f"Next: robosim episode flat --robot {quote(str(folder / 'robot.json'))}")
