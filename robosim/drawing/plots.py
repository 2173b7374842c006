"""Plots of results: episodes, plans, robot logs, and errors of odometry; legend, scale bar and north of plans."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.drawing.plan_view import bar_m
from robosim.episode_log import EpisodeLog
from robosim.logs.robot_log import RobotLog
from robosim.logs.trajectory_scores import align_trajectory
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.calibration import Runs
from robosim.support.axes import axes_in_metres
from robosim.support.colours import FURNISHING, ROBOTS, TARGET, WALL, css, robot_colour
from robosim.support.figures import save_figure
from robosim.team.team_log import TeamLog
from slam.grid import MapEstimate
from wireless.support.counting import counted

#: Height of the strip below a plan over the plan's size.
_STRIP = 0.08


def wall_keys(furnished: bool) -> list[Artist]:
    """Legend entries of `Building.draw_walls`, of a building with or without furnishings."""
    walls: list[Artist] = [Line2D([], [], color=WALL, lw=1.5, label="true walls")]
    return [*walls, Line2D([], [], color=FURNISHING, lw=1.5, label="furniture")] if furnished else walls


def map_keys() -> list[Artist]:
    """Legend entries of a robot's map."""
    shades = (("floor seen", "1.0"), ("obstacle seen", "0.15"), ("not seen", "0.85"))
    return [Patch(facecolor=shade, edgecolor="0.5", lw=0.5, label=label) for label, shade in shades]


def heading(text: str) -> Artist:
    """A heading in a legend."""
    return Line2D([], [], ls="", label=text)


def explain(
    axes: Axes, keys: Sequence[Artist], title: str | None = None, *, after: Sequence[Artist] = ()
) -> None:
    """Add a legend next to a plan, and a scale bar and a north arrow below it; the axes have their final limits.

    The legend has the entries `keys`, those of the labelled artists, and `after`.
    """
    drawn, _ = axes.get_legend_handles_labels()
    inside = axes.get_legend()
    if inside is not None:
        inside.remove()
    axes.figure.legend(
        handles=[*keys, *drawn, *after],
        loc="outside right upper",
        fontsize=8,
        frameon=False,
        title=title,
        title_fontsize=8,
    )
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    strip = _STRIP * max(east - west, north - south)
    axes.set_ylim(south - strip, north)
    length, y = bar_m(east - west), south - 0.62 * strip
    x, tick = west + 0.3 * strip, 0.12 * strip
    for ends in (
        ([x, x + length], [y, y]),
        ([x, x], [y - tick, y + tick]),
        ([x + length, x + length], [y - tick, y + tick]),
    ):
        axes.plot(*ends, color="0.1", lw=1.6, zorder=9, solid_capstyle="butt")
    axes.annotate(f"{length:g} m", (x + length / 2, y + tick), ha="center", va="bottom", fontsize=8, zorder=9)
    at = x + length + 0.8 * strip
    axes.annotate(
        "",
        (at, y + 0.45 * strip),
        (at, y - 0.25 * strip),
        arrowprops={"arrowstyle": "-|>", "color": "0.1", "lw": 1.2},
        zorder=9,
    )
    axes.annotate("N (+y)", (at + 0.2 * strip, y), va="center", fontsize=8, zorder=9)


#: Okabe and Ito's colours (2008), for parts of the floor from the largest on, and a grey for the rest.
_PARTS = ("#009E73", "#E69F00", "#CC79A7", "#0072B2", "#D55E00", "#F0E442")
_OTHERS = "#7F7F7F"
#: Smaller parts have no name [m2].
_LEAST_M2 = 0.1
#: Lines of robots of the same colour.
_STYLES = ("-", "--", ":", "-.")
#: Width of a legend next to a plan.
LEGEND_INCHES = 1.9
#: Colours of trajectories by their estimator.
_TRAJECTORIES = {"odometry": "#E69F00", "matching": "#56B4E9", "graph": "#009E73", "reference": "#000000"}
#: Largest number of points of each action.
_MOST_POINTS = 2000


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


def plot_team(path: Path, building: Building, log: TeamLog) -> None:
    """Draw plan, the map of the first robot to arrive, and the true trajectories of all, each in its colour."""
    figure, axes = plan_axes(building)
    log.maps[log.first.robot].plot(axes, robot=False)
    building.draw_walls(axes)
    _draw_tracks(axes, {f"{name}: {robot.ended}": robot.poses for name, robot in log.robots.items()})
    if log.first.seeks_target:
        axes.plot(*log.first.task.target, "*", color=TARGET, ms=13, label="target")
    explain(axes, [*wall_keys(bool(building.furnishings)), *map_keys()], "the team's map, and the truth")
    result = log.result()
    axes.set_title(
        f"{building.plan.name}: {log.first.ended} after {counted(log.first.steps, 'step')} of "
        f"{counted(len(log.robots), 'robot')}, {100 * result['coverage']:.0f} % seen, "
        f"{100 * result['overlap']:.0f} % of it by several",
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
    named = [component for component in order if area_m2[component] >= _LEAST_M2][: len(_PARTS)]
    keys = wall_keys(bool(building.furnishings))
    # Number of each part's colour: that of all small ones is the last.
    shade = np.full(places.n_parts + 1, np.nan)
    shade[[component + 1 for component in order]] = [min(place, len(named)) for place in range(len(order))]
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
        Patch(color=_PARTS[place], label=f"part {place + 1}: {area_m2[component]:.1f} m2")
        for place, component in enumerate(named)
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


def draw_maps(
    path: Path, plans: Mapping[str, FloorPlan], trajectories: Mapping[str, Float[np.ndarray, "n 3"]]
) -> None:
    """Draw maps side by side, each with its trajectory."""
    figure, axes = plt.subplots(
        1, len(plans), figsize=(9 * len(plans), 9), layout="constrained", squeeze=False
    )
    for axis, (name, plan) in zip(axes[0], plans.items(), strict=True):
        _draw_cells(axis, plan)
        axis.plot(*trajectories[name][:, :2].T, color="tab:red", lw=0.5)
        axis.set_title(f"{plan.name}: {name}", parse_math=False)
    save_figure(figure, path)


def draw_team(
    path: Path, plan: FloorPlan, trajectories: Mapping[str, Float[np.ndarray, "_ 3"]], title: str
) -> None:
    """Draw a map with the trajectories of several robots by name, each in its colour from a dot on."""
    figure, axis = plt.subplots(figsize=(9, 9), layout="compressed")
    _draw_cells(axis, plan)
    _draw_tracks(axis, trajectories)
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, frameon=False)
    axis.set_title(title, parse_math=False)
    save_figure(figure, path)


def _draw_tracks(axes: Axes, tracks: Mapping[str, Sequence[np.ndarray] | np.ndarray]) -> None:
    """Draw the poses of robots by label, each robot in its colour from a dot on; later ones of a colour are dashed."""
    for k, (label, poses) in enumerate(tracks.items()):
        track, colour = np.asarray(poses)[:, :2], css(robot_colour(k))
        style = _STYLES[k // len(ROBOTS) % len(_STYLES)]
        axes.plot(*track.T, color=colour, ls=style, lw=1.2, label=label.replace("$", r"\$"))
        axes.plot(*track[0], "o", color=colour, ms=5)


def _draw_cells(axis: Axes, plan: FloorPlan) -> None:
    """Draw free cells white, occupied ones black, and unknown ones grey."""
    shade = np.full(plan.occupancy.shape, 0.8)
    shade[plan.occupancy == FREE] = 1.0
    shade[plan.occupancy == OCCUPIED] = 0.0
    (x, y, _), (ny, nx), cell_m = plan.origin, plan.occupancy.shape, plan.resolution_m
    extent = (x, x + nx * cell_m, y, y + ny * cell_m)
    axis.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, interpolation="nearest")
    axis.set(xlabel="x [m]", ylabel="y [m]")


def draw_trajectories(
    path: Path, log: RobotLog, trajectories: Mapping[str, Float[np.ndarray, "n 3"]]
) -> None:
    """Draw trajectories together, aligned to the reference if there is one."""
    figure, axes = plt.subplots(figsize=(9, 9), layout="compressed")
    for name, poses in trajectories.items():
        placed = poses if log.reference is None else align_trajectory(poses, log.reference)
        axes.plot(placed[:, 0], placed[:, 1], color=_TRAJECTORIES[name], lw=1, label=name)
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=len(trajectories), frameon=False)
    axes.set_title(f"{log.name}: where the robot was", parse_math=False)
    save_figure(figure, path)


def draw_errors(runs: Runs, path: Path) -> None:
    """Draw the errors of each action: position with the ellipse of 95 %, and a histogram of the turn."""
    figure, axes = plt.subplots(2, len(runs.errors), figsize=(11, 6.5), layout="constrained", squeeze=False)
    circle = np.linspace(0, 2 * math.pi, 100)
    for column, (action, errors) in enumerate(runs.errors.items()):
        shown = errors[:: max(1, len(errors) // _MOST_POINTS)]
        place, turn = axes[:, column]
        place.plot(1000 * shown[:, 0], 1000 * shown[:, 1], ".", ms=2, color="tab:blue", alpha=0.5)
        mean, covariance = errors[:, :2].mean(axis=0), np.cov(errors[:, :2].T)
        lengths, directions = np.linalg.eigh(covariance)
        # A normal distribution in the plane has 95 % of its mass within 2.448 standard deviations.
        reach = (
            2.448 * directions @ (np.sqrt(np.maximum(lengths, 0))[:, None] * [np.cos(circle), np.sin(circle)])
        )
        place.plot(*(1000 * (mean[:, None] + reach)), color="tab:orange", label="95 %")
        place.plot(*(1000 * mean), "+", color="black", ms=10, label="mean")
        place.axhline(0, color="0.8", lw=0.8, zorder=0)
        place.axvline(0, color="0.8", lw=0.8, zorder=0)
        place.set_aspect("equal", "datalim")
        place.set_title(f"{action.name.lower()}, {counted(len(errors), 'run')}")
        place.set(xlabel="ahead, measured minus true [mm]", ylabel="to the left [mm]")
        place.legend(loc="upper right", fontsize=8)
        turn.hist(np.degrees(errors[:, 2]), bins=40, color="tab:blue")
        turn.axvline(float(np.degrees(errors[:, 2].mean())), color="black", lw=1)
        turn.set(xlabel="turn, measured minus true [deg]", ylabel="runs")
    save_figure(figure, path)
