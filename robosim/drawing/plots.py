"""Pictures of results by matplotlib, drawn without a display."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.drawing.plan_marks import explain, map_keys, wall_keys
from robosim.episode_log import EpisodeLog
from robosim.support.figures import save_figure
from slam.grid import MapEstimate
from wireless.support.axes import axes_in_metres
from wireless.support.counting import counted

#: Okabe and Ito's colours (2008), for parts of the floor from the largest on, and a grey for the rest.
_PARTS = ("#009E73", "#E69F00", "#CC79A7", "#0072B2", "#D55E00", "#F0E442")
_OTHERS = "#7F7F7F"
#: Smaller parts have no name [m2].
_LEAST_M2 = 0.1
#: Room for a legend next to a plan.
LEGEND_INCHES = 1.9


def plot_episode(path: Path, building: Building, log: EpisodeLog, estimate: MapEstimate) -> None:
    """Draw plan, built map and both trajectories of an episode, and the target if it was searched for."""
    figure, axes = plan_axes(building)
    estimate.plot(axes, robot=False)
    building.draw_walls(axes)
    log.plot(axes)
    explain(axes, [*wall_keys(bool(building.furnishings)), *map_keys()], "the robot's map, and the truth")
    result = log.result()
    shortest = f" (shortest {log.task.shortest_m:.1f} m)" if log.seeks_target else ""
    axes.set_title(
        f"{building.plan.name}: {log.ended} after {counted(log.steps, 'step')}, {result['path_length_m']:.1f} m"
        f"{shortest}, {100 * result['coverage']:.0f} % seen, pose error "
        f"{100 * result['position_error_rms_m']:.0f} cm RMS",
        fontsize=9,
        parse_math=False,  # names may have dollars in them
    )
    save_figure(figure, path)


def plot_plan(path: Path, building: Building, places: Reach) -> None:
    """Draw a plan's walls and the parts of its floor that a hull can reach, each in its own colour."""
    figure, axes = plan_axes(building)
    building.draw_walls(axes)
    area_m2 = (
        places.plan.resolution_m**2 * np.bincount(places.parts.ravel(), minlength=places.n_parts + 1)[1:]
    )
    order = np.argsort(-area_m2, kind="stable").tolist()
    named = [part for part in order if area_m2[part] >= _LEAST_M2][: len(_PARTS)]
    keys = wall_keys(bool(building.furnishings))
    # Number of each part's colour: that of all small ones is the last.
    shade = np.full(places.n_parts + 1, np.nan)
    shade[[part + 1 for part in order]] = [min(place, len(named)) for place in range(len(order))]
    ny, nx = places.parts.shape
    corner = places.plan.to_map(np.stack(np.meshgrid(np.arange(nx + 1.0), np.arange(ny + 1.0)), axis=-1))
    colours = ListedColormap([*_PARTS[: len(named)], _OTHERS])
    axes.pcolormesh(
        *np.moveaxis(corner, -1, 0),
        shade[places.parts],
        cmap=colours,
        vmin=0,
        vmax=len(named),
        rasterized=True,
    )
    keys += [
        Patch(color=_PARTS[place], label=f"part {place + 1}: {area_m2[part]:.1f} m2")
        for place, part in enumerate(named)
    ]
    if len(named) < places.n_parts:
        rest = f"{counted(places.n_parts - len(named), 'smaller part')}: {np.delete(area_m2, named).sum():.2f} m2"
        keys.append(Patch(color=_OTHERS, label=rest))
    keys.append(Patch(facecolor="0.85", edgecolor="0.5", lw=0.5, label="too near to a wall, or no floor"))
    explain(axes, keys, f"where the middle of a hull of\nradius {places.radius_m:g} m may be")
    axes.set_title(
        f"{building.plan.name}: {building.indoor_m2:.1f} m2 of free floor; a robot drives from place to place within a "
        "part only",
        fontsize=9,
        parse_math=False,
    )
    save_figure(figure, path)


def plan_axes(building: Building) -> tuple[Figure, Axes]:
    """Figure and axes in metres that show a whole plan, with room for a legend next to it."""
    west, south, east, north = building.free.bounds
    aspect = (north - south + 1) / (east - west + 1)
    width = 8.0 if aspect < 1.3 else 8.0 / aspect * 1.3
    size = width + LEGEND_INCHES, np.clip(width * aspect + 0.9, 3.4, 12)
    figure, axes = plt.subplots(figsize=size, layout="compressed")
    axes_in_metres(axes)
    axes.set(xlim=(west - 0.5, east + 0.5), ylim=(south - 0.5, north + 0.5))
    axes.set_facecolor("0.85")
    return figure, axes
