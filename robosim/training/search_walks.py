"""Searches to learn from: many robots in invented homes, driven by a network, a guide beside them.

Radio comes from tables, which are traced once for a place of a transmitter and kept in files. Depth is measured along
the horizon only.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robosim.camera.model import CameraConfig
from robosim.environments.places import route_action
from robosim.environments.sources import GeneratedHomes
from robosim.environments.target_search import TargetSearch
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
    """See `robosim.environments.search`."""
    steps: int
    """Steps after which a search is given up."""
    seed: int
    """Of starts, targets and noise."""
    tables: Path
    """Folder where tables of radio are kept."""


class Robots:
    """Robots on their searches; one whose search has ended begins another with its next step."""

    def __init__(self, walks: Walks) -> None:
        """Put each at the start of a search."""
        # Eight rows are the fewest that a camera has; two of them are looked at.
        simulator = SimulatorConfig(
            physics="kinematic",
            camera="plan",
            image=CameraConfig(width=64, height=8),
            radio=RadioLinkConfig(engine="table", tables=walks.tables),
        )
        self.count, self._most, self._seed = walks.robots, walks.steps, walks.seed
        homes = GeneratedHomes(count=walks.homes, seed=walks.first)
        self._envs = [
            TargetSearch(
                homes,
                config=simulator,
                observe=("depth", "odometry", "radio"),
                depth="metres",
                rewards=REWARDS,
                targets=walks.targets,
                difficulty=walks.difficulty,
            )
            for _ in range(walks.robots)
        ]
        self._senses = [SearchSenses() for _ in range(walks.robots)]
        self._steps = np.zeros(walks.robots, int)
        self.over = np.zeros(walks.robots, bool)
        """Whose search has ended."""
        self.begins = np.ones(walks.robots, bool)
        """Whose search begins with the next step."""
        self.told = np.empty((walks.robots, INPUTS), np.float32)
        """What networks are told."""
        self.infos: list[dict[str, Any]] = [{}] * walks.robots
        """What robots must not know."""
        for i in range(walks.robots):
            self._begin(i, walks.seed + i)

    def advised(self) -> np.ndarray:
        """What a guide that knows the way would do, (robots,) int."""
        known = zip(self._envs, self.infos, strict=True)
        return np.array([int(route_action(env.place, info["pose"], info["target"])) for env, info in known])

    def step(self, actions: np.ndarray, *, again: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Do one action with each.

        Args:
            actions: Of each robot.
            again: Whether those whose search has ended begin another, instead of resting.

        Returns:
            Rewards, arrivals, and whose time ran out.
        """
        reward = np.zeros(self.count)
        arrived, late = np.zeros(self.count, bool), np.zeros(self.count, bool)
        before = self.over.copy()
        for i, env in enumerate(self._envs):
            if not before[i]:
                seen, reward[i], arrived[i], _, self.infos[i] = env.step(actions[i])
                self._steps[i] += 1
                late[i] = self._steps[i] >= self._most
                self.over[i], self.begins[i] = arrived[i] or late[i], False
                self._tell(i, seen)
            elif again:
                self._begin(i, None)
        return reward, arrived, late

    def close(self) -> None:
        """Free the cameras."""
        for env in self._envs:
            env.close()

    def _begin(self, i: int, seed: int | None) -> None:
        """A new search of a robot."""
        seen, self.infos[i] = self._envs[i].reset(seed=seed)
        self._senses[i], self._steps[i] = SearchSenses(), 0
        self.over[i], self.begins[i] = False, True
        self._tell(i, seen)

    def _tell(self, i: int, seen: dict[str, np.ndarray]) -> None:
        n = int(seen["path_found"].sum())
        self.told[i] = self._senses[i].told(
            seen["depth"][..., 0],
            seen["odometry"],
            seen["path_direction"][:n],
            seen["path_snr"][:n],
            1e-9 * seen["path_delay"][:n],
            seen["link_state"],
        )


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
        told, begins, counts, advised = (
            robots.told.copy(),
            robots.begins.copy(),
            ~robots.over,
            robots.advised(),
        )
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
    n, memory = robots.count, no_memory(robots.count)
    shortest = np.array([info["distance_m"] for info in robots.infos])
    driven, bumps, steps, arrived = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n, bool)
    while not robots.over.all():
        going_on = ~robots.over
        if isinstance(driver, SearchNetwork):
            scores, _, memory = driver(robots.told, memory)
            actions = scores.argmax(axis=-1) if most_likely else drawn_actions(scores, rng)
        elif driver == "guide":
            actions = robots.advised()
        else:
            actions = rng.choice([Action.FORWARD] * 3 + [Action.LEFT, Action.RIGHT], n)
        before = np.array([info["pose"] for info in robots.infos])
        arrived |= robots.step(actions, again=False)[1]
        after = np.array([info["pose"] for info in robots.infos])
        driven += np.hypot(*(after - before)[:, :2].T)
        bumps += going_on * np.array([info["collided"] for info in robots.infos])
        steps += going_on
    robots.close()
    return {
        "arrived": float(arrived.mean()),
        "spl": float((arrived * shortest / np.maximum(shortest, driven)).mean()),
        "steps": float(steps[arrived].mean()) if arrived.any() else float("nan"),
        "bumps": float(bumps.mean()),
    }
