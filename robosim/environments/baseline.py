"""Agents of episodes as baselines in an environment: any goal policy, compared with one that has learned.

agent = Baseline(env, "fused")
observation, info = env.reset(seed=1)
observation, reward, terminated, truncated, info = env.step(agent.act())
"""

from typing import Any

import gymnasium

from robosim.agent import Agent, make_agent
from robosim.environments.search import Search
from robosim.environments.target_search import TargetSearch
from robosim.episode_config import EpisodeConfig
from robosim.navigation import calibrated_robot
from robosim.support.parts import Part
from slam.actions import Action
from slam.control.controller import ControlConfig, Controller


class Baseline:
    """An agent with mapper, planner and controller for the robot of an environment.

    It is given what the robot senses, in full, and not the observation of the environment; it never sees the truth,
    except for the start of its map, and the target if the policy is `oracle`.
    """

    def __init__(
        self, env: gymnasium.Env[Any, Any], goal: Part = "fused", mapper: Part = "classical"
    ) -> None:
        """Make an agent for `TargetSearch`, also wrapped; ValueError if the radio that it needs is missing."""
        environment = env.unwrapped
        if not isinstance(environment, TargetSearch):
            raise ValueError(f"env is {environment}, expected robosim/TargetSearch-v1.")
        self._search: Search = environment.current
        simulator = self._search.simulator_config
        controller: Part = "velocity"
        if self._search.config.actions == "discrete":  # of which none goes back
            controller = Controller(calibrated_robot(simulator), ControlConfig(reverses=False))
        self._config = EpisodeConfig(
            goal=goal,
            mapper=mapper,
            explorer="gain",
            controller=controller,
            simulator=simulator,
            link_states=self._search.config.link_states,
        )
        self._agent: Agent | None = None

    def act(self) -> Any:
        """Return the action for what the robot senses now; each search has a new agent."""
        search = self._search
        if self._agent is None or search.sensed.action is None:
            self._agent = self._new_agent()
        decision = self._agent.act(search.sensed)
        return search.action_of(Action.LEFT if decision is None else decision.command)

    def _new_agent(self) -> Agent:
        search = self._search
        agent = make_agent(self._config, search.task)
        agent.interpret = search.robot.interpreter(search.place.classifier(self._config.link_states))
        if agent.policy.uses_radio and agent.interpret is None:
            raise ValueError(
                f"goal is {self._config.goal!r}, which needs a radio. Give the environment the observation 'radio'."
            )
        agent.reset(search.task.start)
        return agent
