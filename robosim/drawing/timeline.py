"""Time lines below a picture: SNR and link state, or coverage where there is no radio."""

import math

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.drawing.marks import write
from robosim.support.colours import Colour
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
        pieces = [part for part in np.split(np.arange(len(values)), breaks) if len(part) and known[part[0]]]
        cv2.polylines(canvas, [fixed[part][:, None] for part in pieces], False, _LINE, 1, cv2.LINE_AA, _SHIFT)

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
