"""Length of scale bars; legend, scale bar and north arrow of pictures that OpenCV draws."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.support.colours import Colour

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
