"""A transmitter that a camera can recognise, with an ArUco marker on each side, and its recognisers.

It hangs from the ceiling. Each cell of a marker is a square of plain black or white, so that no texture is needed and
the pattern is exact at any distance. Around the marker lies a white margin, which detection needs. Colours are drawn
as they are, without light. The target is for cameras only: it stops neither robots, which pass below, nor radio
waves.

`marker` finds the ArUco marker in the picture, at 128 x 128 pixels up to about 1.5 m, at 256 x 256 up to 3 m. Its
distance is that of the depths of its pixels; its size in the picture, a few pixels, would be wrong by a tenth.
`perfect` stands for a recogniser that never fails, as in the published comparison: it finds the target, at its true
place, whenever some of its marker box is in the picture with nothing in front of it.

References: Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial markers under
occlusion", Pattern Recognition 47 (2014), for the marker; arXiv 2110.14789 for `perfect`.
"""

from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import cv2
import numpy as np
import trimesh
from jaxtyping import Float, Float32, UInt8

from robosim.camera.model import RGBD, CameraConfig
from robosim.support.checks import Range, checked

#: The dictionary of the markers: 50 of them, with 4 by 4 cells inside of a black frame.
DICTIONARY = cv2.aruco.DICT_4X4_50
_MARKER_CELLS = 6
_WHITE, _BODY, _RADIO = (255, 255, 255), (214, 96, 40), (52, 60, 72)
# Corners of a box's side as seen from outside: across and up.
_SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@dataclass(frozen=True, kw_only=True)
@checked
class TargetConfig:
    """Size and marker of the target."""

    marker_id: Annotated[int, Range(0, 49, "", "DICT_4X4_50 has 50 markers.")] = 7
    """Which of the 50 markers of OpenCV's DICT_4X4_50 it carries."""
    marker_m: Annotated[float, Range(0.001, 1, "m")] = 0.24
    """Side of a marker, without its margin [m]."""
    margin_m: Annotated[float, Range(0.001, 1, "m")] = 0.04
    """White margin around a marker [m]; a cell of the marker is a sixth of its side."""
    marker_height_m: Annotated[float, Range(0.01, 100, "m")] = 1.72
    """Height of the markers' middle above the floor [m]."""
    radio_height_m: Annotated[float, Range(0.01, 100, "m")] = 1.5
    """Height of the radio's middle above the floor [m]."""
    radio_m: Annotated[float, Range(0.001, 1, "m")] = 0.12
    """Width and height of the radio, which hangs below the markers [m]."""
    rod_m: Annotated[float, Range(0.001, 1, "m")] = 0.03
    """Width of the rod up to the ceiling [m]."""

    def __post_init__(self) -> None:
        lowest = self.radio_height_m + self.radio_m / 2 + self.box_m / 2
        if not (self.radio_height_m > self.radio_m / 2 and self.marker_height_m >= lowest):
            raise ValueError(
                f"radio_height_m is {self.radio_height_m} and marker_height_m {self.marker_height_m}, expected the "
                f"radio above the floor and the markers above it, here at {lowest:g} m or more."
            )

    @property
    def box_m(self) -> float:
        """Side of the box that carries the markers [m]."""
        return self.marker_m + 2 * self.margin_m


def target_mesh(
    position_xy: Float[np.ndarray, "2"],
    *,
    config: TargetConfig = TargetConfig(),
    yaw: float = 0.0,
    ceiling_m: float = 2.5,
) -> trimesh.Trimesh:
    """The target, hanging from the ceiling at x, y [m] in `map`, in vertex colours.

    Its first side faces `yaw` [rad]. The markers stay below the ceiling [m] only if that is high enough.
    """
    half, middle = config.box_m / 2, config.marker_height_m
    radio, radio_half = config.radio_height_m, config.radio_m / 2
    boxes = [
        _box(radio_half, radio - radio_half, radio + radio_half, _RADIO),
        _box(config.rod_m / 2, radio + radio_half, max(ceiling_m, middle + half), _BODY),
        _box(half, middle - half, middle + half, None),
    ]
    quads, colours = (list(column) for column in zip(*boxes, strict=True))
    cells, shades = _marker(config)
    for quarter in range(4):
        quads.append(_rotate_z(cells, quarter * np.pi / 2))
        colours.append(shades)
    corners = _rotate_z(np.concatenate(quads), yaw) + np.array([*position_xy, 0.0])
    shade = np.concatenate(colours)
    faces = 4 * np.arange(len(corners))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    rgba = np.column_stack([shade, np.full(len(shade), 255, np.uint8)]).repeat(4, axis=0)
    return trimesh.Trimesh(
        corners.reshape(-1, 3),
        faces.reshape(-1, 3),
        vertex_colors=rgba,
        process=False,
    )


def _marker(config: TargetConfig) -> tuple[Float[np.ndarray, "64 4 3"], UInt8[np.ndarray, "64 3"]]:
    """The side of the box that faces +x: the squares of its pattern with their margin, and their colours."""
    dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
    pattern = cv2.aruco.generateImageMarker(dictionary, config.marker_id, _MARKER_CELLS)
    grey = np.pad(pattern, 1, constant_values=255)[::-1]  # rows from below
    lines = np.linspace(-config.marker_m / 2, config.marker_m / 2, _MARKER_CELLS + 1)
    lines = np.concatenate([[-config.box_m / 2], lines, [config.box_m / 2]])
    up, across = np.meshgrid(np.arange(len(lines) - 1), np.arange(len(lines) - 1), indexing="ij")
    step = ((_SQUARE + 1) / 2).astype(int)
    corners = np.empty((*up.shape, 4, 3))
    corners[..., 0] = config.box_m / 2
    corners[..., 1] = lines[across[..., None] + step[:, 0]]
    corners[..., 2] = lines[up[..., None] + step[:, 1]] + config.marker_height_m
    return corners.reshape(-1, 4, 3), np.repeat(grey.reshape(-1, 1), 3, axis=1)


def _box(
    half: float, low: float, high: float, colour: tuple[int, int, int] | None
) -> tuple[Float[np.ndarray, "n 4 3"], UInt8[np.ndarray, "n 3"]]:
    """Top and bottom of an upright box, and its four sides if it has a colour; without one, markers cover them."""
    lid = np.column_stack([half * _SQUARE, np.full(4, high)])
    floor = np.column_stack([half * _SQUARE[::-1], np.full(4, low)])
    if colour is None:
        return np.stack([lid, floor]), np.full((2, 3), _WHITE, np.uint8)
    z = np.where(_SQUARE[:, 1] > 0, high, low)
    side = np.column_stack([np.full(4, half), half * _SQUARE[:, 0], z])
    sides = [_rotate_z(side, quarter * np.pi / 2) for quarter in range(4)]
    shades = np.array([1.0, 0.7, 1.0, 1.0, 0.85, 0.75])  # lid, floor, sides: so that edges show
    return np.stack([lid, floor, *sides]), (shades[:, None] * colour).round().astype(np.uint8)


def _rotate_z(points: Float[np.ndarray, "*n 3"], angle: float) -> Float[np.ndarray, "*n 3"]:
    """Points rotated about the z axis, counter-clockwise as seen from above."""
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


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
        """Place of the target x ahead, y left [m] of the camera; None if it is not found.

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
        """Place of the target x ahead, y left [m] of the camera; None if its marker is not found."""
        outlines, ids, _ = self._detector.detectMarkers(cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2GRAY))
        if ids is None:
            return None
        for corners, marker in zip(outlines, ids.ravel(), strict=True):
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
