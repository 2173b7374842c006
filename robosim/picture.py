"""One picture of a moment: the camera's view beside the map as it grows.

Drawn by OpenCV straight into an array, since a video needs one for every decision.
"""

import cv2
import numpy as np
import shapely
from jaxtyping import Float, UInt8

from robosim.belief import TargetBelief
from robosim.building import Building
from robosim.hearing import Heard
from robosim.tasks import Task
from slam.grid import GridFrame, MapEstimate
from wireless.paths import LinkState

HEIGHT = 384
_BAR = 32
_MAX_MAP_WIDTH = 640
_MARGIN_M = 0.4

# Okabe and Ito's palette (2008), which colour-blind people can tell apart.
UNKNOWN_GREY = (200, 200, 200)
FREE_WHITE = (255, 255, 255)
OBSTACLE_BLACK = (30, 30, 30)
WALL_BLUE = (86, 180, 233)
TRUE_GREEN = (0, 158, 115)
ESTIMATE_ORANGE = (230, 159, 0)
PATH_PURPLE = (204, 121, 167)
TARGET_RED = (213, 94, 0)
#: Colour of each link state: outage, line of sight, first order, higher order.
STATE_COLOURS = {
    LinkState.OUTAGE: (120, 120, 120),
    LinkState.LOS: (0, 158, 115),
    LinkState.FIRST_ORDER: (0, 114, 178),
    LinkState.HIGHER_ORDER: (213, 94, 0),
}
#: Length of the strongest arrival's arrow [m].
ARRIVAL_M = 1.5
_PALETTE = np.zeros((256, 1, 3), np.uint8)
_PALETTE[:4, 0] = UNKNOWN_GREY, FREE_WHITE, OBSTACLE_BLACK, TARGET_RED

#: Bits of a pixel's fraction in OpenCV's fixed-point coordinates: lines then fall between pixels smoothly.
_SHIFT = 4


class Picture:
    """Draws the camera's view beside the map, at one scale for a whole episode."""

    def __init__(self, building: Building, task: Task) -> None:
        """Fix the scale so that the whole building fits."""
        west, south, east, north = building.free.bounds
        extent = np.array([east - west, north - south]) + 2 * _MARGIN_M
        self._px_per_m = float(min(HEIGHT / extent[1], _MAX_MAP_WIDTH / extent[0]))
        width = max(int(extent[0] * self._px_per_m), HEIGHT // 2)
        self._map_width = width + width % 2
        slack = np.array([self._map_width, HEIGHT]) / self._px_per_m - extent
        self._corner = np.array([west, south]) - _MARGIN_M - slack / 2
        self._walls = [
            self._fixed(np.asarray(ring.coords)) for part in building.free.geoms for ring in _rings(part)
        ]
        self._target = task.target
        self._true = np.zeros((0, 1, 2), np.int32)
        self._estimated = np.zeros((0, 1, 2), np.int32)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return HEIGHT + self._map_width, HEIGHT + _BAR

    def draw(
        self,
        rgb: UInt8[np.ndarray, "h w 3"],
        depth: Float[np.ndarray, "h w"],
        pose: Float[np.ndarray, "3"],
        estimate: MapEstimate | None = None,
        *,
        goal: Float[np.ndarray, "2"] | None = None,
        path: Float[np.ndarray, "n 2"] | None = None,
        heard: Heard | None = None,
        belief: TargetBelief | None = None,
        text: str = "",
    ) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of one decision.

        Args:
            rgb: What the camera sees.
            depth: Its depth [m]; drawn small in a corner.
            pose: True pose of the robot; the trajectory grows by one point a call.
            estimate: The map built so far, and the estimated pose; none shows the true walls alone.
            goal: Where the robot wants to go.
            path: How it means to get there.
            heard: What its radio heard: an arrow for each path from where it comes, thicker for stronger ones.
            belief: Where the target may be; the likelier, the redder.
            text: A line below.
        """
        self._true = np.concatenate([self._true, self._fixed(pose[None, :2])])
        if estimate is not None:
            self._estimated = np.concatenate([self._estimated, self._fixed(estimate.pose[None, :2])])
        image = np.full((HEIGHT + _BAR, HEIGHT + self._map_width, 3), 255, np.uint8)
        image[:HEIGHT, :HEIGHT] = self._camera(rgb, depth)
        canvas = self._base(estimate)
        if belief is not None:
            self._tint(canvas, belief)
        cv2.polylines(canvas, self._walls, True, WALL_BLUE, 1, cv2.LINE_AA, _SHIFT)
        cv2.polylines(canvas, [self._true], False, TRUE_GREEN, 2, cv2.LINE_AA, _SHIFT)
        cv2.polylines(canvas, [self._estimated], False, ESTIMATE_ORANGE, 1, cv2.LINE_AA, _SHIFT)
        if path is not None and len(path) > 1:
            cv2.polylines(canvas, [self._fixed(path)], False, PATH_PURPLE, 1, cv2.LINE_AA, _SHIFT)
        if heard is not None:
            self._draw_arrivals(canvas, heard)
        if goal is not None:
            cv2.drawMarker(canvas, self._pixel(goal), PATH_PURPLE, cv2.MARKER_CROSS, 10, 2)
        cv2.drawMarker(canvas, self._pixel(self._target), TARGET_RED, cv2.MARKER_STAR, 12, 2)
        nose = pose[:2] + 0.3 * np.array([np.cos(pose[2]), np.sin(pose[2])])
        cv2.circle(canvas, self._pixel(pose[:2]), 4, TRUE_GREEN, -1, cv2.LINE_AA)
        cv2.line(canvas, self._pixel(pose[:2]), self._pixel(nose), TRUE_GREEN, 2, cv2.LINE_AA)
        image[:HEIGHT, HEIGHT:] = canvas
        baseline = (8, HEIGHT + _BAR - 11)
        cv2.putText(image, text, baseline, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
        return image

    def _draw_arrivals(self, canvas: np.ndarray, heard: Heard) -> None:
        """Arrows along the estimated arrivals, in the colour of the link state; the strongest thickest."""
        colour = STATE_COLOURS[heard.state]
        at = self._pixel(heard.pose[:2])
        for i in range(len(heard.aoa_rad))[::-1]:
            angle, below_db = heard.aoa_rad[i], heard.snr_db[0] - heard.snr_db[i]
            reach = ARRIVAL_M * max(1.0 - below_db / 40.0, 0.25)
            tip = self._pixel(heard.pose[:2] + reach * np.array([np.cos(angle), np.sin(angle)]))
            cv2.arrowedLine(canvas, at, tip, colour, 2 if i == 0 else 1, cv2.LINE_AA, tipLength=0.15)

    def _camera(self, rgb: np.ndarray, depth: np.ndarray) -> np.ndarray:
        view = cv2.resize(rgb, (HEIGHT, HEIGHT), interpolation=cv2.INTER_LINEAR)
        near = np.where(depth > 0, np.clip(255 - 40 * depth, 0, 255), 0).astype(np.uint8)
        inset = HEIGHT // 4
        small = cv2.resize(near, (inset, inset), interpolation=cv2.INTER_NEAREST)
        view[-inset:, :inset] = small[:, :, None]
        return view

    def _base(self, estimate: MapEstimate | None) -> np.ndarray:
        """The built map as colours, resampled to the picture's pixels."""
        if estimate is None:
            return np.full((HEIGHT, self._map_width, 3), 255, np.uint8)
        kind = estimate.explored.astype(np.uint8)
        kind[estimate.obstacle] = 2
        kind[estimate.blocked] = 3
        base = self._resampled(kind, estimate.frame, cv2.INTER_NEAREST)
        return cv2.LUT(cv2.cvtColor(base, cv2.COLOR_GRAY2RGB), _PALETTE)

    def _tint(self, canvas: np.ndarray, belief: TargetBelief) -> None:
        """Redden the map where the target is likelier than if nothing were known; most from a thousand times on."""
        p = self._resampled(belief.probability(), belief.frame, cv2.INTER_LINEAR)
        times = np.maximum(p * belief.frame.shape[0] * belief.frame.shape[1], 1.0)
        share = 0.7 * np.minimum(np.log10(times) / 3, 1.0)[..., None]
        canvas[:] = (1 - share) * canvas + share * np.array(TARGET_RED)

    def _resampled(self, grid: np.ndarray, frame: GridFrame, how: int) -> np.ndarray:
        """A grid of `map` at the picture's pixels; 0 beyond it."""
        cell_per_px = 1 / (self._px_per_m * frame.resolution_m)
        first = (self._corner - frame.origin_xy) / frame.resolution_m
        # Canvas rows run downwards, map rows upwards; pixel and cell centres lie half a step in.
        affine = np.array(
            [
                [cell_per_px, 0, first[0] + 0.5 * cell_per_px - 0.5],
                [0, -cell_per_px, first[1] + (HEIGHT - 0.5) * cell_per_px - 0.5],
            ]
        )
        flags = how | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(grid, affine, (self._map_width, HEIGHT), flags=flags, borderValue=0)

    def _pixels(self, points: np.ndarray) -> np.ndarray:
        """Continuous canvas pixels (column, row) of points of `map`."""
        across = (np.asarray(points, float) - self._corner) * self._px_per_m
        return np.column_stack([across[:, 0], HEIGHT - across[:, 1]])

    def _fixed(self, points: np.ndarray) -> np.ndarray:
        """The same in OpenCV's fixed-point numbers."""
        return np.rint(self._pixels(points) * (1 << _SHIFT)).astype(np.int32)[:, None, :]

    def _pixel(self, point: np.ndarray) -> tuple[int, int]:
        column, row = np.rint(self._pixels(np.asarray(point)[None, :2])[0]).astype(int)
        return int(column), int(row)


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    return [polygon.exterior, *polygon.interiors]
