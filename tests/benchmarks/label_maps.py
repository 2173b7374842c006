"""Maps of where computed and published link states disagree, one panel a transmitter."""

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D

from robosim.drawing.radio import TX_COLOUR
from robosim.published.label_links import Links, prepared
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, css
from robosim.support.figures import save_figure
from wireless.formats.mmwrobotnav_measurements import Measurements
from wireless.paths import LinkState

COLUMNS = 5


def draw(path: Path, plan: Path, measured: list[Measurements], links: list[Links]) -> None:
    """Draw a building's links that disagree: fill by published state, rim by computed state.

    Args:
        path: Picture to write.
        plan: File of the floor plan.
        measured: Published links of each transmitter.
        links: Computed links of each, in the same order.
    """
    building = prepared(plan)[0]
    colour = np.array([css(STATE_COLOURS[state]) for state in LinkState], dtype=object)
    n_rows = -(-len(measured) // COLUMNS)
    figure, panels = plt.subplots(
        n_rows,
        min(COLUMNS, len(measured)),
        figsize=(4 * min(COLUMNS, len(measured)), 4 * n_rows + 0.5),
        squeeze=False,
        layout="constrained",
    )
    west, south, east, north = building.free.bounds
    for axes in panels.flat:
        axes.set_axis_off()
    for axes, one, own in zip(panels.flat, measured, links, strict=False):
        axes.set(aspect="equal", xlim=(west - 0.3, east + 0.3), ylim=(south - 0.3, north + 0.3))
        building.draw_walls(axes)
        off = own.published != own.computed
        axes.scatter(
            *one.rx_position[off].T,
            c=list(colour[own.published[off]]),
            edgecolors=list(colour[own.computed[off]]),
            s=9,
            linewidths=1.0,
        )
        axes.plot(*one.tx_position[:2], "*", color=TX_COLOUR, ms=10)
        axes.set_title(f"transmitter {one.number}: {100 * np.mean(~off):.1f} % agree", fontsize=9)
    names = {STATE_NAMES[state]: css(STATE_COLOURS[state]) for state in LinkState}
    handles = [
        Line2D([], [], marker="o", lw=0, color=tone, mew=1.5, label=name) for name, tone in names.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle(
        f"{building.plan.name}: disagreeing links; fill as published, rim as computed", parse_math=False
    )
    save_figure(figure, path)
