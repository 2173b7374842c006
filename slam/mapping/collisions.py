"""Collision marks: obstacles that the camera does not see, marked where a step fell short.

A step, forward or back, that odometry measures as too short was stopped by something. If an obstacle that is already on
the map touches the hull there, no mark is made, unless it happens again and again: then the passage is narrower than on
the map. Otherwise a strip of cells before the hull is marked; it grows wider while the robot bumps into the same place.
A velocity is expected to lead as far as the least of the last three commanded speeds does in its time: the robot has
accelerated by then.
A turn of a base that swings aside as it turns was stopped if it swings by much less than usual: the cells next to the
hull are marked permanently, since the camera does not look there.
Marks fade after a while, because a mark next to a narrow door may close it; a place bumped into again is remembered
twice as long.
Reference: the collision map of Chaplot et al., ICLR 2020, which marks every bump and never forgets.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float32

from robosim.support.checks import Range, checked
from slam.actions import FORWARD_M, MOVES, STEPS, Action, Command, Velocity
from slam.grid import Grid, GridFrame, enlarged, filled_blocks, zeros
from slam.hull import Hull
from slam.odometry import Vector
from slam.poses import Pose, to_map
from slam.robot import Robot

#: Shorter motions are not judged [m]; number of commanded speeds that count.
_JUDGED_M, _COMMANDS = 0.04, 3
#: Least swing of a turn that is judged [m], the fraction of it that a free turn reaches, and width of its mark [m].
_SWING_M, _SWINGS, _SIDE_M = 0.008, 0.65, 0.10


@dataclass(frozen=True, kw_only=True)
@checked
class CollisionConfig:
    """When a step counts as stopped, and which cells are marked."""

    short_m: Annotated[float, Range(1e-6, FORWARD_M, "m", "That is the length of a step.")] = 0.8 * FORWARD_M
    """A step measured shorter than this was stopped [m]; what a velocity leads to, in proportion."""
    touch_m: Annotated[float, Range(0, 1, "m")] = 0.05
    """An obstacle on the map this near to the hull explains the stop [m]."""
    depth_m: Annotated[float, Range(0, 1, "m")] = 0.10
    """Depth of the marked strip, from the hull on [m]."""
    max_width_m: Annotated[float, Range(0.01, 5, "m")] = 0.45
    """Width to which the strip grows [m]; it begins as one cell."""
    patience: Annotated[int, Range(1, 1_000_000, "stops")] = 3
    """Consecutive stops at an obstacle of the map before the place is marked too."""
    memory_steps: Annotated[int, Range(1, 1_000_000, "decisions")] = 150
    """Decisions for which a first mark lasts; doubled at each further bump in the same place."""


class CollisionMarks:
    """Blocked cells of a grid that may grow."""

    def __init__(
        self,
        frame: GridFrame,
        hull: Hull = Robot().hull,
        config: CollisionConfig = CollisionConfig(),
        motions: Sequence[Vector | None] = (),
    ):
        """Begin without marks; `motions` are mean displacements of the actions, in the order of `MOVES`."""
        self.frame = frame
        self.config = config
        self._hull, self._motions = hull, motions
        self.blocked = zeros(frame.shape, bool)
        self._bumps = zeros(frame.shape, np.uint8)
        self._until = zeros(frame.shape, np.int32)
        self._width_m = 0.0
        self._stops = 0
        self._speeds_mps = deque([0.0] * _COMMANDS, maxlen=_COMMANDS)
        self._next_expiry = np.iinfo(np.int32).max

    def grow(self, frame: GridFrame, left: int, below: int) -> None:
        """Move to a larger frame of the same lattice, with `left` columns and `below` rows added before the old."""
        blocks = filled_blocks(self._bumps)
        for name in ("blocked", "_bumps", "_until"):
            setattr(self, name, enlarged(getattr(self, name), frame.shape, left, below, blocks))
        self.frame = frame

    def update(
        self, step: int, action: Command, displacement: Pose, pose: Pose, probability: Float32[Grid, "ny nx"]
    ) -> bool:
        """Detect a collision by the measured displacement, mark it, remove old marks; whether the robot was stopped."""
        self._forget(step)
        if (side := self._stopped_swing(action, displacement)) is not None:
            self._width_m = _SIDE_M
            pose = np.array([pose[0], pose[1], pose[2] + side])
            self._mark(step, pose, self._hull.radius_m - 0.5 * self.frame.resolution_m, is_swing=True)
            return True
        expected_m = self._expected_m(action)
        if expected_m < _JUDGED_M:
            return False
        length_m = math.hypot(displacement[0], displacement[1])
        stopped = bool(length_m < self.config.short_m * (expected_m / FORWARD_M))
        if not stopped:
            self._width_m, self._stops = 0.0, 0
            return False
        stuck = length_m < 0.2 * expected_m
        reach_m = self._hull.ahead_m
        self._stops = self._stops + 1 if stuck else 1
        if action is Action.BACKWARD:
            pose = np.array([pose[0], pose[1], pose[2] + math.pi])  # it met something behind it
            reach_m = self._hull.behind_m
        if self._stops >= self.config.patience or not self._explained(pose, reach_m, probability):
            cell = self.frame.resolution_m
            self._width_m = min(self._width_m + 2 * cell, self.config.max_width_m) if stuck else cell
            self._mark(step, pose, reach_m)
        return True

    def _stopped_swing(self, action: Command, displacement: Pose) -> float | None:
        """Direction [rad] in which something stopped the swing of a turn, relative to the heading; None if free."""
        motions = dict(zip(MOVES, self._motions, strict=False))
        motion = motions.get(action) if action in (Action.LEFT, Action.RIGHT) else None
        if motion is None or (swing_m := math.hypot(*motion[:2])) < _SWING_M:
            return None
        along_m = float(displacement[:2] @ np.array(motion[:2])) / swing_m
        return math.atan2(motion[1], motion[0]) if along_m < _SWINGS * swing_m else None

    def _expected_m(self, action: Command) -> float:
        """Least distance that an action leads to in the open [m]."""
        if not isinstance(action, Velocity):
            self._speeds_mps.append(0.0)
            return FORWARD_M if action in STEPS else 0.0
        self._speeds_mps.append(max(action.v_mps, 0.0))
        return min(self._speeds_mps) * action.duration_s

    def _explained(self, pose: Pose, reach_m: float, probability: Float32[Grid, "ny nx"]) -> bool:
        """Whether an obstacle of the map touches the half of the hull that goes ahead."""
        margin = self.config.touch_m + 0.5 * self.frame.resolution_m
        reach = self._hull.turning_m + margin
        x, y, yaw = pose
        rows, columns, frame = self.frame.window((x - reach, y - reach), (x + reach, y + reach))
        offset = frame.centres(probability[rows, columns] > 0.5) - pose[:2]
        ahead = offset @ np.array([math.cos(yaw), math.sin(yaw)])
        touches = (ahead > 0) & (np.hypot(*offset.T) < reach)
        if self._hull.outline_m:
            aside = offset @ np.array([-math.sin(yaw), math.cos(yaw)])
            touches &= (ahead < reach_m + margin) & (np.abs(aside) < self._hull.radius_m + margin)
        return bool(touches.any())

    def _mark(self, step: int, pose: Pose, reach_m: float, *, is_swing: bool = False) -> None:
        config, cell = self.config, self.frame.resolution_m
        depth_m = cell if is_swing else config.depth_m
        ahead = reach_m + 0.5 * cell + np.arange(0, depth_m - 1e-9, 0.5 * cell)
        side = np.arange(-0.5 * self._width_m, 0.5 * self._width_m + 1e-9, 0.5 * cell)
        a, s = np.meshgrid(ahead, side)
        iy, ix = self.frame.index(to_map(pose, np.column_stack([a.ravel(), s.ravel()])))
        inside = self.frame.inside(iy, ix)
        cells = np.unique(np.column_stack([iy[inside], ix[inside]]), axis=0)
        iy, ix = cells[:, 0], cells[:, 1]
        self._bumps[iy, ix] = np.minimum(self._bumps[iy, ix] + 1, 8)
        self._until[iy, ix] = step + config.memory_steps * 2 ** (self._bumps[iy, ix].astype(np.int32) - 1)
        if is_swing:
            self._until[iy, ix] = np.iinfo(np.int32).max
        self.blocked[iy, ix] = True
        self._next_expiry = min(self._next_expiry, int(self._until[iy, ix].min(initial=self._next_expiry)))

    def _forget(self, step: int) -> None:
        if step < self._next_expiry:
            return
        iy, ix = np.nonzero(self.blocked)
        until = self._until[iy, ix]
        old = until <= step
        self.blocked[iy[old], ix[old]] = False
        left = until[~old]
        self._next_expiry = int(left.min()) if left.size else np.iinfo(np.int32).max

    def stand(self, pose: Pose) -> None:
        """Take marks off the cells whose centres the hull covers."""
        rows, columns, under = self.frame.under(pose, self._hull)
        blocked = self.blocked[rows, columns]
        np.copyto(blocked, False, where=blocked & under)
