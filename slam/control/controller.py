"""Controller: evaluate every turn followed by a straight run, and begin the best.

A robot that turns in steps of 10 degrees and drives in steps of a quarter metre follows a path only roughly; what
matters is the number of decisions. For each heading and each number of steps without contact of the hull, the cost in
decisions is

    |turns| + steps + (cost of the path from there) / 0.25 m + (turns needed there to continue)

and the first action of the cheapest is returned. Runs that pass closer to obstacles cost extra. A turn once begun gets
cheaper at each decision, and turning straight back costs extra. If the swing of the hull still changes the best heading
again and again, one heading is completed. Before turns that would push the hull, the controller looks for an easier
place to make them (`slam.control.manoeuvre`).

Each bump makes the same heading from the same place more expensive. A robot that does not leave a place for long drives
in the direction with most room before it plans again.
Left out: dynamics of the base.
"""

import math
from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from robosim.support.checks import Range, checked
from slam.actions import FORWARD_M, MOVES, STEPS, TURN_RAD, Action, Command
from slam.control.action_search import find_actions, is_clear
from slam.control.manoeuvre import PARTS, SWING_M, Manoeuvre, easier, first_of, pushes_of, swung, turns_round
from slam.planning.clearance import Clearance
from slam.planning.planner import Plan
from slam.poses import Pose, between, wrap
from slam.robot import Robot


@dataclass(frozen=True, kw_only=True)
@checked
class ControlConfig:
    """How actions are chosen."""

    slacks_m: Annotated[tuple[float, ...], Range(-1, 1, "m")] = (-0.02, 0.01, 0.03, 0.06, 0.1)
    """Space that a run leaves around the hull [m], in rising order ..."""
    slack_prices: Annotated[tuple[float, ...], Range(0, 1e6, "decisions")] = (20.0, 12.0, 6.0, 2.0, 0.0)
    """... and the extra cost of such a run [decisions], for the risk of a bump."""
    reach_steps: Annotated[int, Range(1, 1000, "steps")] = 10
    """Longest run looked at [steps forward]."""
    forward_m: Annotated[float, Range(0.001, 10, "m")] = FORWARD_M
    """Nominal distance of a step forward [m]; the actual one is learned."""
    turn_rad: Annotated[float, Range(1e-4, math.pi, "rad")] = TURN_RAD
    """Nominal angle of a turn [rad]."""
    push_price: Annotated[float, Range(0, 1e6, "decisions")] = 2.0
    """Additional cost of each turn that pushes the hull against an obstacle [decisions]."""
    reverses: bool = True
    """Whether the robot may step back to where it can turn without pushing, or forward only."""
    arrived_m: Annotated[float, Range(0, 10, "m")] = 0.15
    """Nearer to the end of the path the robot turns to the goal and looks around [m]."""
    stuck_decisions: Annotated[int, Range(1, 1_000_000, "decisions")] = 45
    """Decisions without getting away by `stuck_radius_m` after which the robot drives away [decisions]."""
    stuck_radius_m: Annotated[float, Range(0, 100, "m")] = 0.35
    """See above [m]."""
    turn_rate_radps: Annotated[float, Range(0.001, 20, "rad/s")] = 1.0
    """Greatest turn rate that `slam.control.velocity` commands, if the robot allows it [rad/s]."""
    control_s: Annotated[float, Range(0.01, 10, "s")] = 0.5
    """Time between commands of speeds [s]."""

    def __post_init__(self) -> None:
        if len(self.slacks_m) != len(self.slack_prices) or list(self.slacks_m) != sorted(self.slacks_m):
            raise ValueError(
                f"slacks_m is {self.slacks_m} and slack_prices {self.slack_prices}, expected as many prices as "
                "slacks, the slacks in rising order."
            )


#: Recent decisions examined for wavering, and changes of side among their turns that are too many.
HISTORY, MOST_REVERSALS = 16, 4

#: Actions of a search that are done before the next search.
_COURSE = 6

#: Number of actions in the mean displacement of a calibration, and least number for a reliable mean.
_CALIBRATED, _SURE = 50, 5


@runtime_checkable
class LocalPolicy(Protocol):
    """Chooses actions or velocities."""

    def act(self, pose: Pose, plan: Plan) -> Command:
        """The next action at an estimated pose x [m], y [m], yaw [rad], along a plan."""

    def withdraw(self) -> None:
        """Learn nothing from the last action: another one was done in its place. By default nothing is to be done."""
        return

    def reset(self) -> None:
        """Forget the last episode; by default nothing is to be done."""
        return


class Controller:
    """Chooses actions; remembers bumps and lack of progress, and learns what its actions do."""

    def __init__(self, robot: Robot = Robot(), config: ControlConfig = ControlConfig()):
        self.robot, self.config, self.hull = robot, config, robot.hull
        half = math.ceil(math.pi / config.turn_rad)
        # No turn first, then pairs: of equal prices the smaller turn wins.
        self._turns = np.array(sorted(range(-half, half + 1), key=lambda k: (abs(k), k)))
        self.reset()

    def reset(self) -> None:
        """Forget the past."""
        turn = self.config.turn_rad
        ahead = self.config.forward_m
        self.motion = np.array([[ahead, 0, 0], [0, 0, turn], [0, 0, -turn], [-ahead, 0, 0]], float)
        self._motions = np.ones(len(MOVES))
        for action, known in zip(MOVES, self.robot.motions, strict=True):
            if known is not None and self._usual(action, np.array(known)):
                self.motion[action], self._motions[action] = known, _CALIBRATED
        self._last: Action | None = None
        self._last_pose: Float[np.ndarray, 3] | None = None
        self._bumps: deque[tuple[float, float, float, float]] = deque(maxlen=12)
        self._trail: deque[tuple[float, float]] = deque(maxlen=self.config.stuck_decisions)
        self._escape_steps = 0
        self._looking: Action | None = None
        self._end: Float[np.ndarray, 2] = np.zeros(2)  # of the path at which it looks around,
        self._aside_m = 0.0  # and how far looking around may lead from there
        self._recent: deque[Action] = deque(maxlen=HISTORY)
        self._course: deque[Action] = deque()  # of a polygon, and where it leads
        self._course_goal: Float[np.ndarray, 2] = np.zeros(2)
        self._committed: deque[Action] = deque()

    def act(self, pose: Pose, plan: Plan) -> Action:
        """The next action.

        Args:
            pose: Estimated x [m], y [m], yaw [rad].
            plan: What the planner returned for this pose.
        """
        self._watch(pose, plan.clearance)
        if np.hypot(*(plan.path[-1] - self._end)) > self.config.arrived_m:
            self._end = plan.path[-1]
            self._looking, self._aside_m = None, 0.0
        if self._escape_steps:
            action = self._escape(pose, plan)
        elif self._committed:
            action = self._committed.popleft()
        elif plan.length_m < self.config.arrived_m + self._aside_m:
            action = self._face(pose, plan)
        else:
            self._looking, self._aside_m = None, 0.0
            action = self._best(pose, plan)
        self._last, self._last_pose = action, pose.copy()
        self._recent.append(action)
        return action

    def withdraw(self) -> None:
        """The last action was not done, as when the robot waits instead: nothing is learned from it."""
        self._last = None
        self._committed.clear()
        self._course.clear()

    def _watch(self, pose: Pose, clearance: Clearance) -> None:
        """Note bumps, and whether the robot gets anywhere."""
        self._trail.append((float(pose[0]), float(pose[1])))
        if self._last is not None and self._last_pose is not None:
            self._learn(self._last, self._last_pose, pose, clearance)
        trail = np.array(self._trail)
        full = len(trail) == self.config.stuck_decisions
        if full and np.hypot(*(trail - trail[-1]).T).max() < self.config.stuck_radius_m:
            self._escape_steps = 4
            self._trail.clear()
            self._committed.clear()

    def _learn(self, action: Action, before: Pose, after: Pose, clearance: Clearance) -> None:
        """Update the mean displacement of an action, unless it was stopped."""
        displacement = between(before, after)
        swing_m = math.hypot(*self.motion[action][:2])
        ahead_m = float(displacement[:2] @ self.motion[action][:2]) / max(swing_m, 1e-9)
        # A turn swings the hull aside; an obstacle stops the swing, though not the turn.
        steps = action in STEPS
        known = steps or (swing_m > SWING_M and self._motions[action] >= _SURE)
        if known and ahead_m < (0.6 if steps else 0.4) * swing_m:
            space = float(clearance.space(self.hull, after[:2], float(after[2])))
            touch = float(np.clip(space + 0.002, 0, 0.025))
            heading = float(before[2]) + math.atan2(self.motion[action][1], self.motion[action][0])
            self._bumps.append((float(after[0]), float(after[1]), heading, touch))
            if steps:
                self._committed.clear()  # they continue from another place
        elif self._usual(action, displacement):
            self._motions[action] = min(self._motions[action] + 1, _CALIBRATED)
            self.motion[action] += (displacement - self.motion[action]) / self._motions[action]

    def _usual(self, action: Action, displacement: Pose) -> bool:
        """Whether a displacement is about what the action is meant to do."""
        nominal = self.config.forward_m if action in STEPS else self.config.turn_rad
        done = (displacement[0] if action in STEPS else displacement[2]) * (
            1 if action in (Action.FORWARD, Action.LEFT) else -1
        )
        return bool(
            0.7 < done / nominal < 1.3 and math.hypot(*displacement[:2]) < 1.5 * self.config.forward_m
        )

    def _best(self, pose: Pose, plan: Plan) -> Action:
        """First action of the cheapest turn and run; of a polygon, of a search."""
        config = self.config
        if self.hull.outline_m and (course := self._searched(pose, plan)):
            return course.popleft()
        turned = self._turned(pose)
        stride = math.hypot(*self.motion[Action.FORWARD, :2])
        headings = turned[:, 2] + math.atan2(self.motion[Action.FORWARD, 1], self.motion[Action.FORWARD, 0])
        directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
        distance = stride * np.arange(config.reach_steps * PARTS + 1) / PARTS
        points = turned[:, None, :2] + directions[:, None, :] * distance[None, :, None]
        ends = points[:, PARTS::PARTS]
        cost_m, downhill = plan.field.at_and_downhill(ends)
        left = cost_m / config.forward_m
        off = np.abs(wrap(downhill - headings[:, None]))
        # The turn that will be needed there fades away at the goal. It is not weighted down: a turn put off must not
        # look cheaper than one made now.
        price = np.arange(1, config.reach_steps + 1) + left
        price += off / config.turn_rad * np.minimum(left, 1.0)
        yaws = np.broadcast_to(turned[:, 2:], points.shape[:2])
        price += self._tightness(points, yaws, distance, plan.clearance)
        price += (np.abs(self._turns) + self._reluctance(pose, headings))[:, None]
        price += self._pushing(pose, plan.clearance)[:, None]
        cheapest = price.min(axis=1)
        k = int(np.argmin(cheapest))
        if not np.isfinite(cheapest[k]):
            return self._towards(pose, plan)
        turns = int(self._turns[k])
        if self._wavers():
            # Each turn swings the hull a little, and changes the best heading: complete this one.
            self._committed.extend([first_of(turns)] * abs(turns) + [Action.FORWARD])
            self._recent.clear()
            return self._committed.popleft()
        return self._turning(pose, turns, plan.clearance)

    def _searched(self, pose: Pose, plan: Plan) -> deque[Action]:
        """Actions that bring a polygon forward: those found before, as long as they are clear, or new ones."""
        same_goal = np.hypot(*(plan.asked_xy - self._course_goal)) < self.config.arrived_m
        if not (
            same_goal
            and self._course
            and is_clear(pose, list(self._course), self.motion, self.hull, plan.clearance)
        ):
            actions = find_actions(
                pose, self.motion, self.hull, plan.clearance, plan.field, forward_m=self.config.forward_m
            )
            self._course, self._course_goal = deque(actions[:_COURSE]), plan.asked_xy
        return self._course

    def _turning(self, pose: Pose, turns: int, clearance: Clearance) -> Action:
        """First of some turns, or of what goes before them where that spares the hull pushes."""
        before, rest = self._manoeuvre(pose, turns, clearance)
        # Complete it: after half of it the turn may still push, and forward may look better again.
        self._committed.extend(before + [first_of(rest)] * abs(rest) if before else [])
        return self._committed.popleft() if before else first_of(turns)

    def _wavers(self) -> bool:
        """Whether recent turns change sides too often."""
        turns = [action for action in self._recent if action not in STEPS]
        return sum(a is not b for a, b in pairwise(turns)) >= MOST_REVERSALS

    def _turned(self, pose: Pose) -> Float[np.ndarray, "k 3"]:
        """Poses after each number of turns: a base that does not turn about its centre swings around."""
        poses = np.empty((len(self._turns), 3))
        n = np.abs(self._turns)
        for action, side in ((Action.LEFT, self._turns > 0), (Action.RIGHT, self._turns <= 0)):
            poses[side] = swung(pose, self.motion[action], int(n.max()))[n[side]]
        return poses

    def _manoeuvre(self, pose: Pose, turns: int, clearance: Clearance, *, around: bool = False) -> Manoeuvre:
        """Return the manoeuvre before turns, see `slam.control.manoeuvre`."""
        config = self.config
        return easier(
            pose,
            turns,
            clearance,
            self.motion,
            hull=self.hull,
            push_price=config.push_price,
            steps=STEPS if config.reverses else (Action.FORWARD,),
            around=around,
        )

    def _pushes(self, pose: Pose, turns: int, clearance: Clearance) -> Int[np.ndarray, " n"]:
        """How many of 0, 1, ... turns, positive to the left, push the hull against something."""
        return pushes_of(pose, turns, clearance, self.motion, self.hull)

    def _tightness(
        self,
        points: Float[np.ndarray, "k n 2"],
        headings: Float[np.ndarray, "k n"],
        distance: Float[np.ndarray, " n"],
        clearance: Clearance,
    ) -> Float[np.ndarray, "k m"]:
        """Price of passing close to obstacles [decisions]; inf where the hull would meet one."""
        config = self.config
        # Where the hull touched although the map left space, the map is off by that much.
        touched = [t for x, y, _, t in self._bumps if np.hypot(*(points[0, 0] - (x, y))) < 0.3]
        space = clearance.space(self.hull, points, headings) - max(touched, default=0.0)
        least = config.slacks_m[0]
        # Where the hull is already closer than it should be, it may still move away, or turn.
        here = space[0, 0]
        space = np.where(space >= here + 0.3 * distance - 1e-3, np.maximum(space, least), space)
        # Turning swings the hull through all the places between here and the last turn.
        for side in (self._turns >= 0, self._turns <= 0):
            space[side, 0] = np.minimum.accumulate(space[side, 0])
        space = np.minimum.accumulate(space, axis=1)[:, PARTS::PARTS]
        price = np.interp(space, config.slacks_m, config.slack_prices)
        price[space < least] = np.inf
        return price

    def _pushing(self, pose: Pose, clearance: Clearance) -> Float[np.ndarray, " k"]:
        """Extra cost of each heading for turns that push the hull against something [decisions]."""
        extra = np.zeros(len(self._turns))
        n = np.abs(self._turns)
        for sign in (1, -1):
            side = np.sign(self._turns) == sign
            extra[side] = self._pushes(pose, sign * int(n.max()), clearance)[n[side]]
        return self.config.push_price * extra

    def _reluctance(self, pose: Pose, headings: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        """Extra cost of each heading for past bumps, and for reversing the last turn [decisions]."""
        extra = np.zeros(len(headings))
        for x, y, yaw, _ in self._bumps:
            if math.hypot(pose[0] - x, pose[1] - y) < 0.15:
                off = np.abs(wrap(headings - yaw))
                extra += 6.0 * np.maximum(0, 1 - off / (2.5 * self.config.turn_rad))
        if self._last is Action.LEFT:
            extra[self._turns < 0] += 3.0
        elif self._last is Action.RIGHT:
            extra[self._turns > 0] += 3.0
        return extra

    def _towards(self, pose: Pose, plan: Plan) -> Action:
        """Turn towards the short-term goal: the fallback if no run is clear."""
        dx, dy = plan.short_term_goal - pose[:2]
        off = wrap(math.atan2(dy, dx) - pose[2])
        return self._turning(pose, round(off / self.config.turn_rad), plan.clearance)

    def _face(self, pose: Pose, plan: Plan) -> Action:
        """At the end of the path: turn to the requested goal, then look around."""
        dx, dy = plan.asked_xy - pose[:2]
        turns = round(wrap(math.atan2(dy, dx) - pose[2]) / self.config.turn_rad)
        if turns == 0 or math.hypot(dx, dy) < 0.1 or self._looking is not None:
            return self._look_around(pose, plan)
        return self._first_aside(pose, turns, plan.clearance)

    def _look_around(self, pose: Pose, plan: Plan) -> Action:
        """Turn once round: to the left, or to the right if that pushes the hull less; out of a niche first."""
        once = turns_round(self.config.turn_rad)
        if self._looking is None:
            left, right = (self._pushes(pose, turns, plan.clearance)[-1] for turns in (once, -once))
            self._looking = Action.LEFT if left <= right else Action.RIGHT
        elif not self._pushes(pose, 1 if self._looking is Action.LEFT else -1, plan.clearance)[-1]:
            return self._looking
        turns = once if self._looking is Action.LEFT else -once
        return self._first_aside(pose, turns, plan.clearance, around=True)

    def _first_aside(self, pose: Pose, turns: int, clearance: Clearance, *, around: bool = False) -> Action:
        """First of some turns at the end of the path, or of a manoeuvre to a place nearby where they push less."""
        before, _ = self._manoeuvre(pose, turns, clearance, around=around)
        circle = swung(pose, self.motion[first_of(turns)], abs(turns))[:, :2]
        steps_m = self.config.forward_m * sum(action in STEPS for action in before)
        self._aside_m = steps_m + max(self._aside_m, float(np.hypot(*(circle - pose[:2]).T).max()))
        self._committed.extend(before)
        return self._committed.popleft() if before else first_of(turns)

    def _escape(self, pose: Pose, plan: Plan) -> Action:
        """Drive away: turn to the direction with most room, and go there."""
        headings = self._turned(pose)[:, 2]
        room = plan.clearance.free_run_m(pose[:2], headings, self.hull)
        decisions = np.abs(self._turns) + self._pushing(pose, plan.clearance)
        score = np.minimum(room, 1.0) - 0.02 * decisions - 0.1 * self._reluctance(pose, headings)
        action = first_of(int(self._turns[int(np.argmax(score))]))
        if action is Action.FORWARD:
            self._escape_steps -= 1
        return action
