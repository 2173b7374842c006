"""Blocks of large scenes: triangles tested for visibility together, and one piece that stands for them from afar.

A floor of tens of thousands of square metres has so many tiles that choosing and drawing them takes most of a
picture's time. Triangles are gathered by squares of some metres, those of each level plane apart. Beyond a distance
where a tile is less than half a pixel high, the tiles of a block are drawn as one fan of triangles, from a middle
point to the edges of the block, in their mean colour: the surface and its edges are those of the tiles. A block of one
colour is drawn so at any distance.

Left out: blocks in the shadow of walls, and those whose fan would not cover their tiles exactly; they are drawn as
tiles.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int, UInt8

from robosim.camera.rendering.tessellation import doubled_area

#: Side of blocks, seen from above [m].
BLOCK_M = 8.0
# The grain of floors is within this share of the brightest tone; shadows are not.
_EVEN = 0.8


class Blocks(NamedTuple):
    """Triangles by block and level plane, and the pieces that stand for them."""

    number: Int[np.ndarray, " m"]
    """Block of each triangle."""
    far_m: Float[np.ndarray, " n"]
    """Distance beyond which a block's piece is drawn [m]; infinite for blocks without one."""
    counts: Int[np.ndarray, " n"]
    """Number of triangles of each block's piece."""
    fans: Float32[np.ndarray, "k 3 3"]
    """Triangles of all pieces, block by block."""
    colours: UInt8[np.ndarray, "k 3"]
    """Their colours."""

    @classmethod
    def of(
        cls, triangles: Float32[np.ndarray, "m 3 3"], colours: UInt8[np.ndarray, "m 3 3"], far_m: float
    ) -> "Blocks":
        """Gather triangles by the square that their middle lies in; `colours` are those of their corners."""
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        doubled = doubled_area(triangles[..., :2].astype(float))
        level = (low[:, 2] == high[:, 2]) & (doubled != 0)
        square = np.floor((low + high)[:, :2] / (2 * BLOCK_M))  # both triangles of a tile have one middle
        plane = np.column_stack([np.sign(doubled), low[:, 2]]) * level[:, None]
        _, number = np.unique(np.hstack([square, plane]), axis=0, return_inverse=True)
        number = number.ravel()
        order = np.argsort(number, kind="stable")
        count = np.bincount(number)
        starts = np.cumsum(count) - count
        middle = np.minimum.reduceat(low[order], starts) + np.maximum.reduceat(high[order], starts)
        sides = _border(triangles, number)
        owner = number[sides // 3]
        ends = triangles.reshape(-1, 3)[np.column_stack([sides, sides - sides % 3 + (sides + 1) % 3])]
        fans = np.concatenate([ends, middle[owner, None] / 2], axis=1)
        # Triangles of one orientation around a point cover what their outer sides enclose, once.
        turned = np.bincount(
            owner, doubled_area(fans[..., :2].astype(float)) * doubled[sides // 3] <= 0, len(count)
        )
        n_sides = np.bincount(owner, minlength=len(count))
        tones = colours[order]
        dark = np.minimum.reduceat(tones.min(axis=1), starts)
        bright = np.maximum.reduceat(tones.max(axis=1), starts)
        fits = level[order[starts]] & (turned == 0) & (n_sides < count) & (dark > _EVEN * bright).all(axis=1)
        mean = np.add.reduceat(tones.mean(axis=1), starts) / count[:, None]
        by_block = np.argsort(owner, kind="stable")
        by_block = by_block[fits[owner[by_block]]]
        return cls(
            number,
            np.where(fits, np.where((dark == bright).all(axis=1), -np.inf, far_m), np.inf),
            np.where(fits, n_sides, 0),
            fans[by_block],
            mean.round().astype(np.uint8)[owner[by_block]],
        )


def _border(triangles: Float32[np.ndarray, "m 3 3"], number: Int[np.ndarray, " m"]) -> Int[np.ndarray, " k"]:
    """Sides of triangles, as triangle * 3 + side, that no other triangle of the block shares."""
    spots, spot = np.unique(triangles[..., 0].astype(float) + 1j * triangles[..., 1], return_inverse=True)
    spot = spot.reshape(-1, 3)
    ends = np.sort(np.stack([spot, np.roll(spot, -1, axis=1)], axis=-1), axis=-1)
    key = (number[:, None] * len(spots) + ends[..., 0]) * len(spots) + ends[..., 1]
    _, first, count = np.unique(key, return_index=True, return_counts=True)
    return first[count == 1]
