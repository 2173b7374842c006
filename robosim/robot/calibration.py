"""Calibrating a robot's odometry: each action many times, and what was measured against what was true."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from robosim.robot.motion import Physics
from robosim.robot.odometry import NoiseModel
from slam.actions import Action
from slam.poses import between


def run_actions(
    world: Physics,
    start: Float[np.ndarray, "3"],
    noise: NoiseModel,
    runs: int,
    rng: np.random.Generator,
) -> Mapping[Action, Float[np.ndarray, "n 3"]]:
    """Measured minus true displacement of each run of each action, for `slam.mapping.odometry.calibrated`.

    Args:
        world: Moves the robot.
        start: Pose in `map` from which every run begins, with room around it.
        noise: How actions and odometry err.
        runs: How often each action is run.
        rng: Source of the noise.
    """
    errors: dict[Action, Float[np.ndarray, "n 3"]] = {}
    for action in Action:
        errors[action] = np.empty((runs, 3))
        for k in range(runs):
            world.reset(start)
            world.move(noise.actuation(action, rng))
            moved = between(start, world.pose)
            errors[action][k] = noise.sense(action, moved, rng) - moved
    return errors
