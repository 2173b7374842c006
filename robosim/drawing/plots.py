"""Pictures of results by matplotlib, drawn without a display."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.support.files import whole_file
from robosim.task.record import EpisodeLog
from slam.grid import MapEstimate
from wireless.support.axes import axes_in_metres


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure, whole or not at all, and free it."""
    with whole_file(path) as partial:
        figure.savefig(partial, dpi=130)
    plt.close(figure)


def plot_episode(path: Path, building: Building, log: EpisodeLog, estimate: MapEstimate) -> None:
    """Draw plan, built map, both trajectories and the target of an episode."""
    figure, axes = plan_axes(building)
    estimate.plot(axes, robot=False)
    building.draw_walls(axes)
    log.plot(axes)
    result = log.result()
    axes.set_title(
        f"{building.plan.name}: {log.ended} after {log.steps} steps, {result['path_length_m']:.1f} m "
        f"(shortest {log.task.shortest_m:.1f} m), {100 * result['coverage']:.0f} % seen, "
        f"pose error {100 * result['position_error_rms_m']:.0f} cm RMS",
        fontsize=9,
        parse_math=False,  # names may have dollars in them
    )
    save_figure(figure, path)


def plot_plan(path: Path, building: Building, places: Reach) -> None:
    """Draw a plan's walls and what parts of its floor a hull can drive through, each in its own colour."""
    figure, axes = plan_axes(building)
    building.draw_walls(axes)
    parts = places.plan.centres(places.parts > 0)
    number = places.parts[places.parts > 0]
    axes.scatter(parts[:, 0], parts[:, 1], c=(number - 1) % 10, cmap="tab10", vmin=0, vmax=9, s=1.5, lw=0)
    axes.set_title(
        f"{building.plan.name}: {building.free.area:.1f} m2 of free floor; places of a hull of radius "
        f"{places.radius_m} m in {places.n_parts} part(s)",
        fontsize=9,
        parse_math=False,
    )
    save_figure(figure, path)


def plan_axes(building: Building) -> tuple[Figure, Axes]:
    """Figure and axes in metres that show a whole plan."""
    west, south, east, north = building.free.bounds
    aspect = (north - south + 1) / (east - west + 1)
    width = 8.0 if aspect < 1.3 else 8.0 / aspect * 1.3
    figure, axes = plt.subplots(figsize=(width, np.clip(width * aspect + 0.6, 3, 12)), layout="constrained")
    axes_in_metres(axes)
    axes.set(xlim=(west - 0.5, east + 0.5), ylim=(south - 0.5, north + 0.5))
    axes.set_facecolor("0.85")
    return figure, axes
