"""Yielding: of two robots that meet where there is no room to pass, one backs off.

A robot that another keeps from going on waits. After some waits it goes to the nearest place next to the other's path,
if that leads past it and the other does not back off, and stays there until the other has passed, or for a while: less
long if the other does not come nearer. Robots wait for different times, by their order in the team, so that they do
not all back off at once, nor forever in turns; one that has no place with room for the other leaves it to that one at
first. A robot with nothing left to do makes room at once.

It goes there in reverse if it looks away from the place, and turns round where a step or a turn is too tight for that:
in a corridor it saves turning round twice.
"""

import math

import numpy as np
from jaxtyping import Float

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.grid import MapEstimate
from slam.hull import Hull
from slam.planning.cost_map import CostConfig, cut_box, travel_time_from_robot
from slam.planning.paths import along
from slam.planning.planner import Plan
from slam.poses import to_map, to_robot

#: Waits after which the first robot of a team backs off, and each further one has waited for longer.
_WAITS, _WAITS_MORE = 3, 5
#: Further waits after which it does so even if there is no place with room for the others to pass.
_WAITS_ROOM = 20
#: Most decisions for which it stays away, and what each counts for as it goes there, in its place or as it waits, and
#: in its place if nothing comes nearer.
_AWAY, _GOES, _STAYS, _IDLE = 25.0, 0.25, 1.0, 4.0
#: Distance from its place at which a robot is there, and by which another has come nearer in a decision [m].
_THERE_M, _NEARER_M = 0.3, 0.02
#: Half side of the surroundings in which it looks for a place [m]; space that it leaves to the other's hull [m].
AROUND_M, _SPACE_M = 5.0, 0.35
#: Space that it keeps from the other as it goes there [m].
_MARGIN_M = 0.1
#: Robots nearer than this may block each other; a path leads past a place that it comes nearer to, by more than the
#: last [m].
NEAR_M, _PAST_M, _PASSES_M = 2.0, 0.7, 0.05
#: Point of its path that a robot aims at as it goes backwards, and space that it leaves next to it [m].
_AIM_M, _SIDE_M = 0.3, 0.02
#: Places on a step backwards, in the frame of the robot [m].
_STEP = np.outer(np.linspace(0.25, 1.0, 4), (-FORWARD_M, 0.0))
#: Length of the other's path that is left free [m].
_PATH_M = 4.0


class Yielding:
    """Decides when a robot backs off, and to where."""

    def __init__(self, order: int, hull: Hull) -> None:
        """Begin; `order` counts the robots of the team from 0."""
        self._patience, self._hull = _WAITS + _WAITS_MORE * order, hull
        self._place: np.ndarray | None = None
        self._left, self._from, self._gap_m = 0.0, np.zeros(2), math.inf
        self._turns_round = False

    def place(
        self,
        waited: float,
        estimate: MapEstimate,
        paths: list[tuple[Float[np.ndarray, "n 2"], float]],
        *,
        another: bool,
        receives: bool,
    ) -> Float[np.ndarray, "2"] | None:
        """The place to back off to; None if there is no need.

        Args:
            waited: Decisions for which something has blocked the robot; infinite if it has nothing to do.
            estimate: Its map.
            paths: Paths of the robots around from where they are, and their radii [m].
            another: Whether another one of them backs off.
            receives: Whether the paths were reported; else they are guesses, and say nothing of robots out of sight.
        """
        here = estimate.pose[:2]
        gap_m = min((math.hypot(*(path[0] - self._from)) for path, _ in paths), default=math.inf)
        is_there = self._place is not None and math.hypot(*(self._place - here)) < _THERE_M
        is_idle = is_there and gap_m > self._gap_m - _NEARER_M
        self._left -= _IDLE if is_idle else _STAYS if is_there or waited else _GOES
        self._gap_m = gap_m
        passes = any(_leads_past(path, place) for path, _ in paths for place in (self._from, here))
        if self._left > 0 and receives and not passes:
            self._left = 0.0
        is_near = any(np.hypot(*(path[0] - here)) < NEAR_M for path, _ in paths)
        if self._left <= 0 and waited >= self._patience and is_near and passes and not another:
            self._place = self._find(estimate, paths, anywhere=waited >= self._patience + _WAITS_ROOM)
            self._left, self._from = 0.0 if self._place is None else _AWAY, here.copy()
            self._turns_round = False
        return self._place if self._left > 0 else None

    def back_along(self, pose: Float[np.ndarray, "3"], plan: Plan) -> Action | None:
        """The action that leads backwards along a path to the place; None if the robot is to go forwards."""
        ahead = along(plan.path, 0.1, _AIM_M) if len(plan.path) > 1 else plan.path
        left = to_robot(pose, ahead[-1])
        angle = math.atan2(-left[1], -left[0])
        if self._turns_round or not left.any() or abs(angle) > math.pi / 2:
            return None
        action, points, yaw = Action.BACKWARD, to_map(pose, _STEP), float(pose[2])
        if abs(angle) > TURN_RAD / 2:
            action, points = Action.LEFT if angle > 0 else Action.RIGHT, pose[None, :2]
            yaw += math.copysign(TURN_RAD, angle)
        now_m = plan.clearance.space(self._hull, pose[:2], float(pose[2]))
        space_m = plan.clearance.space(self._hull, points, yaw).min()
        # Where that is too tight, it turns round once, and not again and again.
        self._turns_round = bool(space_m < min(_SIDE_M, now_m - 1e-3))
        return None if self._turns_round else action

    def _find(
        self, estimate: MapEstimate, paths: list[tuple[Float[np.ndarray, "n 2"], float]], *, anywhere: bool
    ) -> Float[np.ndarray, "2"] | None:
        """The nearest place with room for all others to pass; if there is none, the one with most, or None."""
        here = estimate.pose[:2]
        box = cut_box(estimate, here - AROUND_M, here + AROUND_M)
        for path, radius_m in paths:
            # It cannot pass the other either.
            rows, columns, covered = box.frame.disc(path[0], radius_m + _MARGIN_M)
            box.obstacle[rows, columns][covered] = True
        travel = travel_time_from_robot(box, CostConfig(), self._hull, through_unknown=False)
        cells = np.isfinite(travel.cost_m)
        places, cost_m = travel.frame.centres(cells), travel.cost_m[cells]
        room_m = np.full(len(places), np.inf)
        for path, radius_m in paths:
            points = along(path, 0.1, _PATH_M) if len(path) > 1 else path
            gaps_m = np.hypot(*(places[:, None] - points).transpose(2, 0, 1)).min(axis=1)
            room_m = np.minimum(room_m, gaps_m - radius_m - self._hull.turning_m)
        is_enough = room_m >= _SPACE_M
        if not len(places) or not (anywhere or is_enough.any()):
            return None
        best = np.where(is_enough, cost_m, np.inf).argmin() if is_enough.any() else room_m.argmax()
        return np.asarray(places[best])


def _leads_past(path: Float[np.ndarray, "n 2"], place: Float[np.ndarray, "2"]) -> bool:
    """Whether a path leads past a place, from farther away."""
    points = along(path, 0.2, 2 * AROUND_M) if len(path) > 1 else path
    gaps_m = np.hypot(*(points - place).T)
    return bool(gaps_m.min() < min(_PAST_M, gaps_m[0] - _PASSES_M))


def turn_along(pose: Float[np.ndarray, "3"], path: Float[np.ndarray, "n 2"]) -> Action:
    """The turn towards a path, for a robot that another blocks where it looks to."""
    ahead = path[np.hypot(*(path - pose[:2]).T) > 0.05]
    if not len(ahead):
        return Action.WAIT
    left = to_robot(pose, ahead[0])
    angle = math.atan2(left[1], left[0])
    return Action.WAIT if abs(angle) < TURN_RAD / 2 else Action.LEFT if angle > 0 else Action.RIGHT
