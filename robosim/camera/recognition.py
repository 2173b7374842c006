"""Recognisers of the target in the pictures of the robot's camera.

`marker` finds the ArUco marker in the picture, at 128 x 128 pixels up to about 1.5 m, at 256 x 256 up to 3 m. Its
distance is that of the depths of its pixels; its size in the picture, a few pixels, would be wrong by a tenth.
`perfect` stands for a recogniser that never fails, as in the published comparison: it finds the target, at its true
place, whenever some of its marker box is in the picture with nothing in front of it.

References: Garrido-Jurado et al., Pattern Recognition 47 (2014), for the marker; arXiv 2110.14789 for the other.
"""

from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Float, Float32

from robosim.camera.model import RGBD, CameraConfig
from robosim.camera.target import DICTIONARY, TargetConfig

#: Surfaces nearer than the target's box by more than this hide it [m].
_SLACK_M = 0.05
#: Pixels with a depth that a marker must have, for its plane to be fitted to.
_LEAST_PIXELS = 9

#: Middle of a marker and unit vector into its box, both x to the right, z ahead [m].
_Side = tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]


@runtime_checkable
class Recogniser(Protocol):
    """Finds the target in a picture."""

    def find(self, frame: RGBD, target: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"] | None:
        """Place of the target x ahead, y left [m] of the robot; None if it is not found.

        The frame has depths as measured; `target` is the true place, only for perfect recognisers.
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
            side = self._by_depth(frame.depth, corners[0]) or self._by_size(corners[0])
            if side is None:
                return None
            # The marker lies on the side of a box: the target's middle is behind it, along its inward normal.
            (x, z), inward = side
            x, z = (x, z) + 0.5 * self._target.box_m * inward
            return np.array([z, -x])
        return None

    def _by_depth(
        self, depth: Float32[np.ndarray, "h w"], corners: Float32[np.ndarray, "4 2"]
    ) -> _Side | None:
        """The upright plane through the depths of a marker's pixels; None if too few were measured."""
        inside = np.zeros(depth.shape, np.uint8)
        cv2.fillConvexPoly(inside, np.rint(corners).astype(np.int32), 1)
        rows, columns = np.nonzero(inside)
        measured = depth[rows, columns] > 0
        if measured.sum() < _LEAST_PIXELS:
            return None
        z, columns = depth[rows, columns][measured].astype(float), columns[measured]
        # A pixel at the rim may be one of the wall behind.
        near = np.abs(z - np.median(z)) < 0.5 * self._target.marker_m
        across = (columns[near] - self._k[0, 2]) / self._k[0, 0]
        slope, at_axis = np.polyfit(across, 1 / z[near], 1)
        middle = (corners[:, 0].mean() - self._k[0, 2]) / self._k[0, 0]
        far = 1 / (at_axis + slope * middle)
        inward = np.array([slope, at_axis]) / np.hypot(slope, at_axis)
        return np.array([middle * far, far]), inward

    def _by_size(self, corners: Float32[np.ndarray, "4 2"]) -> _Side | None:
        """The marker's side by its corners alone; None if they do not determine one."""
        solved, turn, at = cv2.solvePnP(
            self._corners, corners.astype(np.float64), self._k, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        if not solved or at[2, 0] <= 0:
            return None
        inward = -cv2.Rodrigues(turn)[0][:, 2]
        return at[[0, 2], 0], inward[[0, 2]] * np.sign(inward[2] or 1.0)


class PerfectRecogniser:
    """Knows the target whenever any of it is in the picture."""

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
