"""`robosim calibrate-materials`."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

from rich.table import Table
from tyro.conf import Positional

from robosim.commands.output import console, emit_result_file
from robosim.commands.shared_options import NO_OPTIONS, Reading, read, results_folder
from robosim.support.checks import FREQUENCY_HZ, Range

_FREQUENCY_GHZ = Range(FREQUENCY_HZ.least / 1e9, FREQUENCY_HZ.most / 1e9, "GHz")


def calibrate_materials(
    plan: Positional[str],
    paths: Positional[Path],
    *,
    frequency_ghz: Annotated[float, _FREQUENCY_GHZ] = 60.0,
    material: str = "partition",
    turn_deg: Annotated[float, Range(-360, 360, "degrees")] = 0.0,
    height: float = 1.5,
    range_db: float = 40.0,
    reading: Reading = NO_OPTIONS,
    out: Path | None = None,
) -> None:
    """Compare traced paths with measured ones, and choose the materials of walls by the strengths of paths.

    Materials are chosen on every other place and tested on the rest: for the walls without a colour in the plan, then
    for each colour. Paths are paired by delay (1 ns) and both azimuths (5 degrees). Writes materials.json, measured.png
    and, if the plan has colours, the plan with the chosen materials.

    Example: robosim calibrate-materials hall.yaml paths.csv --turn-deg -1.6 --out out/hall

    Args:
        plan: Floor plan in the frame of the table. Walls of "vacuum" do not reflect: use them where the plan ends but
            the building continues.
        paths: Table with a row for each path (.csv): place, tx_x_m, tx_y_m, tx_heading_rad, rx_x_m, rx_y_m,
            rx_heading_rad, range_m, aod_rad, aoa_rad, power_db.
        frequency_ghz: Carrier frequency [GHz].
        material: First material of walls without a colour.
        turn_deg: Correction of the transmitter's heading in the table [deg].
        height: Height of both ends [m].
        range_db: Traced paths that are weaker than the strongest of their place by more than this are ignored [dB].
        reading: How to read the plan.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.building.building import BuildingConfig, make_building
    from robosim.plans.files import write_ros
    from robosim.published.material_fit import ADDED, EDGES, Fit
    from robosim.published.measured_figure import draw_measured
    from robosim.published.measured_paths import MatchConfig, read_measured_paths
    from robosim.support.files import write_json
    from robosim.support.progress import unit_progress

    with results_folder(out, "calibrate-materials") as folder:
        floor_plan = read(plan, reading)
        hall = read_measured_paths(paths, math.radians(turn_deg))
        fit = Fit(hall, frequency_ghz * 1e9, MatchConfig(height_m=height, range_db=range_db))
        with unit_progress(console, "materials tried", fit.n_trials(floor_plan)) as tried:
            found = fit.choose(floor_plan, material, tried)
        fitted = replace(floor_plan, materials=found.colours)
        rows = {name: fit.explained(fitted, found.wall, kind) for name, kind in ADDED.items()}
        building = make_building(fitted, config=BuildingConfig(wall_material=found.wall))
        draw_measured(hall, building, fit.match(fitted, found.wall, EDGES), folder / "measured.png")
        if fitted.materials:
            write_ros(fitted, folder / "plan" / f"{fitted.name}.yaml")
        explained = {name: asdict(row) for name, row in rows.items()}
        write_json(folder / "materials.json", {"fit": asdict(found), "explained": explained})
    emit_result_file(folder / "materials.json")
    table = Table("traced", "paths explained", "by chance", "power explained", "off [dB]")
    for name, row in rows.items():
        shares = (f"{100 * share:.1f} %" for share in (row.paths, row.by_chance, row.power))
        table.add_row(name, *shares, f"{row.off_db:.1f}")
    console.print(table)
    console.print(
        f"Walls fit {found.wall} best: reflections are off by {found.after_db[0]:.1f} dB, at the other places "
        f"{found.after_db[1]:.1f} dB; with {material} {found.before_db[0]:.1f} and {found.before_db[1]:.1f} dB."
    )
    console.print(f"Wrote materials.json and measured.png in {folder}")
    console.print(f"Next: robosim trace {plan} --material {found.wall} --frequency-ghz {frequency_ghz:g}")
