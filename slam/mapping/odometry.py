"""What odometry measures wrongly in the same way each time, learned while driving.

The published noise of the LoCoBot is mostly bias: each kind of action has its own constant error (a turn reads 2 cm of
sideways motion that did not happen), and a third or less of it is random. Taking one constant per action off removes
most of the drift. Where scans fit the map well, the difference between measured and matched motion is a sample
of that constant, so a mapper can learn it: a running mean per action, beginning at the calibration.
Reference: Murali et al., PyRobot, 2019 (the noise measured); Chaplot et al., ICLR 2020, section 3.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from slam.actions import Action
from slam.support.checks import check_numbers

Bias = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """Constant and random errors of measured displacements (x [m], y [m], yaw [rad])."""

    forward_bias: Bias = (0.0, 0.0, 0.0)
    """Measured minus true displacement of a step forward, on average."""
    left_bias: Bias = (0.0, 0.0, 0.0)
    """The same for a turn to the left."""
    right_bias: Bias = (0.0, 0.0, 0.0)
    """The same for a turn to the right."""
    learn: bool = True
    """Go on learning the three biases from matched scans."""
    position_std_m: float = 0.004
    """Random error of a measured displacement [m]."""
    yaw_std_rad: float = 0.003
    """Random error of a measured turn [rad]."""
    bias_position_std_m: float = 0.02
    """How far the biases given may be off before anything was learned [m]."""
    bias_yaw_std_rad: float = 0.005
    """The same for the turn [rad]."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            forward_bias=(-1, 1, "m and rad"),
            left_bias=(-1, 1, "m and rad"),
            right_bias=(-1, 1, "m and rad"),
            position_std_m=(1e-9, 10, "m"),
            yaw_std_rad=(1e-9, 10, "rad"),
            bias_position_std_m=(1e-9, 10, "m"),
            bias_yaw_std_rad=(1e-9, 10, "rad"),
        )


class OdometryCorrector:
    """Takes the learned bias off measured displacements."""

    def __init__(self, config: OdometryConfig):
        self.config = config
        self.bias = np.array([config.forward_bias, config.left_bias, config.right_bias], float)
        self._noise = np.array([config.position_std_m, config.position_std_m, config.yaw_std_rad]) ** 2
        spread = [config.bias_position_std_m, config.bias_position_std_m, config.bias_yaw_std_rad]
        self.bias_variance = np.tile(np.array(spread) ** 2 if config.learn else np.zeros(3), (len(Action), 1))

    def correct(
        self, action: Action, measured: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Displacement without its bias, and the variances of its three parts."""
        return measured - self.bias[action], self._noise + self.bias_variance[action]

    def learn(
        self,
        action: Action,
        measured: Float[np.ndarray, "3"],
        matched: Float[np.ndarray, "3"],
        matched_variance: Float[np.ndarray, "3"],
    ) -> None:
        """Move the bias of an action towards what a matched displacement says of it.

        Args:
            action: The action carried out.
            measured: Displacement that odometry measured.
            matched: Displacement between the poses found by matching.
            matched_variance: Variances of the latter; large where the scan said nothing.
        """
        if not self.config.learn:
            return
        innovation = measured - matched - self.bias[action]
        gain = self.bias_variance[action] / (self.bias_variance[action] + self._noise + matched_variance)
        self.bias[action] += gain * innovation
        self.bias_variance[action] *= 1 - gain
