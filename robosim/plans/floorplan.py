"""A floor plan: a grid of free, occupied and unknown cells, and its place in `map`.

Cells follow ROS: ``occupancy[iy, ix]`` has y upwards, and the origin is the pose, in the `map` frame, of
the lower-left corner of cell (0, 0), so that the centre of that cell lies half a cell further.

Walls stand where free space ends. There are two conventions, chosen by ``wall_line``: most plans have their
walls on the edges between free and other cells (``"cell_edge"``). The navigable areas published with
mmwRobotNav were turned to walls through the centres of the outermost free cells (``"cell_centre"``), and
a margin (``eroded_m``, the radius of the agent they were made for) had been taken off them before.
"""

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, UInt8
from tyro.conf import Suppress, UseAppendAction, arg

from robosim.plans.furnishings.furnishing import Furnishing
from robosim.support.axes import axes_in_metres
from robosim.support.checks import Range
from robosim.support.parts import part_name
from robosim.support.reading import FileError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FREE, OCCUPIED, UNKNOWN = 0, 1, 2

WallLine = Literal["cell_edge", "cell_centre"]
#: Unknown cells of a ROS map: by common greys, or by the letter of map_server's rule.
MapReading = Literal["common", "letter"]

#: Larger plans are treated as a mistake of the resolution rather than for a building: 300 m square at 0.05 m.
MAX_CELLS = 36_000_000
#: Sides of cells, coordinates and angles beyond these are treated as mistakes of the unit [m, m, rad].
RESOLUTIONS_M, FARTHEST_M, MOST_YAW = (0.001, 10.0), 1e7, 1e3
#: Longest building whose scale the user gives, unless it is confirmed [m].
LARGEST_M = 500.0
#: Letters of a name: file systems allow 255, and names of files are longer.
_LONGEST_NAME = 200


class MapError(FileError):
    """A floor plan that cannot be read or used; the message names the file, the value and the fix."""


def check_resolution(resolution_m: float) -> None:
    """Raise MapError for a side of a cell [m] beyond `RESOLUTIONS_M`."""
    low, high = RESOLUTIONS_M
    if not low <= resolution_m <= high:
        raise MapError(
            f"resolution is {resolution_m:g} m, expected a positive number from {low:g} to {high:g}: "
            "the side of a cell."
        )


def check_size(shape: tuple[int, ...], resolution_m: float) -> None:
    """Raise MapError for a building, of `shape` rows and columns, that is longer than `LARGEST_M`."""
    longest_m = max(shape) * resolution_m
    if longest_m > LARGEST_M:
        raise MapError(
            f"resolution is {resolution_m:g} m, which with {shape[1]} x {shape[0]} cells makes a building "
            f"{longest_m / 1000:.1f} km long. Give the true size of a cell, such as 0.05; if it is that long, confirm "
            "it by --allow-large (allow_large=True)."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorPlan:
    """Occupancy of a storey on a grid of square cells."""

    occupancy: UInt8[np.ndarray, "ny nx"]
    """FREE, OCCUPIED or UNKNOWN for each cell; row 0 has the lowest y."""
    resolution_m: float
    """Side of a cell [m]."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x [m], y [m], yaw [rad] in `map` of the lower-left corner of cell (0, 0)."""
    name: str = "plan"
    """Name of the plan in reports and pictures."""
    wall_line: WallLine = "cell_edge"
    """Position of walls: on the edges of free cells, or through the centres of the outermost ones."""
    eroded_m: float = 0.0
    """Margin that was already taken off the free area [m]."""
    material: UInt8[np.ndarray, "ny nx"] | None = None
    """Material of the walls at each occupied cell: index into `materials` from 1 on, 0 for the building's default;
    None for the default everywhere."""
    materials: tuple[str, ...] = ()
    """Radio materials of walls, by name or as files of layers."""
    furnishings: tuple[Furnishing, ...] = ()
    """Meshes placed in the building, which are not in the cells."""

    def __post_init__(self) -> None:
        if (
            not self.name.strip()
            or len(self.name) > _LONGEST_NAME
            or any(c in "/\\" or not c.isprintable() for c in self.name)
        ):
            raise MapError(
                f"name is {self.name[:_LONGEST_NAME]!r}, expected printable text of at most {_LONGEST_NAME} letters "
                "without slashes: files are named after it."
            )
        problem = self._problem_of_grid() or self._problem_of_place()
        if problem:
            raise MapError(f"{self.name}: {problem}")

    def __repr__(self) -> str:
        rows, columns = self.shape
        area_m2 = self.free.sum() * self.resolution_m**2
        placed = f", {len(self.furnishings)} placed in it" if self.furnishings else ""
        return (
            f"<FloorPlan {self.name!r}: {columns} x {rows} cells of {self.resolution_m:g} m, {area_m2:.1f} m2 "
            f"free{placed}>"
        )

    def _problem_of_grid(self) -> str | None:
        """Describe what is wrong with the cells; empty if nothing is."""
        grid = self.occupancy
        if grid.ndim != 2 or 0 in grid.shape:
            return f"occupancy has shape {grid.shape}, expected (ny, nx)."
        if grid.size > MAX_CELLS:
            return (
                f"{grid.shape[1]} x {grid.shape[0]} cells, expected at most {MAX_CELLS:.2g} cells in all. "
                "Check the resolution, or downsample the plan."
            )
        if grid.dtype != np.uint8 or grid.max() > UNKNOWN:
            return (
                f"occupancy is {grid.dtype} up to {grid.max()}, expected uint8: {FREE} free, {OCCUPIED} "
                f"occupied, {UNKNOWN} unknown."
            )
        of_wall = self.material
        if of_wall is not None and (
            of_wall.shape != grid.shape or of_wall.dtype != np.uint8 or of_wall.max() > len(self.materials)
        ):
            return (
                f"material is {of_wall.dtype} of {of_wall.shape} up to {of_wall.max()}, expected uint8 of "
                f"{grid.shape} up to {len(self.materials)}, as there are {len(self.materials)} materials."
            )
        if of_wall is not None and (of_wall[grid != OCCUPIED] > 0).any():
            return "material is given for cells that are not occupied, expected 0 there."
        if not (grid == FREE).any():
            return "no free space. Check the thresholds and `negate`, or whether black and white are swapped."
        return None

    def _problem_of_place(self) -> str | None:
        """Describe what is wrong with the numbers around the grid; empty if nothing is."""
        try:
            check_resolution(self.resolution_m)
        except MapError as error:
            return str(error)
        far = (FARTHEST_M, FARTHEST_M, MOST_YAW)
        if len(self.origin) != 3 or not (np.abs(self.origin) <= far).all():
            return (
                f"origin is {self.origin}, expected x and y of at most {FARTHEST_M:g} m and a yaw of at most "
                f"{MOST_YAW:g} rad."
            )
        if self.wall_line not in get_args(WallLine):
            return f"wall_line is {self.wall_line!r}, expected one of {', '.join(get_args(WallLine))}."
        if not 0 <= self.eroded_m <= RESOLUTIONS_M[1]:
            return f"eroded_m is {self.eroded_m:g}, expected 0 to {RESOLUTIONS_M[1]:g} m."
        return None

    def digest(self) -> str:
        """A text that changes with everything that a building depends on; seeds are derived from it too."""
        seen = hashlib.sha256(repr((self.shape, self.resolution_m, self.origin, self.wall_line)).encode())
        seen.update(self.occupancy.tobytes())
        if self.material is not None:
            seen.update(repr(self.materials).encode() + self.material.tobytes())
        for furnishing in self.furnishings:
            seen.update(
                np.ascontiguousarray(furnishing.triangles).tobytes() + part_name(furnishing.material).encode()
            )
        return seen.hexdigest()[:16]

    @property
    def free(self) -> Bool[np.ndarray, "ny nx"]:
        """Mask of the free cells."""
        return self.occupancy == FREE

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (y) and columns (x)."""
        return self.occupancy.shape[0], self.occupancy.shape[1]

    def to_map(self, cells: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Points (x, y) [m] in `map` of continuous cell coordinates (column, row).

        The lower-left corner of cell (iy, ix) is (ix, iy), its centre (ix + 0.5, iy + 0.5).
        """
        x, y, yaw = self.origin
        c, s = np.cos(yaw), np.sin(yaw)
        local = np.asarray(cells, float) * self.resolution_m
        return local @ np.array([[c, s], [-s, c]]) + (x, y)

    def to_cells(self, points: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Continuous cell coordinates (column, row) of points (x, y) [m] in `map`; inverse of `to_map`."""
        x, y, yaw = self.origin
        c, s = np.cos(yaw), np.sin(yaw)
        return (np.asarray(points, float) - (x, y)) @ np.array([[c, -s], [s, c]]) / self.resolution_m

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the cells in `map`: free ones white, occupied ones black, unknown ones grey; None for a new figure."""
        from matplotlib.transforms import Affine2D

        axes = axes_in_metres(axes)
        shades = np.array([255, 0, 200], np.uint8)  # of FREE, OCCUPIED, UNKNOWN
        ny, nx = self.shape
        x, y, yaw = self.origin
        placed = Affine2D().scale(self.resolution_m).rotate(yaw).translate(x, y)
        image = axes.imshow(
            shades[self.occupancy], cmap="gray", vmin=0, vmax=255, origin="lower", extent=(0, nx, 0, ny)
        )
        image.set_transform(placed + axes.transData)
        # The limits of an image do not take its rotation into account.
        corners = self.to_map(np.array([[0.0, 0], [nx, 0], [nx, ny], [0, ny]]))
        axes.set(
            xlim=(corners[:, 0].min(), corners[:, 0].max()), ylim=(corners[:, 1].min(), corners[:, 1].max())
        )
        axes.set_title(self.name, parse_math=False)  # names may have dollars in them
        return axes

    def centres(self, mask: Bool[np.ndarray, "ny nx"]) -> Float[np.ndarray, "n 2"]:
        """Points (x, y) [m] in `map` of the centres of the cells where `mask` holds, row by row."""
        iy, ix = np.nonzero(mask)
        return self.to_map(np.column_stack([ix, iy]) + 0.5)


def grid_size(
    lower: Float[np.ndarray, " 2"], upper: Float[np.ndarray, " 2"], resolution_m: float, what: str
) -> tuple[int, int]:
    """Columns and rows of a grid that holds a rectangle [m], `what` in messages, with a margin of one cell around it.

    Raises:
        MapError: If there would be more than MAX_CELLS, or it lies too far away.
    """
    with np.errstate(over="ignore"):
        cells = (upper - lower) / resolution_m
        n_cells = np.prod(cells + 2)
    if not (n_cells <= MAX_CELLS and np.abs([lower, upper]).max() <= FARTHEST_M):
        raise MapError(
            f"{what} goes from {lower} to {upper} m, more than {MAX_CELLS:.2g} cells of {resolution_m:g} m or too far "
            "away. Are its coordinates in metres? If so, pass a coarser resolution."
        )
    # A rounding error above a whole number of cells does not add another one.
    nx, ny = (int(n) for n in np.maximum(np.ceil(cells - 1e-3), 1) + 2)
    return nx, ny


UpAxis = Literal["auto", "y", "z"]


@dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """Options of reading a floor plan; a reader uses those of its format. Options of commands have the names given."""

    resolution_m: Annotated[float | None, Range(0.001, 10, "m"), arg(name="resolution")] = None
    """Side of a cell [m], for images and arrays; 0.05 for other formats if not given."""
    floor_height_m: Annotated[float | None, Range(-1e5, 1e5, "m"), arg(name="floor-height")] = None
    """Height of the storey's floor [m], to within half a metre, for meshes of several storeys; the lowest if not
    given."""
    slice_m: Annotated[tuple[float, float], Range(0, 1000, "m"), Suppress] = (0.2, 1.5)
    """For meshes: heights above the floor between which nothing may stand in free cells [m]: above doorsills and rugs,
    below lintels."""
    up: UpAxis = "auto"
    """Axis of a mesh that points up; auto is y for glTF and z for others, unless the other one of the two has a floor
    more than twice as large."""
    unit_m: Annotated[float | None, Range(1e-9, 1e6, "m"), arg(name="unit")] = None
    """Unit of length of a mesh or drawing [m]: 0.001 for millimetres, 0.0254 for inches. If not given, metres for
    meshes, and what a drawing says."""
    ground_m: Annotated[float | None, Range(-1e5, 1e5, "m"), arg(name="ground")] = None
    """Height of level ground to add below a mesh that has no floor [m]."""
    thinnest_wall_m: Annotated[float | None, Range(1e-3, 10, "m"), arg(name="thinnest-wall")] = None
    """Dark strokes of an image thinner than this are dropped as text, door arcs and furniture [m]; all are walls if
    not given."""
    allow_large: bool = False
    """Whether an image, array or drawing may be of a building longer than 500 m, and whether a scene may have so many
    triangles that preparing it takes half of the memory."""
    map_reading: MapReading = "common"
    """Unknown cells of a ROS map: by the usual grey of unknown cells, with a warning, or by its thresholds alone."""
    wall_layers: Annotated[tuple[str, ...], arg(name="wall-layer"), UseAppendAction] = ()
    """Layer of walls of a drawing (DXF, SVG), * for any letters, can be given several times; if not given, those called
    walls, or the only one."""
    line_thickness_m: Annotated[float | None, Range(1e-3, 10, "m"), arg(name="line-thickness")] = None
    """Thickness of walls that a drawing has as single lines [m]; one cell if not given."""
