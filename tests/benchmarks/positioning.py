"""Places from paths that were measured in a real hall, held against where the radios truly were.

Four questions: where is the receiver from the paths of one place alone, its clock not known; the same with the clock
known; at all places together, which share a clock that is not known; and where is the transmitter, from all places.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table
from scipy.constants import speed_of_light

from robosim.published.measured_paths import MeasuredHall
from robosim.support.figures import save_figure
from robosim.support.files import write_json
from robosim.support.progress import tracked
from slam.poses import wrap
from wireless.positioning.single_bounce import Located, PositioningConfig, locate, locate_together
from wireless.support.axes import axes_in_metres

#: Metres that light goes in a nanosecond.
_M_PER_NS = speed_of_light / 1e9


@dataclass(frozen=True)
class Row:
    """Errors of one way."""

    way: str
    places: int
    rmse_m: float
    median_m: float
    rmse_deg: float
    median_deg: float
    clock_ns: float
    """Root mean square error of the clock's offset [ns], which is 0 in truth."""


def run(
    hall: MeasuredHall,
    out: Path,
    config: PositioningConfig,
    console: Console,
) -> Table:
    """Locate, compare, and write positioning.json and positioning.png.

    Args:
        hall: What was measured.
        out: Folder for the results.
        config: How well paths are measured.
        console: Where progress is shown.
    """
    with tracked(hall.places, "each place alone", console) as places:
        alone = [locate(place.seen_from_transmitter, config) for place in places]
    with tracked(hall.places, "clock known", console) as places:
        timed = [locate(place.seen_from_transmitter, config, offset_m=0.0) for place in places]
    with console.status("one clock for all places: a minute or two ..."):
        together = locate_together([place.seen_from_transmitter for place in hall.places], config)
    transmitter = locate(hall.seen_from_receiver, config)
    truth = np.array([place.receiver for place in hall.places])
    rows = [
        _row("receiver, each place alone", alone, truth),
        _row("receiver, clock known", timed, truth),
        _row("receiver, one clock for all places", together, truth),
        _row("transmitter, from all places", [transmitter], hall.transmitter[None]),
    ]
    write_json(
        out / "positioning.json",
        {
            "rows": [asdict(row) for row in rows],
            "places": [
                {"true": place.receiver, "alone": a.pose, "clock_known": t.pose, "together": g.pose}
                for place, a, t, g in zip(hall.places, alone, timed, together, strict=True)
            ],
            "transmitter": {"true": hall.transmitter, "found": transmitter.pose},
        },
    )
    _draw(hall, truth, alone, together, transmitter, out / "positioning.png")
    table = Table("", "places", "RMSE [m]", "median", "RMSE [deg]", "median ", "clock [ns]")
    for row in rows:
        table.add_row(
            row.way,
            str(row.places),
            *(f"{value:.2f}" for value in (row.rmse_m, row.median_m, row.rmse_deg, row.median_deg)),
            f"{row.clock_ns:.2f}",
        )
    return table


def _row(way: str, found: Sequence[Located], truth: Float[np.ndarray, "n 3"]) -> Row:
    poses = np.array([one.pose for one in found])
    off_m = np.hypot(*(poses - truth)[:, :2].T)
    off_deg = np.abs(np.degrees([wrap(float(a - b)) for a, b in zip(poses[:, 2], truth[:, 2], strict=True)]))
    clock = np.array([one.offset_m for one in found]) / _M_PER_NS
    return Row(
        way=way,
        places=len(found),
        rmse_m=float(np.sqrt((off_m**2).mean())),
        median_m=float(np.median(off_m)),
        rmse_deg=float(np.sqrt((off_deg**2).mean())),
        median_deg=float(np.median(off_deg)),
        clock_ns=float(np.sqrt((clock**2).mean())),
    )


def _draw(
    hall: MeasuredHall,
    truth: Float[np.ndarray, "n 3"],
    alone: Sequence[Located],
    together: Sequence[Located],
    transmitter: Located,
    path: Path,
) -> None:
    figure, panels = plt.subplots(1, 2, figsize=(11, 5.2), sharex=True, sharey=True, layout="constrained")
    for axes, found, title in zip(
        panels, (alone, together), ("each place alone", "one clock for all places"), strict=True
    ):
        axes_in_metres(axes)
        poses = np.array([one.pose for one in found])
        for true, pose in zip(truth, poses, strict=True):
            axes.plot(*np.array([true[:2], pose[:2]]).T, color="0.7", lw=0.8)
        axes.plot(*truth[:, :2].T, "o", color="black", ms=4, label="receiver")
        axes.plot(*poses[:, :2].T, ".", color="#D55E00", ms=6, label="found")
        axes.plot(*hall.transmitter[:2], "*", color="black", ms=13, label="transmitter")
        axes.plot(
            *transmitter.pose[:2], "*", color="#009E73", ms=8, label="found, from the receiver's places"
        )
        axes.set_title(f"{title}, clock unknown", fontsize=10)
    panels[0].legend(loc="best", fontsize=8)
    save_figure(figure, path)
