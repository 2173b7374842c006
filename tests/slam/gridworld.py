"""A world of cells with a robot that moves exactly and sees exactly, to drive whole loops of decisions in.

The robot's map is perfect but partial: rays are sampled every fifth of a cell, cells before the first solid one are
known free, that one is known solid. Glass stops the robot and no ray. Nothing here comes from the code under test but
the types that it takes.
"""

import math

import numpy as np
from scipy import ndimage

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull
from slam.mapping.collisions import CollisionMarks

CELL = 0.05
RADIUS_M = 0.10


def hall(size_m, walls=()) -> np.ndarray:
    """Solid cells of a hall from (0, 0), closed in by walls of two cells, with further boxes (x0, y0, x1, y1) [m]."""
    ny, nx = round(size_m[1] / CELL), round(size_m[0] / CELL)
    solid = np.ones((ny, nx), bool)
    solid[2:-2, 2:-2] = False
    for box in walls:
        solid[cells_of(box)] = True
    return solid


def cells_of(box) -> tuple[slice, slice]:
    """Rows and columns of a box (x0, y0, x1, y1) [m]."""
    x0, y0, x1, y1 = (round(v / CELL) for v in box)
    return slice(y0, y1), slice(x0, x1)


class GridWorld:
    """A robot among solid cells."""

    def __init__(self, solid, pose, *, glass=None, radius_m=RADIUS_M, explored_range_m=3.2, range_m=4.0):
        self.solid = solid
        self.hard = solid if glass is None else solid | glass
        self.pose = np.array(pose, float)
        self.radius_m = radius_m
        self.frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL, shape=solid.shape)
        self.probability = np.full(solid.shape, 0.5, np.float32)
        self.explored = np.zeros(solid.shape, bool)
        self.marks = CollisionMarks(self.frame, Hull(radius_m))
        self._corners = np.argwhere(self.hard)[:, ::-1] * CELL
        self._reach = np.arange(0.0, range_m, 0.2 * CELL)
        self._near = self._reach <= explored_range_m
        self._steps = 0
        self.bumps = 0
        #: Steps forward still to come in which the wheels slip.
        self.slips = 0
        self.look()

    def know_all(self) -> "GridWorld":
        """Put all that can be seen on the map, as if the robot had been everywhere."""
        self.probability[:] = np.where(self.solid, 0.95, 0.05)
        self.explored[:] = True
        return self

    def look(self) -> None:
        """Enter what a camera of 90 degrees sees."""
        if self.explored.all():
            return
        x, y, yaw = self.pose
        azimuth = yaw + np.linspace(-math.pi / 4, math.pi / 4, 181)[:, None]
        ix = np.floor((x + np.cos(azimuth) * self._reach) / CELL).astype(int)
        iy = np.floor((y + np.sin(azimuth) * self._reach) / CELL).astype(int)
        solid = self.solid[iy.clip(0, self.solid.shape[0] - 1), ix.clip(0, self.solid.shape[1] - 1)]
        behind = np.cumsum(solid, axis=1) - solid > 0
        first, free = solid & ~behind, ~solid & ~behind
        self.probability[iy[free], ix[free]] = 0.05
        self.probability[iy[first], ix[first]] = 0.95
        seen = (first | free) & self._near
        self.explored[iy[seen], ix[seen]] = True
        under = self.beneath(self.pose)
        self.probability[under & (self.probability == 0.5)] = 0.05

    def beneath(self, pose) -> np.ndarray:
        """Cells whose centres the hull covers."""
        iy, ix = np.indices(self.solid.shape)
        return np.hypot((ix + 0.5) * CELL - pose[0], (iy + 0.5) * CELL - pose[1]) < self.radius_m

    def gap_m(self, point) -> float:
        """Distance of a point to the nearest hard cell, taken as a square [m]."""
        off = np.maximum(np.maximum(self._corners - point, point - self._corners - CELL), 0)
        return float(np.hypot(*off.T).min(initial=9.0))

    def act(self, action: Action) -> float:
        """Carry out an action, in pieces of 5 mm until the hull touches; the distance driven [m]."""
        distance = 0.0
        if action is Action.FORWARD and self.slips:
            self.slips -= 1
        elif action in (Action.FORWARD, Action.BACKWARD):
            distance = self._advance(1 if action is Action.FORWARD else -1)
        else:
            self.pose[2] += TURN_RAD if action is Action.LEFT else -TURN_RAD
            self.pose[2] = (self.pose[2] + math.pi) % (2 * math.pi) - math.pi
        self._steps += 1
        displacement = np.array([distance, 0.0, 0.0])
        self.bumps += self.marks.update(self._steps, action, displacement, self.pose, self.probability)
        self.marks.stand(self.pose)
        self.look()
        return distance

    def _advance(self, sign: int) -> float:
        direction, distance = sign * np.array([math.cos(self.pose[2]), math.sin(self.pose[2])]), 0.0
        now = self.gap_m(self.pose[:2])
        for _ in range(round(FORWARD_M / 0.005)):
            after = self.pose[:2] + 0.005 * direction
            gap = self.gap_m(after)
            if gap < self.radius_m - 1e-9 and gap < now:
                break
            self.pose[:2], now, distance = after, gap, distance + 0.005
        return distance

    def estimate(self) -> MapEstimate:
        """What the robot knows."""
        return MapEstimate(
            frame=self.frame,
            obstacle_probability=self.probability,
            explored=self.explored,
            blocked=self.marks.blocked,
            pose=self.pose.copy(),
        )

    def reachable(self) -> np.ndarray:
        """Cells whose centres the centre of the hull can get to from here (by SciPy, on the true world)."""
        gap = ndimage.distance_transform_edt(~self.hard) * CELL
        label = ndimage.label(gap > self.radius_m + 0.5 * CELL)[0]
        iy, ix = (int(v / CELL) for v in self.pose[1::-1])
        return label == label[iy, ix] if label[iy, ix] else np.zeros_like(self.hard)
