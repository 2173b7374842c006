"""A map of radio over the whole floor, coarse at first, then finer.

Each level is traced in parts, so that a newer request waits for one part at most.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from robosim.live.link_model import LinkModel
from robosim.live.scene_colours import angle_colours, power_colours, state_colours
from robosim.radio.receivers import ReceiverGrid

FieldKind = Literal["off", "received power", "link state", "direction of arrival"]
#: Steps between receivers [m]: each level has some four times as many as the one before.
STEPS_M = (1.0, 0.5, 0.25, 0.15)
#: Receivers that are traced at once: some 10 ms.
_AT_ONCE = 64
#: Places of a level: larger floors stop at a coarser one.
_MOST_PLACES = 40_000


@dataclass(frozen=True, eq=False)
class Field:
    """Radio over the floor as colours."""

    rgba: UInt8[np.ndarray, "ny nx 4"]
    """Colour of each cell, rows upwards; clear where there is no receiver, or no path."""
    grid: ReceiverGrid
    """Where the cells are."""
    step_m: float
    """Their side."""


def fields(
    model: LinkModel, tx: Float[np.ndarray, "2"], kind: FieldKind, stale: Callable[[], bool]
) -> Iterator[Field]:
    """Fields of one transmitter, each finer than the one before.

    Args:
        model: Where.
        tx: The transmitter's place [m].
        kind: What is shown.
        stale: Whether they are not wanted any more; called some hundred times per second.
    """
    for step_m in STEPS_M:
        try:
            grid = model.grid(step_m)
        except ValueError:  # too coarse for a small room, or too fine for a large one
            continue
        if len(grid.position) > _MOST_PLACES:
            return
        colours = np.zeros((len(grid.position), 4), np.uint8)
        for first in range(0, len(grid.position), _AT_ONCE):
            if stale():
                return
            some = slice(first, first + _AT_ONCE)
            colours[some] = _colours(model, tx, grid.position[some], kind)
        rgba = np.zeros((*grid.shape, 4), np.uint8)
        rgba[tuple(grid.cell.T)] = colours
        yield Field(rgba, grid, step_m)


def _colours(
    model: LinkModel, tx: Float[np.ndarray, "2"], places: Float[np.ndarray, "n 3"], kind: FieldKind
) -> UInt8[np.ndarray, "n 4"]:
    paths = model.tracer.trace(model.antenna(tx)[None], places, workers=1)
    first = paths.select(paths.rank == 0)
    rgba = np.zeros((len(places), 4), np.uint8)
    rgba[first.rx, 3] = 255
    if kind == "link state":
        rgba[:, :3] = state_colours(paths.link_category()[0])
    elif kind == "direction of arrival":
        rgba[first.rx, :3] = angle_colours(first.aoa_az)
    else:
        rgba[first.rx, :3] = power_colours(model.settings.tx_power_dbm + first.power_db)
    return rgba
