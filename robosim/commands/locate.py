"""`robosim locate`."""

from pathlib import Path
from typing import Annotated

import numpy as np
from rich.table import Table
from tyro.conf import OmitArgPrefixes, Positional, arg

from robosim.commands.output import console, emit_result_file
from robosim.commands.shared_options import NO_OPTIONS, Reading, read, results_folder
from robosim.positioning.beacon_places import BeaconConfig
from robosim.support.checks import ADVANCED, Range
from robosim.support.reading import naming

_DEFAULTS = BeaconConfig()


def locate(
    route: Positional[Path],
    *,
    plan: str | None = None,
    map_from: Path | None = None,
    scans: Annotated[Path | None, ADVANCED] = None,
    beyond: Annotated[float | None, Range(0.05, 100, "m")] = None,
    not_received: float | None = None,
    how: Annotated[OmitArgPrefixes[BeaconConfig], arg(name="")] = _DEFAULTS,
    reading: Reading = NO_OPTIONS,
    out: Path | None = None,
) -> None:
    """Locate beacons, such as of Bluetooth or Wi-Fi, from powers that a robot received along its route.

    Walls between come from a plan, or from the map that the robot makes of its own scans; without either, power depends
    on distance alone. Writes beacons.json, with the place and covariance of each beacon after 25, 50 and 100 % of its
    readings, and beacons.png.

    Example: robosim locate route.csv --plan flat.yaml --out out/beacons

    Args:
        route: Table with a row for each reading (.csv): beacon, x_m, y_m, power_dbm (empty if not received) and, if
            known, time_s, heading_rad; beacon_x_m and beacon_y_m to print errors.
        plan: Floor plan in the frame of the table.
        map_from: Log of the robot with laser scans, as for robosim slam, instead of a plan. Rows of the table need
            time_s. Without x_m and y_m, positions and headings are those of the robot.
        scans: Scans for a log that is a TUM file; see robosim slam.
        beyond: Distance from the floor at which a beacon is less probable by a factor of e [m]; 0.3 with a plan,
            otherwise 3.
        not_received: Number in power_dbm that means that nothing was received, such as 100.
        how: What is known of powers.
        reading: How to read the plan.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.calibration.measured_powers import check_on_plan
    from robosim.logs.log_files import read_log
    from robosim.positioning.beacon_figure import draw_beacons
    from robosim.positioning.beacon_places import SHARES, locate_beacon
    from robosim.positioning.power_route import map_route, read_power_route
    from robosim.support.files import write_json
    from robosim.support.progress import stages_tracked

    if plan is not None and map_from is not None:
        raise ValueError(
            "plan and map_from are both given: give the plan, or the log that a map is made from."
        )
    floor_plan = None if plan is None else read(plan, reading)
    powers = read_power_route(route, needs_time=map_from is not None, not_received=not_received)
    if map_from is not None:
        log = read_log(map_from, scans, needs_times=True)
        floor_plan, powers = map_route(log, powers, stages_tracked(log.name, console))
    beyond = beyond or (3.0 if plan is None else 0.3)
    with results_folder(out, "locate") as folder:
        with naming(route, "powers along a route"):
            if plan is not None and floor_plan is not None:
                check_on_plan(floor_plan, powers.true_xy)
            readings = {name: [powers.readings(name, share) for share in SHARES] for name in powers.names}
            located = {
                name: [locate_beacon(each, floor_plan, beyond, how) for each in readings[name]]
                for name in readings
            }
        table = Table("beacon", "readings", "x [m]", "y [m]", "std [m]", "error [m]")
        result = {}
        for name, places in located.items():
            truth = powers.true_xy.get(name)
            steps = []
            for share, place in zip(SHARES, places, strict=True):
                step = {"share": share, "xy_m": place.xy, "covariance_m2": place.covariance}
                std_m = np.sqrt(np.trace(place.covariance))
                error = ""
                if truth is not None:
                    step["error_m"] = float(np.hypot(*(place.xy - truth)))
                    error = f"{step['error_m']:.1f}"
                row = (f"{100 * share:.0f} %", *(f"{value:.1f}" for value in (*place.xy, std_m)), error)
                table.add_row(name if share == SHARES[0] else "", *row)
                steps.append(step)
            result[name] = steps
        write_json(folder / "beacons.json", {"beacons": result})
        draw_beacons(
            powers, {name: places[-1] for name, places in located.items()}, floor_plan, folder / "beacons.png"
        )
    emit_result_file(folder / "beacons.json")
    console.print(table)
    if powers.true_xy:
        errors = [
            np.median([step["error_m"] for step in steps]) for steps in zip(*result.values(), strict=True)
        ]
        parts = ", ".join(f"{error:.1f} m" for error in errors)
        console.print(f"Median error after 25, 50 and 100 % of the readings: {parts}")
    console.print(f"Wrote beacons.json and beacons.png in {folder}")
