"""Whether the robot's camera sees the target, and where it is.

`marker` finds the ArUco marker in the picture and solves for where it hangs: at 128 x 128 pixels up to about
1.5 m, at 256 x 256 up to 3 m. `perfect` takes the place of any recogniser that never fails, as the published
comparison does: the target is recognised, at its true place, whenever some of its marker box is in the picture
with nothing before it. That one is told the truth; it is for comparisons.

References: Garrido-Jurado et al., Pattern Recognition 47 (2014), for the marker; arXiv 2110.14789 for the other.
"""

from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Float

from robosim.camera.model import RGBD, CameraConfig
from robosim.camera.target import DICTIONARY, TargetConfig

#: How far before its box the target is taken to be hidden by something else [m].
_SLACK_M = 0.05


@runtime_checkable
class Recogniser(Protocol):
    """Tells where in a picture the target is."""

    def find(self, frame: RGBD, target: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"] | None:
        """Place of the target x ahead, y left [m] of the robot; None if it is not found.

        Args:
            frame: What the camera sees, without noise of depth.
            target: Where the target truly is, x ahead, y left [m]: for who stands in for a perfect recogniser alone.
        """


class MarkerRecogniser:
    """Finds the target's marker in colour pictures."""

    def __init__(self, camera: CameraConfig, target: TargetConfig | None = None) -> None:
        self._camera, self._target = camera, target or TargetConfig()
        # Markers are small in small pictures: look for them as small as the detector can read.
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.minMarkerPerimeterRate = 0.02
        self._detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY), parameters)
        half = self._target.marker_m / 2
        self._corners = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]], np.float64)
        self._k = camera.K.copy()
        self._k[:2, 2] -= 0.5  # OpenCV counts from the centre of the first pixel

    def find(self, frame: RGBD, target: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"] | None:
        """Place of the target x ahead, y left [m] of the robot; None if its marker is not found."""
        found, ids, _ = self._detector.detectMarkers(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY))
        if ids is None:
            return None
        for corners, marker in zip(found, ids.ravel(), strict=True):
            if marker != self._target.marker_id:
                continue
            solved, turn, at = cv2.solvePnP(
                self._corners, corners[0].astype(np.float64), self._k, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
            if not solved or at[2, 0] <= 0:
                return None
            # The marker lies on the side of a box: the target's middle is behind it, along its inward normal.
            inward = -cv2.Rodrigues(turn)[0][:, 2]
            middle = at[:, 0] + 0.5 * self._target.box_m * inward * np.sign(inward[2] or 1.0)
            return np.array([middle[2], -middle[0]])
        return None


class PerfectRecogniser:
    """Knows the target when any of it is in the picture."""

    def __init__(self, camera: CameraConfig, target: TargetConfig | None = None) -> None:
        self._camera, self._target = camera, target or TargetConfig()

    def find(self, frame: RGBD, target: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"] | None:
        """True place of the target x ahead, y left [m] of the robot; None if nothing of its box is seen."""
        depth, local = frame.depth, target
        f, half = self._camera.focal_px, 0.5 * self._target.box_m
        ahead = local[0] - half
        if ahead <= self._camera.near_m:
            return None
        up = self._target.marker_height_m - self._camera.height_m
        h, w = depth.shape
        columns = np.array([-(local[1] + half), -(local[1] - half)]) * f / local[0] + 0.5 * w
        rows = np.array([-(up + half), -(up - half)]) * f / local[0] + 0.5 * h
        left, right = np.clip(np.rint(columns).astype(int), 0, w)
        top, bottom = np.clip(np.rint(rows).astype(int), 0, h)
        seen = depth[top:bottom, left:right]
        # Pixels of the box itself lie between its nearest and its farthest corner.
        spread = np.sqrt(2) * half + _SLACK_M
        return local if (np.abs(seen - local[0]) <= spread).any() else None
