"""Velocity controller: a dynamic-window search over speeds and turn rates.

Candidates are pairs of a speed and a turn rate within the limits of the robot. From where the last command leads in the
latency, the robot approaches the candidate with the acceleration of its wheels, and follows an arc from there. Others
are turns on the spot followed by a straight run. For each candidate and each time without contact of the hull, the cost
in seconds is

    time + (cost of the path from there) / speed + (turn needed there) / turn rate

and the first command of the cheapest is returned. Arcs are long enough to decide once more and brake. As in
`slam.control.controller`, arcs that pass closer to obstacles cost extra, and a robot that does not leave a place for
long drives in the direction with most room. At the end of the path it turns to the goal and looks around.
A hull with an outline may also drive backward. Left out: bases that do not turn about their centre.
Reference: Fox, Burgard and Thrun, The dynamic window approach to collision avoidance, IEEE Robotics and Automation
Magazine 4 (1997). The score is that of the planner's field, as in Brock and Khatib, ICRA 1999, instead of headings.
"""

import math
from collections import deque

import numpy as np
from jaxtyping import Bool, Float

from slam.actions import Velocity
from slam.control.controller import ControlConfig
from slam.planning.clearance import Clearance
from slam.planning.planner import Plan
from slam.poses import Pose, compose, wrap
from slam.robot import Robot

#: Numbers of speeds and, to each side, of turn rates that are compared.
_SPEEDS, _RATES = 5, 8
#: Times along arcs [s]: step, and how far beyond the least one.
_STEP_S, _BEYOND_S = 0.125, 1.5
#: Turns on the spot [rad].
_TURNS_RAD = np.radians([turn for turn in range(-180, 180, 10) if turn])
#: Cost of a change of the turn rate [s per rad/s], and of a change between forward and backward [s].
_CHANGE_S, _BACK_S = 0.1, 2.0
#: Decisions with which a stuck robot drives away, its speed then, as a part of the highest, and its space [m].
_ESCAPE, _ESCAPE_PART, _ESCAPE_SPACE_M = 8, 0.4, 0.03


class VelocityController:
    """Chooses speeds and turn rates; remembers the last command, and lack of progress."""

    def __init__(self, robot: Robot = Robot(), config: ControlConfig = ControlConfig()) -> None:
        self.robot, self.config, self.hull = robot, config, robot.hull
        self._turn_rate_radps = min(config.turn_rate_radps, robot.turn_rate_radps)
        rates = self._turn_rate_radps * np.linspace(0, 1, _RATES + 1) ** 1.5  # finer near straight on
        speeds = np.linspace(0, robot.max_speed_mps, _SPEEDS + 1)[1:]
        if robot.outline_m:  # a disk can always turn
            speeds = np.append(speeds, -speeds[1])
        v, w = np.meshgrid(speeds, np.concatenate([-rates[:0:-1], rates]), indexing="ij")
        # Commands that a wheel is too slow for are reduced along the same arc, as the base does.
        scale = np.minimum(1.0, robot.max_speed_mps / (np.abs(v) + np.abs(w) * robot.track_m / 2))
        self._v, self._w = (scale * v).ravel(), (scale * w).ravel()
        least_s = config.control_s + robot.max_speed_mps / robot.max_accel_mps2
        self._first = math.ceil(least_s / _STEP_S) - 1
        self._times = _STEP_S * np.arange(1, self._first + 2 + round(_BEYOND_S / _STEP_S))
        self._runs_m = self._arcs(np.zeros(3), (0.0, 0.0))[1]  # from rest, straight on
        self._runs_m = self._runs_m[(self._w == 0) & (self._v > 0)]
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        self.withdraw()
        self._end: Float[np.ndarray, 2] = np.zeros(2)  # of the path at which it looks around,
        self._looking = 0.0  # and to which side
        self._trail: deque[tuple[float, float]] = deque(maxlen=self.config.stuck_decisions)
        self._escape_decisions = 0

    def withdraw(self) -> None:
        """The last command was not done, as when the robot waits instead: it stands."""
        self._command = self._speeds = (0.0, 0.0)

    def act(self, pose: Pose, plan: Plan) -> Velocity:
        """The next command at an estimated pose x [m], y [m], yaw [rad], along a plan."""
        config = self.config
        self._watch(pose)
        pose = self._at_next_command(pose)
        if math.hypot(*(plan.path[-1] - self._end)) > config.arrived_m:
            self._end, self._looking = plan.path[-1], 0.0
        if self._escape_decisions:
            self._command = self._escape(pose, plan.clearance)
        elif plan.length_m < config.arrived_m:
            self._command = 0.0, self._look(pose, plan)
        else:
            self._command = self._best(pose, plan)
        return Velocity(*self._command, config.control_s)

    def _watch(self, pose: Pose) -> None:
        """Note whether the robot gets anywhere."""
        self._trail.append((float(pose[0]), float(pose[1])))
        trail = np.array(self._trail)
        full = len(trail) == self.config.stuck_decisions
        if full and np.hypot(*(trail - trail[-1]).T).max() < self.config.stuck_radius_m:
            self._escape_decisions = _ESCAPE
            self._trail.clear()

    def _at_next_command(self, pose: Pose) -> Pose:
        """Where the robot is when its next command comes into force; sets its speeds there.

        The last command is in force for one period until then, and the ones before have no part in it.
        """
        config, start = self.config, np.array(self._speeds)
        change = np.array(self._command) - start
        ramp_s = (abs(change[0]) + abs(change[1]) * self.robot.track_m / 2) / self.robot.max_accel_mps2
        before_s = max(config.control_s - self.robot.latency_s, 0.0)
        now, then = (
            start + change * min(1.0, time_s / max(ramp_s, 1e-9)) for time_s in (before_s, config.control_s)
        )
        self._speeds = float(then[0]), float(then[1])
        ahead_m, turn = self.robot.latency_s * (now + then) / 2
        return compose(pose, np.array([ahead_m * math.cos(turn / 2), ahead_m * math.sin(turn / 2), turn]))

    def _best(self, pose: Pose, plan: Plan) -> tuple[float, float]:
        """The cheapest speed and turn rate."""
        config = self.config
        arcs, distance_m = self._arcs(pose, self._speeds)
        price = self._price(arcs, distance_m, plan).min(axis=1)
        price += _BACK_S * (self._v * (self._command[0] or 1.0) < 0)
        runs = np.empty((len(_TURNS_RAD), *self._runs_m.shape, 3))
        headings = (pose[2] + _TURNS_RAD)[:, None, None]
        runs[..., 0] = pose[0] + self._runs_m * np.cos(headings)
        runs[..., 1] = pose[1] + self._runs_m * np.sin(headings)
        runs[..., 2] = headings
        runs_m = np.broadcast_to(self._runs_m, runs.shape[:3])
        run_price = self._price(runs, runs_m, plan).min(axis=(1, 2))
        run_price[~self._can_turn(pose, plan.clearance)] = np.inf
        turns = np.clip(_TURNS_RAD / config.control_s, -self._turn_rate_radps, self._turn_rate_radps)
        price = np.append(price, run_price + np.abs(_TURNS_RAD) / self._turn_rate_radps)
        v, w = np.append(self._v, np.zeros_like(turns)), np.append(self._w, turns)
        price += _CHANGE_S * np.abs(w - self._speeds[1])
        k = int(np.argmin(price))
        if np.isfinite(price[k]):
            return float(v[k]), float(w[k])
        dx, dy = plan.short_term_goal - pose[:2]
        return 0.0, self._turn(wrap(math.atan2(dy, dx) - pose[2]))

    def _price(
        self, poses: Float[np.ndarray, "*k n 3"], distance_m: Float[np.ndarray, "*k n"], plan: Plan
    ) -> Float[np.ndarray, "*k m"]:
        """Price of driving to the poses that are far enough, and on from there [s]; inf where the hull does not fit."""
        config, first = self.config, self._first
        cost_m, downhill = plan.field.at_and_downhill(poses[..., first:, :2])
        # The turn that will be needed there fades away at the goal.
        turn_rad = np.abs(wrap(downhill - poses[..., first:, 2])) * np.minimum(cost_m / config.forward_m, 1.0)
        space = plan.clearance.space(self.hull, poses[..., :2], poses[..., 2])
        least = config.slacks_m[0]
        # Where the hull is already closer than it should be, it may still move away.
        space = np.where(space >= space[..., :1] + 0.3 * distance_m - 1e-3, np.maximum(space, least), space)
        space = np.minimum.accumulate(space, axis=-1)[..., first:]
        price = np.interp(space, config.slacks_m, config.slack_prices) * config.control_s
        price[space < least] = np.inf
        return (
            price + self._times[first:] + cost_m / self.robot.max_speed_mps + turn_rad / self._turn_rate_radps
        )

    def _can_turn(self, pose: Pose, clearance: Clearance) -> Bool[np.ndarray, " k"]:
        """Which turns on the spot leave the hull clear, or no nearer to obstacles than it is; of a disk all."""
        turns = np.append(_TURNS_RAD, 0.0)
        space = clearance.space(self.hull, np.broadcast_to(pose[:2], (len(turns), 2)), pose[2] + turns)
        is_clear = space >= min(0.0, space[-1]) - 1e-3
        for side in (np.flatnonzero(turns > 0), np.flatnonzero(turns < 0)[::-1]):
            is_clear[side] = np.logical_and.accumulate(is_clear[side])
        return is_clear[:-1]

    def _arcs(
        self, pose: Pose, speeds: tuple[float, float]
    ) -> tuple[Float[np.ndarray, "k n 3"], Float[np.ndarray, "k n"]]:
        """Poses and driven distances [m] at all times of all candidates, from a speed and a turn rate."""
        v, w = speeds
        dv, dw = self._v[:, None] - v, self._w[:, None] - w
        ramp_s = (np.abs(dv) + np.abs(dw) * self.robot.track_m / 2) / self.robot.max_accel_mps2
        share = np.clip((self._times - _STEP_S / 2) / np.maximum(ramp_s, 1e-9), 0, 1)
        turns, steps_m = _STEP_S * (w + share * dw), _STEP_S * (v + share * dv)
        yaw = pose[2] + np.cumsum(turns, axis=1)
        x, y = (
            start + np.cumsum(steps_m * project(yaw - turns / 2), axis=1)
            for start, project in ((pose[0], np.cos), (pose[1], np.sin))
        )
        return np.stack([x, y, yaw], axis=-1), np.cumsum(np.abs(steps_m), axis=1)

    def _look(self, pose: Pose, plan: Plan) -> float:
        """Turn rate at the end of the path: to the requested goal, then once round and on."""
        dx, dy = plan.asked_xy - pose[:2]
        off = wrap(math.atan2(dy, dx) - pose[2])
        if not self._looking and (math.hypot(dx, dy) < 0.1 or abs(off) < self.config.turn_rad):
            self._looking = math.copysign(self._turn_rate_radps, off)
        rate = self._looking or self._turn(off)
        yaws = pose[2] + np.array([0.0, rate * self.config.control_s])
        here, there = plan.clearance.space(self.hull, np.broadcast_to(pose[:2], (2, 2)), yaws)
        if there < min(0.0, here) - 1e-3:  # of a disk never
            rate = self._looking = -math.copysign(self._turn_rate_radps, rate)
        return rate

    def _turn(self, off: float) -> float:
        """Turn rate towards a heading at an angle [rad]."""
        limit = self._turn_rate_radps
        return max(-limit, min(limit, off / self.config.control_s))

    def _escape(self, pose: Pose, clearance: Clearance) -> tuple[float, float]:
        """Drive away: turn to the direction with most room, and go there."""
        turns = np.append(_TURNS_RAD, 0.0)
        room_m = clearance.free_run_m(pose[:2], pose[2] + turns, self.hull, _ESCAPE_SPACE_M)
        room_m[:-1][~self._can_turn(pose, clearance)] = -1.0
        off = float(turns[np.argmax(np.minimum(room_m, 1.0) - 0.1 * np.abs(turns))])
        if abs(off) > 2 * self.config.turn_rad:
            return 0.0, self._turn(off)
        self._escape_decisions -= 1
        return _ESCAPE_PART * self.robot.max_speed_mps, self._turn(off)
