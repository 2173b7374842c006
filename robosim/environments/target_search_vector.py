"""Many searches in one process, with the API of Gymnasium's vector environments or that of Stable-Baselines3.

`TargetSearchVector` is what `gymnasium.make_vec("robosim/TargetSearch-v1", n)` makes. Robots share only the buildings
with everything that is computed for them: robot i does step for step the same as a single environment of seed + i.
Robots can be in different buildings. With `robots=2` or more they search in teams, each in a world of its own: team i
does step for step the same as `robosim.parallel_env` of seed + i.
"""

from collections.abc import Sequence
from operator import index
from typing import TYPE_CHECKING, Any, SupportsIndex

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, iterate
from gymnasium.wrappers import TimeLimit
from jaxtyping import Bool, Float, UInt8

from robosim.environments.config import SearchConfig, simulator_for
from robosim.environments.search import Searches, make_spaces
from robosim.environments.sources import source_of
from robosim.environments.target_search import TargetSearch, check_render_mode
from robosim.simulator import SimulatorConfig
from robosim.support.checks import check_number
from robosim.team.team_config import MOST, robot_names
from robosim.world import ROBOT
from slam.actions import Command

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import DummyVecEnv


Flags = Bool[np.ndarray, " n"]
Batch = tuple[dict[str, np.ndarray], Float[np.ndarray, " n"], Flags, Flags, dict[str, Any]]


class TargetSearchVector(gymnasium.vector.VectorEnv):
    """`TargetSearch` for many robots; after the end of a search, the next step starts a new one.

    Robots of a team follow each other in all arrays, and their searches end together.
    """

    metadata = {  # noqa: RUF012
        "render_modes": TargetSearch.metadata["render_modes"],
        "render_fps": TargetSearch.metadata["render_fps"],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        plan: object = "flat",
        *,
        config: SimulatorConfig | None = None,
        max_episode_steps: int = 1000,
        render_mode: str | None = None,
        autoreset: bool = True,
        robots: int = 1,
        **search: Any,
    ) -> None:
        """Nothing is built before the first reset.

        Args:
            num_envs: Number of robots, of all teams together.
            plan: Source of plans: see `robosim.environments.sources`.
            config: Configuration of the simulator; by default the fastest with the needed sensors.
            max_episode_steps: Steps after which a search is truncated.
            render_mode: None, "rgb_array" or "ansi" (text).
            autoreset: Whether robots whose search has ended start another at the next step, or stand still.
            robots: Number of robots in each team.
            search: Fields of `SearchConfig`.

        Raises:
            ValueError: If a number is out of bounds, the render mode unknown, or the robot lacks a sensor that it
                observes by.
            MapError: If there is no such plan.
        """
        check_number("num_envs", num_envs, 1, 65536, "robots", whole=True)
        check_number("robots", robots, 1, MOST, "robots", whole=True)
        if num_envs % robots:
            raise ValueError(f"num_envs is {num_envs}, expected a multiple of the {robots} robots of a team.")
        check_number("max_episode_steps", max_episode_steps, 1, 10**9, "steps", whole=True)
        check_render_mode(render_mode, self.metadata["render_modes"])
        self.num_envs, self.render_mode, self._most = num_envs, render_mode, max_episode_steps
        self._autoreset = autoreset
        if not autoreset:
            self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode.DISABLED}
        self.search = SearchConfig(**search)
        simulator, source = config or simulator_for(self.search), source_of(plan)
        names, count = (robot_names(robots) if robots > 1 else (ROBOT,)), num_envs // robots
        self._robots = robots
        self._teams = [Searches(source, self.search, simulator, names) for _ in range(count)]
        self.searches = [search for team in self._teams for search in team.robots.values()]
        """The current search of each robot."""
        self.single_observation_space, self.single_action_space = make_spaces(self.search, simulator, robots)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rngs: list[np.random.Generator] = [seeding.np_random()[0] for _ in range(count)]
        self._steps = np.zeros(count, int)
        self._over = np.zeros(count, bool)
        self._seen: list[dict[str, np.ndarray]] = [{}] * num_envs

    def reset(
        self,
        *,
        seed: SupportsIndex | Sequence[SupportsIndex | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start a new search with each robot.

        Args:
            seed: Seed of team 0, team i has seed + i; or one for each team. None continues the random numbers.
            options: See `TargetSearch`; the same for all. `reset_mask` (n,) bool marks the robots whose searches start
                again, all of a team or none; the observations of the others do not change.
        """
        options, count = dict(options or {}), len(self._teams)
        mask = np.asarray(options.pop("reset_mask", np.ones(self.num_envs, bool)))
        least = 1 if self._seen[0] else self.num_envs
        if mask.shape != (self.num_envs,) or mask.dtype != bool or mask.sum() < least:
            raise ValueError(
                f"reset_mask is {mask}, expected {self.num_envs} of True or False, one of them True, at first all."
            )
        teams = mask.reshape(count, -1)
        if (teams != teams[:, :1]).any():
            raise ValueError(f"reset_mask is {mask}, expected the same for all robots of a team.")
        seeds: list[SupportsIndex | None] = [None] * count
        if isinstance(seed, Sequence):
            seeds = list(seed)
        elif seed is not None:
            seeds = [index(seed) + i for i in range(count)]
        if len(seeds) != count:
            raise ValueError(f"seed has {len(seeds)} numbers, expected one for each of {count} searches.")
        infos: dict[str, Any] = {}
        for i in np.flatnonzero(teams[:, 0]).tolist():
            if (new := seeds[i]) is not None:
                self._rngs[i], _ = seeding.np_random(index(new))
            infos = self._begin(i, options, infos)
        return self._stack(self._seen), infos

    def step(self, actions: np.ndarray) -> Batch:
        """Do one action with each robot; robots whose search has ended start a new one instead, or stand still."""
        commands, rewards = self._commands_of(actions), np.zeros(self.num_envs)
        arrived, late = np.zeros(len(self._teams), bool), np.zeros(len(self._teams), bool)
        infos: dict[str, Any] = {}
        for i, team in enumerate(self._teams):
            if i in commands:
                outcomes = team.step(commands[i])
                for slot, outcome in zip(self._slots(i), outcomes.values(), strict=True):
                    self._seen[slot], rewards[slot], _, info = outcome
                    infos = self._add_info(infos, info, slot)
                arrived[i] = any(outcome.arrived for outcome in outcomes.values())
                self._steps[i] += 1
                late[i] = self._steps[i] >= self._most
            elif self._autoreset:
                infos = self._begin(i, {}, infos)
        self._over = arrived | late | (self._over & (not self._autoreset))
        ends = np.repeat(arrived, self._robots), np.repeat(late, self._robots)
        return self._stack(self._seen), rewards, *ends, infos

    def render(self) -> tuple[UInt8[np.ndarray, "height width 3"] | str, ...] | None:
        """A picture of each search, as `TargetSearch.render` draws one."""
        if self.render_mode is None:
            return None
        return tuple(
            search.text() if self.render_mode == "ansi" else search.picture() for search in self.searches
        )

    def close_extras(self, **kwargs: Any) -> None:
        """Free the cameras."""
        for team in self._teams:
            team.close()

    def _begin(self, i: int, options: dict[str, Any], infos: dict[str, Any]) -> dict[str, Any]:
        """Start a search of team i; return the infos with those of its robots."""
        self._steps[i], self._over[i] = 0, False
        begun = self._teams[i].reset(self._rngs[i], options)
        for slot, (observation, info) in zip(self._slots(i), begun.values(), strict=True):
            self._seen[slot] = observation
            infos = self._add_info(infos, info, slot)
        return infos

    def _commands_of(self, actions: np.ndarray) -> dict[int, dict[str, Command]]:
        """Commands of the teams whose search goes on; ValueError if an action is none, before any robot moves."""
        chosen = list(iterate(self.action_space, actions))
        if len(chosen) != self.num_envs:
            raise ValueError(
                f"there are {len(chosen)} actions, expected one of each of {self.num_envs} robots."
            )
        commands = {}
        for i in np.flatnonzero(~self._over).tolist():
            of_team = [chosen[slot] for slot in self._slots(i)]
            commands[i] = self._teams[i].commands_of(dict(zip(self._teams[i].robots, of_team, strict=True)))
        return commands

    def _slots(self, i: int) -> range:
        """Places of the robots of team i in all arrays."""
        return range(i * self._robots, (i + 1) * self._robots)

    def _stack(self, seen: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
        """Observations of all robots as arrays with one more axis in front."""
        return {key: np.stack([observation[key] for observation in seen]) for key in seen[0]}


def sb3_vec_env(
    num_envs: int = 1,
    plan: object = "flat",
    *,
    seed: int = 0,
    max_episode_steps: int = 1000,
    threads: int | None = 1,
    **search: Any,
) -> "DummyVecEnv":
    """Searches in one process as a vector environment of Stable-Baselines3.

    Use it as in `PPO("MultiInputPolicy", sb3_vec_env(8, "homes:50", targets=2)).learn(100_000)`. Robots share
    buildings, their scenes and tables. After the last step of a search the next one starts within the same call: the
    last observation is `infos[i]["terminal_observation"]`, and `infos[i]["episode"]` has return and length.

    Args:
        num_envs: Number of robots.
        plan: Source of plans: see `robosim.environments.sources`.
        seed: Seed of robot 0; robot i has seed + i.
        max_episode_steps: Steps after which a search is truncated.
        threads: Threads of PyTorch in this process; for such small networks one is several times faster than one per
            core. None does not change them.
        search: Other arguments of `TargetSearch`.

    Raises:
        ImportError: If Stable-Baselines3 is not installed.
        ValueError: If an argument is out of bounds; MapError if there is no such plan.
    """
    check_number("num_envs", num_envs, 1, 65536, "robots", whole=True)
    check_number("max_episode_steps", max_episode_steps, 1, 10**9, "steps", whole=True)
    try:
        import torch
        from stable_baselines3.common.monitor import Monitor
        from stable_baselines3.common.vec_env import DummyVecEnv
    except ImportError as error:
        raise ImportError(
            "sb3_vec_env needs Stable-Baselines3: pip install stable-baselines3.", name=error.name
        ) from error
    if threads is not None:
        check_number("threads", threads, 1, 1024, "threads", whole=True)
        torch.set_num_threads(threads)
    made = DummyVecEnv(
        [lambda: Monitor(TimeLimit(TargetSearch(plan, **search), max_episode_steps))] * num_envs
    )
    made.seed(seed)
    return made
