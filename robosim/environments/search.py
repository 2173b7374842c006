"""Searches of one robot, one after the other: task, simulator, observations and rewards.

Environments of one robot and of many use this class, so they agree step for step. At difficulty d between 0 and 1 the
shortest drive is at most 2 m + 30 m d^2 longer than the shortest allowed one; at 1 it is not bounded. A curriculum
changes the difficulty by the share of arrivals among the last episodes.
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import trimesh
from gymnasium import spaces
from jaxtyping import Float, UInt8

from robosim.drawing.plan_view import BriefPicture
from robosim.environments import senses
from robosim.environments.config import SearchConfig, check_senses
from robosim.environments.rewards import NO_SNR_DB, WORTH, weighted
from robosim.environments.sources import Place, Source, TaskSpec, shared_place
from robosim.parts import LIDAR
from robosim.plans.floorplan import FloorPlan
from robosim.radio.measurement import Interpreter
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.task.coverage import Coverage
from robosim.task.tasks import ARRIVAL_M, Task, make_task
from robosim.world import ROBOT, World
from slam.actions import PUBLISHED, Action, Command, Velocity
from wireless.paths import LinkState

#: Bound of drives above the shortest allowed one [m]: at difficulty 0, and what difficulty 1 adds.
_NEAR_M, _FAR_M = 2.0, 30.0
#: Episodes between changes, the shares of arrivals that raise and lower difficulty, and the change.
_EPISODES, _RAISE, _LOWER, _STEP = 10, 0.7, 0.3, 0.05


def longest_drive_m(difficulty: float, min_path_m: float) -> float:
    """Upper bound of the shortest drive of a task [m]."""
    return math.inf if difficulty >= 1 else min_path_m + _NEAR_M + _FAR_M * difficulty**2


class Curriculum:
    """The difficulty of the next task."""

    def __init__(self, difficulty: float, *, moves: bool) -> None:
        """Start with a difficulty from 0 to 1, which adapts to success if it `moves`."""
        self.difficulty, self._moves = difficulty, moves
        self._recent: deque[bool] = deque(maxlen=_EPISODES)

    def record(self, arrived: bool) -> None:
        """Record whether the robot arrived in an episode."""
        if not self._moves:
            return
        self._recent.append(arrived)
        if len(self._recent) < _EPISODES:
            return
        share = sum(self._recent) / _EPISODES
        change = _STEP if share >= _RAISE else -_STEP if share <= _LOWER else 0.0
        if change:
            self.difficulty = min(max(self.difficulty + change, 0.0), 1.0)
            self._recent.clear()


#: Largest width in characters; a character stands for twice as many rows as columns.
_WIDTH = 72
_ARROWS = ">^<v"


def draw_text(plan: FloorPlan, pose: Float[np.ndarray, "3"], target: Float[np.ndarray, "2"]) -> str:
    """Lines from top to bottom: # wall, . floor, X target, and > ^ < v for the robot."""
    ny, nx = plan.shape
    step = max(1, -(-nx // _WIDTH))
    rows, columns = range(0, ny, 2 * step), range(0, nx, step)
    free = plan.free.astype(int)
    any_free = np.maximum.reduceat(np.maximum.reduceat(free, rows, axis=0), columns, axis=1) > 0
    every = np.minimum.reduceat(np.minimum.reduceat(free, rows, axis=0), columns, axis=1) > 0
    letters = np.where(every, ".", np.where(any_free, "#", " "))
    arrow = _ARROWS[round((pose[2] - plan.origin[2]) / (np.pi / 2)) % 4]
    for place, letter in ((target, "X"), (pose[:2], arrow)):
        column, row = np.floor(plan.to_cells(np.asarray(place, float))).astype(int)
        if 0 <= row < ny and 0 <= column < nx:
            letters[row // (2 * step), column // step] = letter
    return "\n".join("".join(row).rstrip() for row in letters[::-1]) + "\n"


#: Duration of velocity actions [s].
STEP_S = 0.5
#: Options of `reset`.
OPTIONS = ("start", "target", "plan", "difficulty")


class Outcome(NamedTuple):
    """Result of an action."""

    observation: dict[str, np.ndarray]
    reward: float
    arrived: bool
    info: dict[str, Any]


class Search:
    """The searches of a robot."""

    def __init__(self, source: Source, config: SearchConfig, simulator: SimulatorConfig) -> None:
        """Check the sensors; nothing is built before the first reset."""
        check_senses(config, simulator)
        self.config, self.simulator_config, self._source = config, simulator, source
        self._curriculum = Curriculum(config.difficulty, moves=config.curriculum)
        self._ended = True
        self._place: Place | None = None
        self._world: World
        self.task: Task
        """Start and target of the current search."""
        self.sensed: Observation
        """Measurements of the robot, in full; observations of the environment are made from it."""
        self._interpreter: Interpreter | None = None

    def reset(
        self, rng: np.random.Generator, options: Mapping[str, Any] | None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start a search.

        Args:
            rng: Source of random numbers until the next reset.
            options: `start` (x, y, yaw [rad]) and `target` (x, y) in the frame of the plan, `plan` (its number in the
                source), `difficulty` (0 to 1): each replaces a random choice.
        """
        options = dict(options or {})
        if unknown := set(options) - set(OPTIONS):
            raise ValueError(f"Unknown reset options {sorted(unknown)}. Known: {', '.join(OPTIONS)}.")
        if not self._ended:
            self._curriculum.record(False)
        spec = self._source.task_spec(self._plan_number(rng, options.get("plan")))
        self._enter(spec.plan)
        place = self.place
        difficulty = options.get("difficulty", self._curriculum.difficulty)
        self.task = self._draw_task(spec, rng, options, float(difficulty))
        self._travel = place.travel_m(self.task.target)
        self.sensed = self._world.reset({ROBOT: self.task}, rng)[ROBOT]
        pose = self.robot.pose
        self._picture: BriefPicture | None = None
        self._steps, self._ended = 0, False
        self._distance = place.reach.remaining_m(self._travel, pose[:2])
        self._coverage: Coverage | None = None
        if self.config.uses_coverage:
            image = self.simulator_config.image
            self._coverage = Coverage(
                place.plan, place.reach.floor, float(np.radians(image.hfov_deg)), image.ahead_m
            )
            self._look(pose)
        self._worth, self._snr = self._link()
        info = self._info(pose, collided=False, arrived=False)
        return self._observation(pose), {**info, "plan": place.plan.name, "difficulty": float(difficulty)}

    def step(self, action: Any) -> Outcome:
        """Do one action."""
        self.sensed = self._world.step({ROBOT: self.command_of(action)})[ROBOT]
        self._steps += 1
        pose, motion = self.robot.pose, self.robot.motion
        collided = motion is not None and motion.collided
        before = self._distance, self._seen_m2, self._worth, self._snr
        self._distance = self.place.reach.remaining_m(self._travel, pose[:2])
        if self._coverage is not None:
            self._look(pose)
        self._worth, self._snr = self._link()
        x, y = self.task.target
        arrived = bool(np.hypot(pose[0] - x, pose[1] - y) <= ARRIVAL_M)
        terms = {
            "arrival": float(arrived),
            "progress": before[0] - self._distance,
            "step": 1.0,
            "collision": float(collided),
            "coverage": self._seen_m2 - before[1],
            "link_state": self._worth - before[2],
            "snr": self._snr - before[3],
        }
        info = self._info(pose, collided, arrived)
        observation = self._observation(pose)
        info["rewards"] = weighted(self.config.rewards, terms, observation, info)
        if arrived:
            self._ended = True
            self._curriculum.record(True)
        return Outcome(observation, float(sum(info["rewards"].values())), arrived, info)

    def command_of(self, action: Any) -> Command:
        """Return the robot's command for an action of the environment."""
        if self.config.actions == "discrete":
            return discrete_actions(self.simulator_config)[int(action)]
        v, w = np.clip(np.asarray(action, float), -1, 1) * velocity_scale(self.simulator_config)
        return Velocity(float(v), float(w), STEP_S)

    def action_of(self, command: Command) -> Any:
        """Return the action of the environment for a robot's command; ValueError if it has none."""
        actions = discrete_actions(self.simulator_config)
        if self.config.actions == "discrete" and command in actions:
            return actions.index(command)
        if self.config.actions == "velocity":
            v, w = command[:2] if isinstance(command, Velocity) else (0.0, 0.0)
            return np.array([v, w]) / velocity_scale(self.simulator_config)
        raise ValueError(f"The environment has no action for the command {command!r}.")

    def picture(self) -> UInt8[np.ndarray, "height width 3"]:
        """The camera's view next to the plan with the robot's trajectory."""
        if self._picture is None:
            self._picture = BriefPicture(self.place.rings, self.task.target)
        text = f"{self.place.plan.name}, step {self._steps}: {self._distance:.2f} m to go"
        return self._picture.draw(self.sensed.rgb, self.sensed.depth, self.robot.pose, text)

    def text(self) -> str:
        """The plan as text, with robot and target."""
        return draw_text(self.place.plan, self.robot.pose, self.task.target)

    def close(self) -> None:
        """Free the camera."""
        if self._place is not None:
            self._world.close()

    @property
    def robot(self) -> Simulator:
        """Body and sensors of the robot in the current search."""
        return self._world.robots[ROBOT]

    @property
    def place(self) -> Place:
        """The building of the current search."""
        if self._place is None:
            raise RuntimeError("The search has not begun. Call reset first.")
        return self._place

    def _plan_number(self, rng: np.random.Generator, requested: Any) -> int:
        """Number of the plan in the source: the given one, or a random one."""
        count = len(self._source)
        if requested is None:
            # Nothing is drawn from a single plan, so that its random numbers do not depend on this.
            return int(rng.integers(count)) if count > 1 else 0
        if not 0 <= int(requested) < count:
            raise ValueError(f"Reset option plan is {requested}, expected a number of 0 to {count - 1}.")
        return int(requested)

    def _enter(self, plan: FloorPlan) -> None:
        """Put the robot into the building of a plan."""
        if self._place is not None and self._place.plan is plan:
            return
        self.close()
        self._place = shared_place(plan, self.simulator_config, uses_radio=self.config.uses_radio)
        self._world = self._place.world()
        radio = self.robot.radio
        if radio is not None:
            self._interpreter = Interpreter(radio, self._place.classifier(self.config.link_states))

    def _draw_task(
        self, spec: TaskSpec, rng: np.random.Generator, options: Mapping[str, Any], difficulty: float
    ) -> Task:
        """The task: from the options, from the source, and the rest at random."""
        start, target = (
            np.asarray(options[key], float) if key in options else default
            for key, default in (("start", spec.start), ("target", spec.target))
        )
        if target is None and self.config.targets is not None:
            places = self.place.targets(self.config.targets)
            target = places[rng.integers(len(places))]
        return make_task(
            self.place.reach,
            rng,
            start=start,
            target=target,
            min_path_m=self.config.min_path_m,
            max_path_m=longest_drive_m(difficulty, self.config.min_path_m),
        )

    @property
    def _seen_m2(self) -> float:
        return 0.0 if self._coverage is None else self._coverage.area_m2

    def _look(self, pose: Float[np.ndarray, "3"]) -> None:
        """Count the floor seen from a pose."""
        assert self._coverage is not None
        self._coverage.update(pose, self.robot.true_depth, self.robot.true_laser)

    def _link(self) -> tuple[float, float]:
        """Value of the true link state, if it is rewarded, and SNR of the strongest measured path [dB], or 0."""
        radio, paths = self.robot.radio, self.sensed.paths
        if radio is None or paths is None:
            return 0.0, 0.0
        snr = float(paths.snr_db[0, 0]) if paths.count[0] else NO_SNR_DB
        state_worth = WORTH[LinkState(radio.state)] if self.config.rewards.get("link_state") else 0.0
        return state_worth, snr

    def _observation(self, pose: Float[np.ndarray, "3"]) -> dict[str, np.ndarray]:
        view, config = self.sensed, self.config
        senses_by_key: dict[str, np.ndarray] = {}
        for sense in config.observe:
            if sense == "rgb":
                senses_by_key["rgb"] = view.rgb.copy()  # the array is reused
            elif sense == "depth":
                scaled = senses.depth_picture if config.depth == "picture" else senses.depth_metres
                senses_by_key["depth"] = scaled(view.depth)
            elif sense == "lidar" and view.laser is not None:
                senses_by_key["lidar"] = senses.ranges(view.laser)
            elif sense == "odometry":
                senses_by_key["odometry"] = senses.odometry(view)
            elif sense == "radio" and view.paths is not None and self._interpreter is not None:
                senses_by_key |= senses.paths(view.paths, self._interpreter.probability(view.paths))
            elif sense == "map" and self._coverage is not None:
                senses_by_key["map"] = senses.map_ahead(
                    self.place.plan, self._coverage.seen, pose, config.map_cells, config.map_cell_m
                )
            elif sense == "pose":
                senses_by_key["pose"] = senses.pose_since(self.task.start, pose)
        return senses_by_key

    def _info(self, pose: Float[np.ndarray, "3"], collided: bool, arrived: bool) -> dict[str, Any]:
        return {
            "pose": pose.copy(),
            "target": self.task.target.copy(),
            "distance_m": self._distance,
            "collided": collided,
            "arrived": arrived,
        }


def make_spaces(
    config: SearchConfig, simulator: SimulatorConfig
) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """The spaces of observations and of actions."""
    lidar = None
    if "lidar" in config.observe:
        # In any mesh: only the beams of the lidar are used.
        room = trimesh.creation.box((1.0, 1.0, 1.0))
        lidar = LIDAR.make(simulator.robot.lidar, [room], simulator.robot.laser, field="lidar")
    observed = senses.observation_space(config, simulator, lidar)
    actions: spaces.Space[Any] = (
        spaces.Box(-1.0, 1.0, (2,), np.float32)
        if config.actions == "velocity"
        else spaces.Discrete(len(discrete_actions(simulator)))
    )
    return observed, actions


def velocity_scale(simulator: SimulatorConfig) -> Float[np.ndarray, "2"]:
    """Full scale of velocity actions [m/s, rad/s]: the limits of the robot."""
    return np.array([simulator.robot.max_speed_mps, simulator.robot.turn_rate_radps])


def discrete_actions(simulator: SimulatorConfig) -> tuple[Action, ...]:
    """Return actions by number: the actions of the published system, and a wait where others move."""
    return (*PUBLISHED, Action.WAIT) if simulator.movers.any else PUBLISHED
