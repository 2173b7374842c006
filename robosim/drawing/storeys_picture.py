"""Pictures of the rays of a link in three dimensions, in buildings of several storeys and in scenes."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import shapely
import trimesh
from jaxtyping import Float
from matplotlib.colors import Normalize
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from robosim.building.multi_storey import Storeys
from robosim.drawing.radio_pictures import RX_COLOUR, TX_COLOUR, WALL, conditions
from robosim.radio.mesh_scene import MeshScene
from robosim.support.figures import save_figure
from wireless.paths import Paths
from wireless.support.counting import counted
from wireless.support.ray_colours import ray_colours

#: Stretch of heights, since buildings are wider than high.
STRETCH = 2.0
#: Faces that meet at a smaller angle are one surface in pictures.
FLAT_RAD = 1e-3


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
    axes.plot([], [], color="#D55E00", lw=0.9, label="opening of a slab")
    _draw_link(axes, paths, tx, rx, tx_power_dbm)
    _finish(axes, whole.plan.name, paths, tx, rx, whole.bounds, (1, 1, STRETCH))
    save_figure(figure, path)


def plot_scene(path: Path, scene: MeshScene, paths: Paths, tx: int, rx: int) -> None:
    """Draw the outlines of a scene's surfaces near a link, and all of its paths."""
    figure = plt.figure(figsize=(8.0, 8.0), layout="constrained")
    axes: Axes3D = figure.add_subplot(projection="3d", computed_zorder=False)
    link = paths.between(tx, rx)
    corners = np.concatenate(
        [link.corners().reshape(-1, 3), paths.tx_position[[tx]], paths.rx_position[[rx]]]
    )
    near = (np.nanmin(corners, axis=0), np.nanmax(corners, axis=0))
    margin = 1.0 + 0.1 * (near[1] - near[0]).max()
    low = np.maximum(near[0] - margin, np.minimum(near[0], scene.mesh.bounds[0]))
    high = np.minimum(near[1] + margin, np.maximum(near[1], scene.mesh.bounds[1]))
    outlines = _within(_outlines(scene.mesh), low, high)
    if len(outlines):
        axes.add_collection3d(Line3DCollection(list(outlines), colors=WALL, linewidths=0.8, zorder=2))
    _draw_link(axes, paths, tx, rx, scene.config.tx_power_dbm)
    _finish(axes, scene.name, paths, tx, rx, np.array([low, high]), (1, 1, 1))
    save_figure(figure, path)


def _outlines(mesh: trimesh.Trimesh) -> Float[np.ndarray, "n 2 3"]:
    """Edges of a mesh, but for those within a flat surface."""
    solid = mesh.copy()
    solid.merge_vertices()
    flat = solid.face_adjacency_edges[solid.face_adjacency_angles < FLAT_RAD]
    edges = np.unique(solid.edges_sorted, axis=0)
    key, key_of_flat = (pairs.astype(np.int64) @ [len(solid.vertices), 1] for pairs in (edges, flat))
    return solid.vertices[edges[~np.isin(key, key_of_flat)]]


def _within(
    lines: Float[np.ndarray, "n 2 3"], low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "m 2 3"]:
    """The parts of straight lines within a box (Liang and Barsky, 1984)."""
    start, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = np.sort([(low - start) / along, (high - start) / along], axis=0)
    apart = ((along == 0) & ((start < low) | (start > high))).any(axis=1)
    first = np.fmax(np.where(along == 0, 0.0, enter).max(axis=1), 0.0)
    last = np.fmin(np.where(along == 0, 1.0, leave).min(axis=1), 1.0)
    some = ~apart & (first < last)
    ends = np.stack([first, last], axis=1)[some, :, None]
    return start[some, None] + ends * along[some, None]


def _draw_link(axes: Axes3D, paths: Paths, tx: int, rx: int, tx_power_dbm: float) -> None:
    """Draw all paths of one link, coloured by power, and its ends."""
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
        label = f"received power [dBm], {tx_power_dbm:g} dBm sent"
        axes.figure.colorbar(rays, ax=axes, shrink=0.5, label=label)
    _mark(axes, ends_m[0], "*", TX_COLOUR, "transmitter")
    _mark(axes, ends_m[1], "P", RX_COLOUR, "receiver")


def _finish(
    axes: Axes3D,
    name: str,
    paths: Paths,
    tx: int,
    rx: int,
    bounds: Float[np.ndarray, "2 3"],
    stretch: tuple[float, float, float],
) -> None:
    """Limits, title and legend of a picture of one link."""
    low, high = bounds
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 0.1) * stretch, zoom=1.05)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    title = f"{name}: {counted(len(paths.between(tx, rx)), 'path')} of one link"
    about = conditions(paths.frequency_hz, paths.tx_position[tx], paths.rx_position[[rx]])
    axes.set_title(f"{title}\n{about}", fontsize=10, parse_math=False)
    axes.legend(loc="upper left", fontsize=8)
    axes.view_init(elev=24, azim=-58)


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
