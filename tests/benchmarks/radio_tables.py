"""Radio tables measured: what a grid costs, and how far paths between its nodes are from those of the tracer there.

The judge is the tracer at the place itself. Beside it stands what a robot has without interpolation: the nearest node.
And estimates that are read off true paths by rule are compared with those of the full receiver at the same places.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from rich.table import Table

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link import RadioLink
from robosim.radio.table import RadioTable
from robosim.radio.table_reader import read_paths
from robosim.radio.transmitters import random_transmitters
from robosim.robot.robots import RobotConfig
from robosim.support.figures import save_figure
from slam.poses import wrap
from wireless.estimates import PathEstimates
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer

#: Grids that are compared [m], and transmitters.
STEPS_M = (0.1, 0.15, 0.25, 0.5)
_TRANSMITTERS = 3
#: Places at which everything is measured and estimated too, for each transmitter.
_MEASURED = 60


@dataclass(frozen=True)
class TableError:
    """Errors of one way to know paths; shares of links, and percentiles over them."""

    way: str
    step_m: float
    seconds: float
    """CPU time to trace a table, NaN where none is [s]."""
    micros: float
    """CPU time to ask it once [us]."""
    states_right: float
    """Link states that are those of the truth, or number of paths that is that of the full receiver."""
    aoa_deg_50: float
    aoa_deg_90: float
    """Direction of the strongest path [degrees]."""
    power_db_50: float
    power_db_90: float
    """Power of the strongest path [dB]."""


def radio_errors(plan: FloorPlan, *, links: int, seed: int) -> list[TableError]:
    """Errors of tables over their grid, and of reading by rule.

    Args:
        plan: Where.
        links: Places for each of three transmitters.
        seed: Of the places.
    """
    building, rng = make_building(plan), np.random.default_rng(seed)
    link = RadioLink(building)
    height_m, frequency_hz = link.config.height_m, link.config.frequency_hz
    tracer = Tracer(building, frequency_hz=frequency_hz)
    transmitters = random_transmitters(building, _TRANSMITTERS, height_m, rng)
    places = reach(building, RobotConfig().radius_m)
    centres = plan.centres(places.parts == 1)
    at = centres[rng.integers(len(centres), size=links)]
    at = at + rng.uniform(-0.4, 0.4, at.shape) * plan.resolution_m
    truth = [
        tracer.trace(tx[None], np.column_stack([at, np.full(links, height_m)]), workers=1)
        for tx in transmitters
    ]
    RadioTable.trace(building, tracer, transmitters[0], STEPS_M[-1]).at(at[0])  # compiled before it is timed
    found = []
    for step_m in STEPS_M:
        between, nearest = [], []
        spent = asked = 0.0
        for tx, true in zip(transmitters, truth, strict=True):
            begin = process_time()
            table = RadioTable.trace(building, tracer, tx, step_m)
            table.at(at[0])
            spent += process_time() - begin
            states = true.link_state()[0]
            begin = process_time()
            got = [table.at(place) for place in at]
            asked += process_time() - begin
            for i, place in enumerate(at):
                own = true.between(0, i)
                between.append(_gap(got[i], own, int(states[i])))
                nearest.append(_gap(_nearest(table, place), own, int(states[i])))
        micros = 1e6 * asked / (_TRANSMITTERS * links)
        found.append(_error("interpolated", step_m, spent / _TRANSMITTERS, micros, between))
        found.append(_error("nearest node", step_m, spent / _TRANSMITTERS, np.nan, nearest))
    return [*found, _reading(link, transmitters, centres, rng)]


def _nearest(table: RadioTable, place: Float[np.ndarray, "2"]) -> Paths | None:
    around = table.nodes_around(place)
    if around is None:
        return None
    node = int(around[0][around[1].argmax()])
    return table.paths.select(table.paths.rx == node)


def _gap(got: Paths | None, own: Paths, state: int) -> tuple[float, float, float]:
    """Whether the state is right, and gaps of direction [degrees] and power [dB] of the strongest paths."""
    if got is None:
        return float("nan"), float("nan"), float("nan")
    own_state = int(got.link_state().max())  # of the one link that has paths
    if not len(got) or not len(own):
        return float(own_state == state), float("nan"), float("nan")
    turn = abs(wrap(float(got.aoa_az[0] - own.aoa_az[0])))
    return float(own_state == state), float(np.degrees(turn)), abs(float(got.power_db[0] - own.power_db[0]))


def _reading(
    link: RadioLink,
    transmitters: Float[np.ndarray, "n 3"],
    centres: Float[np.ndarray, "m 2"],
    rng: np.random.Generator,
) -> TableError:
    """Estimates by rule beside measured ones, of the same true paths."""
    gaps, micros = [], []
    for tx in transmitters:
        link.place(tx[:2])
        for _ in range(_MEASURED):
            pose = np.array([*centres[rng.integers(len(centres))], rng.uniform(-np.pi, np.pi)])
            measured = link.measure(pose, rng)
            assert link.paths is not None
            begin = process_time()
            read = read_paths(link.paths, float(pose[2]), link.sounder, rng)
            micros.append(1e6 * (process_time() - begin))
            gaps.append(_estimate_gap(read, measured))
    return _error("estimates by rule, against measured ones", np.nan, np.nan, float(np.median(micros)), gaps)


def _estimate_gap(read: PathEstimates, measured: PathEstimates) -> tuple[float, float, float]:
    same = float(read.count[0] == measured.count[0])
    if not read.count[0] or not measured.count[0]:
        return same, float("nan"), float("nan")
    turn = abs(wrap(float(read.aoa_rad[0, 0] - measured.aoa_rad[0, 0])))
    return same, float(np.degrees(turn)), abs(float(read.snr_db[0, 0] - measured.snr_db[0, 0]))


def _error(
    way: str, step_m: float, seconds: float, micros: float, gaps: Sequence[tuple[float, float, float]]
) -> TableError:
    right, turn, power = np.array(gaps).T
    return TableError(
        way,
        step_m,
        seconds,
        micros,
        float(np.nanmean(right)),
        *np.nanpercentile(turn, [50, 90]).tolist(),
        *np.nanpercentile(power, [50, 90]).tolist(),
    )


def radio_table(errors: Sequence[TableError], plan: str) -> Table:
    """One row a way and a grid."""
    grid = Table(title=f"Radio tables in {plan}: errors of the strongest path, median and 90 %")
    for name in (
        "way",
        "grid [m]",
        "trace [CPU-s]",
        "ask [us]",
        "states right",
        "direction [deg]",
        "power [dB]",
    ):
        grid.add_column(name, justify="left" if name == "way" else "right")
    for one in errors:
        grid.add_row(
            one.way,
            _number(one.step_m, ".2f"),
            _number(one.seconds, ".2f"),
            _number(one.micros, ".0f"),
            f"{100 * one.states_right:.1f} %",
            f"{one.aoa_deg_50:.2f}, {one.aoa_deg_90:.2f}",
            f"{one.power_db_50:.2f}, {one.power_db_90:.2f}",
        )
    return grid


def _number(value: float, form: str) -> str:
    return "" if np.isnan(value) else format(value, form)


def plot_errors(path: Path, errors: Sequence[TableError]) -> None:
    """Draw errors of direction and power over the CPU time of a table."""
    figure, panels = plt.subplots(1, 2, figsize=(8.5, 3.4), layout="constrained")
    for axes, name, label in zip(
        panels, ("aoa_deg_90", "power_db_90"), ("direction [deg]", "power [dB]"), strict=True
    ):
        for way in ("interpolated", "nearest node"):
            own = [one for one in errors if one.way == way]
            axes.plot([one.seconds for one in own], [getattr(one, name) for one in own], "o-", label=way)
            for one in own:
                at = one.seconds, getattr(one, name)
                axes.annotate(f"{one.step_m:g} m", at, xytext=(4, 4), textcoords="offset points", fontsize=7)
        axes.set(xscale="log", xlabel="CPU time of a table [s]", ylabel=f"{label}, 90 % of links within")
        axes.grid(alpha=0.3, which="both")
    panels[0].legend(fontsize=8)
    save_figure(figure, path)
