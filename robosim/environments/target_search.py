"""The search for a target as an environment of Gymnasium: `robosim/TargetSearch-v1`."""

from operator import index
from typing import Any, SupportsIndex

import gymnasium
import numpy as np
from jaxtyping import UInt8

from robosim.environments.config import SearchConfig, simulator_for
from robosim.environments.search import Search, Searches, make_spaces
from robosim.environments.sources import source_of
from robosim.simulator import SimulatorConfig
from robosim.world import ROBOT


class TargetSearch(gymnasium.Env):
    """A differential-drive robot looks for a target at an unknown place in a building.

    ## Action space
    Discrete (default): 0 forward 0.25 m, 1 left 10 degrees, 2 right 10 degrees (among people also 3, wait), each
    subject to actuation noise. With `actions="velocity"`: Box (2,), forward speed [-1, 1] as a fraction of the robot's
    `max_speed_mps` and turn rate [-1, 1] as a fraction of its `turn_rate_radps`, held for 0.5 s; the wheels reduce what
    they cannot do along the same arc.

    ## Observation space
    Dict of the senses in `observe`, all in the robot's own frame: rgb, depth, lidar, odometry, radio, map, pose. By
    default depth, odometry and radio. `robosim.environments.senses` has keys, shapes, units and bounds.

    ## Reward
    Weighted sum of the terms of `robosim.environments.rewards`; `rewards={...}` gives the weights, and functions for
    terms of your own. By default metres by which the shortest drive to the target became shorter, minus 0.01 per step,
    plus 10 on arrival.

    ## Start
    Drawn from the seed: the plan if there are several, the target and a start at least 3 m of driving from it.
    `options` of `reset` can set `start` (x, y, yaw [rad]) and `target` (x, y), in the frame of the plan, `plan` (its
    number) and `difficulty` (0 to 1), which bounds the drive.

    ## End
    Terminated when the robot's true position is within 0.3 m of the target. Truncated after 1000 steps.

    `info` holds ground truth that the robot must not know: `pose`, `target`, `distance_m` (of the shortest drive),
    `collided`, `arrived`; after a step also `rewards`, the weighted terms, whose sum is the reward; after a reset
    `plan` and `difficulty`.
    """

    metadata = {"render_modes": ["rgb_array", "ansi"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        plan: object = "flat",
        *,
        config: SimulatorConfig | None = None,
        render_mode: str | None = None,
        **search: Any,
    ) -> None:
        """Nothing is built before the first reset.

        Args:
            plan: Source of plans: see `robosim.environments.sources`.
            config: Configuration of the simulator; by default the fastest with the needed sensors.
            render_mode: None, "rgb_array" or "ansi" (text).
            search: Fields of `SearchConfig`.

        Raises:
            ValueError: If the render mode is unknown, or the robot lacks a sensor that it observes by.
            MapError: If there is no such plan.
        """
        check_render_mode(render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.search = SearchConfig(**search)
        simulator = config or simulator_for(self.search)
        self._searches = Searches(source_of(plan), self.search, simulator)
        self.observation_space, self.action_space = make_spaces(self.search, simulator)

    def reset(
        self, *, seed: SupportsIndex | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start a new search; see the class for `options`."""
        super().reset(seed=None if seed is None else index(seed))
        return self._searches.reset(self.np_random, options)[ROBOT]

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Do one action."""
        observation, reward, arrived, info = self._searches.step(self._searches.commands_of({ROBOT: action}))[
            ROBOT
        ]
        return observation, reward, arrived, False, info

    def render(self) -> UInt8[np.ndarray, "height width 3"] | str | None:
        """The camera's view next to the plan with the robot's trajectory, or the plan as text."""
        if self.render_mode is None:
            return None
        return self.current.text() if self.render_mode == "ansi" else self.current.picture()

    @property
    def current(self) -> Search:
        """The current search, for guides that know the route and agents that need the robot's own observation."""
        return self._searches.robots[ROBOT]

    def close(self) -> None:
        """Free the camera."""
        self._searches.close()


def check_render_mode(mode: str | None, known: list[str]) -> None:
    """Raise ValueError if a render mode is unknown."""
    if mode not in (None, *known):
        raise ValueError(f"render_mode = {mode!r}, expected None or one of {', '.join(known)}.")
