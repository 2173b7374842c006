"""How strong the published ray tracer's edges are, and which law of diffraction they follow.

Lone diffractions of the public data (`tests.benchmarks.edge_cases`) are held against laws, one for each hypothesis
(`tests.benchmarks.edge_laws`). The residual is published over expected SNR, less the offset that far links in line of
sight have. Its spread has a floor: that of a receiver whose paths are exactly as strong as expected.
"""

from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib import pyplot as plt
from rich.console import Console
from rich.table import Table
from scipy.constants import speed_of_light

from robosim.published.label_links import GAP_M, PLASTERBOARD_M
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from robosim.support.progress import told_units
from tests.benchmarks.edge_cases import Cases, find_cases, offset_db
from tests.benchmarks.edge_laws import laws, published_faces
from wireless.estimation.public import PublicReceiver
from wireless.formats.mmwrobotnav_measurements import DataError, find_measurements, read_measurements
from wireless.paths import Interaction

FREQUENCY_HZ = 28e9
#: The law that `robosim.published.label_links` traces by.
TRACED = "bisector"
#: Classes of the angle by which an edge bends a path into its shadow [deg], and of the length of the path [m].
BENDS_DEG = (-180, -90, -60, -30, -5, 0, 5, 10, 20, 60)
LENGTHS_M = (0, 4, 6, 8, 10, 30)
#: Laws that are drawn over the bending angle, and their colours.
DRAWN = {"nearer face (default)": "#0072B2", "Luebbers' own angles": "#009E73", "bisector": "#D55E00"}
#: A class of fewer cases is left out.
FEWEST = 8


@dataclass(frozen=True, kw_only=True)
class Residual:
    """Published over expected strength [dB]: median, quartiles and number of cases."""

    median: float
    low: float
    high: float
    cases: int

    @property
    def spread(self) -> float:
        """Interquartile range."""
        return self.high - self.low

    @classmethod
    def of(cls, values: Float[np.ndarray, " n"]) -> "Residual":
        """NaN of no cases."""
        low, median, high = np.percentile(values, (25, 50, 75)) if len(values) else [np.nan] * 3
        return cls(median=float(median), low=float(low), high=float(high), cases=len(values))

    def text(self) -> str:
        """Median and, in brackets, interquartile range."""
        return f"{self.median:.1f} ({self.spread:.1f})"


def run(data: Path, plans: Path, *, transmitters: int, out: Path, console: Console) -> Table:
    """Collect cases, try the laws, write edges.json and edges.png.

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with `NAME.glb_topdownmap.out` for each building.
        transmitters: How many of each building.
        out: Folder for the results.
        console: Where progress is shown.

    Raises:
        DataError: If there are no measurements, or a plan is missing.
        ValueError: If no edge or no far link in line of sight is among them.
    """
    units = [unit for unit in find_measurements(data) if unit[1] <= transmitters]
    receiver, found = PublicReceiver(), []
    with told_units(console, "transmitters", len(units)) as tell:
        for name, number in units:
            plan = plans / f"{name}.glb_topdownmap.out"
            if not plan.is_file():
                raise DataError(f"{plan}: no such plan, but there are measurements of {name}.")
            found.append(find_cases(read_measurements(data, name, number), plan, receiver))
            tell(f"{name} {number}")
    result = judge(Cases.joined(found))
    write_json(out / "edges.json", result)
    draw(result, out / "edges.png")
    return shown(result)


def judge(cases: Cases) -> dict[str, Any]:
    """Offset, floor, and residuals of each law, in all and by class.

    Raises:
        ValueError: If no edge or no far link in line of sight is among them.
    """
    offset, plain = offset_db(cases.select(cases.kind == 0))
    some = cases.select((cases.kind == Interaction.DIFFRACTION) & cases.clean)
    if not len(some):
        raise ValueError("no lone diffraction is among these links.")
    mirrors = cases.select((cases.kind == Interaction.REFLECTION) & cases.clean)
    wedges, k = some.wedges, 2 * np.pi * FREQUENCY_HZ / speed_of_light
    powers = laws(wedges, published_faces(FREQUENCY_HZ, "drywall", PLASTERBOARD_M, GAP_M), k)
    own = powers[TRACED]
    bend, length = np.degrees(wedges.bending_rad), wedges.before_m + wedges.after_m
    rows = {}
    for name, power in powers.items():
        with np.errstate(divide="ignore"):
            off = some.published_db - some.received_db - offset - 10 * np.log10(power / own)
        rows[name] = {
            "all": asdict(Residual.of(off)),
            "shadow": asdict(Residual.of(off[bend > 0])),
            "lit": asdict(Residual.of(off[(bend <= 0) & (bend > BENDS_DEG[1])])),
            "back": asdict(Residual.of(off[bend <= BENDS_DEG[1]])),
            "bend": _classes(off, bend, BENDS_DEG),
            "length": _classes(off, length, LENGTHS_M),
        }
    return {
        "offset_db": offset,
        "line_of_sight_before_db": plain,
        "line_of_sight": int((cases.kind == 0).sum()),
        "cases": len(some),
        "saturated_or_noise": int((cases.kind == Interaction.DIFFRACTION).sum()) - len(some),
        "floor": asdict(Residual.of(some.again_db - some.received_db)),
        "reflections": asdict(Residual.of(mirrors.published_db - mirrors.received_db - offset)),
        "laws": rows,
    }


def _classes(
    off: Float[np.ndarray, " n"], value: Float[np.ndarray, " n"], edges: tuple[float, ...]
) -> list[dict[str, Any]]:
    found = []
    for low, high in pairwise(edges):
        inside: Bool[np.ndarray, " n"] = (value > low) & (value <= high)
        if inside.sum() >= FEWEST:
            found.append({"from": low, "to": high, **asdict(Residual.of(off[inside]))})
    return found


def shown(result: dict[str, Any]) -> Table:
    """Residuals of each law as a table, and what they are counted from as its caption."""
    table = Table(
        "law",
        "all [dB]",
        "shadow",
        "lit",
        "turned back",
        title=f"Published over expected strength of {result['cases']} lone diffractions, median (interquartile range)",
        caption=f"Less {result['offset_db']:.1f} dB by {result['line_of_sight']} links in line of sight; "
        f"single reflections {Residual(**result['reflections']).text()}; a perfect law would have "
        f"{Residual(**result['floor']).text()}.",
    )
    for name, row in result["laws"].items():
        table.add_row(name, *(Residual(**row[part]).text() for part in ("all", "shadow", "lit", "back")))
    return table


def draw(result: dict[str, Any], path: Path) -> None:
    """Residuals over the bending angle, and medians with quartiles of all laws."""
    figure, (over, every) = plt.subplots(1, 2, figsize=(12.5, 5.4), layout="constrained")
    for name, colour in DRAWN.items():
        rows = result["laws"][name]["bend"]
        middle = [(row["from"] + row["to"]) / 2 for row in rows]
        over.fill_between(
            middle,
            [row["low"] for row in rows],
            [row["high"] for row in rows],
            color=colour,
            alpha=0.15,
            lw=0,
        )
        style = "o--" if name.startswith("Luebbers") else "o-"
        over.plot(middle, [row["median"] for row in rows], style, color=colour, ms=4, label=name)
    over.axhline(0, color="0.5", lw=0.8)
    over.axvline(0, color="0.5", lw=0.8, ls=":")
    over.set(
        xlabel="angle into the edge's shadow [deg]; below 0 the edge hides nothing",
        ylabel="published over expected [dB], median and quartiles",
    )
    over.legend(fontsize=8)
    over.grid(True, lw=0.3)
    names = list(result["laws"])[::-1]
    rows = [result["laws"][name]["all"] for name in names]
    place = np.arange(len(names))
    for row, y, name in zip(rows, place, names, strict=True):
        every.plot([row["low"], row["high"]], [y, y], color=DRAWN.get(name, "0.55"), lw=4, alpha=0.5)
        every.plot(row["median"], y, "o", color=DRAWN.get(name, "0.35"), ms=5)
    floor = result["floor"]
    every.axvspan(floor["low"], floor["high"], color="0.9", zorder=0, label="a perfect law, as received")
    every.set_yticks(place, names, fontsize=8)
    every.set(xlabel="published over expected [dB]: median, quartiles", xlim=(-12, 24))
    every.grid(True, lw=0.3, axis="x")
    every.legend(fontsize=8, loc="lower right")
    save_figure(figure, path)
