"""Searches for training: many robots in generated homes, driven by a network or a guide that knows the route.

Radio comes from tables, which are traced once per position of a transmitter and stored in files. Depth is measured
along the horizon only.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from robosim.camera.model import CameraConfig
from robosim.environments.sources import GeneratedHomes, TaskSpec, route_action
from robosim.environments.target_search_vector import TargetSearchVector
from robosim.generator.generate import GeneratorConfig
from robosim.policies.search_network import (
    INPUTS,
    SearchNetwork,
    SearchSenses,
    action_probabilities,
    draw_actions,
    empty_memory,
)
from robosim.radio.link import RadioLinkConfig
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.training.search_learning import Segment
from slam.actions import Action

#: Seed of the kinds of buildings; limits of the areas of offices, and of the mean areas of their rooms [m2].
_KINDS, _OFFICES_M2, _ROOM_M2 = 42, (150.0, 2000.0), (15.0, 40.0)
#: Rewards of a search.
REWARDS = {"arrival": 10.0, "progress": 1.0, "step": -0.01, "collision": -0.05}


@dataclass(frozen=True, kw_only=True)
class GeneratedBuildings:
    """Generated homes, and among them offices, whose logarithm of area is uniform between limits."""

    count: int
    """Different buildings."""
    seed: int
    """Seed of the first building; the others follow it."""
    offices: float
    """Share of offices, 0 to 1."""

    def __len__(self) -> int:
        return self.count

    def task_spec(self, number: int) -> TaskSpec:
        """A building without a task."""
        seed = self.seed + number
        rng = np.random.default_rng([_KINDS, seed])
        config = GeneratorConfig()
        if rng.random() < self.offices:
            area_m2 = float(np.exp(rng.uniform(*np.log(_OFFICES_M2))))
            rooms = min(round(area_m2 / rng.uniform(*_ROOM_M2)), 100)
            config = GeneratorConfig(style="office", area_m2=area_m2, rooms=rooms)
        return GeneratedHomes(count=1, seed=seed, config=config).task_spec(0)


@dataclass(frozen=True, kw_only=True)
class Walks:
    """Searches of several robots."""

    robots: int
    homes: int
    """Number of different homes."""
    first: int
    """Number of the first home."""
    offices: float
    """Share of the homes that are offices instead."""
    targets: int
    """Number of target positions in each home."""
    difficulty: float
    """See `robosim.environments.search`."""
    steps: int
    """Largest number of steps of a search."""
    seed: int
    """Seed of starts, targets and noise."""
    tables: Path
    """Folder of radio tables."""


class Robots:
    """Robots on their searches; after the end of one, the next step begins another, or the robot rests."""

    def __init__(self, walks: Walks, *, again: bool = True) -> None:
        """Begin a search of each robot."""
        # Eight rows are the fewest of a camera; two of them are used.
        simulator = SimulatorConfig(
            physics="kinematic",
            camera="plan",
            robot=RobotConfig(camera=CameraConfig(width=64, height=8)),
            radio=RadioLinkConfig(engine="table", tables=walks.tables),
        )
        self.count = walks.robots
        self._env = TargetSearchVector(
            walks.robots,
            GeneratedBuildings(count=walks.homes, seed=walks.first, offices=walks.offices),
            config=simulator,
            max_episode_steps=walks.steps,
            autoreset=again,
            observe=("depth", "odometry", "radio"),
            depth="metres",
            rewards=REWARDS,
            targets=walks.targets,
            difficulty=walks.difficulty,
        )
        self._senses = [SearchSenses() for _ in range(walks.robots)]
        self.over = np.zeros(walks.robots, bool)
        """Whether the search of each robot has ended."""
        self.begins = np.ones(walks.robots, bool)
        """Whether the next step begins its search."""
        self.inputs = np.empty((walks.robots, INPUTS), np.float32)
        """Inputs of the network."""
        self.pose, self.target = np.empty((walks.robots, 3)), np.empty((walks.robots, 2))
        """True poses, and places of the targets, which the network does not receive."""
        self.collided = np.zeros(walks.robots, bool)
        observations, infos = self._env.reset(seed=walks.seed)
        self.shortest_m = infos["distance_m"]
        self._take(observations, infos)

    def guide_actions(self) -> np.ndarray:
        """Actions along the routes to the targets, (robots,) int."""
        known = zip(self._env.searches, self.pose, self.target, strict=True)
        return np.array([int(route_action(search.place, pose, target)) for search, pose, target in known])

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Do one action of each robot; returns rewards, arrivals, and which robots ran out of time."""
        ended = self.over
        observations, reward, arrived, late, infos = self._env.step(actions)
        self.begins = ended & infos["_pose"]
        self.over = arrived | late | (ended & ~infos["_pose"])
        self._take(observations, infos)
        return reward, arrived, late

    def close(self) -> None:
        """Release the cameras."""
        self._env.close()

    def _take(self, observations: dict[str, np.ndarray], infos: dict[str, Any]) -> None:
        """Store what has changed: all but robots that rest."""
        for i in np.flatnonzero(infos["_pose"]):
            self.pose[i], self.target[i] = infos["pose"][i], infos["target"][i]
            self.collided[i] = infos["collided"][i]
            if self.begins[i]:
                self._senses[i] = SearchSenses()
            n = int(observations["path_found"][i].sum())
            self.inputs[i] = self._senses[i].encode(
                observations["depth"][i, ..., 0],
                observations["odometry"][i],
                observations["path_direction"][i, :n],
                observations["path_snr"][i, :n],
                1e-9 * observations["path_delay"][i, :n],
                observations["link_state"][i],
            )


def walk(
    robots: Robots,
    network: SearchNetwork,
    memory: np.ndarray,
    steps: int,
    guided: float,
    rng: np.random.Generator,
) -> tuple[Segment, np.ndarray]:
    """A segment of steps from the present state of the robots, and their memories (robots, hidden) after it.

    The guide drives in a share `guided` of the steps.
    """
    rows: list[dict[str, Any]] = []
    first = memory
    for _ in range(steps):
        memory = np.where(robots.begins[:, None], np.float32(0), memory)
        row: dict[str, Any] = {
            "inputs": robots.inputs.copy(), "begins": robots.begins.copy(), "counts": ~robots.over,
            "advised": robots.guide_actions(),
        }  # fmt: skip
        scores, row["value"], memory = network(row["inputs"], memory)
        drawn = draw_actions(scores, rng)
        row["taken"] = np.where(rng.random(robots.count) < guided, row["advised"], drawn)
        probability = action_probabilities(scores)[np.arange(robots.count), row["taken"]]
        row["log_odds"] = np.log(probability)
        row["reward"], row["arrived"], row["late"] = robots.step(row["taken"])
        rows.append(row)
    columns = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    after = network(robots.inputs, np.where(robots.begins[:, None], np.float32(0), memory)).value
    columns["value"] = np.vstack([columns["value"], after]).astype(float)
    return Segment(**columns, memory=first), memory


class Scores(NamedTuple):
    """Scores of one search of each robot."""

    arrived: Bool[np.ndarray, " robots"]
    spl: Float[np.ndarray, " robots"]
    """Success weighted by path length: the shortest drive over the actual one, 0 without arrival (Anderson et al., On
    evaluation of embodied navigation agents, arXiv:1807.06757)."""
    steps: Float[np.ndarray, " robots"]
    bumps: Float[np.ndarray, " robots"]


def evaluate_driver(
    driver: SearchNetwork | str, walks: Walks, *, most_likely: bool = False
) -> dict[str, float]:
    """Means of the scores of a driver, see `drive`: of the searches with arrival for the steps, else of all."""
    scores = drive(driver, walks, most_likely=most_likely)
    means = {name: float(values.mean()) for name, values in scores._asdict().items()}
    return {
        **means,
        "steps": float(scores.steps[scores.arrived].mean()) if scores.arrived.any() else float("nan"),
    }


def drive(driver: SearchNetwork | str, walks: Walks, *, most_likely: bool = False) -> Scores:
    """Drive a search of each robot by a network, "guide" or "random" (three of five actions forward)."""
    robots, rng = Robots(walks, again=False), np.random.default_rng([walks.seed, 2])
    n, memory = robots.count, empty_memory(robots.count)
    driven, bumps, steps, arrived = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, bool)
    while not robots.over.all():
        is_running = ~robots.over
        if isinstance(driver, SearchNetwork):
            scores, _, memory = driver(robots.inputs, memory)
            actions = scores.argmax(axis=-1) if most_likely else draw_actions(scores, rng)
        elif driver == "guide":
            actions = robots.guide_actions()
        else:
            actions = rng.choice([Action.FORWARD] * 3 + [Action.LEFT, Action.RIGHT], n)
        before = robots.pose.copy()
        arrived |= robots.step(actions)[1]
        driven += np.hypot(*(robots.pose - before)[:, :2].T)
        bumps += is_running & robots.collided
        steps += is_running
    robots.close()
    return Scores(arrived, arrived * robots.shortest_m / np.maximum(robots.shortest_m, driven), steps, bumps)
