"""`robosim calibrate` and `robosim calibrate-materials`."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import numpy as np
import yaml
from rich.table import Table
from tyro.conf import Positional

from robosim.commands.episode_config import DEFAULT_START, DEFAULTS, Base, Settings
from robosim.commands.output import console, emit_result, emit_result_file
from robosim.commands.shared_options import NO_OPTIONS, Reading, read, results_folder
from robosim.plans.floorplan import FloorPlan
from robosim.robot.calibration import open_floor, read_runs, run_actions
from robosim.robot.robot_files import write_robot
from robosim.support.checks import FREQUENCY_HZ, SEED, Range
from robosim.support.reading import naming

#: Minima of the fit to powers are reported up to this difference of logarithms of the posterior.
_LIKELY = 2.0

if TYPE_CHECKING:
    from robosim.calibration.measured_powers import MeasuredPowers
    from robosim.calibration.power_fit import PowerFitConfig

_FREQUENCY_GHZ = Range(FREQUENCY_HZ.least / 1e9, FREQUENCY_HZ.greatest / 1e9, "GHz")


def calibrate_materials(
    plan: Positional[str],
    measured: Positional[Path],
    *,
    frequency_ghz: Annotated[float | None, _FREQUENCY_GHZ] = None,
    material: str = "partition",
    turn_deg: Annotated[float, Range(-360, 360, "degrees")] = 0.0,
    height: float = 1.5,
    range_db: float = 40.0,
    ceiling: Annotated[float, Range(0.1, 100, "m")] = 2.5,
    wall_thickness: Annotated[float, Range(1e-3, 2, "m")] = 0.1,
    sensitivity_dbm: Annotated[float | None, Range(-200, 100, "dBm")] = None,
    not_received: float | None = None,
    reading: Reading = NO_OPTIONS,
    out: Path | None = None,
) -> None:
    """Fit the materials of walls to measured paths, or to received powers.

    Paths: Materials are chosen on every other place and tested on the rest: for the walls without a colour in the plan,
    then for each colour. Paths are paired by delay (1 ns) and both azimuths (5 degrees). Writes materials.json,
    measured.png and, if the plan has colours, the plan with the chosen materials.

    Powers: Permittivity and conductivity of the walls without a colour, an offset of each beacon and patterns of the
    antennas are fitted in every other square of 1 m of the floor and tested in the rest. Writes materials.json,
    wall.yaml (a material for plans and --material), measured.png and residuals.png.

    Example: robosim calibrate-materials hall.yaml paths.csv --turn-deg -1.6 --out out/hall

    Args:
        plan: Floor plan in the frame of the table. Walls of "vacuum" do not reflect: use them where the plan ends but
            the building continues.
        measured: Table with a row for each path (.csv): place, tx_x_m, tx_y_m, tx_heading_rad, rx_x_m, rx_y_m,
            rx_heading_rad, range_m, aod_rad, aoa_rad, power_db. Or with a row for each reading of a power: beacon,
            beacon_x_m, beacon_y_m, beacon_z_m, x_m, y_m, power_dbm (empty if not received) and, if known, z_m,
            heading_rad.
        frequency_ghz: Carrier frequency [GHz]; if not given, 60 for paths and 2.44 for powers.
        material: First material of walls without a colour, for paths.
        turn_deg: Correction of the transmitter's heading in the table of paths [deg].
        height: Height of both ends of paths, and of places without z_m [m].
        range_db: Traced paths that are weaker than the strongest of their place by more than this are ignored [dB].
        ceiling: Height of the ceiling, for powers [m].
        wall_thickness: Thickness of walls, for powers [m].
        sensitivity_dbm: Lowest power that the receiver reports [dBm]; no limit if not given.
        not_received: Number in power_dbm that means that nothing was received, such as 100.
        reading: How to read the plan.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.building.building import BuildingConfig, make_building
    from robosim.calibration.material_fit import ADDED, EDGES, Fit
    from robosim.calibration.measured_figure import draw_measured
    from robosim.calibration.measured_paths import MatchConfig, read_measured_paths
    from robosim.calibration.measured_powers import check_on_plan, is_table_of_powers, read_measured_powers
    from robosim.calibration.power_fit import PowerFitConfig
    from robosim.plans.files import write_ros
    from robosim.support.files import write_json
    from robosim.support.progress import unit_progress

    with results_folder(out, "calibrate-materials") as folder:
        floor_plan = read(plan, reading)
        has_powers = is_table_of_powers(measured)
        frequency_ghz = frequency_ghz or (2.44 if has_powers else 60.0)
        if has_powers:
            config = PowerFitConfig(
                frequency_hz=frequency_ghz * 1e9,
                ceiling_m=ceiling,
                thickness_m=wall_thickness,
                sensitivity_dbm=sensitivity_dbm,
            )
            powers = read_measured_powers(measured, height, not_received)
            with naming(measured, "a table of received powers"):
                check_on_plan(floor_plan, dict(zip(powers.names, powers.beacons, strict=True)))
                _fit_powers(floor_plan, powers, config, folder)
            console.print(
                f"Next: robosim trace {plan} --material {quote(str(folder / 'wall.yaml'))} "
                f"--frequency-ghz {frequency_ghz:g}"
            )
            return
        hall = read_measured_paths(measured, math.radians(turn_deg))
        fit = Fit(hall, frequency_ghz * 1e9, MatchConfig(height_m=height, range_db=range_db))
        with unit_progress(console, "materials tried", fit.n_trials(floor_plan)) as tried:
            best = fit.choose(floor_plan, material, tried)
        fitted = replace(floor_plan, materials=best.colours)
        rows = {name: fit.explained(fitted, best.wall, kind) for name, kind in ADDED.items()}
        building = make_building(fitted, config=BuildingConfig(wall_material=best.wall))
        draw_measured(hall, building, fit.match(fitted, best.wall, EDGES), folder / "measured.png")
        if fitted.materials:
            write_ros(fitted, folder / "plan" / f"{fitted.name}.yaml")
        explained = {name: asdict(row) for name, row in rows.items()}
        write_json(folder / "materials.json", {"fit": asdict(best), "explained": explained})
    emit_result_file(folder / "materials.json")
    table = Table("traced", "paths explained", "by chance", "power explained", "off [dB]")
    for name, row in rows.items():
        shares = (f"{100 * share:.1f} %" for share in (row.paths, row.by_chance, row.power))
        table.add_row(name, *shares, f"{row.off_db:.1f}")
    console.print(table)
    console.print(
        f"Walls fit {best.wall} best: reflections are off by {best.after_db[0]:.1f} dB, at the other places "
        f"{best.after_db[1]:.1f} dB; with {material} {best.before_db[0]:.1f} and {best.before_db[1]:.1f} dB."
    )
    console.print(f"Wrote materials.json and measured.png in {folder}")
    console.print(f"Next: robosim trace {plan} --material {best.wall} --frequency-ghz {frequency_ghz:g}")


def _fit_powers(plan: FloorPlan, measured: "MeasuredPowers", config: "PowerFitConfig", folder: Path) -> None:
    """Fit walls to received powers, and write and print the result."""
    from robosim.calibration.power_figures import draw_powers, draw_residuals
    from robosim.calibration.power_fit import STEPS, WALL_PARAMETERS, fit_powers
    from robosim.support.files import write_json, write_whole
    from robosim.support.progress import unit_progress

    with unit_progress(console, "steps", STEPS) as done:
        fit = fit_powers(measured, plan, config, done)
    halves = ("fitted", "held_out", "distance_law_fitted", "distance_law_held_out")
    write_json(
        folder / "materials.json",
        {
            "parameters": {
                name: dict(zip(("value", "std"), pair, strict=True)) for name, pair in fit.parameters.items()
            },
            "log_covariance_of_wall": fit.log_covariance,
            "minima": [
                dict(zip((*WALL_PARAMETERS, "less_likely"), minimum, strict=True)) for minimum in fit.minima
            ],
            "rms_db": {name: dict(zip(halves, errors, strict=True)) for name, errors in fit.rms_db.items()},
        },
    )
    layer = {name: getattr(fit.wall.layers[0], name) for name in (*WALL_PARAMETERS, "thickness_m")}
    write_whole(folder / "wall.yaml", yaml.safe_dump({"name": fit.wall.name, "layers": [layer]}).encode())
    draw_powers(measured, fit, folder / "measured.png")
    draw_residuals(measured, fit, folder / "residuals.png")
    emit_result_file(folder / "materials.json")
    table = Table("error [dB]", "fitted", "held out", "law of distance, fitted", "held out ")
    for name, errors in fit.rms_db.items():
        table.add_row(name if name == "mean" else f"beacon {name}", *(f"{error:.1f}" for error in errors))
    console.print(table)
    for name in WALL_PARAMETERS:
        value, std = fit.parameters[name]
        console.print(f"{name} {value:.3g}, standard deviation {std:.2g}")
    if others := [f"{minimum[0]:.3g}" for minimum in fit.minima[1:] if minimum[2] < _LIKELY]:
        console.print(f"Nearly as likely are relative permittivities of {', '.join(others)}.")
    console.print(f"Wrote materials.json, wall.yaml, measured.png and residuals.png in {folder}")


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
    from robosim.drawing.plots import draw_errors
    from robosim.parts import PHYSICS
    from robosim.support.progress import tracked
    from slam.odometry import calibrated

    if settings.team.robots != "1":
        raise ValueError(
            f"robots is {settings.team.robots}: calibrate measures one robot. Give it by --robot."
        )
    simulator = settings.simulator
    with results_folder(out, "calibrate") as folder:
        if measured is not None:
            done = read_runs(measured)
        else:
            world = PHYSICS.make(simulator.physics, open_floor(), robot=simulator.robot)
            with tracked(range(runs), "runs of each action", console) as numbers:
                done = run_actions(world, simulator.robot.noise, numbers, np.random.default_rng(seed))
        errors_of_actions = calibrated(*done)
        write_robot(folder / "robot.json", replace(simulator.robot, odometry=errors_of_actions))
        draw_errors(done, folder / "odometry.png")
    table = Table("action", "runs", "mean x, y [mm]", "yaw [deg]", "std x, y [mm]", "yaw [deg] ")
    rows = []
    for action, errors in done.errors.items():
        error = errors_of_actions.of_actions[action]
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
