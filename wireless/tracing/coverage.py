"""Coverage maps of scenes: a level grid over a mesh, traced in batches so that memory stays bounded."""

import math
from typing import Annotated, Any

import numpy as np
import trimesh
from jaxtyping import Float
from numpy.typing import ArrayLike

from robosim.support.checks import Range, check_arguments, check_number
from wireless.antennas.mounting import MountedArray
from wireless.channel import noise_power_dbm
from wireless.coverage import CellState, CoverageMap, ReceiverGrid, link_values
from wireless.geometry.closed_surfaces import Sides, capped
from wireless.support.arrays import to_positions

#: Sides of cells [m], and most points of a grid.
CELL_M, MOST_POINTS = Range(1e-6, 1e5, "m", "Try 1."), 1_000_000
#: Most points of all cells of a map.
_MOST_SAMPLES = 20_000_000
#: Links that are traced at once: their paths take some 100 MB.
_BATCH_LINKS = 8192


def level_grid(
    mesh: trimesh.Trimesh,
    cell_m: float,
    z_m: float,
    *,
    tx: Float[np.ndarray, "n_tx 3"],
    bounds_m: tuple[float, ...] | None = None,
) -> ReceiverGrid:
    """Cells at a height over all of a mesh, or over a box x, y, x, y from its lower-left corner.

    Air is where a transmitter is: in a room on the inside of a closed surface, around houses on the outside. Other
    cells are in a body, or outside of all closed surfaces.

    Raises:
        ValueError: If there are too many cells, or the box is outside of the mesh.
    """
    check_number("grid", cell_m, *CELL_M)
    low, high = np.asarray(mesh.bounds)[:, :2]
    box = np.array((*low, *high) if bounds_m is None else bounds_m, float)
    start, end = box[:2], box[2:]
    if box.shape != (4,) or not ((start < end) & (start < high) & (end > low)).all():
        raise ValueError(
            f"bounds are {bounds_m}, expected the lower-left and the upper-right corner x, y, x, y [m] of a box in the "
            f"scene, which reaches from {low.round(3).tolist()} to {high.round(3).tolist()} m."
        )
    nx, ny = (max(1, math.ceil(side / cell_m - 1e-9)) for side in (end - start).tolist())
    check_count(nx * ny, cell_m, *(end - start))
    corner = np.stack(np.meshgrid(np.arange(nx + 1), np.arange(ny + 1)), axis=-1) * cell_m + start
    cell = np.argwhere(np.ones((ny, nx), bool))
    # Rounded to picometres: a grid of 0.15 m holds 0.3, not 0.30000000000000004.
    middle = np.round((cell[:, ::-1] + 0.5) * cell_m + start, 12)
    position = np.column_stack([middle, np.full(len(cell), z_m)])
    sides, centre = Sides(capped(mesh)), mesh.bounds.mean(axis=0)
    in_air = np.isin(sides.parity(position - centre), sides.parity(tx - centre))
    state = np.where(sides.enclosed(position - centre), CellState.IN_BODY, CellState.OUTSIDE)
    state[in_air] = CellState.NO_PATH
    state[((middle < low) | (middle > high)).any(axis=1)] = CellState.OUTSIDE
    unreached = state.reshape(ny, nx).astype(np.uint8)
    return ReceiverGrid(position=position, cell=cell, shape=(ny, nx), edges=corner, unreached=unreached)


def check_count(count: float, cell_m: float, width_m: float, height_m: float) -> None:
    """Raise ValueError if a grid has too many points."""
    if count > MOST_POINTS:
        wide_m = math.ceil(120 * math.sqrt(width_m * height_m / MOST_POINTS)) / 100
        raise ValueError(
            f"grid is {cell_m:g} m, which makes {count:.0f} receivers on {width_m:g} x {height_m:g} m, more than "
            f"{MOST_POINTS} places. Take wider cells, such as {wide_m:g} m, or in a scene smaller bounds."
        )


def trace_coverage(
    tracer: Any,
    tx: ArrayLike,
    *,
    cell_m: float = 1.0,
    height_m: Annotated[float, Range(-1e4, 1e4, "m")] = 1.5,
    bounds_m: tuple[float, ...] | None = None,
    points_per_side: Annotated[int, Range(1, 100, "points")] = 1,
    grid: ReceiverGrid | None = None,
    tx_antenna: MountedArray | None = None,
    rx_antenna: MountedArray | None = None,
    tx_power_dbm: float | tuple[float, ...] = 23.0,
    bandwidth_mhz: Annotated[float, Range(1e-3, 1e5, "MHz")] = 400.0,
    loss_db: Annotated[float, Range(-200, 200, "dB")] = 6.0,
    threshold_db: float = -math.inf,
    coherent: bool = False,
    workers: int | None = None,
) -> CoverageMap:
    """Coverage of a level plane by transmitters: power, link state, delay, spreads, SNR and SINR of each cell.

    Args:
        tracer: Tracer of the scene.
        tx: Positions of transmitters [m], n_tx x 3.
        cell_m: Side of a cell [m].
        height_m: Height above the scene's floor, its lowest point [m].
        bounds_m: Box x, y, x, y of the map [m]; None for the whole scene.
        points_per_side: A cell is the mean of so many points squared; 1 for its middle.
        grid: Receivers instead of these cells, such as of `robosim.radio.receivers.receiver_grid`.
        tx_antenna: Antennas of transmitters; None for isotropic ones with the tracer's polarisation.
        rx_antenna: Antennas of receivers; likewise.
        tx_power_dbm: Power of all transmitters, or of each [dBm].
        bandwidth_mhz: Bandwidth, which sets the noise [MHz].
        loss_db: Noise figure and other losses of receivers [dB].
        threshold_db: Paths of less power gain do not count for link categories.
        coherent: Whether paths add with their phases, as at one frequency at a point; else their powers add.
        workers: Threads, see `Tracer.trace`.

    Raises:
        ValueError: If there are too many cells, the map is outside of the scene, or an argument is out of range.
    """
    check_arguments(trace_coverage, locals())
    places, power_dbm = to_positions(tx, "tx"), np.asarray(tx_power_dbm, float)
    if power_dbm.shape not in ((), (len(places),)) or not np.isfinite(power_dbm).all():
        raise ValueError(
            f"tx_power_dbm is {tx_power_dbm}, expected a number [dBm], or one for each transmitter."
        )
    if grid is None:
        z_m = float(tracer.mesh.bounds[0, 2]) + height_m
        grid = level_grid(tracer.mesh, cell_m, z_m, tx=places, bounds_m=bounds_m)
    isotropic, n = MountedArray.polarised(tracer.config.polarisation), points_per_side**2
    if (count := n * len(grid.position)) > _MOST_SAMPLES:
        raise ValueError(
            f"points_per_side is {points_per_side}, which makes {count} points in {len(grid.position)} cells, expected "
            f"at most {_MOST_SAMPLES}. Take fewer, or wider cells."
        )
    ends = tx_antenna or isotropic, rx_antenna or isotropic
    middle = (np.arange(points_per_side) + 0.5) / points_per_side - 0.5
    sides = np.diff(grid.edges[:2, :2], axis=1)[0, 0], np.diff(grid.edges[:2, :2], axis=0)[0, 0]
    offset = (middle[:, None, None] * sides[1] + middle[:, None] * sides[0]).reshape(-1, 2)
    points = (grid.position[:, None] + np.pad(offset, ((0, 0), (0, 1)))).reshape(-1, 3)
    parts, batch = [], n * max(1, _BATCH_LINKS // (n * len(places)))
    for first in range(0, len(points), batch):
        paths = tracer.trace(places, points[first : first + batch], workers=workers)
        turned = ends[0], ends[1].of_terminals(slice(first, first + batch))
        parts.append(link_values(paths, *turned, coherent=coherent, threshold_db=threshold_db, points=n))
    return CoverageMap.from_links(
        {name: np.concatenate([values[name] for values in parts], axis=1) for name in parts[0]},
        grid,
        tx_position=places,
        tx_power_dbm=np.broadcast_to(power_dbm, len(places)).copy(),
        noise_dbm=noise_power_dbm(bandwidth_mhz, loss_db),
        frequency_hz=tracer.frequency_hz,
        coherent=coherent,
        points_per_cell=n,
    )
