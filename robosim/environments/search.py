"""One robot's searches, one after the other: the task, the simulator, what is observed and what is rewarded.

Environments of one robot and of many are made of it, so that they agree step for step.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from jaxtyping import Float, UInt8

from robosim.drawing.picture import Picture
from robosim.drawing.snapshot import Snapshot, whole_mm
from robosim.environments import senses
from robosim.environments.config import SearchConfig, check_senses
from robosim.environments.curriculum import Curriculum, longest_m
from robosim.environments.places import Place, place_of
from robosim.environments.rewards import NO_SNR_DB, WORTH, weighted
from robosim.environments.sources import Given, Source
from robosim.environments.text_plan import draw_text
from robosim.parts import LIDAR
from robosim.radio.measurement import Interpreter
from robosim.simulator import Observation, Simulator, SimulatorConfig
from robosim.task.coverage import Coverage
from robosim.task.tasks import ARRIVAL_M, Task, make_task
from slam.actions import PUBLISHED, Action
from wireless.paths import LinkState

#: Full scale of continuous actions, and how long one is held.
MAX_SPEED_MPS = 0.5
MAX_TURN_RADPS = float(np.pi / 2)
STEP_S = 0.5
#: What `reset` may be told.
OPTIONS = ("start", "target", "plan", "difficulty")


class Outcome(NamedTuple):
    """What came of an action."""

    observation: dict[str, np.ndarray]
    reward: float
    arrived: bool
    info: dict[str, Any]


class Search:
    """A robot that searches."""

    def __init__(self, source: Source, config: SearchConfig, simulator: SimulatorConfig) -> None:
        """Nothing is built before the first reset.

        Args:
            source: Where plans come from.
            config: What is observed and rewarded.
            simulator: What is simulated.

        Raises:
            ValueError: If the robot does not carry what it is to observe by.
        """
        check_senses(config, simulator)
        self.config, self.simulator_config, self._source = config, simulator, source
        self._curriculum = Curriculum(config.difficulty, moves=config.curriculum)
        self._ended = True
        self._place: Place | None = None
        self._simulator: Simulator
        self._interpreter: Interpreter | None = None

    def reset(
        self, rng: np.random.Generator, options: Mapping[str, Any] | None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin a search.

        Args:
            rng: Source of all that is random until the next reset.
            options: `start` (x, y, yaw [rad]) and `target` (x, y) in the frame of the plan, `plan` (its number in the
                source), `difficulty` (0 to 1): each fixes what would be drawn.
        """
        options = dict(options or {})
        if unknown := set(options) - set(OPTIONS):
            raise ValueError(f"Unknown reset options {sorted(unknown)}. Known: {', '.join(OPTIONS)}.")
        if not self._ended:
            self._curriculum.ended(False)
        number = self._number(rng, options.get("plan"))
        given = self._source.given(number)
        self._enter(given)
        place = self.place
        difficulty = options.get("difficulty", self._curriculum.difficulty)
        self._task = self._draw(given, rng, options, float(difficulty))
        self._travel = place.travel_m(self._task.target)
        self._view = self._simulator.reset(self._task, rng)
        pose = self._simulator.pose
        self._picture: Picture | None = None
        self._steps, self._ended = 0, False
        self._distance = place.reach.remaining_m(self._travel, pose[:2])
        self._coverage: Coverage | None = None
        if self.config.uses_coverage:
            image = self.simulator_config.image
            self._coverage = Coverage(place.plan, place.reach.floor, float(np.radians(image.hfov_deg)))
            self._look(pose)
        self._worth, self._snr = self._link()
        info = self._info(pose, collided=False, arrived=False)
        return self._observation(pose), {**info, "plan": place.plan.name, "difficulty": float(difficulty)}

    def step(self, action: Any) -> Outcome:
        """Do one action."""
        if self.config.continuous:
            v, w = np.clip(np.asarray(action, float), -1, 1) * (MAX_SPEED_MPS, MAX_TURN_RADPS)
            self._view, motion = self._simulator.drive(float(v), float(w), STEP_S)
        else:
            self._view, motion = self._simulator.step(Action(int(action)))
        self._steps += 1
        pose = self._simulator.pose
        before = self._distance, self._seen_m2, self._worth, self._snr
        self._distance = self.place.reach.remaining_m(self._travel, pose[:2])
        if self._coverage is not None:
            self._look(pose)
        self._worth, self._snr = self._link()
        x, y = self._task.target
        arrived = bool(np.hypot(pose[0] - x, pose[1] - y) <= ARRIVAL_M)
        terms = {
            "arrival": float(arrived),
            "progress": before[0] - self._distance,
            "step": 1.0,
            "collision": float(motion.collided),
            "coverage": self._seen_m2 - before[1],
            "link_state": self._worth - before[2],
            "snr": self._snr - before[3],
        }
        info = self._info(pose, motion.collided, arrived)
        observation = self._observation(pose)
        info["rewards"] = weighted(self.config.rewards, terms, observation, info)
        if arrived:
            self._ended = True
            self._curriculum.ended(True)
        return Outcome(observation, float(sum(info["rewards"].values())), arrived, info)

    def picture(self) -> UInt8[np.ndarray, "height width 3"]:
        """The camera's view beside the plan with the robot's way."""
        if self._picture is None:
            self._picture = Picture(self.place.rings, self._task.target, brief=True)
        moment = Snapshot(
            rgb=self._view.rgb,
            depth_mm=whole_mm(self._view.depth),
            pose=self._simulator.pose,
            text=f"{self.place.plan.name}, step {self._steps}: {self._distance:.2f} m to go",
        )
        return self._picture.draw(moment)

    def text(self) -> str:
        """The plan in letters, with robot and target."""
        return draw_text(self.place.plan, self._simulator.pose, self._task.target)

    def close(self) -> None:
        """Free the camera."""
        if self._place is not None:
            self._simulator.close()

    @property
    def place(self) -> Place:
        """The building of the present search."""
        if self._place is None:
            raise RuntimeError("The search has not begun. Call reset first.")
        return self._place

    def _number(self, rng: np.random.Generator, asked: Any) -> int:
        """Which plan of the source."""
        count = len(self._source)
        if asked is None:
            # Not drawn where there is no choice.
            return int(rng.integers(count)) if count > 1 else 0
        if not 0 <= int(asked) < count:
            raise ValueError(f"Reset option plan is {asked}, expected a number of 0 to {count - 1}.")
        return int(asked)

    def _enter(self, given: Given) -> None:
        """Be in a building."""
        if self._place is not None and self._place.plan is given.plan:
            return
        self.close()
        self._place = place_of(given.plan, self.simulator_config, uses_radio=self.config.uses_radio)
        self._simulator = self._place.simulator()
        radio = self._simulator.radio
        if radio is not None:
            self._interpreter = Interpreter(radio, self._place.classifier(self.config.link_states))

    def _draw(
        self, given: Given, rng: np.random.Generator, options: Mapping[str, Any], difficulty: float
    ) -> Task:
        """The task: what is asked for, what the source says, and the rest drawn."""
        start, target = (
            np.asarray(options[key], float) if key in options else said
            for key, said in (("start", given.start), ("target", given.target))
        )
        if target is None and self.config.targets is not None:
            pool = self.place.pool(self.config.targets)
            target = pool[rng.integers(len(pool))]
        return make_task(
            self.place.reach,
            rng,
            start=start,
            target=target,
            min_path_m=self.config.min_path_m,
            max_path_m=longest_m(difficulty, self.config.min_path_m),
        )

    @property
    def _seen_m2(self) -> float:
        return 0.0 if self._coverage is None else self._coverage.area_m2

    def _look(self, pose: Float[np.ndarray, "3"]) -> None:
        """Count what is seen from here."""
        assert self._coverage is not None
        self._coverage.update(pose, self._simulator.true_depth, self._simulator.true_laser)

    def _link(self) -> tuple[float, float]:
        """Worth of the true link state, if that is rewarded, and SNR of the strongest measured path [dB], or 0."""
        radio, paths = self._simulator.radio, self._view.paths
        if radio is None or paths is None:
            return 0.0, 0.0
        snr = float(paths.snr_db[0, 0]) if paths.count[0] else NO_SNR_DB
        worth = WORTH[LinkState(radio.state)] if self.config.rewards.get("link_state") else 0.0
        return worth, snr

    def _observation(self, pose: Float[np.ndarray, "3"]) -> dict[str, np.ndarray]:
        view, config = self._view, self.config
        found: dict[str, np.ndarray] = {}
        for sense in config.observe:
            if sense == "rgb":
                found["rgb"] = view.rgb.copy()  # a blind robot's is always the same array
            elif sense == "depth":
                scaled = senses.depth_picture if config.depth == "picture" else senses.depth_metres
                found["depth"] = scaled(view.depth)
            elif sense == "lidar" and view.laser is not None:
                found["lidar"] = senses.ranges(view.laser)
            elif sense == "odometry":
                found["odometry"] = senses.odometry(view)
            elif sense == "radio" and view.paths is not None:
                found |= senses.paths(view.paths, self._probability(view))
            elif sense == "map" and self._coverage is not None:
                found["map"] = senses.map_ahead(
                    self.place.plan, self._coverage.seen, pose, config.map_cells, config.map_cell_m
                )
            elif sense == "pose":
                found["pose"] = senses.pose_since(self._task.start, pose)
        return found

    def _probability(self, view: Observation) -> Float[np.ndarray, "4"]:
        """Of the link's states, as the robot takes them to be."""
        assert self._interpreter is not None and view.paths is not None
        return self._interpreter.probability(view.paths)

    def _info(self, pose: Float[np.ndarray, "3"], collided: bool, arrived: bool) -> dict[str, Any]:
        return {
            "pose": pose.copy(),
            "target": self._task.target.copy(),
            "distance_m": self._distance,
            "collided": collided,
            "arrived": arrived,
        }


def spaces_of(
    config: SearchConfig, simulator: SimulatorConfig
) -> tuple[spaces.Space[Any], spaces.Space[Any]]:
    """The spaces of observations and of actions."""
    lidar = None
    if "lidar" in config.observe:
        lidar = LIDAR.make(simulator.lidar, [_somewhere()], simulator.laser, field="lidar")
    observed = senses.space_of(config, simulator, lidar)
    actions: spaces.Space[Any] = (
        spaces.Box(-1.0, 1.0, (2,), np.float32) if config.continuous else spaces.Discrete(len(PUBLISHED))
    )
    return observed, actions


def _somewhere() -> Any:
    """A mesh to make a lidar in that is asked for nothing but its beams."""
    import trimesh

    return trimesh.creation.box((1.0, 1.0, 1.0))
