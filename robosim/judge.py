"""Judges an episode by the truth: what was seen, whether the robot has arrived, and whether it goes on."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from robosim.building.building import Building
from robosim.building.reach import Reach
from robosim.episode_log import EpisodeLog
from robosim.simulator import Simulator
from robosim.step import Truth
from robosim.task.coverage import Coverage
from robosim.task.tasks import Task


class Judge:
    """Keeps the log of an episode, and ends it: by the true pose, by one rule for every policy."""

    def __init__(
        self,
        robot: Simulator,
        building: Building,
        reach: Reach,
        task: Task,
        max_steps: int,
        seeks_target: bool,
    ) -> None:
        """Begin with nothing seen.

        Args:
            robot: Body and sensors of the robot.
            building: Where it is.
            reach: What its hull can reach there; coverage is counted over it.
            task: From where to where.
            max_steps: Actions before the episode is given up.
            seeks_target: Whether the episode ends on arrival.
        """
        self.log = EpisodeLog(task, seeks_target=seeks_target)
        self._robot, self._max_steps = robot, max_steps
        floor = reach.swept(reach.part_near(task.start[:2], reach.radius_m))
        image = robot.config.image
        self._coverage = Coverage(building.plan, floor, np.radians(image.hfov_deg), image.ahead_m)

    def observe(self, truth: Truth, estimate: Float[np.ndarray, "3"]) -> Truth:
        """Log a step, and set `log.ended` if the episode ends with it; return the truth with the coverage so far.

        Args:
            truth: What is true after the last action.
            estimate: Estimated pose x [m], y [m], yaw [rad].
        """
        log, coverage = self.log, self._coverage
        coverage.update(truth.pose, self._robot.true_depth, self._robot.true_laser)
        log.add_pose(truth.motion, truth.pose, estimate, coverage.fraction)
        if log.seeks_target and log.arrived:
            log.ended = "arrived"
        elif log.steps >= self._max_steps:
            log.ended = "out of steps"
        return replace(truth, coverage=coverage.fraction)
