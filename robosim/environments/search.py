"""Searches, one after the other: task, world, and observations and rewards of each robot.

Environments of one robot, of many and of teams use these classes, so they agree step for step. At difficulty d between
0 and 1 the shortest drive is at most 2 m + 30 m d^2 longer than the shortest allowed one; at 1 it is not bounded. A
curriculum changes the difficulty by the share of arrivals among the last episodes.
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
from robosim.entrants import tasks_near
from robosim.environments import senses
from robosim.environments.config import SearchConfig, check_senses
from robosim.environments.rewards import NO_SNR_DB, WORTH, weighted
from robosim.environments.sources import Place, Source, TaskSpec, shared_place
from robosim.parts import LIDAR
from robosim.plans.floorplan import FloorPlan
from robosim.radio.measurement import Interpreter
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.support.checks import check_number, shown
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


class Searches:
    """Searches of the robots of a world, which have the same target."""

    def __init__(
        self,
        source: Source,
        config: SearchConfig,
        simulator: SimulatorConfig,
        names: tuple[str, ...] = (ROBOT,),
    ) -> None:
        """Check the sensors; nothing is built before the first reset."""
        check_senses(config, simulator)
        self._config, self._simulator_config, self._source = config, simulator, source
        self._curriculum = Curriculum(config.difficulty, moves=config.curriculum)
        self._ended = True
        self._place: Place | None = None
        self._world: World
        self.robots = {name: Search(config, simulator, len(names)) for name in names}
        """The current search of each robot."""

    def reset(
        self, rng: np.random.Generator, options: Mapping[str, Any] | None
    ) -> dict[str, tuple[dict[str, np.ndarray], dict[str, Any]]]:
        """Start a search.

        Args:
            rng: Source of random numbers until the next reset.
            options: `start` (x, y, yaw [rad]) of the first robot and `target` (x, y) in the frame of the plan, `plan`
                (its number in the source), `difficulty` (0 to 1): each replaces a random choice.

        Raises:
            ValueError: If an option is unknown or out of bounds.
            MapError: If the plan has no such task, or no room for all robots at the start.
        """
        options = dict(options or {})
        if unknown := set(options) - set(OPTIONS):
            raise ValueError(f"Unknown reset options {sorted(unknown)}. Known: {', '.join(OPTIONS)}.")
        if not self._ended:
            self._curriculum.record(False)
            self._ended = True
        spec = self._source.task_spec(self._plan_number(rng, options.get("plan")))
        place = self._enter(spec.plan)
        difficulty = options.get("difficulty", self._curriculum.difficulty)
        check_number("difficulty", difficulty, 0, 1)
        first = self._draw_task(place, spec, rng, options, difficulty)
        tasks = dict(zip(self.robots, tasks_near(first, [place.reach] * len(self.robots)), strict=True))
        sensed = self._world.reset(tasks, rng)
        self._ended = False
        begun = {name: search.begin(tasks[name], sensed[name]) for name, search in self.robots.items()}
        drawn = {"plan": place.plan.name, "difficulty": difficulty}
        return {name: (observation, {**info, **drawn}) for name, (observation, info) in begun.items()}

    def commands_of(self, actions: Mapping[str, Any]) -> dict[str, Command]:
        """Return the commands of robots for their actions; ValueError if one is none."""
        return {name: self.robots[name].command_of(action) for name, action in actions.items()}

    def step(self, commands: Mapping[str, Command]) -> dict[str, Outcome]:
        """Do one command with each of these robots, one after the other; the others stand still."""
        if self._ended:
            raise RuntimeError("The search has not begun, or it has ended. Call reset first.")
        sensed = self._world.step(commands)
        outcomes = {name: self.robots[name].after(observation) for name, observation in sensed.items()}
        if any(outcome.arrived for outcome in outcomes.values()):
            self._ended = True
            self._curriculum.record(True)
        return outcomes

    def close(self) -> None:
        """Free the cameras."""
        if self._place is not None:
            self._world.close()

    def _plan_number(self, rng: np.random.Generator, requested: Any) -> int:
        """Number of the plan in the source: the given one, or a random one."""
        count = len(self._source)
        if requested is None:
            # Nothing is drawn from a single plan, so that its random numbers do not depend on this.
            return int(rng.integers(count)) if count > 1 else 0
        check_number("Reset option plan", requested, 0, count - 1, whole=True)
        return int(requested)

    def _enter(self, plan: FloorPlan) -> Place:
        """Put the robots into the building of a plan."""
        if self._place is None or self._place.plan is not plan:
            self.close()
            uses_radio = self._config.uses_radio
            self._place = shared_place(plan, self._simulator_config, uses_radio=uses_radio)
            self._world = self._place.world(tuple(self.robots))
            for name, search in self.robots.items():
                search.enter(self._place, self._world.robots[name])
        return self._place

    def _draw_task(
        self,
        place: Place,
        spec: TaskSpec,
        rng: np.random.Generator,
        options: Mapping[str, Any],
        difficulty: float,
    ) -> Task:
        """The task of the first robot: from the options, from the source, and the rest at random."""
        start, target = (
            np.asarray(options[key], float) if key in options else default
            for key, default in (("start", spec.start), ("target", spec.target))
        )
        if target is None and self._config.targets is not None:
            places = place.targets(self._config.targets)
            target = places[rng.integers(len(places))]
        return make_task(
            place.reach,
            rng,
            start=start,
            target=target,
            min_path_m=self._config.min_path_m,
            max_path_m=longest_drive_m(difficulty, self._config.min_path_m),
        )


class Search:
    """The search of one robot: what it observes, does, and is rewarded for."""

    def __init__(self, config: SearchConfig, simulator: SimulatorConfig, robots: int = 1) -> None:
        """Make the search of one of several robots in a world; it has no place yet."""
        self.config, self.simulator_config = config, simulator
        self._actions = discrete_actions(simulator, robots)
        self._place: Place | None = None
        self.robot: Simulator
        """Body and sensors of the robot in the current search."""
        self.task: Task
        """Start and target of the current search."""
        self.sensed: Observation
        """Measurements of the robot, in full; observations of the environment are made from it."""
        self._interpreter: Interpreter | None = None

    def enter(self, place: Place, robot: Simulator) -> None:
        """Search in another building from now on."""
        self._place, self.robot = place, robot
        if robot.radio is not None:
            self._interpreter = Interpreter(robot.radio, place.classifier(self.config.link_states))

    def begin(self, task: Task, sensed: Observation) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin a task; returns observation and info for what the robot senses first."""
        self.task, self.sensed = task, sensed
        place, pose = self.place, self.robot.pose
        self._travel = place.travel_m(task.target)
        self._picture: BriefPicture | None = None
        self._steps = 0
        self._distance = place.reach.remaining_m(self._travel, pose[:2])
        self._coverage: Coverage | None = None
        if self.config.uses_coverage:
            image = self.simulator_config.image
            self._coverage = Coverage(
                place.plan, place.reach.floor, float(np.radians(image.hfov_deg)), image.ahead_m
            )
            self._look(pose)
        self._worth, self._snr = self._link()
        return self._observation(pose), self._info(pose, collided=False, arrived=False)

    def after(self, sensed: Observation) -> Outcome:
        """The outcome of an action, after which the robot senses this."""
        self.sensed = sensed
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
        return Outcome(observation, float(sum(info["rewards"].values())), arrived, info)

    def command_of(self, action: Any) -> Command:
        """Return the robot's command for an action of the environment; ValueError if it is none."""
        numbers = np.asarray(action).tolist()
        if self.config.actions == "discrete":
            if numbers not in range(len(self._actions)):
                raise ValueError(
                    f"an action is {shown(numbers)}, expected a number of 0 to {len(self._actions) - 1}."
                )
            return self._actions[int(numbers)]
        values = np.asarray(action)
        if values.shape != (2,) or values.dtype.kind not in "fiu" or np.isnan(values).any():
            raise ValueError(f"an action is {shown(numbers)}, expected two numbers from -1 to 1.")
        v, w = np.clip(values, -1, 1) * velocity_scale(self.simulator_config)
        return Velocity(float(v), float(w), STEP_S)

    def action_of(self, command: Command) -> Any:
        """Return the action of the environment for a robot's command; ValueError if it has none."""
        if self.config.actions == "discrete" and command in self._actions:
            return self._actions.index(command)
        if self.config.actions == "velocity":
            v, w = command[:2] if isinstance(command, Velocity) else (0.0, 0.0)
            return np.array([v, w]) / velocity_scale(self.simulator_config)
        raise ValueError(f"The environment has no action for the command {command!r}.")

    def picture(self) -> UInt8[np.ndarray, "height width 3"]:
        """The camera's view next to the plan with the robot's trajectory."""
        rings = self.place.rings
        if self._picture is None:
            self._picture = BriefPicture(rings, self.task.target)
        text = f"{self.place.plan.name}, step {self._steps}: {self._distance:.2f} m to go"
        return self._picture.draw(self.sensed.rgb, self.sensed.depth, self.robot.pose, text)

    def text(self) -> str:
        """The plan as text, with robot and target."""
        return draw_text(self.place.plan, self.robot.pose, self.task.target)

    @property
    def place(self) -> Place:
        """The building of the current search."""
        if self._place is None:
            raise RuntimeError("The search has not begun. Call reset first.")
        return self._place

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
                bound = senses.odometry_bound(self.simulator_config)
                senses_by_key["odometry"] = senses.odometry(view, bound)
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
    config: SearchConfig, simulator: SimulatorConfig, robots: int = 1
) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """The spaces of observations and of actions of one of several robots in a world."""
    lidar = None
    if "lidar" in config.observe:
        # In any mesh: only the beams of the lidar are used.
        room = trimesh.creation.box((1.0, 1.0, 1.0))
        lidar = LIDAR.make(simulator.robot.lidar, [room], simulator.robot.laser, field="lidar")
    observed = senses.observation_space(config, simulator, lidar)
    actions: spaces.Space[Any] = (
        spaces.Box(-1.0, 1.0, (2,), np.float32)
        if config.actions == "velocity"
        else spaces.Discrete(len(discrete_actions(simulator, robots)))
    )
    return observed, actions


def velocity_scale(simulator: SimulatorConfig) -> Float[np.ndarray, "2"]:
    """Full scale of velocity actions [m/s, rad/s]: the limits of the robot."""
    return np.array([simulator.robot.max_speed_mps, simulator.robot.turn_rate_radps])


def discrete_actions(simulator: SimulatorConfig, robots: int = 1) -> tuple[Action, ...]:
    """Return actions by number: the actions of the published system, and a wait where others move."""
    return (*PUBLISHED, Action.WAIT) if simulator.movers.any or robots > 1 else PUBLISHED
