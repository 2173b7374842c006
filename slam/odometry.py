"""Errors of odometry per action: a constant part, a random part, and an online correction.

The noise measured on a LoCoBot is mostly constant: each kind of action has its own mean error (a turn reads 2 cm of
sideways motion that did not happen), and a third or less of it is random. How large the random part is differs more
still: the heading after a step forward is known ten times as well as after a turn, and equal values would let each scan
turn the robot a little. So both parts are stored per action, as a calibration with a reference finds them
(`calibrated`).

Constants drift with tyres and floors. Where scans fit the map well, the difference between measured and matched
motion is a sample of the constant: a Kalman filter per action moves it, no faster than the calibration's own
uncertainty, the spread of the random part and that of the match allow.
Reference: Murali et al., PyRobot, 2019 (the noise measured); Chaplot et al., ICLR 2020, section 3; Borenstein and
Feng, Measurement and correction of systematic odometry errors in mobile robots, IEEE Trans. Robotics and Automation 12
(1996).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from jaxtyping import Float

from robosim.support.checks import Range, checked
from slam.actions import FORWARD_M, MOVES, TURN_RAD, Action, Command, Velocity
from slam.poses import Covariance, Pose

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

#: Least standard deviations [m, m, rad]: no robot's are smaller, and a covariance has to have an inverse.
_LEAST = np.array([1e-6, 1e-6, 1e-6])
#: An innovation farther out than this many standard deviations is no sample of the constant error: wheels slipped.
_SLIPPED = 4.0
#: Variance by which a constant error may drift in an action, as a share of the random part's.
_DRIFT = 1e-5


@dataclass(frozen=True, kw_only=True)
@checked
class ActionError:
    """Measured minus true displacement of one kind of action, x, y [m] and yaw [rad] in the robot's frame before it."""

    mean: Annotated[Vector, Range(-1, 1, "m and rad")] = (0.0, 0.0, 0.0)
    """Its constant part [m, m, rad]."""
    covariance: Matrix = ((1.6e-5, 0.0, 0.0), (0.0, 1.6e-5, 0.0), (0.0, 0.0, 9e-6))
    """Covariance of its random part [m^2, m rad, rad^2]; 4 mm and 0.17 degrees without calibration."""
    motion: Annotated[Vector | None, Range(-100, 100, "m and rad")] = None
    """True mean displacement of the action on open floor: x, y [m], yaw [rad]. None without calibration."""

    def __post_init__(self) -> None:
        matrix = np.asarray(self.covariance, float)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise ValueError("covariance has to be three rows of three numbers [m^2, m rad, rad^2].")
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-15) or np.linalg.eigvalsh(matrix)[0] < -1e-12:
            raise ValueError("covariance is not symmetric and positive, as covariances are.")

    @property
    def reverse(self) -> "ActionError":
        """Error of the reversed action: constant parts change their signs, the random part does not."""
        x, y, yaw = self.mean
        back = None if self.motion is None else (-self.motion[0], -self.motion[1], -self.motion[2])
        return replace(self, mean=(-x, -y, -yaw), motion=back)


#: While the robot stands still.
_STANDING = ActionError(covariance=((1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1e-12)))


@dataclass(frozen=True, kw_only=True)
@checked
class OdometryConfig:
    """Errors of measured displacements, action by action."""

    forward: ActionError = field(default_factory=ActionError)
    """Error of a step forward."""
    left: ActionError = field(default_factory=ActionError)
    """Error of a turn to the left."""
    right: ActionError = field(default_factory=ActionError)
    """Error of a turn to the right."""
    backward: ActionError | None = None
    """Error of a step back. None where it was not measured: the reverse of a step forward."""
    runs: Annotated[int, Range(0, 1_000_000_000, "runs")] = 0
    """Measured actions of each kind that the numbers above come from; 0 if they are guessed."""
    guess_position_std_m: Annotated[float, Range(0, 10, "m")] = 0.02
    """How far guessed constants may be off [m]."""
    guess_yaw_std_rad: Annotated[float, Range(0, 10, "rad")] = 0.005
    """How far guessed turns may be off [rad]."""

    @property
    def of_actions(self) -> tuple[ActionError, ...]:
        """In the order of `MOVES`."""
        back = self.backward or self.forward.reverse
        by_action = {
            Action.FORWARD: self.forward,
            Action.LEFT: self.left,
            Action.RIGHT: self.right,
            Action.BACKWARD: back,
        }
        return tuple(by_action[action] for action in MOVES)


def calibrated(
    errors: Mapping[Action, Float[np.ndarray, "n 3"]],
    motions: Mapping[Action, Float[np.ndarray, "n 3"]] | None = None,
) -> OdometryConfig:
    """Calibration of odometry from measured actions.

    Args:
        errors: Measured minus true displacement of each run of an action, x, y [m] and yaw [rad] in the robot's frame
            before it; ground truth comes from a motion capture, a total station, marks on the floor, or a simulator.
            A step back may be missing.
        motions: The true displacements, if what the actions do is to be known too.

    Raises:
        ValueError: If an action has fewer than ten runs.
    """
    errors_of: dict[str, ActionError] = {}
    for action in MOVES:
        samples = np.asarray(errors.get(action, np.zeros((0, 3))), float)
        if action is Action.BACKWARD and not len(samples):
            continue
        if len(samples) < 10:
            raise ValueError(
                f"{action.name.lower()} was run {len(samples)} times: a covariance takes ten, and good ones a hundred."
            )
        mean, covariance = samples.mean(axis=0), np.cov(samples.T)
        errors_of[action.name.lower()] = ActionError(
            mean=(float(mean[0]), float(mean[1]), float(mean[2])),
            covariance=tuple(tuple(float(value) for value in row) for row in covariance),  # type: ignore[arg-type]
            motion=None if motions is None else tuple(float(v) for v in np.mean(motions[action], axis=0)),  # type: ignore[arg-type]
        )
    return OdometryConfig(
        forward=errors_of["forward"],
        left=errors_of["left"],
        right=errors_of["right"],
        backward=errors_of.get("backward"),
        runs=min(len(errors[Action[name.upper()]]) for name in errors_of),
    )


class OdometryCorrector:
    """Takes the constant error off measured displacements, and learns what of it has changed."""

    def __init__(self, config: OdometryConfig) -> None:
        self.config = config
        errors = (*config.of_actions, _STANDING)  # in the order of `Action`
        self.bias = np.array([error.mean for error in errors], float)
        least = np.diag(_LEAST**2)
        self._noise = np.array([error.covariance for error in errors], float) + least
        guess = np.array([config.guess_position_std_m, config.guess_position_std_m, config.guess_yaw_std_rad])
        guessed = np.broadcast_to(np.diag(guess**2), self._noise.shape)
        self.bias_covariance = self._noise / config.runs if config.runs else guessed.copy()
        self.bias_covariance[Action.WAIT] = least

    def correct(self, action: Command, measured: Pose) -> tuple[Pose, Covariance]:
        """Displacement without its constant error, and the covariance of what is left.

        The motion of a velocity counts as parts of a step and of a turn: constants grow with the parts, and so do the
        variances of the random part, as of independent pieces.
        """
        if isinstance(action, Velocity):
            corrected = measured
            for _ in range(2):  # the parts are those of the true motion
                ahead, turn = corrected[0] / FORWARD_M, corrected[2] / TURN_RAD
                actions = [
                    Action.FORWARD if ahead > 0 else Action.BACKWARD,
                    Action.LEFT if turn > 0 else Action.RIGHT,
                ]
                parts = np.abs([ahead, turn])
                corrected = measured - parts @ self.bias[actions]
            random = np.tensordot(parts, self._noise[actions], 1)
            constant = np.tensordot(parts**2, self.bias_covariance[actions], 1)
            return corrected, self._noise[Action.WAIT] + random + constant
        return measured - self.bias[action], self._noise[action] + self.bias_covariance[action]

    def learn(self, action: Command, measured: Pose, matched: Pose, matched_covariance: Covariance) -> None:
        """Move the constant error of an action towards what a matched displacement says of it; not of a velocity."""
        if action is Action.WAIT or isinstance(action, Velocity):
            return
        before = self.bias_covariance[action] + _DRIFT * self._noise[action]
        innovation = measured - matched - self.bias[action]
        spread = before + self._noise[action] + matched_covariance
        if innovation @ np.linalg.solve(spread, innovation) > _SLIPPED**2:
            return
        gain = np.linalg.solve(spread, before).T
        self.bias[action] += gain @ innovation
        after = before - gain @ before
        self.bias_covariance[action] = 0.5 * (after + after.T)
