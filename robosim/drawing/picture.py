"""The picture of a step: the camera's picture next to the growing map and the anticipated map.

Below them are goal, reason and time lines; on the right is a legend, and on each map a scale bar with north.
"""

import math
import textwrap
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.drawing.plan_view import (
    BODY_YELLOW,
    ESTIMATE_ORANGE,
    FREE_WHITE,
    HEIGHT,
    OBSTACLE_BLACK,
    PALETTE,
    PATH_PURPLE,
    TARGET_RED,
    TRUE_GREEN,
    UNKNOWN_GREY,
    WALL_BLUE,
    Entry,
    PlanView,
    draw_camera,
    legend,
    write,
)
from robosim.layers import GUESS, GUESS_LEVELS, depth_in_mm
from robosim.radio.measurement import Measurement
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, Colour
from wireless.paths import LinkState

#: Margins: names and numbers on the left, and beyond the last decision on the right [pixels].
_LEFT, _RIGHT = 74, 12
#: Decisions that fit at first; doubled whenever they do not fit.
_FIRST_SPAN = 100
#: Range of SNR that is drawn, and its marks [dB].
_SNR_DB, _MARKS_DB = (-10.0, 60.0), (0, 20, 40, 60)
_INK, _GRID, _LINE = (20, 20, 20), (225, 225, 225), (0, 114, 178)
#: Bits of a pixel's fraction in OpenCV's fixed-point coordinates.
_SHIFT = 4


class Timeline:
    """Grows by one decision at a time."""

    def __init__(self, width: int, height: int, states: dict[int, Colour]) -> None:
        """Begin without decisions, for a picture of a size [pixels]; `states` are colours of link states."""
        self._width, self._height = width, height
        self._colours = np.full((256, 3), 255, np.uint8)
        for state, colour in states.items():
            self._colours[int(state)] = colour
        self._snr_db: list[float] = []
        self._estimated: list[int] = []
        self._true: list[int] = []
        self._seen: list[float] = []

    def add(
        self, snr_db: float, estimated: LinkState | None, true: LinkState | None, coverage: float
    ) -> None:
        """Append a decision: SNR [dB], estimated and true link state, coverage; NaN and None where unknown."""
        self._snr_db.append(snr_db)
        self._estimated.append(255 if estimated is None else int(estimated))
        self._true.append(255 if true is None else int(true))
        self._seen.append(coverage)

    def draw(self) -> UInt8[np.ndarray, "height width 3"]:
        """The picture up to the last decision."""
        canvas = np.full((self._height, self._width, 3), 255, np.uint8)
        foot = self._height - 18
        if any(state != 255 for state in self._estimated):
            top = foot - 36
            self._lane(canvas, "SNR [dB]", (8, top - 6), _SNR_DB, _MARKS_DB, np.array(self._snr_db))
            self._ribbon(canvas, "estimated", top, self._estimated)
            self._ribbon(canvas, "true state", top + 18, self._true)
        else:
            self._lane(canvas, "seen [%]", (8, foot), (0, 100), (0, 50, 100), 100 * np.array(self._seen))
        self._axis(canvas, foot)
        return canvas

    @property
    def _span(self) -> int:
        """Decisions that fit into the width."""
        return _FIRST_SPAN * 2 ** max(0, math.ceil(math.log2(max(len(self._seen), 1) / _FIRST_SPAN)))

    def _x(self, i: float) -> float:
        """Column of a decision, in pixels."""
        return _LEFT + i * ((self._width - _LEFT - _RIGHT) / self._span)

    def _lane(
        self,
        canvas: np.ndarray,
        name: str,
        rows: tuple[int, int],
        ends: tuple[float, float],
        marks: tuple[int, ...],
        values: Float[np.ndarray, " n"],
    ) -> None:
        """A curve between two rows of the picture; interrupted where there is no value."""
        write(canvas, name, (4, (rows[0] + rows[1]) // 2 + 4))

        def height(value: np.ndarray) -> np.ndarray:
            share = (np.clip(value, *ends) - ends[0]) / (ends[1] - ends[0])
            return rows[1] - share * (rows[1] - rows[0])

        for mark in marks:
            y = round(float(height(np.array([mark]))[0]))
            cv2.line(canvas, (_LEFT, y), (self._width - _RIGHT, y), _GRID, 1)
            write(canvas, str(mark), (_LEFT - 4 - 7 * len(str(mark)), y + 4), 0.32)
        known = np.isfinite(values)
        x = self._x(0.5) + (self._x(1.0) - self._x(0.0)) * np.arange(len(values))
        at = np.stack([x, height(np.where(known, values, 0.0))], axis=-1)
        fixed = np.rint(at * (1 << _SHIFT)).astype(np.int32)
        breaks = np.flatnonzero(np.diff(known.astype(np.int8))) + 1
        pieces = [
            piece for piece in np.split(np.arange(len(values)), breaks) if len(piece) and known[piece[0]]
        ]
        cv2.polylines(
            canvas, [fixed[piece][:, None] for piece in pieces], False, _LINE, 1, cv2.LINE_AA, _SHIFT
        )

    def _ribbon(self, canvas: np.ndarray, name: str, top: int, states: list[int]) -> None:
        """A band of colours, one for each decision."""
        write(canvas, name, (4, top + 11))
        right = max(round(self._x(len(states))), _LEFT + 1)
        which = ((np.arange(right - _LEFT) + 0.5) * len(states) / (right - _LEFT)).astype(int)
        canvas[top : top + 14, _LEFT:right] = self._colours[np.array(states)[which]]

    def _axis(self, canvas: np.ndarray, foot: int) -> None:
        cv2.line(canvas, (_LEFT, foot), (self._width - _RIGHT, foot), _INK, 1)
        for share in range(5):
            number = self._span * share // 4
            x = round(self._x(number))
            cv2.line(canvas, (x, foot), (x, foot + 3), _INK, 1)
            text = f"{number}" if share else "0 decisions"
            write(canvas, text, (x if not share else x - 4 * len(text), foot + 14), 0.35)


#: Height of text and time lines below the maps, and width of the legend [pixels].
_STRIP, LEGEND = 132, 210
#: Letters per line below the camera, lines, and their height [pixels].
_LETTERS, _LINES, _LINE_PX = 54, 7, 18
#: Length of the strongest arrival's arrow [m].
ARRIVAL_M = 1.5
#: Colours of what is anticipated, from likely floor (yellowish) over unknown to a likely obstacle (slate).
ANTICIPATED = ((255, 243, 176), UNKNOWN_GREY, (110, 115, 140))
ANTICIPATING_PALETTE = PALETTE.copy()
ANTICIPATING_PALETTE[GUESS : GUESS + GUESS_LEVELS, 0] = np.stack(
    [
        np.interp(np.arange(GUESS_LEVELS), [0, (GUESS_LEVELS - 1) / 2, GUESS_LEVELS - 1], channel)
        for channel in zip(*ANTICIPATED, strict=True)
    ],
    axis=-1,
)


class Picture:
    """Draws steps of one episode."""

    #: Width of the legend at the right [pixels].
    legend_width = LEGEND

    def __init__(
        self,
        rings: Sequence[Float[np.ndarray, "_ 2"]],
        target: Float[np.ndarray, "2"] | None,
        *,
        title: str = "",
        anticipates: bool = False,
    ) -> None:
        """Fix the scale so that the whole building fits, by its outlines from `plan_view.building_rings` [m].

        The title begins the text below; `anticipates` adds a second map with anticipated cells.
        """
        self._palettes = (
            {"observed": PALETTE, "anticipated": ANTICIPATING_PALETTE} if anticipates else {"": PALETTE}
        )
        self._view, self._title = PlanView(rings), title
        self.target = target
        self._true, self._estimated = np.zeros((0, 2)), np.zeros((0, 2))
        self._timeline = Timeline(len(self._palettes) * self._view.width, _STRIP, STATE_COLOURS)
        self._legend: np.ndarray | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return HEIGHT + len(self._palettes) * self._view.width + LEGEND, HEIGHT + _STRIP

    def add(self, robot: str, step: Step) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of a step of the robot, of which there is one."""
        return self.draw(step)

    def last(self) -> None:
        """No picture: `add` has returned those of all steps."""

    def draw(self, step: Step) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of a step; trajectories and time lines grow by one point per call.

        Each estimated radio path is an arrow towards its origin, thicker and longer for stronger ones; a redder place
        is more likely to hold the target.
        """
        self._true = np.vstack([self._true, step.true.pose[:2]])
        self._estimated = np.vstack([self._estimated, step.estimated.pose[:2]])
        image = np.full((*self.size[::-1], 3), 255, np.uint8)
        depth_m = depth_in_mm(step.sensed.depth) / np.float32(1000)
        image[:HEIGHT, :HEIGHT] = draw_camera(step.sensed.rgb, depth_m)
        for k, (title, palette) in enumerate(self._palettes.items()):
            left = HEIGHT + k * self._view.width
            image[:HEIGHT, left : left + self._view.width] = self._map(step, title, palette)
        for i, line in enumerate(self._lines(step)[:_LINES]):
            write(image, line, (8, HEIGHT + 18 + _LINE_PX * i))
        measured, true = step.estimated.measurement, step.true
        state = None if measured is None else measured.state
        self._timeline.add(step.snr_db, state, true.link_state, true.coverage)
        below = self._timeline.draw()
        image[HEIGHT:, HEIGHT : HEIGHT + below.shape[1]] = below
        if self._legend is None:
            self._legend = legend(self._entries(step), LEGEND, len(image))
        image[:, -LEGEND:] = self._legend
        return image

    def _map(self, step: Step, title: str, palette: UInt8[np.ndarray, "256 1 3"]) -> np.ndarray:
        """A map with belief, walls, trajectories, arrivals, goal, target and robot over it."""
        view, canvas = self._view, self._view.canvas(step.map_layer, palette)
        if step.belief_layer is not None:
            view.tint(canvas, step.belief_layer)
        view.draw_walls(canvas)
        view.draw_line(canvas, self._true, TRUE_GREEN, 2)
        view.draw_line(canvas, self._estimated, ESTIMATE_ORANGE, 1)
        if len(step.decided.path) > 1:
            view.draw_line(canvas, step.decided.path, PATH_PURPLE, 1)
        if step.estimated.measurement is not None:
            self._draw_arrivals(canvas, step.estimated.measurement)
        view.draw_goal(canvas, step.decided.goal)
        if self.target is not None:
            view.draw_target(canvas, self.target)
        view.draw_bodies(canvas, step.true.bodies)
        view.draw_robot(canvas, step.true.pose, title)
        return canvas

    def _draw_arrivals(self, canvas: np.ndarray, measured: Measurement) -> None:
        """Arrows along the estimated arrivals, in the colour of the link state; the strongest thickest."""
        foot = measured.pose[:2]
        for i in measured.directed[::-1].tolist():
            direction = np.array([np.cos(measured.aoa_rad[i]), np.sin(measured.aoa_rad[i])])
            tip = foot + arrow_length_m(measured, i) * direction
            self._view.draw_arrow(canvas, foot, tip, STATE_COLOURS[measured.state], 2 if i == 0 else 1)

    def _entries(self, step: Step) -> list[Entry]:
        """Entries of the legend, for all that an episode with such a step shows."""
        entries = [
            Entry("true wall", WALL_BLUE),
            Entry("true trajectory", TRUE_GREEN),
            Entry("estimated trajectory", ESTIMATE_ORANGE),
            Entry("planned path", PATH_PURPLE),
            Entry("goal", PATH_PURPLE, "cross"),
            Entry("The robot's map"),
            Entry("floor seen", FREE_WHITE, "area"),
            Entry("obstacle seen", OBSTACLE_BLACK, "area"),
            Entry("bumped into", TARGET_RED, "area"),
            Entry("not seen", UNKNOWN_GREY, "area"),
        ]
        if len(self._palettes) > 1:
            floor, _, wall = ANTICIPATED
            entries += [
                Entry("floor anticipated", floor, "area"),
                Entry("obstacle anticipated", wall, "area"),
            ]
        if len(step.true.bodies):
            entries.append(Entry("person", BODY_YELLOW, "area"))
        if self.target is not None:
            entries += [Entry("The target"), Entry("where it is", TARGET_RED, "star")]
        if step.decided.belief is not None:
            entries.append(Entry("where it may be", _tint_of(0.5), "area"))
        if step.estimated.measurement is not None:
            entries.append(Entry("Arrivals, by link state"))
            entries += [Entry(STATE_NAMES[state], STATE_COLOURS[state], "arrow") for state in LinkState]
        return [*entries, Entry("Depth in the corner:"), Entry("the nearer, the lighter")]

    def _lines(self, step: Step) -> list[str]:
        """Text below the camera: status, goal and reason."""
        reason, lines = step.decided.reason, [f"{self._title}  step {step.number}  "]
        lines[0] += status_line(step, self.target)
        if reason.because:
            far = step.actions_to_goal
            lines.append(
                f"Goal: {reason.kind.value}" + ("" if math.isnan(far) else f", {far:.0f} decisions away")
            )
            lines.append(f"Why: {reason.because}")
            if not math.isnan(reason.mass):
                lines.append(f"Belief within 0.5 m of its peak: {reason.mass:.0%}")
        return [short for line in lines for short in textwrap.wrap(line, _LETTERS)]


def status_line(step: Step, target: Float[np.ndarray, "2"] | None) -> str:
    """Progress of an episode in words; `target` is None if there is no search."""
    text = f"{100 * step.true.coverage:.0f} % seen, pose error {100 * step.position_error_m:.0f} cm"
    if target is None:
        return text
    text = f"{np.hypot(*(step.true.pose[:2] - target)):.1f} m to target, {text}"
    measured = step.estimated.measurement
    return text if measured is None else f"{text}, {measured.state.name.lower().replace('_', ' ')}"


def _tint_of(share: float) -> tuple[int, int, int]:
    """Colour of the floor by the level of the belief, 0 to 1."""
    mixed = [round((1 - 0.7 * share) * 255 + 0.7 * share * channel) for channel in TARGET_RED]
    return mixed[0], mixed[1], mixed[2]


def arrow_length_m(measured: Measurement, i: int) -> float:
    """Length of the arrow of the i-th path: shorter for weaker ones [m]."""
    return float(ARRIVAL_M * max(1.0 - (measured.snr_db[0] - measured.snr_db[i]) / 40.0, 0.25))
