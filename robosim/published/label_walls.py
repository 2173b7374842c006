"""The walls that the published labels were traced with: the exact outline, less a few pieces of one cell.

At tips of free space one cell long and one or two cells wide the published ray tracer let paths through the slanted
piece of wall south of the tip, though the outline is closed there. This is found from the labels, and why is not
known. The patterns are steps along the outline from cell to cell, north up, free space on the left; the step in
capitals is open. Evidence from fully traced receivers (`robosim.published.label_links`) in the clear that nothing
but paths through one such piece and one more wall reach: 980 of 1172 (`sw w SE`), 728 of 851 (`sw w s SE`) and 80 of
89 (`NE n w nw`) are labelled higher order. Where the tip is longer (`w w SE`, `w w s SE`, `NE n w w`) it is 27 of 355,
where it is wider (`sw w s s SE` and so on) 41 of 180, so these are closed; and of direct paths through such pieces
north of a tip, 0 of 22 are line of sight. Without the openings whole rooms that are reached through a tip become
outages; there are others, not found yet, for which rooms are outages still.
"""

import cv2
import numpy as np
import trimesh
from jaxtyping import Float

from robosim.plans.floorplan import FloorPlan

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
    found = []
    for pattern in OPEN:
        words = pattern.split()
        if len(names) > len(words) and all(
            names[(i + j) % len(names)] == word.lower() for j, word in enumerate(words)
        ):
            found += [(i + j) % len(names) for j, word in enumerate(words) if word.isupper()]
    return found
