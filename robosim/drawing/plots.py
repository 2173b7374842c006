"""Pictures of results by matplotlib, drawn without a display."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.drawing.plan_marks import explain, map_keys, wall_keys
from robosim.support.files import whole_file
from robosim.task.record import EpisodeLog
from slam.grid import MapEstimate
from wireless.support.axes import axes_in_metres

#: Okabe and Ito's colours (2008), for parts of the floor from the largest on, and a grey for the rest.
_PARTS = ("#009E73", "#E69F00", "#CC79A7", "#0072B2", "#D55E00", "#F0E442")
_OTHERS = "#7F7F7F"
#: Smaller parts have no name [m2].
_LEAST_M2 = 0.1
#: Room for a legend beside a plan.
LEGEND_INCHES = 1.9


def save_figure(figure: Figure, path: Path, *, cut: bool = False) -> None:
    """Write a figure, whole or not at all, and free it.

    Args:
        figure: What to write.
        path: Where to.
        cut: Whether to cut it to what is drawn.
    """
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=130, bbox_inches="tight" if cut else None)
    plt.close(figure)


def plot_episode(path: Path, building: Building, log: EpisodeLog, estimate: MapEstimate) -> None:
    """Draw plan, built map, both trajectories and the target of an episode, if that was looked for."""
    figure, axes = plan_axes(building)
    estimate.plot(axes, robot=False)
    building.draw_walls(axes)
    log.plot(axes)
    explain(axes, [*wall_keys(bool(building.furnishings)), *map_keys()], "the robot's map, and the truth")
    result = log.result()
    shortest = f" (shortest {log.task.shortest_m:.1f} m)" if log.seeks_target else ""
    axes.set_title(
        f"{building.plan.name}: {log.ended} after {log.steps} steps, {result['path_length_m']:.1f} m{shortest}, "
        f"{100 * result['coverage']:.0f} % seen, pose error {100 * result['position_error_rms_m']:.0f} cm RMS",
        fontsize=9,
        parse_math=False,  # names may have dollars in them
    )
    save_figure(figure, path, cut=True)


def plot_plan(path: Path, building: Building, places: Reach) -> None:
    """Draw a plan's walls and what parts of its floor a hull can drive through, each in its own colour."""
    figure, axes = plan_axes(building)
    building.draw_walls(axes)
    area_m2 = (
        places.plan.resolution_m**2 * np.bincount(places.parts.ravel(), minlength=places.n_parts + 1)[1:]
    )
    order = np.argsort(-area_m2, kind="stable").tolist()
    named = [part for part in order if area_m2[part] >= _LEAST_M2][: len(_PARTS)]
    keys = wall_keys(bool(building.furnishings))
    for part in order:
        at = places.plan.centres(places.parts == part + 1)
        colour = _PARTS[named.index(part)] if part in named else _OTHERS
        axes.scatter(at[:, 0], at[:, 1], color=colour, s=1.5, lw=0)
    keys += [
        Patch(color=_PARTS[place], label=f"part {place + 1}: {area_m2[part]:.1f} m2")
        for place, part in enumerate(named)
    ]
    if len(named) < places.n_parts:
        rest = f"{places.n_parts - len(named)} smaller part(s): {np.delete(area_m2, named).sum():.2f} m2"
        keys.append(Patch(color=_OTHERS, label=rest))
    keys.append(Patch(facecolor="0.85", edgecolor="0.5", lw=0.5, label="too near to a wall, or no floor"))
    explain(axes, keys, f"where the middle of a hull of\nradius {places.radius_m:g} m may be")
    axes.set_title(
        f"{building.plan.name}: {building.indoor_m2:.1f} m2 of free floor; a robot drives from place to place within a "
        "part only",
        fontsize=9,
        parse_math=False,
    )
    save_figure(figure, path, cut=True)


def plan_axes(building: Building) -> tuple[Figure, Axes]:
    """Figure and axes in metres that show a whole plan, with room for a legend beside it."""
    west, south, east, north = building.free.bounds
    aspect = (north - south + 1) / (east - west + 1)
    width = 8.0 if aspect < 1.3 else 8.0 / aspect * 1.3
    size = width + LEGEND_INCHES, np.clip(width * aspect + 0.9, 3.4, 12)
    figure, axes = plt.subplots(figsize=size, layout="compressed")
    axes_in_metres(axes)
    axes.set(xlim=(west - 0.5, east + 0.5), ylim=(south - 0.5, north + 0.5))
    axes.set_facecolor("0.85")
    return figure, axes
