"""Judges an episode by the truth: the area seen, whether the robot has arrived, and whether it goes on."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from robosim.building.reach import Reach
from robosim.episode_log import EpisodeLog
from robosim.simulator import Simulator
from robosim.step import Truth
from robosim.task.coverage import Coverage


class Judge:
    """Keeps the log of an episode, and ends it: by the true pose, by one rule for every policy."""

    def __init__(self, log: EpisodeLog, robot: Simulator, reach: Reach, max_steps: int) -> None:
        """Begin with nothing seen.

        Args:
            log: Is filled; its task says where to.
            robot: Body and sensors of the robot.
            reach: Area that its hull can reach; coverage is counted over it.
            max_steps: Actions before the episode is given up.
        """
        self.log, self._robot, self._max_steps = log, robot, max_steps
        floor = reach.swept(reach.part_near(log.task.start[:2], reach.radius_m))
        image = robot.config.image
        self.coverage = Coverage(robot.building.plan, floor, np.radians(image.hfov_deg), image.ahead_m)

    def observe(self, truth: Truth, estimate: Float[np.ndarray, "3"]) -> Truth:
        """Log a step; set `log.ended` if the episode ends with it. Returns the truth with the coverage so far."""
        log, coverage = self.log, self.coverage
        coverage.update(truth.pose, self._robot.true_depth, self._robot.true_laser)
        log.add_pose(truth.motion, truth.pose, estimate, coverage.fraction)
        if log.seeks_target and log.arrived:
            log.ended = "arrived"
        elif log.steps >= self._max_steps:
            log.ended = "out of steps"
        return replace(truth, coverage=coverage.fraction)
