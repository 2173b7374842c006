"""The search for a target by several robots in one world, with the parallel API of PettingZoo.

Made by `robosim.parallel_env`, which needs the extra `team`.
"""

from collections.abc import Mapping
from operator import index
from typing import Any, ClassVar, SupportsIndex

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from jaxtyping import Float, UInt8
from pettingzoo import ParallelEnv

from robosim.drawing.plan_view import PALETTE, PlanView
from robosim.environments.config import SearchConfig, simulator_for
from robosim.environments.search import Searches, make_spaces
from robosim.environments.sources import source_of
from robosim.environments.target_search import check_render_mode
from robosim.simulator import SimulatorConfig
from robosim.support.checks import check_number
from robosim.support.colours import robot_colour
from robosim.team.team_config import MOST, robot_names

#: What one robot observes.
Seen = dict[str, np.ndarray]


class TargetSearchTeam(ParallelEnv[str, Seen, Any]):
    """Robots look for a target at an unknown place in a building.

    Agents are "robot1", "robot2" and so on. Actions, observations, rewards and `info` of each are those of
    `robosim.environments.target_search.TargetSearch`; discrete actions of two or more robots include 3, wait.

    The robots act one after the other, in the order of their numbers. Each observes the others as they stand after its
    own action: as cylinders that stop it, which counts as a collision, that its camera and lidar see, and that weaken
    its radio paths.

    The first robot starts as in `TargetSearch`, the others at the nearest places with room, with the same heading.
    All terminate when a robot reaches the target, and only that one has the reward of arrival. All are truncated after
    `max_steps` steps.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "robosim_target_search_team",
        "render_modes": ["rgb_array"],
        "render_fps": 20,
    }

    def __init__(
        self,
        plan: object = "flat",
        *,
        robots: int = 2,
        config: SimulatorConfig | None = None,
        max_steps: int = 1000,
        render_mode: str | None = None,
        **search: Any,
    ) -> None:
        """Nothing is built before the first reset; arguments and errors are those of `robosim.parallel_env`."""
        check_number("robots", robots, 1, MOST, "robots", whole=True)
        check_number("max_steps", max_steps, 1, 10**9, "steps", whole=True)
        check_render_mode(render_mode, self.metadata["render_modes"])
        self.render_mode, self.max_steps = render_mode, max_steps
        self.search = SearchConfig(**search)
        simulator = config or simulator_for(self.search)
        self.possible_agents = list(robot_names(robots))
        self.agents: list[str] = []
        self._searches = Searches(source_of(plan), self.search, simulator, tuple(self.possible_agents))
        # One for each, since random numbers of a space are its own.
        made = {agent: make_spaces(self.search, simulator, robots) for agent in self.possible_agents}
        self.observation_spaces = {agent: observed for agent, (observed, _) in made.items()}
        self.action_spaces = {agent: actions for agent, (_, actions) in made.items()}
        self._rng, _ = seeding.np_random()
        self._trails: list[Float[np.ndarray, "robots 3"]] = []

    def observation_space(self, agent: str) -> gymnasium.Space[Any]:
        """The space of observations of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.Space[Any]:
        """The space of actions of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: SupportsIndex | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Seen], dict[str, dict[str, Any]]]:
        """Start a new search; `options` are those of `TargetSearch`, with the start of the first robot."""
        if seed is not None:
            self._rng, _ = seeding.np_random(index(seed))
        # PettingZoo's test of the API passes an option of this name, which means nothing.
        begun = self._searches.reset(
            self._rng, {name: value for name, value in (options or {}).items() if name != "options"}
        )
        self.agents, self._trails = list(self.possible_agents), []
        self._note_poses()
        return (
            {agent: observation for agent, (observation, _) in begun.items()},
            {agent: info for agent, (_, info) in begun.items()},
        )

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[
        dict[str, Seen], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
    ]:
        """Do one action of each agent."""
        if not self.agents:
            raise RuntimeError("The search has not begun, or it has ended. Call reset first.")
        if set(actions) != set(self.agents):
            raise ValueError(
                f"actions are of {sorted(map(str, actions))}, expected one of each of {self.agents}."
            )
        commands = self._searches.commands_of({agent: actions[agent] for agent in self.agents})
        outcomes = self._searches.step(commands)
        self._note_poses()
        is_over = any(outcome.arrived for outcome in outcomes.values())
        is_late = len(self._trails) > self.max_steps
        if is_over or is_late:
            self.agents = []
        return (
            {agent: outcome.observation for agent, outcome in outcomes.items()},
            {agent: outcome.reward for agent, outcome in outcomes.items()},
            dict.fromkeys(outcomes, is_over),
            dict.fromkeys(outcomes, is_late),
            {agent: outcome.info for agent, outcome in outcomes.items()},
        )

    def render(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The plan with the target, and each robot with its trajectory in its colour."""
        if self.render_mode is None:
            return None
        first = self._searches.robots[self.possible_agents[0]]
        view = PlanView(first.place.rings)
        canvas = view.canvas(None, PALETTE)
        view.draw_walls(canvas)
        view.draw_target(canvas, first.task.target)
        for number, poses in enumerate(np.swapaxes(self._trails, 0, 1)):
            (x, y, yaw), places, colour = poses[-1], poses[:, :2], robot_colour(number)
            view.draw_line(canvas, places, colour, 2)
            view.draw_dot(canvas, places[-1], colour)
            view.draw_line(
                canvas, np.array([[x, y], [x + 0.3 * np.cos(yaw), y + 0.3 * np.sin(yaw)]]), colour, 2
            )
        view.draw_scale(canvas)
        return canvas

    def close(self) -> None:
        """Free the cameras."""
        self._searches.close()

    def _note_poses(self) -> None:
        """Add the true poses of all robots to their trajectories."""
        self._trails.append(np.array([search.robot.pose for search in self._searches.robots.values()]))
