"""Input features of learned mappers: one depth image projected to the floor, and the map so far.

Known geometry is computed rather than learned. A depth image becomes a scan (`slam.sensing.projection`), and each cell
of the patch ahead gets its signed distance to the surface in its image column, to a centimetre, which a picture of
occupied cells would lose. The network learns the rest: which of several noisy returns is the edge, where an unmeasured
surface lies, and what is behind.

| channel | meaning |
|---|---|
| CLEARANCE | how far before the surface of its column the cell lies, -1 to 1 in tenths of a metre; 0 out of view |
| SURFACE | 1 where the column has a surface, else 0 |
| IN_VIEW | 1 where the column has measured anything, else 0 |
| POINTS | surface points in the cell, shared among the four nearest cells, 0 to 1 |
| BELIEF | obstacle probability of the map, -1 to 1; 0 where nothing is known |
| AHEAD, LEFT | place of the cell, -1 to 1 |
"""

import numpy as np
from jaxtyping import Float, Float32

from slam.sensing.egocentric import AHEAD
from slam.sensing.projection import CameraModel, Scan, scan_from_depth, surface_points

CLEARANCE, SURFACE, IN_VIEW, POINTS, BELIEF, PLACE_AHEAD, PLACE_LEFT = range(7)
N_CHANNELS = 7

#: Clearance that counts as 1 [m].
CLEARANCE_M = 0.1
#: Points farther than this are left out [m].
RANGE_M = 4.5


class Features:
    """Lays out scans on the patch ahead."""

    def __init__(self) -> None:
        """Fix the geometry."""
        centres = AHEAD.centres(np.ones(AHEAD.shape, bool)).reshape(*AHEAD.shape, 2)
        self._ahead = centres[..., 0].astype(np.float32)
        self._slope = (centres[..., 1] / np.maximum(centres[..., 0], 1e-6)).astype(np.float32)
        low = np.array(AHEAD.origin_xy)
        size = np.array(AHEAD.shape[::-1]) * AHEAD.resolution_m
        self._place = np.moveaxis(2 * (centres - low) / size - 1, -1, 0).astype(np.float32)

    def of(
        self, depth: Float32[np.ndarray, "h w"], belief: Float32[np.ndarray, "ny nx"]
    ) -> Float32[np.ndarray, "7 ny nx"]:
        """Channels of one depth image of the default camera."""
        return self.of_scan(scan_from_depth(depth, CameraModel()), belief)

    def of_scan(self, scan: Scan, belief: Float32[np.ndarray, "ny nx"]) -> Float32[np.ndarray, "7 ny nx"]:
        """Channels of one scan; see `of`."""
        out = np.empty((N_CHANNELS, *AHEAD.shape), np.float32)
        per_column = (scan.left[0] - scan.left[-1]) / (len(scan.left) - 1)
        column = np.rint((scan.left[0] - self._slope) / per_column)
        inside = (column >= 0) & (column < len(scan.left)) & (self._ahead > 0)
        column = np.where(inside, column, 0).astype(np.intp)
        clear = scan.clear_m[column]
        view = inside & (clear > 0)
        out[CLEARANCE] = np.where(view, np.clip((clear - self._ahead) / CLEARANCE_M, -1, 1), 0)
        out[SURFACE] = view & scan.hit[column]
        out[IN_VIEW] = view
        out[POINTS] = self._splat(surface_points(scan, RANGE_M))
        out[BELIEF] = 2 * belief - 1
        out[PLACE_AHEAD], out[PLACE_LEFT] = self._place
        return out

    def _splat(self, points: Float[np.ndarray, "n 2"]) -> Float32[np.ndarray, "ny nx"]:
        """Points shared among the four cells whose centres are nearest."""
        ny, nx = AHEAD.shape
        cells = AHEAD.to_cells(points) - 0.5
        # A rim of one cell takes what falls off the edge.
        cells = cells[((cells > -1) & (cells < (nx, ny))).all(axis=1)] + 1
        corner = np.floor(cells).astype(np.intp)
        fx, fy = (cells - corner).T
        start = corner[:, 1] * (nx + 2) + corner[:, 0]
        index = np.concatenate([start, start + 1, start + nx + 2, start + nx + 3])
        share = np.concatenate([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy])
        total = np.bincount(index, share, minlength=(nx + 2) * (ny + 2)).reshape(ny + 2, nx + 2)[1:-1, 1:-1]
        return np.minimum(total / 4, 1).astype(np.float32)
