"""Visibility of the parts of a scene from a level camera, so that only visible parts are drawn.

If a camera is level, all rays of one column of pixels lie in one upright plane. Where that plane meets a wall
that reaches from the lowest to the highest point of the scene, nothing behind the wall can be seen in that
column. One ray per column, cast at such walls as seen from above, gives the distance that is visible there; parts
that begin farther off in all columns in which they may appear are left out.

Pictures are bit-identical to those of the whole scene, but for large scenes, whose far floors are drawn in blocks
(`robosim.camera.rendering.blocks`). OpenGL rounds corners to a grid of 1/256 pixel, and may so see
past a wall that the ray at a column's middle just meets: there are two rays for each column, 1/64 pixel to either
side, and the longer one counts.

Left out: furniture that is lower than the walls hides nothing here; a camera that is tilted sees everything.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from robosim.camera.model import CameraConfig
from robosim.camera.rendering.blocks import Blocks
from robosim.support.index_ranges import index_ranges
from robosim.support.ray_casting import make_ray_scene

#: Side of the squares, seen from above, whose triangles make a part [m]; scenes of more parts are cut into blocks.
PART_M, MANY_PARTS = 0.5, 20_000
_SHAKE_PX = 1 / 64
_MARGIN_M = 0.01


class Parts(NamedTuple):
    """Triangles in runs, one for each square of a grid; those of one block follow each other."""

    order: Int[np.ndarray, " m"]
    """All triangles, part by part."""
    starts: Int[np.ndarray, " n"]
    """Start of each group in that order."""
    counts: Int[np.ndarray, " n"]
    """Number of triangles of each group."""
    blocks: Blocks | None = None
    """The blocks of a large scene, which stand for their parts from afar."""

    @classmethod
    def of(
        cls, triangles: Float32[np.ndarray, "m 3 3"], colours: UInt8[np.ndarray, "m 3 3"], focal_px: float
    ) -> "Parts":
        """Gather triangles by the square that their middle lies in; of many squares, by block first."""
        square = np.floor(triangles[:, :, :2].mean(axis=1) / PART_M).astype(int)
        squares, group = np.unique(square, axis=0, return_inverse=True)
        blocks = None
        if len(squares) > MANY_PARTS:
            # A metre of floor, seen from a metre above, is half a pixel high at this distance.
            blocks = Blocks.of(triangles, colours, (2 * focal_px) ** 0.5)
            _, group = np.unique(blocks.number * len(squares) + group.ravel(), return_inverse=True)
        count = np.bincount(group.ravel())
        return cls(np.argsort(group.ravel(), kind="stable"), np.cumsum(count) - count, count, blocks)


class Visibility:
    """Finds the parts of a scene that are seen from a pose."""

    def __init__(self, triangles: Float[np.ndarray, "m 3 3"], parts: Parts, config: CameraConfig) -> None:
        self._boxes = _boxes(triangles, parts.order, parts.starts)
        self._floor, self._top = float(triangles[..., 2].min()), float(triangles[..., 2].max())
        self._block_boxes: Float[np.ndarray, "5 n"] | None = None
        if parts.blocks is not None:
            block_of = parts.blocks.number[parts.order[parts.starts]]
            self._far_m, self._sizes = parts.blocks.far_m, np.bincount(block_of)
            self._first = np.cumsum(self._sizes) - self._sizes
            self._block_boxes = _boxes(triangles, parts.order, parts.starts[self._first])
        self._config = config
        column = np.arange(config.width) + 0.5 - 0.5 * config.width
        across = np.concatenate([column - _SHAKE_PX, column + _SHAKE_PX]) / config.focal_px
        self._fan = np.column_stack([across, np.ones_like(across)]).astype(np.float32)
        self._rays, self._origins = np.zeros((2, len(across), 3), np.float32)
        self._reach = np.full(config.width + 1, np.inf, np.float32)
        self._middle = np.array([[0.5 * config.width - 1.0], [0.5 * config.width + 2.0]])
        walls = screens(triangles)
        self._walls = make_ray_scene(_upright(walls)) if len(walls) else None

    def parts(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Int[np.ndarray, " _"]:
        """Parts that may be seen from a place [m]; columns of `R` are the camera's axes right, down and ahead.

        Numbers after those of the parts are of blocks, which stand for all their parts.
        """
        n = self._boxes.shape[1]
        if abs(R[2, 1] + 1.0) > 1e-9 or abs(R[2, 0]) > 1e-9 or abs(R[2, 2]) > 1e-9:
            return np.arange(n)
        view, reach = self._view(R, t), self._look(R, t)
        if self._block_boxes is None:
            return self._seen(view @ self._boxes, reach)[0]
        block, nearest = self._seen(view @ self._block_boxes, reach)
        far = nearest > self._far_m[block]
        near = block[~far]
        _, parts = index_ranges(self._first[near], self._sizes[near])
        return np.concatenate([parts[self._seen(view @ self._boxes[:, parts], reach)[0]], n + block[far]])

    def _seen(
        self, extents: Float[np.ndarray, "4 n"], reach: Float32[np.ndarray, " _"]
    ) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, " k"]]:
        """Boxes that begin within reach in a column of the picture, and how far ahead each begins [m].

        Extents are the least and greatest place of each across [focal lengths] and ahead [m].
        """
        width, near = self._config.width, self._config.near_m
        left, right, nearest, farthest = extents
        # A box is seen widest where it is nearest, but for an edge that lies beyond the middle of the picture.
        close, far = 1.0 / np.maximum(nearest, near), 1.0 / np.maximum(farthest, near)
        columns = np.empty((2, len(left)))
        np.minimum(left * close, left * far, out=columns[0])
        np.maximum(right * close, right * far, out=columns[1])
        columns += self._middle
        np.maximum(columns, 0.0, out=columns)
        np.minimum(columns, width, out=columns)
        columns = columns.astype(np.intp)
        inside = np.flatnonzero((columns[0] < columns[1]) & (farthest > near))
        visible_m = np.maximum.reduceat(reach, columns[:, inside].T.ravel())[::2]  # type: ignore[arg-type]
        inside = inside[np.minimum(visible_m, self._config.far_m) > nearest[inside] - _MARGIN_M]
        return inside, nearest[inside]

    def _view(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 5"]:
        """Matrix from boxes to their extents from a place."""
        f = self._config.focal_px
        (rx, ry, _), (ax, ay, _) = R[:, 0].tolist(), R[:, 2].tolist()
        x, y, _ = t.tolist()
        across, ahead = (f * rx, f * ry), (ax, ay)
        rows = []
        for u, v in (across, ahead):
            rows += [[u, v, sign * abs(u), sign * abs(v), -u * x - v * y] for sign in (-1.0, 1.0)]
        return np.array(rows)

    def _look(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Float32[np.ndarray, " _"]:
        """Visible distance ahead in each column [m], and one additional value."""
        if self._walls is not None and self._floor < t[2] < self._top:
            self._rays[:, :2] = self._fan @ R[:2, ::2].T.astype(np.float32)
            self._origins[:, :2] = t[:2]
            distance = self._walls.run(self._origins, self._rays, query="DISTANCE")
            width = self._config.width
            np.maximum(distance[:width], distance[width:], out=self._reach[:-1])
        return self._reach


def _boxes(
    triangles: Float32[np.ndarray, "m 3 3"], order: Int[np.ndarray, " m"], starts: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "5 n"]:
    """Boxes around runs of triangles, seen from above: middle x, y and half sides [m], and 1."""
    low = np.minimum.reduceat(triangles[..., :2].min(axis=1)[order], starts).astype(float)
    high = np.maximum.reduceat(triangles[..., :2].max(axis=1)[order], starts).astype(float)
    return np.ascontiguousarray(np.column_stack([(low + high) / 2, (high - low) / 2, np.ones(len(low))]).T)


def screens(triangles: Float[np.ndarray, "m 3 3"]) -> Float[np.ndarray, "n 2 2"]:
    """Walls that reach from the lowest to the highest point of a scene: their ends as seen from above.

    Walls may consist of strips, one above the other, each a rectangle of two triangles.
    """
    spot, number = np.unique(triangles[..., 0].astype(float) + 1j * triangles[..., 1], return_inverse=True)
    number, z = number.reshape(-1, 3), triangles[..., 2]
    a, b = number.min(axis=1), number.max(axis=1)
    third = np.where((number == a[:, None]).sum(axis=1) == 1, a, b)  # the other two lie above each other
    upright = (a < b) & ((number == a[:, None]) | (number == b[:, None])).all(axis=1)
    z_third = np.where(number == third[:, None], z, -np.inf).max(axis=1)
    strip, group = np.unique(
        np.column_stack([a, b, z.min(axis=1), z.max(axis=1)])[upright], axis=0, return_inverse=True
    )
    # Two of the four triangles that a rectangle has with either diagonal make it whole.
    corner = 2 * (third == b) + (z_third == z.max(axis=1))
    has = np.zeros((len(strip), 4), bool)
    has[group.ravel(), corner[upright]] = True
    strip = strip[(has[:, 0] & has[:, 3]) | (has[:, 1] & has[:, 2])]
    if len(strip) == 0:
        return np.empty((0, 2, 2))
    wall, first = np.unique(strip[:, :2].astype(int), axis=0, return_index=True)
    low, high = strip[:, 2], strip[:, 3]
    fits = np.append(low[1:] == high[:-1], True) | np.append(np.isin(np.arange(1, len(low)), first), True)
    whole = np.logical_and.reduceat(fits, first)
    whole &= (low[first] == z.min()) & (high[np.append(first[1:], len(low)) - 1] == z.max())
    return np.stack([spot.real, spot.imag], axis=-1)[wall[whole]]


def _upright(walls: Float[np.ndarray, "n 2 2"]) -> Float32[np.ndarray, "_ 3 3"]:
    """Walls seen from above as triangles from z = -1 to 1."""
    corners = np.empty((len(walls), 4, 3), np.float32)
    corners[:, :, :2] = walls[:, [0, 1, 1, 0]]
    corners[:, :, 2] = [-1, -1, 1, 1]
    return corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)
