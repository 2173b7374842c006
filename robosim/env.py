"""Gymnasium environments.

`robosim/TargetSearch-v0`: find a target in a building from RGB-D and odometry.
"""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.drawing.picture import Picture, building_rings
from robosim.drawing.snapshot import Snapshot, whole_mm
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan
from robosim.simulator import Simulator, SimulatorConfig
from robosim.task.tasks import ARRIVAL_M, make_task
from slam.actions import Action

#: Depth in observations is cut off here [m]: a sensor's range, and the bound of the space.
MAX_DEPTH_M = 10.0

#: Bounds of one odometry reading [m, m, rad]; far beyond what one action can do.
_ODOMETRY_BOUND = np.array([2.0, 2.0, np.pi], np.float32)

#: Full scale of continuous actions, and how long one is held.
MAX_SPEED_MPS = 0.5
MAX_TURN_RADPS = float(np.pi / 2)
STEP_S = 0.5

_ARRIVAL_REWARD = 10.0
_STEP_COST = 0.01


class TargetSearch(gymnasium.Env):
    """A differential-drive robot looks for a target at an unknown place in a building.

    ## Action space
    Discrete (default): 0 forward 0.25 m, 1 left 10 degrees, 2 right 10 degrees, each subject to actuation
    noise. With `continuous=True`: Box (2,), forward speed [-1, 1] as a fraction of 0.5 m/s and turn rate
    [-1, 1] as a fraction of 90 degrees/s, held for 0.5 s.

    ## Observation space
    Dict, all in the robot's own frame:

    | key | shape, type | meaning | min | max |
    |---|---|---|---|---|
    | rgb | (h, w, 3) uint8 | camera picture | 0 | 255 |
    | depth | (h, w, 1) float32 | metres along the camera's axis, 0 nothing hit | 0 | 10 |
    | odometry | (3,) float32 | measured motion since then: dx, dy [m], dyaw [rad] | -2, -2, -pi | 2, 2, pi |

    ## Reward
    Metres by which the shortest drive to the target became shorter, minus 0.01 a step, plus 10 on arrival.

    ## Start
    Drawn from the seed: the target and a start at least 3 m of driving from it. `options` of `reset` may fix
    `start` (x, y, yaw [rad]) and `target` (x, y), in the frame of the plan.

    ## End
    Terminated when the robot's true position is within 0.3 m of the target. Truncated after 1000 steps.

    `info` holds what the robot must not know: `pose`, `target`, `distance_m` (of the shortest drive),
    `collided`, `arrived`.

    ## Versions
    v0: first.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012

    def __init__(
        self,
        plan: str | Path | FloorPlan = "flat",
        *,
        continuous: bool = False,
        config: SimulatorConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Build the scene.

        Args:
            plan: A floor plan, its file, or the name of a shipped one.
            continuous: Whether actions are speeds instead of steps.
            config: What is simulated, and how faithfully.
            render_mode: None or "rgb_array".

        Raises:
            ValueError: If the render mode is unknown.
            MapError: If the plan cannot be read.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode = {render_mode!r}, expected None or 'rgb_array'.")
        self.render_mode = render_mode
        self.continuous = continuous
        config = config or SimulatorConfig()
        floor_plan = plan if isinstance(plan, FloorPlan) else read_plan(plan)
        self._simulator = Simulator(make_building(floor_plan), config)
        self._reach = reach(self._simulator.building, config.robot.radius_m, config.robot.height_m)
        size = (config.image.height, config.image.width)
        self.observation_space = gymnasium.spaces.Dict(
            {
                "rgb": gymnasium.spaces.Box(0, 255, (*size, 3), np.uint8),
                "depth": gymnasium.spaces.Box(0.0, MAX_DEPTH_M, (*size, 1), np.float32),
                "odometry": gymnasium.spaces.Box(-_ODOMETRY_BOUND, _ODOMETRY_BOUND, dtype=np.float32),
            }
        )
        self.action_space: gymnasium.Space[Any] = (
            gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
            if continuous
            else gymnasium.spaces.Discrete(len(Action))
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start a new search; see the class for `options`."""
        super().reset(seed=seed)
        given = {key: np.asarray(value, float) for key, value in (options or {}).items()}
        unknown = set(given) - {"start", "target"}
        if unknown:
            raise ValueError(f"Unknown reset options {sorted(unknown)}. Known: start, target.")
        self._task = make_task(
            self._reach, self.np_random, start=given.get("start"), target=given.get("target")
        )
        self._travel = self._reach.travel_m(self._task.target)
        self._view = self._simulator.reset(self._task, self.np_random)
        self._picture = Picture(building_rings(self._simulator.building), self._task.target)
        self._distance = self._reach.remaining_m(self._travel, self._simulator.pose[:2])
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Do one action."""
        if self.continuous:
            v, w = np.clip(np.asarray(action, float), -1, 1) * (MAX_SPEED_MPS, MAX_TURN_RADPS)
            self._view, motion = self._simulator.drive(float(v), float(w), STEP_S)
        else:
            self._view, motion = self._simulator.step(Action(int(action)))
        before, self._distance = (
            self._distance,
            self._reach.remaining_m(self._travel, self._simulator.pose[:2]),
        )
        gap = np.hypot(*(self._simulator.pose[:2] - self._task.target))
        arrived = bool(gap <= ARRIVAL_M)
        reward = before - self._distance - _STEP_COST + _ARRIVAL_REWARD * arrived
        return self._observation(), float(reward), arrived, False, self._info(motion.collided, arrived)

    def render(self) -> np.ndarray | None:
        """The camera's view beside the plan with the robot's way, if made with `render_mode="rgb_array"`."""
        if self.render_mode is None:
            return None
        moment = Snapshot(
            rgb=self._view.rgb,
            depth_mm=whole_mm(self._view.depth),
            pose=self._simulator.pose,
            text=f"{self._distance:.2f} m to go",
        )
        return self._picture.draw(moment)

    def close(self) -> None:
        """Free the camera."""
        self._simulator.close()

    def _observation(self) -> dict[str, np.ndarray]:
        odometry = np.clip(self._view.odometry, -_ODOMETRY_BOUND, _ODOMETRY_BOUND).astype(np.float32)
        depth = np.clip(self._view.depth, 0, MAX_DEPTH_M).astype(np.float32)[..., None]
        return {"rgb": self._view.rgb, "depth": depth, "odometry": odometry}

    def _info(self, collided: bool = False, arrived: bool = False) -> dict[str, Any]:
        return {
            "pose": self._simulator.pose.copy(),
            "target": self._task.target.copy(),
            "distance_m": self._distance,
            "collided": collided,
            "arrived": arrived,
        }
