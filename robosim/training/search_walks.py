"""Searches to learn from: many robots in invented homes, driven by a network, a guide beside them.

Radio comes from tables, which are traced once for a place of a transmitter and kept in files. Depth is measured along
the horizon only.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robosim.camera.model import CameraConfig
from robosim.environments.guide import way_action
from robosim.environments.sources import MadeHomes
from robosim.environments.target_search_vector import TargetSearchVector
from robosim.policies.search_network import SearchNetwork, drawn_actions, likelihood, no_memory
from robosim.policies.search_senses import INPUTS, SearchSenses
from robosim.radio.link import RadioLinkConfig
from robosim.simulator import SimulatorConfig
from robosim.training.search_learning import Segment
from slam.actions import Action

#: What a search is rewarded for.
REWARDS = {"arrival": 10.0, "progress": 1.0, "step": -0.01, "collision": -0.05}


@dataclass(frozen=True, kw_only=True)
class Walks:
    """Which searches are walked."""

    robots: int
    """Robots side by side."""
    homes: int
    """Different homes."""
    first: int
    """Number of the first home."""
    targets: int
    """Places of targets in each."""
    difficulty: float
    """See `robosim.environments.curriculum`."""
    steps: int
    """Steps after which a search is given up."""
    seed: int
    """Of starts, targets and noise."""
    tables: Path
    """Folder where tables of radio are kept."""


class Robots:
    """Robots on their searches."""

    def __init__(self, walks: Walks) -> None:
        """Put each at the start of a search."""
        # Eight rows are the fewest that a camera has; two of them are looked at.
        simulator = SimulatorConfig(
            physics="kinematic",
            camera="plan",
            image=CameraConfig(width=64, height=8),
            radio=RadioLinkConfig(engine="table", tables=walks.tables),
        )
        self.count = walks.robots
        self._env = TargetSearchVector(
            walks.robots,
            MadeHomes(count=walks.homes, seed=walks.first),
            config=simulator,
            max_episode_steps=walks.steps,
            observe=("depth", "odometry", "radio"),
            depth="metres",
            rewards=REWARDS,
            targets=walks.targets,
            difficulty=walks.difficulty,
        )
        self._senses = [SearchSenses() for _ in range(walks.robots)]
        self.begins = np.ones(walks.robots, bool)
        self._over = np.zeros(walks.robots, bool)
        seen, self.info = self._env.reset(seed=walks.seed)
        self.told = self._telling(seen)

    @property
    def counts(self) -> np.ndarray:
        """Whether the next step is one of a search, not the pause that begins another."""
        return ~self._over

    def advised(self) -> np.ndarray:
        """What a guide that knows the way would do, (robots,) int."""
        places = self._env.places
        known = zip(places, self.info["pose"], self.info["target"], strict=True)
        return np.array([int(way_action(place, pose, target)) for place, pose, target in known])

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Do one action with each; rewards, arrivals, and whose time ran out."""
        seen, reward, arrived, late, self.info = self._env.step(actions)
        self.begins, self._over = self._over, arrived | late
        self.told = self._telling(seen)
        return reward, arrived, late

    def close(self) -> None:
        """Free the cameras."""
        self._env.close()

    def _telling(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        """What networks are told, (robots, inputs)."""
        told = np.empty((self.count, INPUTS), np.float32)
        for i, begins in enumerate(self.begins):
            if begins:
                self._senses[i] = SearchSenses()
            n = int(seen["path_found"][i].sum())
            told[i] = self._senses[i].told(
                seen["depth"][i, ..., 0],
                seen["odometry"][i],
                seen["path_direction"][i, :n],
                seen["path_snr"][i, :n],
                1e-9 * seen["path_delay"][i, :n],
                seen["link_state"][i],
            )
        return told


def walk(
    robots: Robots,
    network: SearchNetwork,
    memory: np.ndarray,
    steps: int,
    guided: float,
    rng: np.random.Generator,
) -> tuple[Segment, np.ndarray]:
    """Walk a segment.

    Args:
        robots: Where they are; they go on from there.
        network: The policy.
        memory: Of each robot, (robots, hidden).
        steps: How many.
        guided: Share of the steps in which the guide drives.
        rng: Draws actions, and who drives.

    Returns:
        The segment, and the memories after it.
    """
    rows: list[dict[str, Any]] = []
    first = memory
    for _ in range(steps):
        memory = np.where(robots.begins[:, None], np.float32(0), memory)
        told, begins, counts, advised = robots.told, robots.begins, robots.counts, robots.advised()
        scores, value, memory = network(told, memory)
        own = drawn_actions(scores, rng)
        taken = np.where(rng.random(robots.count) < guided, advised, own)
        odds = np.log(likelihood(scores)[np.arange(robots.count), taken])
        reward, arrived, late = robots.step(taken)
        rows.append(
            {
                "told": told,
                "begins": begins,
                "counts": counts,
                "advised": advised,
                "taken": taken,
                "log_odds": odds,
                "reward": reward,
                "arrived": arrived,
                "late": late,
                "value": value,
            }
        )
    columns = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    after = network(robots.told, np.where(robots.begins[:, None], np.float32(0), memory)).value
    columns["value"] = np.vstack([columns["value"], after]).astype(float)
    return Segment(**columns, memory=first), memory


def judge(driver: SearchNetwork | str, walks: Walks, *, most_likely: bool = False) -> dict[str, float]:
    """How well searches go, one of each robot.

    Args:
        driver: A network; or "guide", which knows the way; or "random", three of five actions forward.
        walks: Which.
        most_likely: Whether the network's most likely actions are done, instead of drawn ones.

    Returns:
        `arrived`: share of the searches. `spl`: success weighted by path length, the mean of the shortest drive over
        the drive that was driven, 0 for who did not arrive (Anderson et al., On evaluation of embodied navigation
        agents, arXiv:1807.06757). `steps`: of those that arrived, their mean; `bumps`: a search.
    """
    robots, rng = Robots(walks), np.random.default_rng([walks.seed, 2])
    n = robots.count
    shortest = np.maximum(np.array(robots.info["distance_m"], float), 1e-6)
    driven, bumps, steps = np.zeros(n), np.zeros(n), np.zeros(n)
    memory, arrived, going_on = no_memory(n), np.zeros(n, bool), np.ones(n, bool)
    while going_on.any():
        if isinstance(driver, SearchNetwork):
            memory = np.where(robots.begins[:, None], np.float32(0), memory)
            scores, _, memory = driver(robots.told, memory)
            actions = scores.argmax(axis=-1) if most_likely else drawn_actions(scores, rng)
        elif driver == "guide":
            actions = robots.advised()
        else:
            actions = rng.choice([Action.FORWARD] * 3 + [Action.LEFT, Action.RIGHT], n)
        before = robots.info["pose"]
        _, there, late = robots.step(actions)
        moved = np.hypot(*(robots.info["pose"] - before)[:, :2].T)
        driven += going_on * moved
        steps += going_on
        bumps += going_on * np.array(robots.info.get("collided", np.zeros(n)), bool)
        arrived |= going_on & there
        going_on &= ~(there | late)
    robots.close()
    return {
        "arrived": float(arrived.mean()),
        "spl": float((arrived * shortest / np.maximum(shortest, driven)).mean()),
        "steps": float(steps[arrived].mean()) if arrived.any() else float("nan"),
        "bumps": float(bumps.mean()),
    }
