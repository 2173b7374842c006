"""Pictures of traced radio: power, link state, direction of arrival over a floor plan, and rays of one link.

Colours are safe for the colour-blind: states from `robosim.support.colours`, power of the floor in cividis, of rays in
plasma, both the brighter the stronger, angles in twilight, which is the same at both ends.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import shapely
from jaxtyping import Float, UInt8
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import EllipseCollection, LineCollection, PathCollection, QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.path import Path as PathOutline
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from robosim.building.building import Building
from robosim.drawing.plan_view import BODY_YELLOW
from robosim.radio.receivers import ReceiverGrid
from robosim.radio.scene import RadioSite, SceneSection
from robosim.support.colours import FURNISHING, STATE_COLOURS, STATE_NAMES, css
from robosim.support.figures import save_figure
from wireless.coverage import CoverageMap
from wireless.motion.bodies import Bodies
from wireless.paths import Interaction, LinkCategory, LinkState, Paths
from wireless.support.counting import counted
from wireless.support.ray_colours import ray_colours

#: Place of a terminal [m].
Place = Float[np.ndarray, "3"]


WALL = "0.25"
TX_COLOUR, RX_COLOUR = "#CC0000", "#009E73"
KINDS = {
    Interaction.REFLECTION: ("reflection", "o"),
    Interaction.DIFFRACTION: ("diffraction", "^"),
    Interaction.SCATTERING: ("scattering", "D"),
    Interaction.TRANSMISSION: ("transmission", "s"),
}
#: Arrows of arrival are about this far apart, as a share of the plan's longer side.
ARROW_SHARE = 1 / 28
#: What a picture from above shows.
Section = Building | SceneSection
_PERSON = "person"
_NO_PATH: dict[str, Any] = {"facecolor": "0.97", "edgecolor": "0.8", "hatch": "/////", "linewidth": 0}


def plot_grid(
    folder: Path,
    suffix: str,
    building: Section,
    grid: ReceiverGrid,
    paths: Paths,
    tx: int,
    *,
    tx_power_dbm: float,
    threshold_db: float,
    link: tuple[Paths, int, int],
    bodies: Bodies | None = None,
) -> list[Path]:
    """Draw the radio of one transmitter on a grid of receivers, and the rays of one link (paths, its tx and its rx).

    People and other bodies among the paths are drawn from above.

    Returns:
        The files {power,state,aoa,rays,overview}SUFFIX.png, of which the last has all four.
    """
    first = paths.select((paths.tx == tx) & (paths.rank == 0))
    category = paths.link_category(threshold_db)[tx]
    position = paths.tx_position[tx]
    draw: dict[str, Callable[[Axes], None]] = {
        "power": lambda axes: draw_power(axes, building, grid, first, position, tx_power_dbm),
        "state": lambda axes: draw_state(
            axes, building, grid, category, position, frequency_hz=paths.frequency_hz
        ),
        "aoa": lambda axes: draw_arrival(axes, building, grid, first, position),
        "rays": lambda axes: draw_rays(axes, building, *link, tx_power_dbm),
    }
    files = [folder / f"{name}{suffix}.png" for name in (*draw, "overview")]
    for file, draw_on in zip(files[:-1], draw.values(), strict=True):
        figure, axes = plt.subplots(figsize=_size(building, 1), layout="constrained")
        _draw_bodies(axes, bodies)
        draw_on(axes)
        save_figure(figure, file)
    figure, axes_of_all = plt.subplots(2, 2, figsize=_size(building, 2), layout="constrained")
    for draw_on, axes in zip(draw.values(), axes_of_all.ravel(), strict=True):
        _draw_bodies(axes, bodies)
        draw_on(axes)
    save_figure(figure, files[-1])
    return files


def plot_link(
    path: Path, site: RadioSite, paths: Paths, tx: int, rx: int, bodies: Bodies | None = None
) -> None:
    """Draw the paths of one link among bodies: from above in a building of one storey, else in three dimensions."""
    if len(site.storeys) == 1:
        building = site.storeys[0].building
        figure, axes = plt.subplots(figsize=_size(building, 1), layout="constrained")
        _draw_bodies(axes, bodies)
        draw_rays(axes, building, paths, tx, rx, site.config.tx_power_dbm)
    else:
        figure = plt.figure(figsize=(8.0, 8.0), layout="constrained")
        axes = figure.add_subplot(projection="3d", computed_zorder=False)
        draw_in_space(axes, site, paths, tx, rx, bodies)
    save_figure(figure, path)


def plot_coverage(path: Path, building: Section, coverage: CoverageMap, bodies: Bodies | None = None) -> None:
    """Draw the best server of each cell, and its power, SINR and delay spread, among bodies."""
    figure, axes_of_all = plt.subplots(2, 2, figsize=_size(building, 2), layout="constrained")
    quantities = ("power_dbm", "sinr_db", "best_server", "delay_spread_s")
    for quantity, axes in zip(quantities, axes_of_all.ravel(), strict=True):
        coverage.plot(quantity, axes=axes)
        _shade_free(axes, building)
        _draw_bodies(axes, bodies)
        about = conditions(coverage.frequency_hz, coverage.tx_position[0], coverage.position.reshape(-1, 3))
        _frame(axes, building, f"coverage of {counted(len(coverage.tx_position), 'transmitter')}", about)
    save_figure(figure, path)


def draw_in_space(
    axes: Axes3D, site: RadioSite, paths: Paths, tx: int, rx: int, bodies: Bodies | None = None
) -> None:
    """All paths of one link in three dimensions among the surfaces and bodies around it, coloured by power."""
    link, ends = paths.between(tx, rx), (paths.tx_position[tx], paths.rx_position[rx])
    corners = np.vstack([link.corners().reshape(-1, 3), *ends])
    low, high = site.draw(axes, np.array([np.nanmin(corners, axis=0), np.nanmax(corners, axis=0)]))
    power = site.config.tx_power_dbm + link.power_db
    order = reversed(range(len(link)))  # the strongest on top
    lines = [np.vstack([ends[0], link.point[i, : link.order[i]], ends[1]]) for i in order]
    if lines:
        scale = Normalize(power.min(), max(power.max(), power.min() + 1))
        rays = Line3DCollection(lines, cmap=ray_colours(), norm=scale, linewidths=1.1, zorder=50)
        rays.set_array(power[::-1])
        axes.add_collection3d(rays)
        label = f"received power [dBm], {site.config.tx_power_dbm:g} dBm sent"
        axes.figure.colorbar(rays, ax=axes, shrink=0.5, label=label)
    for at, marker, colour, label in zip(
        ends, "*P", (TX_COLOUR, RX_COLOUR), ("transmitter", "receiver"), strict=True
    ):
        axes.plot(*at[:, None], marker, color=colour, mec="white", ms=12, label=label, zorder=60)
    is_shown = bodies is not None and ((low <= bodies.position) & (bodies.position <= high)).all(axis=1)
    if bodies is not None and np.any(is_shown):
        feet, height_m = bodies.position[is_shown], bodies.height_m[is_shown]
        upright = np.stack([feet, feet + height_m[:, None] * [0, 0, 1]], axis=1)
        people = Line3DCollection(
            list(upright), colors=css(BODY_YELLOW), linewidths=4, label=_PERSON, zorder=40
        )
        axes.add_collection3d(people)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 0.1), zoom=1.05)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    about = conditions(paths.frequency_hz, ends[0], ends[1][None])
    title = f"{site.name}: {counted(len(link), 'path')} of one link\n{about}"
    axes.set_title(title, fontsize=10, parse_math=False)
    axes.legend(loc="upper left", fontsize=8)
    axes.view_init(elev=24, azim=-58)


def choose_link(paths: Paths, tx: int) -> int:
    """A receiver with instructive rays: out of sight, with many paths that turn at distant places."""
    count = paths.count()[tx]
    hidden = paths.link_state()[tx] != LinkState.LOS
    score = np.where(hidden, count, 0) if (count[hidden] > 0).any() else count
    mine = paths.select(paths.tx == tx)
    turns = mine.interaction != Interaction.NONE
    rx, point = np.repeat(mine.rx, turns.sum(axis=1)), mine.point[turns][:, :2]
    number = np.maximum(np.bincount(rx, minlength=len(score)), 1)
    mean = [np.bincount(rx, weights=x, minlength=len(score)) / number for x in point.T]
    off = point - np.column_stack(mean)[rx]
    xx, yy, xy = (
        np.bincount(rx, weights=off[:, i] * off[:, j], minlength=len(score)) / number
        for i, j in ((0, 0), (1, 1), (0, 1))
    )
    spread = xx * yy - xy**2  # of an area, which places along one line do not have
    return int(np.argmax(np.where(2 * score >= score.max(), spread, -1.0)))


def draw_power(
    axes: Axes, building: Section, grid: ReceiverGrid, first: Paths, tx_position: Place, tx_power_dbm: float
) -> None:
    """Received power of the strongest path."""
    values = np.full(len(grid.position), np.nan)
    values[first.rx] = tx_power_dbm + first.power_db
    known = values[np.isfinite(values)]
    low, high = np.percentile(known, [1, 99.5]) if len(known) else (0, 1)
    image = _cells(axes, grid, values, cmap="cividis", vmin=low, vmax=high)
    _bar(axes, image, f"received power [dBm], {tx_power_dbm:g} dBm sent", extend="both")
    _shade_free(axes, building)
    about = conditions(first.frequency_hz, tx_position, grid.position)
    _frame(axes, building, "power of the strongest path", about)
    _mark(axes, tx_position)
    _legend(axes, building, [_tx_handle(), _nothing_handle("no path")])


def draw_state(
    axes: Axes,
    building: Section,
    grid: ReceiverGrid,
    category: UInt8[np.ndarray, " n"],
    tx_position: Place,
    title: str = "link state",
    *,
    frequency_hz: float | None = None,
) -> None:
    """Link states with their shares; a given frequency is in the title, with the heights."""
    colours = ListedColormap([css(STATE_COLOURS[state]) for state in LinkCategory])
    reached = np.where(category == LinkCategory.OUTAGE, np.nan, category)
    _cells(axes, grid, reached, cmap=colours, norm=BoundaryNorm(np.arange(-0.5, 5), 5))
    _shade_free(axes, building)
    about = "" if frequency_hz is None else conditions(frequency_hz, tx_position, grid.position)
    _frame(axes, building, title, about)
    _mark(axes, tx_position)
    share = 100 * np.bincount(category, minlength=5) / len(category)
    states = [
        Patch(
            facecolor=css(STATE_COLOURS[state]),
            edgecolor=WALL,
            lw=0.4,
            label=f"{name} ({share[state]:.0f} %)",
        )
        for state, name in STATE_NAMES.items()
        if share[state] > 0 and state != LinkCategory.OUTAGE
    ]
    outage = _nothing_handle(f"outage ({share[LinkCategory.OUTAGE]:.0f} %)")
    _legend(axes, building, [_tx_handle(), *states, outage])


def draw_arrival(axes: Axes, building: Section, grid: ReceiverGrid, first: Paths, tx_position: Place) -> None:
    """Azimuth of the strongest arrival, as colour, and as arrows that point there."""
    values = np.full(len(grid.position), np.nan)
    values[first.rx] = np.degrees(first.aoa_az)
    image = _cells(axes, grid, values, cmap="twilight", vmin=-180, vmax=180)
    bar = _bar(axes, image, "azimuth of arrival [degrees from +x]")
    bar.set_ticks([-180, -90, 0, 90, 180])
    _shade_free(axes, building)
    about = conditions(first.frequency_hz, tx_position, grid.position)
    _frame(axes, building, "direction of arrival of the strongest path", about)
    step_m = float(np.hypot(*(grid.edges[0, 1] - grid.edges[0, 0])))
    every = max(1, round(ARROW_SHARE * max(_extent(building)) / step_m))
    cell = grid.cell[first.rx]
    is_drawn = np.all(cell % every == every // 2, axis=1)
    at, angle = grid.position[first.rx][is_drawn, :2], first.aoa_az[is_drawn]
    for colour, width in (("white", 0.025), ("black", 0.011)):
        axes.quiver(
            *at.T, np.cos(angle), np.sin(angle), color=colour, angles="xy", pivot="mid", scale_units="xy",
            scale=1 / (0.8 * every * step_m), units="inches", width=width,
            headwidth=3.5 if colour == "black" else 2.6, zorder=4,
        )  # fmt: skip
    _mark(axes, tx_position)
    arrow = Line2D(
        [], [], color="black", marker=r"$\rightarrow$", ms=10, lw=0, label="points to where it is from"
    )
    _legend(axes, building, [_tx_handle(), arrow, _nothing_handle("no path")])


def draw_rays(axes: Axes, building: Section, paths: Paths, tx: int, rx: int, tx_power_dbm: float) -> None:
    """All paths of one link from above, coloured by power."""
    link, ends = paths.between(tx, rx), (paths.tx_position[tx], paths.rx_position[rx])
    power = tx_power_dbm + link.power_db
    lines = [
        np.vstack([ends[0][:2], link.point[i, : link.order[i], :2], ends[1][:2]])
        for i in reversed(range(len(link)))  # the strongest one on top
    ]
    rays = LineCollection(lines, cmap=ray_colours(), linewidths=1.1, zorder=3)
    rays.set_array(power[::-1])
    axes.add_collection(rays)
    if len(link):
        _bar(axes, rays, f"received power [dBm], {tx_power_dbm:g} dBm sent")
    receiver = Line2D([], [], marker="P", color=RX_COLOUR, mec="white", ms=9, lw=0, label="receiver")
    handles = [_tx_handle(), receiver]
    for kind, (name, marker) in KINDS.items():
        spots = link.point[link.interaction == kind][:, :2]
        if len(spots):
            style: dict[str, Any] = {
                "marker": marker,
                "mfc": "white",
                "mec": "black",
                "mew": 0.7,
                "ms": 4.5,
                "lw": 0,
            }
            axes.plot(*spots.T, **style, zorder=5)
            handles.append(Line2D([], [], **style, label=name))
    _mark(axes, ends[0])
    axes.plot(*ends[1][:2], "P", color=RX_COLOUR, mec="white", ms=9, zorder=7)
    state = STATE_NAMES[int(link.link_category()[tx, rx])]
    about = conditions(paths.frequency_hz, ends[0], ends[1][None])
    _frame(axes, building, f"{counted(len(link), 'path')} of one link ({state})", about)
    _zoom(axes, np.vstack([ends[0][:2], ends[1][:2], *lines]))
    _legend(axes, building, handles)


def conditions(frequency_hz: float, tx_position: Place, rx_position: Float[np.ndarray, "n 3"]) -> str:
    """Frequency and heights, for the title of a picture of radio."""
    low_m, high_m = float(rx_position[:, 2].min()), float(rx_position[:, 2].max())
    receivers = f"{low_m:g} m" if low_m == high_m else f"{low_m:g} to {high_m:g} m"
    of_them = "receiver" if len(rx_position) == 1 else "receivers"
    return f"{frequency_hz / 1e9:g} GHz; transmitter {tx_position[2]:g} m, {of_them} {receivers} high"


def _extent(building: Section) -> tuple[float, float]:
    west, south, east, north = building.free.bounds
    return east - west, north - south


def _size(building: Section, across: int) -> tuple[float, float]:
    """Width and height [inches] of a figure with some plans per row and column, each with bar and legend."""
    width, height = _extent(building)
    scale = (7.0 if across == 1 else 5.0) / max(width, height)
    return across * (max(width * scale, 3.2) + 1.5), across * (max(height * scale, 2.4) + 1.2)


def _shade_free(axes: Axes, building: Section) -> None:
    """Hatch the free floor, which remains visible where no path arrives."""
    outlines = [
        PathOutline.make_compound_path(
            *(PathOutline(shapely.get_coordinates(ring), closed=True) for ring in shapely.get_rings(polygon))
        )
        for polygon in building.free.geoms
    ]
    axes.add_collection(PathCollection(outlines, zorder=0, **_NO_PATH))


def _cells(axes: Axes, grid: ReceiverGrid, values: Float[np.ndarray, " n"], **style: Any) -> QuadMesh:
    """Colour the cells of the receivers that have a value."""
    full = np.full(grid.shape, np.nan)
    full[tuple(grid.cell.T)] = values
    return axes.pcolormesh(grid.edges[..., 0], grid.edges[..., 1], full, rasterized=True, zorder=2, **style)


def _bar(axes: Axes, values: ScalarMappable, label: str, **style: Any) -> Colorbar:
    """Colour bar as high as the axes."""
    bar = axes.inset_axes((1.02, 0.0, 0.035, 1.0))
    return axes.figure.colorbar(values, cax=bar, label=label, **style)


def _frame(axes: Axes, building: Section, title: str, about: str = "") -> None:
    """Walls, axes in metres, and a title of one line or two."""
    west, south, east, north = building.free.bounds
    margin = 0.03 * max(east - west, north - south)
    axes.set_aspect("equal")
    axes.set(xlim=(west - margin, east + margin), ylim=(south - margin, north + margin))
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.set_title(f"{building.name}: {title}\n{about}".strip(), fontsize=10, parse_math=False)
    building.draw_walls(axes, colour=WALL, zorder=3)


def _zoom(axes: Axes, points: Float[np.ndarray, "n 2"]) -> None:
    """Show only the surroundings of some points, but at least a third of the plan."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    whole = np.array([axes.get_xlim(), axes.get_ylim()])
    half = np.ptp(points, axis=0) / 2 + 1.0
    share = max((half / (np.ptp(whole, axis=1) / 2)).max(), 1 / 3)
    if share < 1:
        half = share * np.ptp(whole, axis=1) / 2
        middle = np.clip(middle, whole[:, 0] + half, whole[:, 1] - half)
        axes.set(
            xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1])
        )


def _draw_bodies(axes: Axes, bodies: Bodies | None) -> None:
    """Draw bodies from above, of their true size, for a legend of `_legend`."""
    if bodies is None:
        return
    style = {"facecolor": css(BODY_YELLOW), "edgecolor": "black", "linewidth": 0.5}
    width, place = 2 * bodies.radius_m, bodies.position[:, :2]
    circles = EllipseCollection(
        width, width, 0, units="xy", offsets=place, offset_transform=axes.transData, zorder=6, **style
    )
    axes.add_collection(circles)
    axes.plot([], [], "o", mfc=css(BODY_YELLOW), mec="black", mew=0.5, ms=7, label=_PERSON)


def _mark(axes: Axes, tx_position: Place) -> None:
    axes.plot(*tx_position[:2], "*", color=TX_COLOUR, mec="white", mew=0.8, ms=15, zorder=7)


def _tx_handle() -> Line2D:
    return Line2D([], [], marker="*", color=TX_COLOUR, mec="white", ms=13, lw=0, label="transmitter")


def _nothing_handle(label: str) -> Patch:
    return Patch(label=label, **_NO_PATH)


def _legend(axes: Axes, building: Section, handles: Sequence[Artist]) -> None:
    """Legend below the axes, with furniture if the building has some, and artists that have a label."""
    placed = [Line2D([], [], color=FURNISHING, lw=1.5, label="furniture")] if building.furnishings else []
    axes.legend(
        handles=[*handles, *placed, *axes.get_legend_handles_labels()[0]], loc="upper center", fontsize=8, ncols=3,
        bbox_to_anchor=(0.5, -0.11), frameon=False, handletextpad=0.5, columnspacing=1.2,
    )  # fmt: skip
