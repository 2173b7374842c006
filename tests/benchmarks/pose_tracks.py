"""Methods to estimate the pose, on the same frames: odometry, RGB-D odometry of OpenCV, mappers.

Each but the mappers adds up displacements from the true start. Errors are those of evo: ATE is the root mean square
distance of estimated from true places, without alignment, since all begin at the true pose; RPE is the same of the
displacements from frame to frame, and of their turns.
OpenCV's odometry (dense, point-to-plane and photometric) sees two pictures and does not use wheels. It is lost at
times, in turns before bare walls: answers more than 0.1 m or 5 degrees off odometry are replaced by odometry.
Reference: Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012; Park, Zhou and Koltun, Colored
point cloud registration revisited, ICCV 2017; evo, Grupp 2017.
"""

import math
from collections.abc import Collection, Sequence

import cv2
import numpy as np
from jaxtyping import Float

from robosim.camera.model import CameraConfig
from robosim.robot.odometry import NoiseModel
from robosim.simulator import Observation
from slam.actions import Action
from slam.mapping.classical import ClassicalMapper
from slam.poses import between, compose, wrap
from slam.sensing.bearings import Bearing

#: Farthest that OpenCV's answer may be from odometry before it counts as lost [m, rad].
LOST_M, LOST_RAD = 0.1, math.radians(5.0)


class Odometry:
    """Displacements since the frame before, as odometry measures them."""

    def __init__(self, less: NoiseModel | None = None) -> None:
        """Take the constant error of each action off, as a calibration would find it, if the noise is given."""
        self._bias = {action: less.sensor_bias(action) if less else np.zeros(3) for action in Action}

    def begin(self, view: Observation) -> None:
        """Take the first frame."""

    def displacement(self, view: Observation, action: Action) -> Float[np.ndarray, "3"]:
        """Displacement in the robot's frame before the action: x, y [m], yaw [rad]."""
        return view.odometry - self._bias[action]


class OpenCVOdometry:
    """OpenCV's RGB-D odometry between neighbouring frames."""

    def __init__(self, camera: CameraConfig, noise: NoiseModel) -> None:
        """Set it up for a camera."""
        self._fallback = Odometry(less=noise)
        settings = cv2.OdometrySettings()
        matrix = camera.K.astype(np.float32)
        matrix[:2, 2] -= 0.5  # OpenCV counts from the first pixel's centre
        settings.setCameraMatrix(matrix)
        settings.setMaxTranslation(0.5)
        settings.setMaxRotation(30.0)
        settings.setMinDepth(0.1)
        settings.setMaxDepth(10.0)
        settings.setMaxDepthDiff(0.3)
        kind, algorithm = cv2.OdometryType_RGB_DEPTH, cv2.OdometryAlgoType_COMMON
        self._odometry = cv2.Odometry(kind, settings, algorithm)
        self.lost = 0

    @staticmethod
    def available() -> bool:
        """Whether the OpenCV that is installed has it: some builds of 4.x do not."""
        return hasattr(cv2, "Odometry") and hasattr(cv2, "OdometrySettings")

    def begin(self, view: Observation) -> None:
        """Take the first frame."""
        self._before = _frame(view)

    def displacement(self, view: Observation, action: Action) -> Float[np.ndarray, "3"]:
        """See `Odometry`."""
        now, before = _frame(view), self._before
        self._before = now
        odometry = self._fallback.displacement(view, action)
        found, T_now_before = self._odometry.compute(*before, *now)
        if found and np.isfinite(T_now_before).all():
            T_before_now = np.linalg.inv(T_now_before)
            yaw = -math.atan2(T_before_now[0, 2], T_before_now[2, 2])
            estimated = np.array([T_before_now[2, 3], -T_before_now[0, 3], yaw])
            off = estimated - odometry
            if math.hypot(off[0], off[1]) <= LOST_M and abs(wrap(float(off[2]))) <= LOST_RAD:
                return estimated
        self.lost += 1
        return odometry


def _frame(view: Observation) -> tuple[np.ndarray, np.ndarray]:
    depth = view.depth.astype(np.float32)
    depth[~(depth > 0)] = np.nan
    return depth, np.ascontiguousarray(view.rgb[..., ::-1])


class Track:
    """Adds up displacements from the true start."""

    def __init__(self, source: Odometry | OpenCVOdometry, start: Float[np.ndarray, "3"]) -> None:
        self._source = source
        self.poses = [np.array(start, float)]

    def update(self, view: Observation, action: Action | None) -> None:
        """Take in a frame and the action that led to it; None at the first."""
        if action is None:
            self._source.begin(view)
        else:
            self.poses.append(compose(self.poses[-1], self._source.displacement(view, action)))


class MapperTrack:
    """The poses of a mapper that gets the same frames."""

    def __init__(
        self, mapper: ClassicalMapper, start: Float[np.ndarray, "3"], sources: Collection[str] = ()
    ) -> None:
        """Begin.

        Args:
            mapper: Estimates the pose.
            start: Where it begins.
            sources: Names of the transmitters that it receives, where the robot has a radio.
        """
        self._mapper, self._sources = mapper, sources
        self._mapper.reset(start)
        self.poses: list[np.ndarray] = []

    def update(self, view: Observation, action: Action | None) -> None:
        """Take in a frame and the action that led to it; None at the first."""
        estimate = self._mapper.update(
            view.depth, action, view.odometry, laser=view.laser, time_s=view.time_s
        )
        self.poses.append(estimate.pose)

    def listen(self, bearings: Sequence[Bearing]) -> None:
        """Take in where transmitters appear."""
        self._mapper.listen([bearing for bearing in bearings if bearing.source in self._sources])


def trajectory_errors(
    true: Float[np.ndarray, "n 3"], estimated: Float[np.ndarray, "n 3"]
) -> dict[str, float]:
    """ATE and RPE of a trajectory of poses x [m], y [m], yaw [rad].

    Returns:
        `ate_m`: root mean square of distances. `rpe_m` and `rpe_deg`: root mean squares of the errors of displacements
        and of turns from frame to frame. `last_m`, `last_deg`: errors at the end; `worst_m`, `worst_deg`: the largest.
    """
    off = estimated - true
    gap = np.hypot(off[:, 0], off[:, 1])
    steps = [
        between(between(true[k], true[k + 1]), between(estimated[k], estimated[k + 1]))
        for k in range(len(true) - 1)
    ]
    step = np.array(steps).reshape(-1, 3)
    return {
        "ate_m": _rms(gap),
        "rpe_m": _rms(np.hypot(step[:, 0], step[:, 1])),
        "rpe_deg": math.degrees(_rms(step[:, 2])),
        "last_m": float(gap[-1]),
        "worst_m": float(gap.max()),
        "worst_deg": math.degrees(max(abs(wrap(float(yaw))) for yaw in off[:, 2])),
        "last_deg": math.degrees(abs(wrap(float(off[-1, 2])))),
    }


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
