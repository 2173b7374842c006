"""Coverage maps of scenes: a level grid over a mesh, traced in batches so that memory stays bounded."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import trimesh
from jaxtyping import Float, UInt8

from robosim.support.checks import Range, check_number, checked
from wireless.antennas.mounting import MountedArray
from wireless.bands import noise_power_dbm
from wireless.coverage import CellState, CoverageMap, ReceiverGrid, check_bounds, link_values, outside_error
from wireless.geometry.array_types import Points
from wireless.geometry.closed_surfaces import Sides, capped
from wireless.paths import Paths

#: Sides of cells [m], and most points of a grid.
CELL_M, MOST_POINTS = Range(1e-6, 1e5, "m", "Try 1."), 1_000_000
#: Links that are traced at once: their paths take some 100 MB.
_BATCH_LINKS = 8192


@dataclass(frozen=True, kw_only=True)
@checked
class CoverageConfig:
    """What a coverage map shows, and of where."""

    cell_m: Annotated[float, CELL_M] = 1.0
    """Side of a cell [m]."""
    height_m: Annotated[float, Range(-1e4, 1e4, "m")] = 1.5
    """Height above the scene's floor, its lowest point [m]."""
    bounds_m: tuple[float, float, float, float] | None = None
    """Box x, y, x, y of the map [m]; None for the whole scene."""
    points_per_side: Annotated[int, Range(1, 100, "points")] = 1
    """A cell is the mean of so many points squared; 1 for its middle."""
    tx_power_dbm: float | tuple[float, ...] = 23.0
    """Power of all transmitters, or of each [dBm]."""
    bandwidth_mhz: Annotated[float, Range(1e-3, 1e5, "MHz")] = 400.0
    """Bandwidth, which sets the noise [MHz]."""
    loss_db: Annotated[float, Range(-200, 200, "dB")] = 6.0
    """Noise figure and other losses of receivers [dB]."""
    threshold_db: float = -math.inf
    """Paths of less power gain do not count for link categories."""
    coherent: bool = False
    """Whether paths add with their phases, as at one frequency at a point; else their powers add."""


def level_grid(
    mesh: trimesh.Trimesh,
    cell_m: float,
    z_m: float,
    bounds_m: tuple[float, ...] | None = None,
    tx: Float[np.ndarray, "n_tx 3"] | None = None,
    per_side: int = 1,
) -> ReceiverGrid:
    """Cells at a height over all of a mesh, or over a box, from its lower-left corner, each of per_side^2 receivers.

    Cells outside of the mesh's own box, and those that closed surfaces part from all transmitters, are known as such.

    Raises:
        ValueError: If there are too many cells, or the box is outside of the mesh.
    """
    check_number("grid", cell_m, *CELL_M)
    low, high = np.asarray(mesh.bounds)
    check_bounds(box := bounds_m or (*low[:2], *high[:2]))
    west, south, east, north = box
    if not (west < high[0] and south < high[1] and east > low[0] and north > low[1]):
        raise outside_error(box, low, high)
    nx, ny = (per_side * max(1, math.ceil(side / cell_m - 1e-9)) for side in (east - west, north - south))
    check_count(nx * ny, cell_m, east - west, north - south)
    step_m, origin = cell_m / per_side, np.array([west, south])
    corner = np.stack(np.meshgrid(np.arange(nx + 1), np.arange(ny + 1)), axis=-1) * step_m + origin
    cell = np.argwhere(np.ones((ny, nx), bool))
    # Rounded to picometres: a grid of 0.15 m holds 0.3, not 0.30000000000000004.
    middle = np.round((cell[:, ::-1] + 0.5) * step_m + origin, 12)
    position = np.column_stack([middle, np.full(len(cell), z_m)])
    unreached = _unreached(mesh, position, tx).reshape(ny, nx)
    return ReceiverGrid(position=position, cell=cell, shape=(ny, nx), edges=corner, unreached=unreached)


def check_count(count: float, cell_m: float, width_m: float, height_m: float) -> None:
    """Raise ValueError if a grid has too many points."""
    if count > MOST_POINTS:
        least = math.sqrt(width_m * height_m / MOST_POINTS)
        raise ValueError(
            f"grid is {cell_m:g} m, which makes {count:.0f} receivers on {width_m:g} x {height_m:g} m, more than "
            f"{MOST_POINTS} places. Take wider cells, such as {math.ceil(least * 120) / 100:g} m, or in a scene "
            "smaller bounds."
        )


def _unreached(
    mesh: trimesh.Trimesh, points: Points, tx: Float[np.ndarray, "n_tx 3"] | None
) -> UInt8[np.ndarray, " n"]:
    """`CellState` of points where no path arrives."""
    state = np.full(len(points), CellState.NO_PATH, np.uint8)
    middle, (low, high) = mesh.bounds.mean(axis=0), mesh.bounds[:, :2]
    if tx is not None:
        sides = Sides(capped(mesh))
        # Air is where a transmitter is: in a room outside of no closed surface, around buildings outside of all.
        in_air = np.isin(sides.parity(points - middle), sides.parity(tx - middle))
        enclosed = sides.enclosed(points - middle)
        state[~in_air] = np.where(enclosed[~in_air], CellState.IN_BODY, CellState.OUTSIDE)
    state[((points[:, :2] < low) | (points[:, :2] > high)).any(axis=1)] = CellState.OUTSIDE
    return state


def trace_coverage(
    trace: Callable[[np.ndarray, np.ndarray], Paths],
    tx: Float[np.ndarray, "n_tx 3"],
    grid: ReceiverGrid,
    config: CoverageConfig,
    *,
    tx_antenna: MountedArray,
    rx_antenna: MountedArray,
) -> CoverageMap:
    """Coverage of a grid with `config.points_per_side` points along the sides of cells, traced by a function.

    Raises:
        ValueError: If the powers do not fit the transmitters.
    """
    power_dbm = np.asarray(config.tx_power_dbm, float)
    if power_dbm.shape not in ((), (len(tx),)) or not np.isfinite(power_dbm).all():
        raise ValueError(
            f"tx_power_dbm is {config.tx_power_dbm}, expected a number [dBm], or one for each of the {len(tx)} "
            "transmitters."
        )
    batch = max(1, _BATCH_LINKS // len(tx))
    links = []
    for first in range(0, len(grid.position), batch):
        paths = trace(tx, grid.position[first : first + batch])
        options = {"coherent": config.coherent, "threshold_db": config.threshold_db}
        links.append(link_values(paths, tx=tx_antenna, rx=rx_antenna, **options))
    joined = {name: np.concatenate([part[name] for part in links], axis=1) for name in links[0]}
    points = CoverageMap.from_links(
        joined,
        grid,
        tx_position=tx,
        tx_power_dbm=np.broadcast_to(power_dbm, len(tx)).copy(),
        noise_dbm=noise_power_dbm(config.bandwidth_mhz, config.loss_db),
        frequency_hz=paths.frequency_hz,
        coherent=config.coherent,
    )
    return points.averaged(config.points_per_side) if config.points_per_side > 1 else points
