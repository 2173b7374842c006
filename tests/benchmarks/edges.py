"""How strong the published ray tracer's edges are, and which law of diffraction they follow.

Lone diffractions of the public data (`edge_cases`) are compared with laws, one for each hypothesis (`edge_laws`). The
residual is published over expected SNR, less the offset that far links in line of sight have. Its spread has a floor:
that of a receiver whose paths are exactly as strong as expected.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.constants import speed_of_light
from tyro.conf import OmitArgPrefixes, Positional

from robosim.training.label_links import GAP_M, PLASTERBOARD_M
from tests.benchmarks.edge_cases import Cases, find_cases, offset_db
from tests.benchmarks.edge_laws import laws, published_faces
from tests.benchmarks.harness import DEFAULT, Options, figure_of, quartiles, run_units
from tests.benchmarks.labels import plan_file
from tests.benchmarks.results import Results
from wireless.estimation.public import PublicReceiver
from wireless.formats.mmwrobotnav_measurements import find_measurements, read_measurements
from wireless.paths import Interaction

FREQUENCY_HZ = 28e9
#: The law that the links of `robosim.training.label_links` are traced by.
TRACED = "bisector"
#: Beyond this angle an edge turns a path back [deg].
BACK_DEG = -90.0


def main(
    data: Positional[Path],
    plans: Positional[Path],
    *,
    transmitters: int = 4,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Edges: strength of lone diffractions of mmwRobotNav, published over expected by each of 20 laws.

    Seven seconds a transmitter.

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with `NAME.glb_topdownmap.out` for each building.
        transmitters: Most transmitters of each building.
        options: Of every benchmark.
    """
    units = {
        f"{name} {number}": (data, plan_file(plans, name), name, number)
        for name, number in find_measurements(data)
        if number <= transmitters
    }
    found = run_units(cases_of, units, options.folder("edges"), workers=options.workers)
    return options.finish("edges", judge(Cases.joined(list(found.values()))))


def cases_of(data: Path, plan: Path, name: str, number: int) -> Cases:
    """Cases of one published transmitter."""
    return find_cases(read_measurements(data, name, number), plan, PublicReceiver())


def judge(cases: Cases) -> Results:
    """Offset, floor, and residuals of each law: of all cases, in the shadow, lit, and turned back.

    Raises:
        ValueError: If no edge or no far link in line of sight is among them.
    """
    far, results = cases.select(cases.kind == 0), Results()
    offset, _ = offset_db(far)
    some = cases.select((cases.kind == Interaction.DIFFRACTION) & cases.clean)
    if not len(some):
        raise ValueError("no lone diffraction is among these links.")
    mirrors = cases.select((cases.kind == Interaction.REFLECTION) & cases.clean)
    wavenumber = 2 * np.pi * FREQUENCY_HZ / speed_of_light
    powers = laws(some.wedges, published_faces(FREQUENCY_HZ, "drywall", PLASTERBOARD_M, GAP_M), wavenumber)
    bend = np.degrees(some.wedges.bending_rad)
    classes: dict[str, Bool[np.ndarray, " n"]] = {
        "all": np.ones(len(some), bool),
        "shadow": bend > 0,
        "lit": (bend <= 0) & (bend > BACK_DEG),
        "turned back": bend <= BACK_DEG,
    }
    results.add("offset", "far links in line of sight", "median", offset, "dB", digits=1, cases=len(far))
    _add(results, "offset", "single reflections", mirrors.published_db - mirrors.received_db - offset)
    _add(results, "offset", "a perfect law, as received", some.again_db - some.received_db)
    for name, power in powers.items():
        with np.errstate(divide="ignore"):
            off = some.published_db - some.received_db - offset - 10 * np.log10(power / powers[TRACED])
        for column, own in classes.items():
            _add(results, "laws", name, off[own], column)
    results.figures["edges"] = draw(results)
    return results


def _add(
    results: Results, table: str, row: str, values: Float[np.ndarray, " n"], name: str = "median"
) -> None:
    middle, spread = quartiles(values)
    results.add(table, row, name, middle, "dB", digits=1, spread=spread, cases=len(values))


def draw(results: Results) -> Any:
    """Medians and quartiles of all laws."""
    figure, (axes,) = figure_of(1, size=(7.0, 5.4))
    rows = [row for row in results.rows if (row["table"], row["name"]) == ("laws", "all")][::-1]
    for place, row in enumerate(rows):
        axes.plot(row["spread"], [place, place], color="0.55", lw=4, alpha=0.5)
        axes.plot(row["value"], place, "o", color="0.35", ms=5)
    floor = results.find("offset", "a perfect law, as received", "median")["spread"]
    axes.axvspan(*floor, color="0.9", zorder=0, label="a perfect law, as received")
    axes.set_yticks(range(len(rows)), [row["row"] for row in rows], fontsize=8)
    axes.set(xlabel="published over expected [dB]: median, quartiles", xlim=(-12, 24))
    axes.legend(fontsize=8, loc="lower right")
    return figure
