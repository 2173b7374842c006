"""Measured and traced paths: where they arrive, and how strong they are."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Bool

from robosim.building.building import Building
from robosim.calibration.measured_paths import Matched, MeasuredHall
from robosim.support.axes import axes_in_metres
from robosim.support.figures import save_figure

#: What explains a measured path, and its colour.
KINDS = {"direct": "#000000", "reflections": "#0072B2", "an edge": "#E69F00", "nothing": "#D55E00"}
#: Length of the strokes that arrivals are drawn as [m].
_STROKE_M = 1.0


def kinds_of(matched: Matched) -> dict[str, Bool[np.ndarray, " n"]]:
    """Group measured paths by what explains them."""
    by_walls = matched.explained & ~matched.diffracted
    return {
        "direct": matched.order == 0,
        "reflections": by_walls & (matched.order > 0),
        "an edge": matched.diffracted,
        "nothing": ~matched.explained,
    }


def draw_measured(hall: MeasuredHall, building: Building, matched: Matched, path: Path) -> None:
    """Draw a stroke to where each measured path arrives from, and its strength over the traced one's."""
    assert hall.power_db is not None
    direct = matched.order == 0
    from_db = np.median(hall.power_db[direct]), np.median(matched.traced_db[direct])
    figure, (plan, strength) = plt.subplots(
        1, 2, figsize=(12.5, 6), layout="constrained", width_ratios=(1.25, 1)
    )
    axes_in_metres(plan)
    building.draw_walls(plan)
    table = hall.table
    arrival = table[:, 6] + table[:, 9]
    ends = table[:, 4:6] + _STROKE_M * np.column_stack([np.cos(arrival), np.sin(arrival)])
    for name, selected in kinds_of(matched).items():
        strokes = np.stack([table[selected, 4:6], ends[selected]], axis=1)
        for i, stroke in enumerate(strokes):
            plan.plot(
                *stroke.T, color=KINDS[name], lw=1.0, label=f"{name} ({selected.sum()})" if i == 0 else None
            )
        if name != "nothing":
            strength.plot(
                matched.traced_db[selected] - from_db[1],
                hall.power_db[selected] - from_db[0],
                "o",
                ms=4,
                color=KINDS[name],
                label=name,
            )
    plan.plot(*table[:, 4:6].T, "o", ms=3, color="0.4")
    plan.plot(*hall.transmitter[:2], "*", ms=14, color="black", mec="white")
    plan.autoscale_view()
    plan.set_title("arrivals at each place, by what explains them", fontsize=10)
    plan.legend(fontsize=8, loc="lower left")
    low, high = strength.get_xlim()
    strength.plot([low, high], [low, high], color="0.6", lw=0.8, zorder=0)
    strength.set(
        xlabel="traced power, direct paths at 0 in the median [dB]", ylabel="measured power, likewise [dB]"
    )
    strength.set_title("strength of explained paths", fontsize=10)
    strength.grid(True, lw=0.3)
    strength.legend(fontsize=8)
    save_figure(figure, path)
