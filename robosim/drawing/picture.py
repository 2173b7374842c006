"""One picture of a moment: the camera's view beside the map as it grows, and beside what is guessed of the rest.

Below them what was decided and why, and time lines; beside them a legend, and on each map a scale bar and north.
Drawn by OpenCV straight into an array, since a video needs one for every decision.
"""

import math
import textwrap
from collections.abc import Sequence

import cv2
import numpy as np
import shapely
from jaxtyping import Float, UInt8

from robosim.building.building import Building
from robosim.drawing.marks import SCALE_PX, Entry, draw_scale, legend, write
from robosim.drawing.snapshot import (
    BLOCKED,
    FREE,
    GUESS,
    GUESS_LEVELS,
    OBSTACLE,
    TOP_LEVEL,
    UNKNOWN,
    Arrivals,
    Layer,
    Snapshot,
)
from robosim.drawing.timeline import Timeline
from robosim.support.colours import STATE_COLOURS, STATE_NAMES
from slam.grid import GridFrame
from wireless.paths import LinkState

HEIGHT = 384
#: Height of what stands below, brief or with time lines; width of the legend [pixels].
_BAR, _STRIP, LEGEND = 32, 132, 210
#: Letters of a line below the camera, and lines there.
_LETTERS, _LINES, _LINE_PX = 54, 7, 18
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
#: Length of the strongest arrival's arrow [m].
ARRIVAL_M = 1.5
#: Colour of each kind of cell of the built map, as OpenCV's tables are.
PALETTE = np.full((256, 1, 3), UNKNOWN_GREY, np.uint8)
PALETTE[[UNKNOWN, FREE, OBSTACLE, BLOCKED], 0] = UNKNOWN_GREY, FREE_WHITE, OBSTACLE_BLACK, TARGET_RED

#: The same with guesses: yellowish where floor is likely, slate where an obstacle is; the belief alone is red.
_GUESSES = PALETTE.copy()
_GUESSES[GUESS : GUESS + GUESS_LEVELS, 0] = np.stack(
    [
        np.interp(np.arange(GUESS_LEVELS), [0, (GUESS_LEVELS - 1) / 2, GUESS_LEVELS - 1], channel)
        for channel in zip((255, 243, 176), UNKNOWN_GREY, (110, 115, 140), strict=True)
    ],
    axis=-1,
)

#: Size of titles.
_TEXT = 0.45
#: Bits of a pixel's fraction in OpenCV's fixed-point coordinates: lines then fall between pixels smoothly.
_SHIFT = 4


class Picture:
    """Draws the camera's view beside the map, at one scale for a whole episode."""

    def __init__(
        self,
        rings: Sequence[Float[np.ndarray, "_ 2"]],
        target: Float[np.ndarray, "2"],
        *,
        anticipates: bool = False,
        brief: bool = False,
    ) -> None:
        """Fix the scale so that the whole building fits.

        Args:
            rings: Outlines of its free space, of `building_rings` [m].
            target: Where the target is [m].
            anticipates: Whether a second map shows what the mapper guesses where it has not looked.
            brief: Whether legend, reasons and time lines are left out.
        """
        self._brief = brief
        self._palettes = {"observed": PALETTE, "anticipated": _GUESSES} if anticipates else {"": PALETTE}
        low, high = np.concatenate(rings).min(axis=0), np.concatenate(rings).max(axis=0)
        extent = high - low + 2 * _MARGIN_M
        # Scale bar and north stand below the plan.
        self._px_per_m = float(min((HEIGHT - SCALE_PX) / extent[1], _MAX_MAP_WIDTH / extent[0]))
        width = max(int(extent[0] * self._px_per_m), HEIGHT // 2)
        self._map_width = width + width % 2
        slack = np.array([self._map_width, HEIGHT - SCALE_PX]) / self._px_per_m - extent
        self._corner = low - _MARGIN_M - slack / 2 - np.array([0, SCALE_PX / self._px_per_m])
        self._walls = [self._fixed(ring) for ring in rings]
        self._target = target
        #: Whether the target is looked for, and drawn.
        self.seeks_target = True
        self._true = np.zeros((0, 1, 2), np.int32)
        self._estimated = np.zeros((0, 1, 2), np.int32)
        self._timeline = Timeline(len(self._palettes) * self._map_width, _STRIP, STATE_COLOURS)
        self._legend: np.ndarray | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        width = HEIGHT + len(self._palettes) * self._map_width
        return (width, HEIGHT + _BAR) if self._brief else (width + LEGEND, HEIGHT + _STRIP)

    def draw(self, snapshot: Snapshot) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of one decision; the trajectories grow by one point a call.

        Without a map the true walls stand alone. Each radio path is an arrow to where it comes from, thicker and
        longer for stronger ones; the likelier a place is to hold the target, the redder it is.
        """
        self._true = np.concatenate([self._true, self._fixed(snapshot.pose[None, :2])])
        if snapshot.estimate is not None:
            self._estimated = np.concatenate([self._estimated, self._fixed(snapshot.estimate[None, :2])])
        image = np.full((*self.size[::-1], 3), 255, np.uint8)
        image[:HEIGHT, :HEIGHT] = self._camera(snapshot.rgb, snapshot.depth_mm / np.float32(1000))
        for k, (title, palette) in enumerate(self._palettes.items()):
            canvas = self._base(snapshot.built, palette)
            self._draw_over(canvas, snapshot)
            draw_scale(canvas, self._px_per_m)
            write(canvas, title, (8, 16), _TEXT)
            left = HEIGHT + k * self._map_width
            image[:HEIGHT, left : left + self._map_width] = canvas
        if self._brief:
            write(image, snapshot.text, (8, HEIGHT + _BAR - 11), _TEXT)
            return image
        for i, line in enumerate(_lines(snapshot)[:_LINES]):
            write(image, line, (8, HEIGHT + 18 + _LINE_PX * i))
        self._grow(snapshot)
        below = self._timeline.draw()
        image[HEIGHT:, HEIGHT : HEIGHT + below.shape[1]] = below
        if self._legend is None:
            self._legend = legend(self._entries(snapshot), LEGEND, len(image))
        image[:, -LEGEND:] = self._legend
        return image

    def _grow(self, snapshot: Snapshot) -> None:
        """Let the time lines grow."""
        found = snapshot.arrivals
        snr_db = float(found.snr_db[0]) if found is not None and len(found.snr_db) else math.nan
        told = None if found is None else found.state
        self._timeline.add(snr_db, told, snapshot.true_state, snapshot.coverage)

    def _entries(self, snapshot: Snapshot) -> list[Entry]:
        """What is named in the legend: what an episode like this one shows."""
        entries = [
            Entry("true wall", WALL_BLUE),
            Entry("true way", TRUE_GREEN),
            Entry("way as estimated", ESTIMATE_ORANGE),
            Entry("planned way", PATH_PURPLE),
            Entry("goal", PATH_PURPLE, "cross"),
            Entry("The robot's map"),
            Entry("floor seen", FREE_WHITE, "area"),
            Entry("obstacle seen", OBSTACLE_BLACK, "area"),
            Entry("bumped into", TARGET_RED, "area"),
            Entry("not seen", UNKNOWN_GREY, "area"),
        ]
        if len(self._palettes) > 1:
            floor, wall = (_GUESSES[GUESS + k, 0].tolist() for k in (0, GUESS_LEVELS - 1))
            entries += [
                Entry("floor anticipated", tuple(floor), "area"),
                Entry("obstacle anticipated", tuple(wall), "area"),
            ]
        if self.seeks_target:
            entries += [Entry("The target"), Entry("where it is", TARGET_RED, "star")]
        if snapshot.belief is not None:
            entries.append(Entry("where it may be", _tint_of(0.5), "area"))
        if snapshot.arrivals is not None:
            entries.append(Entry("Arrivals, by told state"))
            entries += [Entry(STATE_NAMES[state], STATE_COLOURS[state], "arrow") for state in LinkState]
        return [*entries, Entry("Depth in the corner:"), Entry("the nearer the lighter")]

    def _draw_over(self, canvas: np.ndarray, snapshot: Snapshot) -> None:
        """Draw belief, walls, ways, arrivals, goal, target and robot over a map."""
        if snapshot.belief is not None:
            self._tint(canvas, snapshot.belief)
        cv2.polylines(canvas, self._walls, True, WALL_BLUE, 1, cv2.LINE_AA, _SHIFT)
        cv2.polylines(canvas, [self._true], False, TRUE_GREEN, 2, cv2.LINE_AA, _SHIFT)
        cv2.polylines(canvas, [self._estimated], False, ESTIMATE_ORANGE, 1, cv2.LINE_AA, _SHIFT)
        if snapshot.path is not None and len(snapshot.path) > 1:
            cv2.polylines(canvas, [self._fixed(snapshot.path)], False, PATH_PURPLE, 1, cv2.LINE_AA, _SHIFT)
        if snapshot.arrivals is not None and snapshot.estimate is not None:
            self._draw_arrivals(canvas, snapshot.arrivals, snapshot.estimate)
        if snapshot.goal is not None:
            cv2.drawMarker(canvas, self._pixel(snapshot.goal), PATH_PURPLE, cv2.MARKER_CROSS, 10, 2)
        if self.seeks_target:
            cv2.drawMarker(canvas, self._pixel(self._target), TARGET_RED, cv2.MARKER_STAR, 12, 2)
        pose = snapshot.pose
        nose = pose[:2] + 0.3 * np.array([np.cos(pose[2]), np.sin(pose[2])])
        cv2.circle(canvas, self._pixel(pose[:2]), 4, TRUE_GREEN, -1, cv2.LINE_AA)
        cv2.line(canvas, self._pixel(pose[:2]), self._pixel(nose), TRUE_GREEN, 2, cv2.LINE_AA)

    def _draw_arrivals(self, canvas: np.ndarray, arrivals: Arrivals, pose: Float[np.ndarray, "3"]) -> None:
        """Arrows along the estimated arrivals, in the colour of the link state; the strongest thickest."""
        colour = STATE_COLOURS[arrivals.state]
        at = self._pixel(pose[:2])
        for i in range(len(arrivals.aoa_rad))[::-1]:
            angle = arrivals.aoa_rad[i]
            reach = arrow_m(arrivals, i)
            tip = self._pixel(pose[:2] + reach * np.array([np.cos(angle), np.sin(angle)]))
            cv2.arrowedLine(canvas, at, tip, colour, 2 if i == 0 else 1, cv2.LINE_AA, tipLength=0.15)

    def _camera(self, rgb: np.ndarray, depth: np.ndarray) -> np.ndarray:
        view = cv2.resize(rgb, (HEIGHT, HEIGHT), interpolation=cv2.INTER_LINEAR)
        near = np.where(depth > 0, np.clip(255 - 40 * depth, 0, 255), 0).astype(np.uint8)
        inset = HEIGHT // 4
        small = cv2.resize(near, (inset, inset), interpolation=cv2.INTER_NEAREST)
        view[-inset:, :inset] = small[:, :, None]
        return view

    def _base(self, built: Layer | None, palette: UInt8[np.ndarray, "256 1 3"]) -> np.ndarray:
        """The built map as colours, resampled to the picture's pixels."""
        if built is None:
            return np.full((HEIGHT, self._map_width, 3), 255, np.uint8)
        base = self._resampled(built.values, built.frame, cv2.INTER_NEAREST)
        return cv2.LUT(cv2.cvtColor(base, cv2.COLOR_GRAY2RGB), palette)

    def _tint(self, canvas: np.ndarray, belief: Layer) -> None:
        """Redden the map where the target is likelier than if nothing were known."""
        level = self._resampled(belief.values.astype(np.float32), belief.frame, cv2.INTER_LINEAR)
        share = 0.7 * level[..., None] / TOP_LEVEL
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


def _lines(snapshot: Snapshot) -> list[str]:
    """What was decided and why, in lines below the camera."""
    said = [snapshot.text]
    if snapshot.reason is not None and snapshot.reason.because:
        far = "" if math.isnan(snapshot.decisions) else f", {snapshot.decisions:.0f} decisions away"
        said.append(f"Goal: {snapshot.reason.kind.value}{far}")
        said.append(f"Why: {snapshot.reason.because}")
        if not math.isnan(snapshot.reason.mass):
            said.append(f"Belief within 0.5 m of its peak: {snapshot.reason.mass:.0%}")
    return [line for one in said for line in textwrap.wrap(one, _LETTERS)]


def _tint_of(share: float) -> tuple[int, int, int]:
    """Colour of the floor where the belief is of some strength, 0 to 1."""
    mixed = [round((1 - 0.7 * share) * 255 + 0.7 * share * channel) for channel in TARGET_RED]
    return mixed[0], mixed[1], mixed[2]


def building_rings(building: Building) -> list[Float[np.ndarray, "_ 2"]]:
    """Outlines of a building's free space, and of what stands in it [m]."""
    walls = [np.asarray(ring.coords) for part in building.free.geoms for ring in _rings(part)]
    return walls + building.outlines


def arrow_m(arrivals: Arrivals, i: int) -> float:
    """Length of the arrow of a path: shorter for weaker ones [m]."""
    return float(ARRIVAL_M * max(1.0 - (arrivals.snr_db[0] - arrivals.snr_db[i]) / 40.0, 0.25))


def _rings(polygon: shapely.Polygon) -> list[shapely.LinearRing]:
    return [polygon.exterior, *polygon.interiors]
