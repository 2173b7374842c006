"""Received powers in a real flat against traced ones: what each kind of path and each unknown contributes.

The walls of the plan are what lies between the edges of the free floor. The robot carries the transmitter; by
reciprocity paths are traced from the six receivers to its places, as if these were beacons.
Data: Kolakowski, Sensors 21, 6270, 2021 (CC BY 4.0).
"""

from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
import shapely
from tyro.conf import OmitArgPrefixes, Positional

from robosim.calibration.measured_powers import BLOCK_M, MeasuredPowers
from robosim.calibration.power_fit import WALL_PARAMETERS, PowerFit, PowerFitConfig, fit_powers
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.support.reading import reading
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.measured_figures import draw_flat
from tests.benchmarks.results import Results
from wireless.tracing.tracer import TracerConfig

#: Height of the transmitter on the robot, side of a cell of the plan, and its margin [m].
_TAG_M, _CELL_M, _MARGIN_M = 1.3, 0.05, 0.5
_DIRECT = TracerConfig(max_reflections=0, diffraction=False, max_transmissions=2, max_paths=30)
_TWO, _EDGES = replace(_DIRECT, max_reflections=2), replace(_DIRECT, max_reflections=2, diffraction=True)
#: All that is traced and fitted; most inner walls are drawn 0.11 m thick.
CONFIG = PowerFitConfig(thickness_m=0.11, ceiling_m=2.65)
_NO_PATTERNS = replace(CONFIG, receiver_orders=0, beacon_orders=0)
#: What is traced and fitted, one addition after the other.
ADDED = {
    "direct paths, walls passed": replace(_NO_PATTERNS, tracer=_DIRECT),
    "and one reflection": replace(_NO_PATTERNS, tracer=replace(_DIRECT, max_reflections=1)),
    "and two": replace(_NO_PATTERNS, tracer=_TWO),
    "and edges": replace(_NO_PATTERNS, tracer=_EDGES),
    "and floor and ceiling": _NO_PATTERNS,
    "and the receiver's pattern": replace(CONFIG, beacon_orders=0),
    "and patterns of beacons": CONFIG,
}


def main(folder: Positional[Path], *, every: int = 3, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Errors of predicted powers in a real flat, with one kind of path and one unknown added after the other.

    Args:
        folder: The data set: anchors.csv, layout.csv, calibration_df.csv.
        every: Every so many places are used for the additions; the full fit uses all places.
        options: Of every benchmark.
    """
    results = Results()
    plan, measured = read_flat(folder, every)
    for name, config in ADDED.items():
        _add(results, "additions", name, plan, measured, config)
    plan, measured = read_flat(folder)
    first = _add(results, "all places", "first half fitted", plan, measured, CONFIG, by_beacon=True)
    other = _add(results, "all places", "second half fitted", *_moved(plan, measured), CONFIG, by_beacon=True)
    predicted_dbm = np.where(measured.held_out, first.predicted_dbm, other.predicted_dbm)
    places = dict(zip(measured.names, measured.beacons[:, :2], strict=True))
    results.figures["flat_powers"] = draw_flat(
        plan, measured.places[:, :2], measured.power_dbm - predicted_dbm, places
    )
    return options.finish("warsaw_powers", results)


def read_flat(folder: Path, every: int = 1) -> tuple[FloorPlan, MeasuredPowers]:
    """The plan of the flat, and the powers at every so many places."""
    with reading(folder / "layout.csv", "the corners of a flat") as file:
        floor = shapely.Polygon(np.loadtxt(file, delimiter=",", skiprows=1))
    with reading(folder / "anchors.csv", "positions of receivers") as file:
        anchors = np.loadtxt(file, delimiter=",", skiprows=1)
    with reading(folder / "calibration_df.csv", "powers at places") as file:
        rows = np.genfromtxt(file, delimiter=",", skip_header=1)[::every]
    x, y = (
        np.arange(floor.bounds[i] - _MARGIN_M, floor.bounds[i + 2] + _MARGIN_M, _CELL_M) for i in range(2)
    )
    is_free = shapely.contains_xy(floor, *np.meshgrid(x + _CELL_M / 2, y + _CELL_M / 2))
    plan = FloorPlan(
        occupancy=np.where(is_free, FREE, OCCUPIED).astype(np.uint8),
        resolution_m=_CELL_M,
        origin=(float(x[0]), float(y[0]), 0.0),
        name="flat",
    )
    measured = MeasuredPowers(
        names=tuple(f"{number:g}" for number in anchors[:, 0]),
        beacons=anchors[:, 1:],
        places=np.column_stack([rows[:, 2], rows[:, 4], np.full(len(rows), _TAG_M)]),
        heading_rad=rows[:, 3],
        power_dbm=rows[:, 5:].T.copy(),
    )
    return plan, measured


def _moved(plan: FloorPlan, measured: MeasuredPowers) -> tuple[FloorPlan, MeasuredPowers]:
    """The same one block to the right, where the halves are exchanged."""
    by = np.array([BLOCK_M, 0.0, 0.0])
    return replace(plan, origin=(plan.origin[0] + BLOCK_M, *plan.origin[1:])), replace(
        measured, beacons=measured.beacons + by, places=measured.places + by
    )


def _add(
    results: Results,
    table: str,
    row: str,
    plan: FloorPlan,
    measured: MeasuredPowers,
    config: PowerFitConfig,
    by_beacon: bool = False,
) -> PowerFit:
    """Fit, and add errors and walls."""
    begin = perf_counter()
    fit = fit_powers(measured, plan, config)
    seconds = perf_counter() - begin
    for name, errors in fit.rms_db.items():
        if by_beacon and name != "mean":
            results.add(f"{table}, {row}", f"beacon {name}", "fitted", errors[0], "dB", digits=2)
            results.add(f"{table}, {row}", f"beacon {name}", "held out", errors[1], "dB", digits=2)
    fitted, held_out, _, law = fit.rms_db["mean"]
    reached = ~np.isnan(fit.predicted_dbm[~np.isnan(measured.power_dbm)])
    results.add(table, row, "readings reached", 100 * float(reached.mean()), "%", digits=1)
    results.add(table, row, "fitted", fitted, "dB", digits=2)
    results.add(table, row, "held out", held_out, "dB", digits=2, bar=law)
    for name in WALL_PARAMETERS:
        value, std = fit.parameters[name]
        results.add(table, row, name, value, digits=3, spread=(value - 2 * std, value + 2 * std))
    results.add(table, row, "time", seconds, "s", digits=0)
    return fit
