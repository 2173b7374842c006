"""Pictures of a log: its map next to the reference's, and the trajectories of odometry, matching and the graph."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from robosim.logs.robot_log import RobotLog
from robosim.logs.trajectory_scores import align_trajectory
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.support.figures import save_figure

#: Okabe and Ito's colours.
_COLOURS = {"odometry": "#E69F00", "matching": "#56B4E9", "graph": "#009E73", "reference": "#000000"}


def draw_maps(
    path: Path, plans: Mapping[str, FloorPlan], trajectories: Mapping[str, Float[np.ndarray, "n 3"]]
) -> None:
    """Draw maps side by side, each with its trajectory."""
    figure, axes = plt.subplots(
        1, len(plans), figsize=(9 * len(plans), 9), layout="constrained", squeeze=False
    )
    for axis, (name, plan) in zip(axes[0], plans.items(), strict=True):
        _draw(axis, plan)
        axis.plot(*trajectories[name][:, :2].T, color="tab:red", lw=0.5)
        axis.set_title(f"{plan.name}: {name}", parse_math=False)
    save_figure(figure, path)


def draw_trajectories(
    path: Path, log: RobotLog, trajectories: Mapping[str, Float[np.ndarray, "n 3"]]
) -> None:
    """Draw trajectories over each other: aligned to the reference, if there is one."""
    figure, axes = plt.subplots(figsize=(9, 9), layout="compressed")
    for name, poses in trajectories.items():
        placed = poses if log.reference is None else align_trajectory(poses, log.reference)
        axes.plot(placed[:, 0], placed[:, 1], color=_COLOURS[name], lw=1, label=name)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=len(trajectories), frameon=False)
    axes.set_title(f"{log.name}: where the robot was", parse_math=False)
    save_figure(figure, path)


def _draw(axes: Axes, plan: FloorPlan) -> None:
    shade = np.full(plan.occupancy.shape, 0.8)
    shade[plan.occupancy == FREE] = 1.0
    shade[plan.occupancy == OCCUPIED] = 0.0
    (x, y, _), (ny, nx), cell_m = plan.origin, plan.occupancy.shape, plan.resolution_m
    extent = (x, x + nx * cell_m, y, y + ny * cell_m)
    axes.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, interpolation="nearest")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
