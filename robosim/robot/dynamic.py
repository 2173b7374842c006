"""The robot in its building, driven by its wheels.

A move follows a plan of poses over time. Each control period the wheels get the speeds that cover the
plan's next piece, ahead of time by the lag of their servos, and a correction of the pose error; what
wheels cannot do, moving sideways, the sliding floor does. A move ends where it was sent, or when at a
wall its time is up or nothing is gained any more; then the robot stands still.

The model's frame is `map` moved to the middle of the building, so that plans far from the origin lose no
accuracy. The same calls after a reset give the same poses, bit for bit.
Left out: encoders (feedback is from the true pose; what odometry gets wrong is in `odometry`).
"""

import logging
import math
from copy import copy

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.movers.movers import Movers
from robosim.robot.body import add_robot
from robosim.robot.collision import check_pose, solids
from robosim.robot.motion import (
    BLOCKED_M,
    BLOCKED_RAD,
    CommandQueue,
    Motion,
    PlannedMove,
    check_displacement,
    check_drive,
)
from robosim.robot.physics import PhysicsConfig, add_floor, add_movers, add_walls, new_spec
from robosim.robot.physics_engine import mujoco
from robosim.robot.robots import SERVO_LAG_S, RobotConfig
from slam.poses import wrap

__all__ = ["Motion", "PhysicsConfig", "World"]
logger = logging.getLogger(__name__)

#: A move has arrived when it is this close [m], [rad].
ARRIVED_M, ARRIVED_RAD = 1e-4, 1e-4
#: A robot at a wall gives up if it comes no closer to its goal by GAIN_M [m] within STALL_S [s].
GAIN_M, STALL_S = 5e-4, 0.1
#: Time to settle after the end of the plan [s], and to come to rest [s].
SETTLE_S, REST_S = 0.5, 0.2
#: Movers move after more than this time [s].
MOVERS_S = 0.03
#: What counts as rest [m/s], [rad/s].
REST_MPS, REST_RADPS = 1e-3, 1e-2
#: Feedback of pose errors [1/s].
FEEDBACK_PER_S = 15.0
#: Fastest slip to correct drift, and at walls [m/s]: wheels that slip fast while a wall holds the robot hop.
DRIFT_MPS, SCRAPE_MPS = 0.01, 0.05
#: Where bodies are that are not there [m].
BELOW_M = -100.0
#: Floor beyond the walls [m].
MARGIN_M = 5.0

_Pose = tuple[float, float, float]


class World:
    """A building with one robot, simulated by MuJoCo."""

    def __init__(
        self,
        building: Building,
        *,
        robot: RobotConfig | None = None,
        config: PhysicsConfig | None = None,
        movers: Movers | None = None,
    ) -> None:
        """Build the model; takes some tenths of a second on a large plan. `movers` move while the robot does."""
        self.building = building
        self.robot = robot or RobotConfig()
        self._turning_m = self.robot.hull.turning_m
        self._stall_slip_mps = self.robot.stall_slip_mps  # used thirty times a motion
        self.config = config or PhysicsConfig()
        xmin, ymin, xmax, ymax = building.free.bounds
        self._origin = np.array([(xmin + xmax) / 2, (ymin + ymax) / 2])
        half_m = np.array([xmax - xmin, ymax - ymin]) / 2 + MARGIN_M
        self._room = building.floor(self.robot.height_m)
        walls = solids(building, self.robot.height_m)
        spec = new_spec(self.config)
        add_floor(spec, half_m)
        add_walls(spec, walls, self.config, origin=self._origin, height_m=building.height_m)
        add_robot(spec, self.robot, self.config)
        self._movers = movers
        if movers is not None:
            add_movers(spec, movers.radius_m, movers.height_m, self.config)
        self.model = spec.compile()
        _let_walls_sleep(self.model)
        self._begin_data()
        self._height_m = 0.0
        self._place(half_m[0] - 1.0, half_m[1] - 1.0, 0.0)  # outside of all walls
        mujoco.mj_step(self.model, self.data, round(1.0 / self.config.timestep_s))
        self._height_m = float(self._body[2])  # where it rests on its wheels

    def clone(self) -> "World":
        """The same building with another robot in it, independent of the first."""
        other = copy(self)
        other._begin_data()
        return other

    def _begin_data(self) -> None:
        """Make the state of a robot, and views of it."""
        self.data = mujoco.MjData(self.model)
        robot_at, floor_at = self.model.joint("robot"), self.model.joint("floor_x")
        self._body = self.data.qpos[robot_at.qposadr[0] :][:7]  # views: position and quaternion,
        self._rates = self.data.qvel[robot_at.dofadr[0] :][:6]  # velocity and turn rates,
        self._floor = self.data.qpos[floor_at.qposadr[0] :][:2]  # and of the floor likewise
        self._slide = self.data.qvel[floor_at.dofadr[0] :][:2]
        self._touch = self.data.sensordata[self.model.sensor("touch").adr[0] :][:2]
        self._commands = CommandQueue(round(self.robot.latency_s / self.config.timestep_s))
        self._commanded = (0.0, 0.0)  # speed [m/s] and turn rate [rad/s] of the last command to the wheels
        self._steps, self._moved, self._deepest_m = 0, 0, 0.0  # steps of the robot, and of movers
        self._touched = self._at_wall = False  # during this motion, in its last control period
        self._warned = False  # that a move missed its goal

    def reset(self, pose: Float[np.ndarray, "3"]) -> None:
        """Put the robot at a pose in `map`, at rest; ValueError if the hull does not fit there."""
        check_pose(self._room, pose, self.robot.hull)
        self._place(pose[0] - self._origin[0], pose[1] - self._origin[1], pose[2])

    @property
    def pose(self) -> Float[np.ndarray, "3"]:
        """Pose x [m], y [m], yaw [rad] in `map`."""
        x, y, yaw = self._pose()
        return np.array([x + self._origin[0], y + self._origin[1], wrap(yaw)])

    def move(self, displacement: Float[np.ndarray, "3"]) -> Motion:
        """Go to a pose near by, and stop there or where walls stop the robot.

        The displacement is dx [m], dy [m], dyaw [rad] in [-pi, pi] in the robot's frame. What wheels cannot do is slip.
        The motion collided if a wall left the robot off its goal by more than `BLOCKED_M` or `BLOCKED_RAD`.
        """
        check_displacement(displacement)
        self._begin()
        self._halt()
        plan = PlannedMove(self._pose(), displacement, self.robot.profile(displacement))
        self._follow(plan)
        self._halt()
        off_m, off_rad = plan.left(self._pose())
        is_off = off_m > BLOCKED_M or off_rad > BLOCKED_RAD
        if is_off and not (self._touched or self._warned):
            self._warned = True
            logger.warning(
                "On open floor a move ended %.1f cm and %.1f degrees off its goal: the motors are too weak. "
                "Give the robot a wider track_m, a smaller hull, or a mass_kg that fits its rotors and wheels.",
                100 * off_m,
                math.degrees(off_rad),
            )
        return self._motion(self._touched and is_off)

    def drive(self, v_mps: float, w_radps: float, duration_s: float) -> Motion:
        """Drive with a speed and a turn rate, and roll on: the next `drive` continues at full speed.

        Speeds beyond the robot's limits are reduced, along the same arc, and change within the bounds of its wheels.
        Times are rounded to physics steps. The motion collided if the hull touched a wall.
        """
        check_drive(v_mps, w_radps, duration_s)
        self._begin()
        steps = round(duration_s / self.config.timestep_s)
        for speeds, duration in self._commands.during(self.robot.within_reach(v_mps, w_radps), steps):
            end = self._steps + round(duration)
            while self._steps < end:
                period = min(self.config.control_steps, end - self._steps)
                self._command(*self._towards(*speeds, period), self._pose()[2])
                self._advance(period)
        return self._motion(self._touched)

    def _place(self, x: float, y: float, yaw: float) -> None:
        """Reset the state with the robot at a pose in the model's frame."""
        mujoco.mj_resetData(self.model, self.data)
        self._body[:] = (x, y, self._height_m, math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
        self._commanded, self._at_wall = (0.0, 0.0), False
        self._commands.clear()
        self._place_movers()
        mujoco.mj_forward(self.model, self.data)

    def _place_movers(self) -> None:
        """Put the bodies of movers where they are now; below the floor if they are not there."""
        if self._movers is not None:
            self.data.mocap_pos[:, :2] = np.nan_to_num(self._movers.poses[:, :2] - self._origin)
            is_there = np.isfinite(self._movers.poses[:, 0])
            self.data.mocap_pos[:, 2] = np.where(is_there, 0.0, BELOW_M)

    def _pose(self) -> _Pose:
        """Pose in the model's frame."""
        x, y, _, qw, qx, qy, qz = self._body.tolist()
        return x, y, math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))

    def _follow(self, plan: PlannedMove) -> None:
        """Drive along a plan until it is done or a wall makes it useless."""
        end_s, begin = plan.profile.duration_s, self._steps
        best_m, best_s = math.inf, 0.0
        while True:
            time_s, pose = (self._steps - begin) * self.config.timestep_s, self._pose()
            off_m, off_rad = plan.left(pose)
            late, turned = time_s >= end_s, off_rad < ARRIVED_RAD
            if late and ((turned and (self._touched or off_m < ARRIVED_M)) or time_s >= end_s + SETTLE_S):
                return
            left_m = off_m + self._turning_m * off_rad
            if left_m < best_m - GAIN_M:
                best_m, best_s = left_m, time_s
            elif self._at_wall and time_s - best_s > STALL_S:
                return
            # A wall decides how far the robot gets: pushing harder would only make it slide on.
            self._steer(plan, time_s, pose, closing=not (self._at_wall or (late and self._touched)))
            self._advance(self.config.control_steps)

    def _steer(self, plan: PlannedMove, time_s: float, pose: _Pose, *, closing: bool) -> None:
        """Set speeds of wheels and floor for the next control period; `closing` corrects the position too."""
        period_s = self.config.control_steps * self.config.timestep_s
        lead_s = time_s + SERVO_LAG_S + self.config.timestep_s / 2
        now, ahead, then = plan.at(time_s), plan.at(lead_s), plan.at(lead_s + period_s)
        vx, vy, w = (
            (then[0] - ahead[0]) / period_s,
            (then[1] - ahead[1]) / period_s,
            (then[2] - ahead[2]) / period_s,
        )
        gain = FEEDBACK_PER_S if closing else 0.0
        ex, ey = gain * (now[0] - pose[0]), gain * (now[1] - pose[1])
        c, s = math.cos(pose[2]), math.sin(pose[2])
        v, w = c * (vx + ex) + s * (vy + ey), w + FEEDBACK_PER_S * wrap(now[2] - pose[2])
        slip = c * vy - s * vx
        if self._at_wall:
            slip = max(-SCRAPE_MPS, min(SCRAPE_MPS, slip))
        else:
            slip += max(-DRIFT_MPS, min(DRIFT_MPS, c * ey - s * ex))
        self._command(v, w, pose[2], slip)

    def _command(self, v_mps: float, w_radps: float, yaw: float, sideways_mps: float = 0.0) -> None:
        """Set the speeds of the wheels, and slide the floor to the left of the robot at a yaw.

        Where the robot pushes against a wall, half of the motors' torque is left for turning, and the tyres
        slip sideways: their grip would hold the robot, where real robots scrape along.
        """
        robot = self.robot
        c, s = math.cos(yaw), math.sin(yaw)
        vx, vy, _, _, _, w_now = self._rates.tolist()
        v_now, half_track = c * vx + s * vy, robot.track_m / 2
        if self._at_wall:  # the floor goes along at the robot's own pace, and never speeds it up
            aside = c * vy - s * vx
            pace = max(abs(aside), abs(sideways_mps))
            sideways_mps = max(-pace, min(pace, aside + sideways_mps))
        top = robot.max_speed_mps
        rim = max(-top, min(top, w_radps * half_track))
        stall_mps = self._stall_slip_mps
        spare = max(stall_mps - abs(rim - w_now * half_track), stall_mps / 2)
        v = max(-top + abs(rim), min(0.0, v_now) - spare, min(top - abs(rim), max(0.0, v_now) + spare, v_mps))
        self._commanded = v, rim / half_track
        self.data.ctrl[0] = (v - rim) / robot.wheel_radius_m
        self.data.ctrl[1] = (v + rim) / robot.wheel_radius_m
        self._slide[0], self._slide[1] = -sideways_mps * s, sideways_mps * c

    def _towards(self, v_mps: float, w_radps: float, steps: int) -> tuple[float, float]:
        """Speeds towards target speeds, as far as a wheel's acceleration allows in some physics steps."""
        v, w = self._commanded
        dv, dw = v_mps - v, w_radps - w
        change = abs(dv) + abs(dw) * self.robot.track_m / 2
        max_change = self.robot.max_accel_mps2 * steps * self.config.timestep_s
        fraction = min(1.0, max_change / change) if change > 0 else 1.0
        return v + fraction * dv, w + fraction * dw

    def _halt(self) -> None:
        """Stop the wheels, and wait for the robot to come to rest."""
        self._commands.clear()
        while self._commanded != (0.0, 0.0):
            self._command(*self._towards(0.0, 0.0, self.config.control_steps), self._pose()[2])
            self._advance(self.config.control_steps)
        self._slide[:] = 0.0
        last = self._steps + round(REST_S / self.config.timestep_s)
        while self._steps < last:
            vx, vy, _, _, _, w = self._rates.tolist()
            if math.hypot(vx, vy) < REST_MPS and abs(w) < REST_RADPS:
                return
            self._advance(1)

    def _begin(self) -> None:
        """Start counting for a new motion."""
        self._steps, self._moved, self._deepest_m, self._touched = 0, 0, 0.0, False
        # The floor looks the same everywhere; back to the middle, so that it never runs out.
        self._floor[:] = 0.0
        self._place_movers()

    def _advance(self, steps: int) -> None:
        """Let physics go on, and watch the hull's contacts at each step."""
        model, data, touch = self.model, self.data, self._touch
        self._at_wall = False
        for _ in range(steps):
            mujoco.mj_step(model, data)
            if touch[0] > 0:
                self._at_wall = True
                self._deepest_m = min(self._deepest_m, float(touch[1]))
        self._touched |= self._at_wall
        self._steps += steps
        if (self._steps - self._moved) * self.config.timestep_s > MOVERS_S:
            self._move_movers()

    def _move_movers(self) -> None:
        """Let movers go on to the present."""
        if self._movers is not None:
            self._movers.advance((self._steps - self._moved) * self.config.timestep_s, self.pose)
            self._place_movers()
        self._moved = self._steps

    def _motion(self, collided: bool) -> Motion:
        self._move_movers()
        return Motion(
            pose=self.pose,
            collided=collided,
            duration_s=self._steps * self.config.timestep_s,
            penetration_m=max(0.0, -self._deepest_m),
            physics_steps=self._steps,
        )


def _let_walls_sleep(model: mujoco.MjModel) -> None:
    """Compute positions of walls once, rather than at each step: motions are bit-identical.

    What moves is always awake.
    """
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    model.tree_sleep_policy[:] = int(mujoco.mjtSleepPolicy.mjSLEEP_NEVER)
