"""Paths between the ends of a published link, as the published ray tracer would have found them.

The walls are two plasterboards with air between (`GAP_M`), of which paths pass one at most. The published ray tracer
searched for paths at a quarter of the receivers only: every second receiver of every second row. A receiver between
adopted the interactions of the paths found around it, and the exact paths with these interactions were computed. A
path that exists between but nowhere around is missing. The authors describe this as adjacent path generation; the
coarse grid and how far around is searched were found from the labels.

The coarse grid continues outside of the building, where nothing is published: these receivers are traced too.

The walls follow the exact outline, less a few pieces of one cell. At tips of free space one cell long and one or two
cells wide the published ray tracer let paths through the slanted piece of wall south of the tip, though the outline
is closed there. This is found from the labels, and why is not known. The patterns are steps along the outline from
cell to cell, north up, free space on the left; the step in capitals is open. Evidence from fully traced receivers in
the clear that nothing but paths through one such piece and one more wall reach: 980 of 1172 (`sw w SE`), 728 of 851
(`sw w s SE`) and 80 of 89 (`NE n w nw`) are labelled higher order. Where the tip is longer (`w w SE`, `w w s SE`,
`NE n w w`) it is 27 of 355, where it is wider (`sw w s s SE` and so on) 41 of 180, so these are closed; and of direct
paths through such pieces north of a tip, 0 of 22 are line of sight. Without the openings whole rooms that are reached
through a tip become outages; there are others, not found yet, for which rooms are outages still.
"""

from dataclasses import replace

import cv2
import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from robosim.plans.floorplan import FloorPlan
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer, TracerConfig

STEPS = {
    (1, 0): "e", (1, 1): "ne", (0, 1): "n", (-1, 1): "nw",
    (-1, 0): "w", (-1, -1): "sw", (0, -1): "s", (1, -1): "se",
}  # fmt: skip
OPEN = ("sw w SE", "sw w s SE", "NE n w nw")
Step = tuple[int, int]


def published_walls(plan: FloorPlan) -> Float[np.ndarray, "n 2 2"]:
    """Ends (x, y) [m] in `map` of walls through the outermost free cells, straight runs in one piece."""
    # The border is followed as in a picture: the row of the north first.
    lines, _ = cv2.findContours(plan.free[::-1].astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    walls: list[tuple[np.ndarray, np.ndarray]] = []
    for line in lines:
        points = line.reshape(-1, 2) * (1, -1) + (0, plan.shape[0] - 1)
        if len(points) > 1:
            walls += _runs(points)
    return plan.to_map(np.array(walls) + 0.5)


def published_mesh(plan: FloorPlan, height_m: float) -> trimesh.Trimesh:
    """Upright walls without floor and ceiling."""
    ends = published_walls(plan)
    n = len(ends)
    low, high = np.zeros((2 * n, 1)), np.full((2 * n, 1), height_m)
    foot = ends.transpose(1, 0, 2).reshape(-1, 2)
    vertices = np.vstack([np.hstack([foot, low]), np.hstack([foot, high])])
    a = np.arange(n)
    faces = np.vstack([np.column_stack([a, a + n, a + 3 * n]), np.column_stack([a, a + 3 * n, a + 2 * n])])
    return trimesh.Trimesh(vertices, faces, process=False)


def _runs(points: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Straight runs of a closed line of neighbouring cells, without its open pieces."""
    steps = [(int(x), int(y)) for x, y in np.roll(points, -1, axis=0) - points]
    names = [STEPS[step] for step in steps]
    n = len(steps)
    opened = {place for i in range(n) for place in _open_from(names, i)}
    # Begin where the direction changes, so that no run goes over the end.
    first = next((i for i in range(n) if names[i] != names[i - 1]), 0)
    runs, start = [], None
    for i in range(first, first + n):
        here, after = i % n, (i + 1) % n
        if here in opened:
            start = None
            continue
        start = points[here] if start is None else start
        if after in opened or names[after] != names[here] or i == first + n - 1:
            runs.append((start, points[after]))
            start = None
    return runs


def _open_from(names: list[str], i: int) -> list[int]:
    """Places of open pieces in patterns that begin at step i."""
    places = []
    for pattern in OPEN:
        words = pattern.split()
        if len(names) > len(words) and all(
            names[(i + j) % len(names)] == word.lower() for j, word in enumerate(words)
        ):
            places += [(i + j) % len(names) for j, word in enumerate(words) if word.isupper()]
    return places


#: Distance between receivers [m].
SPACING_M = 0.15
#: Receivers adopt what is found at most so many rows and columns away: 93.4 % of links of seven buildings agree
#: so, 93.2 % with 2.
REACH = 1
#: More than there are rows or columns.
_WIDE = 1 << 20
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


def fully_traced(cell: Int[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Which receivers, by row and column from 1, rays were shot to: even row, odd column."""
    return (cell[:, 0] % 2 == 0) & (cell[:, 1] % 2 == 1)


def with_coarse(
    cell: Int[np.ndarray, "n 2"], position: Float[np.ndarray, "n 2"]
) -> tuple[Int[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
    """Cells and positions [m] of receivers, and then of all others around to which rays were shot.

    Cells are rows and columns from 1 at the north-west.

    Raises:
        ValueError: If receivers are on no grid of `SPACING_M`.
    """
    corner = position - SPACING_M * cell[:, ::-1] * (1, -1)
    origin = np.median(corner, axis=0)
    off = np.abs(corner - origin).max()
    if not off < 0.01 * SPACING_M:
        raise ValueError(
            f"a receiver is {off:.3g} m off its place in a grid of {SPACING_M} m. "
            "Are its row and column those of the published data?"
        )
    around = np.unique((cell[:, None] + _steps()).reshape(-1, 2), axis=0)
    around = around[fully_traced(around)]
    around = around[~np.isin(_number(around), _number(cell))]
    return np.vstack([cell, around]), np.vstack([position, origin + SPACING_M * around[:, ::-1] * (1, -1)])


def adopted(paths: Paths, cell: Int[np.ndarray, "n_rx 2"]) -> Bool[np.ndarray, " n"]:
    """Which paths of one transmitter end at a fully traced receiver, or have the interactions of one around."""
    rows = np.column_stack([paths.interaction.astype(np.int64), paths.primitive])
    sequence = np.unique(rows, axis=0, return_inverse=True)[1].ravel().astype(np.int64)
    n_sequences = int(sequence.max(initial=0)) + 1
    full = fully_traced(cell)
    there = full[paths.rx]
    known = np.unique(_number(cell)[paths.rx[there]] * n_sequences + sequence[there])
    is_adopted = there.copy()
    for step in _steps():
        near = cell + step
        wanted = _number(near)[paths.rx] * n_sequences + sequence
        is_adopted |= ~there & fully_traced(near)[paths.rx] & np.isin(wanted, known)
    return is_adopted


def _steps() -> Int[np.ndarray, "k 2"]:
    """Rows and columns to the receivers around, and to the receiver itself."""
    offset = np.arange(-REACH, REACH + 1)
    return np.stack(np.meshgrid(offset, offset, indexing="ij"), axis=-1).reshape(-1, 2)


def _number(cell: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
    """Return a number for each cell."""
    return (cell[:, 0] + _WIDE // 2) * _WIDE + cell[:, 1] + _WIDE // 2
