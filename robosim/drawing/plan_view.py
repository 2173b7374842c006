"""A building from above, with scale and legend, drawn by OpenCV, since a video needs it at every step.

A view has one scale for a whole episode.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.building.building import Building
from robosim.layers import BLOCKED, FREE, OBSTACLE, TOP_LEVEL, UNKNOWN, Layer
from robosim.support.colours import Colour
from slam.grid import GridFrame
from slam.poses import Pose

#: Lengths of scale bars [m].
BARS_M = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
#: Height of a line of the legend, and of small text [pixels].
LINE_PX = 20
#: Height of a scale bar with its words [pixels].
SCALE_PX = 34
_INK = (20, 20, 20)
_SMALL = 0.4
#: Size of titles, relative to OpenCV's font.
TITLE_SIZE = 0.45


def bar_m(extent_m: float) -> float:
    """The largest length of a scale bar of at most three tenths of a picture [m]."""
    return max((bar for bar in BARS_M if bar <= 0.3 * extent_m), default=BARS_M[0])


class Entry(NamedTuple):
    """A line of a legend; a heading if it has no colour."""

    text: str
    colour: Colour | None = None
    sign: Literal["line", "area", "cross", "star", "arrow"] = "line"


def legend(entries: Sequence[Entry], width: int, height: int) -> UInt8[np.ndarray, "height width 3"]:
    """A panel with a legend; entries that do not fit into its height [pixels] are left out."""
    panel = np.full((height, width, 3), 255, np.uint8)
    for i, entry in enumerate(entries[: (height - 8) // LINE_PX]):
        y = 8 + LINE_PX * i + LINE_PX // 2
        if entry.colour is None:
            write(panel, entry.text, (8, y + 4))
            continue
        _sign(panel, entry, (20, y))
        write(panel, entry.text, (40, y + 4))
    return panel


def _sign(panel: np.ndarray, entry: Entry, at: tuple[int, int]) -> None:
    (x, y), colour = at, entry.colour or _INK
    if entry.sign == "line":
        cv2.line(panel, (x - 10, y), (x + 10, y), colour, 3, cv2.LINE_AA)
    elif entry.sign == "arrow":
        cv2.arrowedLine(panel, (x - 10, y), (x + 10, y), colour, 2, cv2.LINE_AA, tipLength=0.35)
    elif entry.sign == "area":
        cv2.rectangle(panel, (x - 9, y - 6), (x + 9, y + 6), colour, -1)
        cv2.rectangle(panel, (x - 9, y - 6), (x + 9, y + 6), (120, 120, 120), 1)
    else:
        kind = cv2.MARKER_CROSS if entry.sign == "cross" else cv2.MARKER_STAR
        cv2.drawMarker(panel, at, colour, kind, 12, 2)


def draw_scale(canvas: np.ndarray, px_per_m: float) -> None:
    """Draw a scale bar of a round length in the lower left corner of a map, and an arrow to the north (+y)."""
    height, width = canvas.shape[:2]
    length = bar_m(width / px_per_m)
    x, y, far = 10, height - 12, round(10 + length * px_per_m)
    label = f"{length:g} m"
    behind = np.s_[height - SCALE_PX :, : far + 60]
    canvas[behind] = canvas[behind] // 4 + 191
    cv2.line(canvas, (x, y), (far, y), _INK, 2)
    for end in (x, far):
        cv2.line(canvas, (end, y - 4), (end, y + 4), _INK, 2)
    write(canvas, label, (x, y - 8))
    cv2.arrowedLine(canvas, (far + 18, y + 4), (far + 18, y - 16), _INK, 2, cv2.LINE_AA, tipLength=0.35)
    write(canvas, "N +y", (far + 26, y))


def write(canvas: np.ndarray, text: str, at: tuple[int, int], size: float = _SMALL) -> None:
    """Write a line of text that begins at a place [pixels: column, row of its foot]."""
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, _INK, 1, cv2.LINE_AA)


#: Height of a picture of the plan, and side of the camera's picture [pixels].
HEIGHT = 384
_MAX_WIDTH, _MARGIN_M = 640, 0.4
#: Height of the line of text below a brief picture [pixels].
_BAR = 32

# Okabe and Ito's palette (2008), which colour-blind people can distinguish.
UNKNOWN_GREY = (200, 200, 200)
FREE_WHITE = (255, 255, 255)
OBSTACLE_BLACK = (30, 30, 30)
WALL_BLUE = (86, 180, 233)
TRUE_GREEN = (0, 158, 115)
ESTIMATE_ORANGE = (230, 159, 0)
PATH_PURPLE = (204, 121, 167)
TARGET_RED = (213, 94, 0)
BODY_YELLOW = (240, 228, 66)
#: Colour of each kind of cell of the built map, as OpenCV's tables are.
PALETTE = np.full((256, 1, 3), UNKNOWN_GREY, np.uint8)
PALETTE[[UNKNOWN, FREE, OBSTACLE, BLOCKED], 0] = UNKNOWN_GREY, FREE_WHITE, OBSTACLE_BLACK, TARGET_RED

#: Bits of a pixel's fraction in OpenCV's fixed-point coordinates: lines then fall between pixels smoothly.
_SHIFT = 4


class PlanView:
    """Draws onto canvases that show a whole building."""

    def __init__(self, rings: Sequence[Float[np.ndarray, "_ 2"]]) -> None:
        """Fix the scale so that a whole building fits, by its outlines from `building_rings` [m]."""
        low, high = np.concatenate(rings).min(axis=0), np.concatenate(rings).max(axis=0)
        extent = high - low + 2 * _MARGIN_M
        # Scale bar and north are below the plan.
        self._px_per_m = float(min((HEIGHT - SCALE_PX) / extent[1], _MAX_WIDTH / extent[0]))
        width = max(int(extent[0] * self._px_per_m), HEIGHT // 2)
        #: Width of a canvas [pixels], an even number.
        self.width = width + width % 2
        slack = np.array([self.width, HEIGHT - SCALE_PX]) / self._px_per_m - extent
        self._corner = low - _MARGIN_M - slack / 2 - np.array([0, SCALE_PX / self._px_per_m])
        self._walls = [self._fixed(ring) for ring in rings]

    def canvas(self, layer: Layer | None, palette: UInt8[np.ndarray, "256 1 3"]) -> np.ndarray:
        """A map in colours, white without one."""
        if layer is None:
            return np.full((HEIGHT, self.width, 3), 255, np.uint8)
        cells = self._resampled(layer.values, layer.frame, cv2.INTER_NEAREST)
        return cv2.LUT(cv2.cvtColor(cells, cv2.COLOR_GRAY2RGB), palette)

    def tint(self, canvas: np.ndarray, belief: Layer) -> None:
        """Redden cells where the target is likelier than in a uniform distribution."""
        level = self._resampled(belief.values.astype(np.float32), belief.frame, cv2.INTER_LINEAR)
        is_likely = level > 0
        share = 0.7 * level[is_likely, None] / TOP_LEVEL
        canvas[is_likely] = (1 - share) * canvas[is_likely] + share * np.array(TARGET_RED)

    def draw_walls(self, canvas: np.ndarray) -> None:
        """Draw the true walls."""
        cv2.polylines(canvas, self._walls, True, WALL_BLUE, 1, cv2.LINE_AA, _SHIFT)

    def draw_line(
        self, canvas: np.ndarray, points: Float[np.ndarray, "n 2"], colour: tuple[int, int, int], width: int
    ) -> None:
        """Draw a line through points [m]."""
        if len(points):
            cv2.polylines(canvas, [self._fixed(points)], False, colour, width, cv2.LINE_AA, _SHIFT)

    def draw_arrow(
        self,
        canvas: np.ndarray,
        foot: Float[np.ndarray, "2"],
        tip: Float[np.ndarray, "2"],
        colour: tuple[int, int, int],
        width: int,
    ) -> None:
        """Draw an arrow between two points [m]."""
        ends = self._pixel(foot), self._pixel(tip)
        cv2.arrowedLine(canvas, *ends, colour, width, cv2.LINE_AA, tipLength=0.15)

    def draw_goal(self, canvas: np.ndarray, at: Float[np.ndarray, "2"]) -> None:
        """Mark the goal [m]."""
        cv2.drawMarker(canvas, self._pixel(at), PATH_PURPLE, cv2.MARKER_CROSS, 10, 2)

    def draw_target(self, canvas: np.ndarray, at: Float[np.ndarray, "2"]) -> None:
        """Mark the target [m]."""
        cv2.drawMarker(canvas, self._pixel(at), TARGET_RED, cv2.MARKER_STAR, 12, 2)

    def draw_bodies(self, canvas: np.ndarray, bodies: Float[np.ndarray, "n 4"]) -> None:
        """Draw what moves: x [m], y [m], yaw [rad], radius [m]."""
        for x, y, yaw, radius_m in bodies:
            at, nose = np.array([x, y]), np.array([x + 0.35 * np.cos(yaw), y + 0.35 * np.sin(yaw)])
            cv2.circle(
                canvas,
                self._pixel(at),
                max(round(radius_m * self._px_per_m), 3),
                BODY_YELLOW,
                -1,
                cv2.LINE_AA,
            )
            cv2.line(canvas, self._pixel(at), self._pixel(nose), OBSTACLE_BLACK, 1, cv2.LINE_AA)

    def draw_dot(self, canvas: np.ndarray, at: Float[np.ndarray, "2"], colour: Colour) -> None:
        """Mark a robot of a team [m]."""
        cv2.circle(canvas, self._pixel(at), 5, colour, -1, cv2.LINE_AA)

    def draw_scale(self, canvas: np.ndarray) -> None:
        """Draw the scale."""
        draw_scale(canvas, self._px_per_m)

    def draw_robot(self, canvas: np.ndarray, pose: Pose, title: str = "") -> None:
        """Draw the robot at its true pose, the scale, and a title."""
        nose = pose[:2] + 0.3 * np.array([np.cos(pose[2]), np.sin(pose[2])])
        cv2.circle(canvas, self._pixel(pose[:2]), 4, TRUE_GREEN, -1, cv2.LINE_AA)
        cv2.line(canvas, self._pixel(pose[:2]), self._pixel(nose), TRUE_GREEN, 2, cv2.LINE_AA)
        self.draw_scale(canvas)
        write(canvas, title, (8, 16), TITLE_SIZE)

    def _resampled(self, grid: np.ndarray, frame: GridFrame, interpolation: int) -> np.ndarray:
        """A grid of `map` at the canvas's pixels; 0 beyond it."""
        cell_per_px = 1 / (self._px_per_m * frame.resolution_m)
        first = (self._corner - frame.origin_xy) / frame.resolution_m
        # Canvas rows run downwards, map rows upwards; pixel and cell centres lie half a step in.
        affine = np.array(
            [
                [cell_per_px, 0, first[0] + 0.5 * cell_per_px - 0.5],
                [0, -cell_per_px, first[1] + (HEIGHT - 0.5) * cell_per_px - 0.5],
            ]
        )
        flags = interpolation | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(grid, affine, (self.width, HEIGHT), flags=flags, borderValue=0)

    def _pixels(self, points: np.ndarray) -> np.ndarray:
        """Continuous canvas pixels (column, row) of points of `map`."""
        across = (np.asarray(points, float) - self._corner) * self._px_per_m
        return np.column_stack([across[:, 0], HEIGHT - across[:, 1]])

    def _fixed(self, points: np.ndarray) -> np.ndarray:
        """Pixels in OpenCV's fixed-point numbers."""
        return np.rint(self._pixels(points) * (1 << _SHIFT)).astype(np.int32)[:, None, :]

    def _pixel(self, point: np.ndarray) -> tuple[int, int]:
        column, row = np.rint(self._pixels(np.asarray(point)[None, :2])[0]).astype(int)
        return int(column), int(row)


class BriefPicture:
    """The camera's picture next to the plan with the true trajectory, and a line of text."""

    def __init__(self, rings: Sequence[Float[np.ndarray, "_ 2"]], target: Float[np.ndarray, "2"]) -> None:
        """Begin without a trajectory; outlines of the building by `building_rings` [m]."""
        self._view, self._target = PlanView(rings), target
        self._places = np.zeros((0, 2))

    def draw(
        self, rgb: UInt8[np.ndarray, "h w 3"], depth_m: Float[np.ndarray, "h w"], pose: Pose, text: str
    ) -> UInt8[np.ndarray, "height width 3"]:
        """The picture at a true pose, with a line of text; the trajectory grows by one point per call."""
        self._places = np.vstack([self._places, pose[:2]])
        canvas = self._view.canvas(None, PALETTE)
        self._view.draw_walls(canvas)
        self._view.draw_line(canvas, self._places, TRUE_GREEN, 2)
        self._view.draw_target(canvas, self._target)
        self._view.draw_robot(canvas, pose)
        image = np.full((HEIGHT + _BAR, HEIGHT + self._view.width, 3), 255, np.uint8)
        image[:HEIGHT, :HEIGHT] = draw_camera(rgb, depth_m)
        image[:HEIGHT, HEIGHT:] = canvas
        write(image, text, (8, HEIGHT + _BAR - 11), TITLE_SIZE)
        return image


def draw_camera(
    rgb: UInt8[np.ndarray, "h w 3"], depth_m: Float[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "side side 3"]:
    """The camera's picture, with its depth in the lower left corner: the nearer, the lighter; black for none.

    Grey where no picture was recorded, as in the episodes of an evaluation.
    """
    if not rgb.size:
        grey = np.full((HEIGHT, HEIGHT, 3), 200, np.uint8)
        write(grey, "no picture recorded", (8, HEIGHT // 2))
        return grey
    view = cv2.resize(rgb, (HEIGHT, HEIGHT), interpolation=cv2.INTER_LINEAR)
    near = np.where(depth_m > 0, np.clip(255 - 40 * depth_m, 0, 255), 0).astype(np.uint8)
    inset = HEIGHT // 4
    small = cv2.resize(near, (inset, inset), interpolation=cv2.INTER_NEAREST)
    view[-inset:, :inset] = small[:, :, None]
    return view


def building_rings(building: Building) -> list[Float[np.ndarray, "_ 2"]]:
    """Outlines of a building's free space, and of the furniture in it [m]."""
    rings = [
        np.asarray(ring.coords)
        for polygon in building.free.geoms
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    return rings + building.outlines
