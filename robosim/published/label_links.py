"""Paths between the ends of a published link, as the published ray tracer would have found them.

The walls are those of `robosim.published.label_walls`, which the published ray tracer let paths through once: two
plasterboards with air between (`GAP_M`). Of the paths, those are taken that the published ray tracer could find
(`robosim.published.label_adjacent`).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from robosim.published.label_adjacent import adopted, with_coarse
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer, TracerConfig

#: Plasterboard and the air between two of it [m]. Found from the published estimates: in line of sight, 2056 single
#: reflections received apart are, over incidence, as strong as this wall says, with a median of 0.2 dB over all; of all
#: thicknesses from 8 to 20 mm and gaps to 130 mm it fits best. It lets 8 dB more through than a layer of 0.1 m.
PLASTERBOARD_M, GAP_M = 0.013, 0.089
#: Faces of edges reflect at half the angle between the rays: of all laws tried on 2,000 lone diffractions the one that
#: spreads least about the published strengths (`python -m tests.benchmarks edges`), though full-wave solutions
#: differ.
#: An edge with two reflections, one before and one after, was found from the labels: where nothing else arrives at a
#: fully traced receiver, 78 % of the links that have such a path are higher order, but 26 % and 41 % of those with both
#: reflections after or before (nine buildings). With one more wall passed it is 44 %: three interactions are the most.
TRACER = TracerConfig(
    max_reflections=3,
    diffraction_reflections=2,
    diffraction_side_reflections=1,
    diffraction_law="bisector",
    max_transmissions=1,
    wall_passage="face",
    max_interactions=3,
    wall_thickness_m=PLASTERBOARD_M,
    wall_gap_m=GAP_M,
    max_paths=25,
)


def published_paths(
    tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "n 3"], cell: Int[np.ndarray, "n 2"], tracer: Tracer
) -> Paths:
    """Paths to receivers [m] at one height, as far as the published ray tracer could find them.

    Cells are rows and columns from 1 at the north-west. ValueError if receivers are on no regular grid.
    """
    all_cells, position = with_coarse(cell, rx[:, :2])
    all_rx = np.column_stack([position, np.full(len(position), rx[0, 2])])
    paths = tracer.trace(tx[None], all_rx, workers=1)
    paths = paths.select(adopted(paths, all_cells) & (paths.rx < len(rx)))
    return replace(paths, rx_position=rx)
