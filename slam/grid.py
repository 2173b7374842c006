"""Grid frames and map estimates.

Cells follow ROS: ``grid[iy, ix]`` has y upwards, and the origin is the lower-left corner of cell (0, 0), so that
the centre of a cell lies half a cell further. A `GridFrame` places such a grid in a frame of coordinates (`map`, or
a robot's own); planners, explorers and controllers receive a `MapEstimate` at every decision.

A growing map adds whole cells only, so a cell never changes its place in `map`.
"""

import math
import mmap
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Real
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import DTypeLike

from robosim.support.axes import axes_in_metres
from robosim.support.checks import shown
from slam.hull import Hull
from slam.poses import to_robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, kw_only=True)
class GridFrame:
    """Place and size of a grid of square cells whose axes are those of the frame."""

    origin_xy: tuple[float, float]
    """Lower-left corner of cell (0, 0) [m]."""
    resolution_m: float = 0.05
    """Side of a cell [m]."""
    shape: tuple[int, int] = (1, 1)
    """Rows (y) and columns (x)."""

    def __post_init__(self) -> None:
        # Several per decision, hence plain checks for speed.
        if len(self.origin_xy) != 2 or not all(abs(value) <= 1e9 for value in self.origin_xy):
            raise ValueError(f"origin_xy is {shown(self.origin_xy)}, expected two numbers up to 1e9 m.")
        if not 1e-6 <= self.resolution_m <= 1e6:
            raise ValueError(f"resolution_m is {self.resolution_m:g}, expected 1e-6 to 1e6 m.")
        if len(self.shape) != 2 or not all(1 <= count <= 1_000_000 for count in self.shape):
            raise ValueError(f"shape is {shown(self.shape)}, expected (rows, columns), both 1 to 1000000.")

    def to_cells(self, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Continuous cell coordinates (column, row) of points (x, y) [m].

        The lower-left corner of cell (iy, ix) is (ix, iy), its centre (ix + 0.5, iy + 0.5).
        """
        return (np.asarray(points, float) - self.origin_xy) / self.resolution_m

    def to_points(self, cells: Real[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Points (x, y) [m] of continuous cell coordinates (column, row); inverse of `to_cells`."""
        return np.asarray(cells, float) * self.resolution_m + self.origin_xy

    def index(
        self, points: Float[np.ndarray, "*batch 2"]
    ) -> tuple[Int[np.ndarray, "*batch"], Int[np.ndarray, "*batch"]]:
        """Row and column of the cell that holds each point (x, y) [m]; may lie outside of the grid."""
        cells = np.floor(self.to_cells(points)).astype(np.int64)
        return cells[..., 1], cells[..., 0]

    def centres(self, mask: Bool[np.ndarray, "ny nx"]) -> Float[np.ndarray, "n 2"]:
        """Centres (x, y) [m] of the cells where `mask` holds, row by row."""
        iy, ix = np.nonzero(mask)
        return self.to_points(np.column_stack([ix, iy]) + 0.5)

    def inside(
        self, iy: Int[np.ndarray, "*batch"] | int, ix: Int[np.ndarray, "*batch"] | int
    ) -> Bool[np.ndarray, "*batch"]:
        """Whether rows and columns belong to the grid."""
        iy, ix = np.asarray(iy), np.asarray(ix)
        return np.asarray((iy >= 0) & (iy < self.shape[0]) & (ix >= 0) & (ix < self.shape[1]))

    def window(
        self, low_xy: tuple[float, float], high_xy: tuple[float, float]
    ) -> tuple[slice, slice, "GridFrame"]:
        """The part of the grid that covers a box of `map`.

        Returns:
            Rows, columns and frame of the part. At least one cell, even if the box lies outside.
        """
        (x0, y0), (x1, y1) = self.to_cells(np.array([low_xy, high_xy]))
        ny, nx = self.shape
        ix0, iy0 = min(max(int(x0), 0), nx - 1), min(max(int(y0), 0), ny - 1)
        ix1, iy1 = min(max(math.ceil(x1), ix0 + 1), nx), min(max(math.ceil(y1), iy0 + 1), ny)
        rows, columns = slice(iy0, iy1), slice(ix0, ix1)
        return rows, columns, self.window_frame(rows, columns)

    def axes(self) -> tuple[Float[np.ndarray, " nx"], Float[np.ndarray, " ny"]]:
        """Centres of columns (x) and rows (y) [m]."""
        ny, nx = self.shape
        x = self.origin_xy[0] + (np.arange(nx) + 0.5) * self.resolution_m
        y = self.origin_xy[1] + (np.arange(ny) + 0.5) * self.resolution_m
        return x, y

    def disc(
        self, xy: Float[np.ndarray, "2"], radius_m: float
    ) -> tuple[slice, slice, Bool[np.ndarray, "ny nx"]]:
        """Rows and columns around a disc in `map`, and which of their cells have their centres in it."""
        x, y = float(xy[0]), float(xy[1])
        rows, columns, frame = self.window((x - radius_m, y - radius_m), (x + radius_m, y + radius_m))
        cx, cy = frame.axes()
        return rows, columns, (cx - x) ** 2 + (cy - y)[:, None] ** 2 < radius_m**2

    def under(
        self, pose: Float[np.ndarray, "3"], hull: Hull, margin_m: float = 0.0
    ) -> tuple[slice, slice, Bool[np.ndarray, "ny nx"]]:
        """Rows and columns around a hull at a pose, and which of their cells have their centres under it.

        Those nearer than a margin [m] to its edge are left out.
        """
        if not hull.outline_m:
            return self.disc(pose[:2], hull.radius_m - margin_m)
        reach = hull.turning_m
        low, high = pose[:2] - reach, pose[:2] + reach
        rows, columns, frame = self.window((low[0], low[1]), (high[0], high[1]))
        centres = np.stack(np.meshgrid(*frame.axes()), axis=-1)
        return rows, columns, hull.covers(to_robot(pose, centres), margin_m)

    def window_frame(self, rows: slice, columns: slice) -> "GridFrame":
        """Frame of some rows and columns."""
        x, y = self.origin_xy
        origin_xy = (x + columns.start * self.resolution_m, y + rows.start * self.resolution_m)
        shape = (rows.stop - rows.start, columns.stop - columns.start)
        return GridFrame(origin_xy=origin_xy, resolution_m=self.resolution_m, shape=shape)

    def padded(self, left: int, right: int, below: int, above: int) -> "GridFrame":
        """Return the lattice with whole cells added on its four sides."""
        x, y = self.origin_xy
        ny, nx = self.shape
        return GridFrame(
            origin_xy=(x - left * self.resolution_m, y - below * self.resolution_m),
            resolution_m=self.resolution_m,
            shape=(ny + below + above, nx + left + right),
        )


#: Area for which work over the whole map is done at full rate [m2].
_FULL_RATE_M2 = 1000.0
#: Grids of more cells are not held as arrays where their values follow from those of another grid.
LARGE_CELLS = 4_000_000


def zeros(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """An array of zeros that takes memory page by page, where it is written to."""
    # numpy requests pages of 2 MB, which a few cells per row would fill.
    size = max(math.prod(shape) * np.dtype(dtype).itemsize, 1)
    return np.ndarray(shape, dtype, buffer=mmap.mmap(-1, size, access=mmap.ACCESS_COPY))


def filled_blocks(grid: np.ndarray) -> list[tuple[slice, slice]]:
    """Rows and columns of the blocks of a grid that hold more than zeros."""
    rows, columns = (
        [slice(k, k + side) for k in range(0, size, side)]
        for size, side in zip(grid.shape, (64, 512), strict=False)
    )
    return [block for block in product(rows, columns) if grid[block].any()]


def enlarged(
    old: np.ndarray,
    shape: tuple[int, int],
    left: int,
    below: int,
    blocks: list[tuple[slice, slice]] | None = None,
) -> np.ndarray:
    """Return a grid of a larger shape (rows, columns), 0 around the old one; zeros take no memory.

    Of the old one, `blocks` hold more than zeros; they are searched for if None.
    """
    new = zeros((*shape, *old.shape[2:]), old.dtype)
    inside = new[below : below + old.shape[0], left : left + old.shape[1]]
    for block in filled_blocks(old) if blocks is None else blocks:
        np.copyto(inside[block], old[block], where=old[block] != 0)
    return new


class ComputedGrid(NDArrayOperatorsMixin):
    """A large grid whose values are computed where they are read, from other grids of the same cells.

    It is read like an array: `grid[rows, columns]` is an array of these cells. Whatever needs all cells, as
    comparisons and methods do, takes the time and memory of an array: `np.asarray(grid)`.
    """

    def __init__(self, compute: Callable[..., Any], *sources: Any) -> None:
        """Make a grid by a function of cells of the sources, which all have the same rows and columns."""
        self._compute, self._sources = compute, sources
        self.shape, self.size, self.ndim = sources[0].shape, sources[0].size, sources[0].ndim
        self.dtype = self[:1].dtype

    def __len__(self) -> int:
        return int(self.shape[0])

    def __getitem__(self, key: Any) -> Any:
        return self._compute(*(source[key] for source in self._sources))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> np.ndarray:
        values = np.empty(self.shape, self.dtype if dtype is None else dtype)
        for y in range(0, len(self), 256):
            values[y : y + 256] = self[y : y + 256]
        return values

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        arrays = (np.asarray(value) if isinstance(value, ComputedGrid) else value for value in inputs)
        return getattr(ufunc, method)(*arrays, **options)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(np.asarray(self), name)


#: Values of all cells: an array, or computed where they are read.
Grid = np.ndarray | ComputedGrid


def read_only(grid: Grid) -> Any:
    """A view of a grid that cannot be written to."""
    if not isinstance(grid, np.ndarray):
        return grid
    view = grid.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingThing:
    """A tracked thing."""

    xy: Float[np.ndarray, "2"]
    """Position of its centre in `map` [m]."""
    velocity: Float[np.ndarray, "2"]
    """Velocity [m/s]."""
    covariance: Float[np.ndarray, "4 4"]
    """Covariance of position and velocity [m2, m2/s, m2/s2]."""
    stood_s: float
    """Time that it has stood at its place [s]."""
    unseen_s: float
    """Time since it was last seen [s]."""
    number: int
    """Number of the track, constant in all estimates."""
    radius_m: float | None = None
    """Radius [m]; None if it is not known."""


class Claim(NamedTuple):
    """Where another robot is bound."""

    xy: Float[np.ndarray, "2"]
    """Its goal in `map` [m]."""
    cost_m: float
    """Length of its path there [m]."""
    to_target: bool = False
    """Whether it expects the target there, or farther in that direction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MapEstimate:
    """Estimate of a mapper at one decision: map and pose.

    The arrays are read-only views of the mapper's own and change with its next update: copy what must last. Of maps of
    more than 4 million cells, the shipped mappers compute probabilities where they are read (`ComputedGrid`).
    """

    frame: GridFrame
    """Where the cells lie in `map`."""
    obstacle_probability: Float32[Grid, "ny nx"]
    """Belief that something that stops the robot stands in the cell; 0.5 where nothing is known."""
    explored: Bool[np.ndarray, "ny nx"]
    """Cells that the camera has looked at from near enough to count as seen."""
    blocked: Bool[np.ndarray, "ny nx"]
    """Cells where the robot ran into something that the camera does not see."""
    pose: Float[np.ndarray, "3"]
    """Estimated x [m], y [m], yaw [rad] in `map`."""
    surface_offset_m: Float32[np.ndarray, "ny nx 2"] | None = None
    """Where in an obstacle cell its surface lies, from the centre of the cell (x, y) [m]; None if unknown."""
    anticipated_probability: Float32[Grid, "ny nx"] | None = None
    """`obstacle_probability` continued by a guess where the camera has not looked, as far as one was made: behind
    furniture, round corners. None if the mapper does not guess."""
    moving: tuple[MovingThing, ...] = ()
    """People and others who move, if they are tracked; they are not part of the map."""
    claims: tuple[Claim, ...] = ()
    """Where other robots of a team are bound."""

    def __repr__(self) -> str:
        x, y, yaw = self.pose
        ny, nx = self.frame.shape
        explored_m2 = self.explored.sum() * self.frame.resolution_m**2
        return (
            f"<MapEstimate: {nx} x {ny} cells of {self.frame.resolution_m:g} m, {explored_m2:.1f} m2 explored, "
            f"robot at ({x:.2f}, {y:.2f}) m, {math.degrees(yaw):.0f} deg>"
        )

    def plot(self, axes: "Axes | None" = None, *, robot: bool = True) -> "Axes":
        """Draw the map: obstacles black, what was seen free of them white, the rest grey.

        Args:
            axes: Where to draw; None for axes of a new figure.
            robot: Whether to draw where the robot is taken to be, and where it looks to.
        """
        axes = axes_in_metres(axes)
        shade = np.full(self.frame.shape, 0.85)
        shade[self.explored] = 1.0
        shade[self.obstacle] = 0.15
        (x, y), (ny, nx), cell_m = self.frame.origin_xy, self.frame.shape, self.frame.resolution_m
        extent = (x, x + nx * cell_m, y, y + ny * cell_m)
        axes.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, zorder=0)
        if robot:
            ahead = np.array([math.cos(self.pose[2]), math.sin(self.pose[2])])
            axes.quiver(*self.pose[:2], *ahead, color="tab:orange", pivot="middle")
        return axes

    @property
    def size_factor(self) -> int:
        """Factor by which work over the whole map is done less often than on a small one; 1 below 2,000 m^2."""
        ny, nx = self.frame.shape
        return max(1, int(ny * nx * self.frame.resolution_m**2 / _FULL_RATE_M2))

    @property
    def obstacle(self) -> Bool[np.ndarray, "ny nx"]:
        """Cells more likely occupied than not."""
        return self.obstacle_probability > 0.5

    @property
    def known_free(self) -> Bool[np.ndarray, "ny nx"]:
        """Cells more likely free than not; neither obstacle nor unknown."""
        return self.obstacle_probability < 0.5
