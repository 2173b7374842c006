"""Pictures of buildings of several storeys: walls and slabs in three dimensions, and the rays of a link in them."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
from jaxtyping import Float
from matplotlib.colors import Normalize
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from robosim.building.multi_storey import Storeys
from robosim.drawing.radio_pictures import RX_COLOUR, TX_COLOUR, WALL, conditions
from robosim.support.figures import save_figure
from wireless.paths import Paths
from wireless.support.counting import counted
from wireless.support.ray_colours import ray_colours

#: Stretch of heights, since buildings are wider than high.
STRETCH = 2.0


def plot_storeys(path: Path, whole: Storeys, paths: Paths, tx: int, rx: int, tx_power_dbm: float) -> None:
    """Draw the floors of a building over each other, its stairwells, and all paths of one link."""
    figure = plt.figure(figsize=(8.0, 8.0), layout="constrained")
    axes: Axes3D = figure.add_subplot(projection="3d", computed_zorder=False)
    for number, storey in enumerate(whole.storeys):
        _floor(axes, whole, number)
        ends = storey.building.walls_2d
        feet = np.concatenate([ends, np.full((len(ends), 2, 1), storey.floor_m)], axis=2)
        walls = Line3DCollection(list(feet), colors=WALL, linewidths=0.6, zorder=2 + 4 * number)
        axes.add_collection3d(walls)
        for ring in shapely.get_rings(shapely.get_parts(storey.opening)):
            for z in (storey.ceiling_m, storey.ceiling_m + whole.plan.storeys[number].slab_m):
                xy = shapely.get_coordinates(ring)
                axes.plot(*xy.T, z, color="#D55E00", lw=0.9, zorder=40)
    link, ends_m = paths.between(tx, rx), (paths.tx_position[tx], paths.rx_position[rx])
    power = tx_power_dbm + link.power_db
    lines = [
        np.vstack([ends_m[0], link.point[i, : link.order[i]], ends_m[1]]) for i in reversed(range(len(link)))
    ]
    if lines:
        scale = Normalize(power.min(), max(power.max(), power.min() + 1))
        rays = Line3DCollection(lines, cmap=ray_colours(), norm=scale, linewidths=1.1, zorder=50)
        rays.set_array(power[::-1])
        axes.add_collection3d(rays)
        figure.colorbar(rays, ax=axes, shrink=0.5, label=f"received power [dBm], {tx_power_dbm:g} dBm sent")
    _mark(axes, ends_m[0], "*", TX_COLOUR, "transmitter")
    _mark(axes, ends_m[1], "P", RX_COLOUR, "receiver")
    axes.plot([], [], color="#D55E00", lw=0.9, label="opening of a slab")
    low, high = whole.bounds
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 0.1) * (1, 1, STRETCH), zoom=1.15)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    title = f"{whole.plan.name}: {counted(len(link), 'path')} of one link"
    about = conditions(paths.frequency_hz, ends_m[0], ends_m[1][None])
    axes.set_title(f"{title}\n{about}", fontsize=10, parse_math=False)
    axes.legend(loc="upper left", fontsize=8)
    axes.view_init(elev=24, azim=-58)
    save_figure(figure, path)


def _floor(axes: Axes3D, whole: Storeys, number: int) -> None:
    """Draw the free floor of a storey without its opening, translucent."""
    storey = whole.storeys[number]
    free = storey.building.free
    if number:
        free = shapely.difference(free, whole.storeys[number - 1].opening)
    triangles = [
        shapely.get_coordinates(triangle)[:3]
        for part in shapely.get_parts(free)
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(part))
    ]
    corner = np.array([np.column_stack([xy, np.full(3, storey.floor_m)]) for xy in triangles])
    axes.add_collection3d(
        Poly3DCollection(corner, facecolors="0.85", alpha=0.5, linewidths=0, zorder=1 + 4 * number)
    )


def _mark(axes: Axes3D, at: Float[np.ndarray, "3"], marker: str, colour: str, label: str) -> None:
    axes.plot(*at[:, None], marker, color=colour, mec="white", ms=12, label=label, zorder=60)
