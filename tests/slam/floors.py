"""Known maps drawn by hand: open floor with the walls of a test."""

import numpy as np

from slam.grid import GridFrame, MapEstimate
from slam.odometry import ActionError, OdometryConfig
from slam.robot import Robot

CELL = 0.05


def floor(
    pose=(0.0, 0.0, 0.0), *, low_xy=(-3.0, -2.0), size_m=(6.0, 4.0), walls=(), surfaces=True
) -> MapEstimate:
    """A known floor closed in by walls of one cell.

    Args:
        pose: Where the robot is.
        low_xy: Lower-left corner [m].
        size_m: Extent in x and y, walls included [m].
        walls: Boxes (x0, y0, x1, y1) [m] whose cells (by their centres) are obstacles.
        surfaces: Whether offsets are given; all zero, so that obstacles are their cells' centres.
    """
    frame = GridFrame(
        origin_xy=low_xy, resolution_m=CELL, shape=(round(size_m[1] / CELL), round(size_m[0] / CELL))
    )
    obstacle = np.ones(frame.shape, bool)
    obstacle[1:-1, 1:-1] = False
    x, y = np.moveaxis(frame.centres(np.ones(frame.shape, bool)).reshape(*frame.shape, 2), -1, 0)
    for x0, y0, x1, y1 in walls:
        obstacle |= (x > x0) & (x < x1) & (y > y0) & (y < y1)
    return MapEstimate(
        frame=frame,
        obstacle_probability=np.where(obstacle, 0.95, 0.05).astype(np.float32),
        explored=np.ones(frame.shape, bool),
        blocked=np.zeros(frame.shape, bool),
        pose=np.array(pose, float),
        surface_offset_m=np.zeros((*frame.shape, 2), np.float32) if surfaces else None,
    )


def divided(gap_cells: int, pose=(-1.5, 0.0, 0.0)) -> MapEstimate:
    """Two rooms side by side, with a wall 0.1 m thick at x = 0 and a door of so many free cells at y >= 0."""
    top = gap_cells * CELL
    return floor(pose, walls=[(-0.05, -2.0, 0.05, 0.0), (-0.05, top, 0.05, 2.0)])


def at_pose(estimate: MapEstimate, pose) -> MapEstimate:
    """The same map with the robot at another pose."""
    return MapEstimate(
        frame=estimate.frame,
        obstacle_probability=estimate.obstacle_probability,
        explored=estimate.explored,
        blocked=estimate.blocked,
        pose=np.array(pose, float),
        surface_offset_m=estimate.surface_offset_m,
    )


def robot_of(motions, **fields) -> Robot:
    """A robot whose actions have these mean displacements: forward, left, right and, if given, back."""
    names = ("forward", "left", "right", "backward")
    errors = {name: ActionError(motion=motion) for name, motion in zip(names, motions, strict=False)}
    return Robot(odometry=OdometryConfig(**errors), **fields)
