"""Bounds of views: the sector of the plan that an image sees, and the window in a slab that it looks through."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.support.compiled import compiled
from wireless.geometry.array_types import FlatPolygon
from wireless.geometry.convex import area_of, cut_to_left, without_doubles
from wireless.geometry.plan import NEAR_M

#: Corners of a window in the plan [m].
Window = Float[np.ndarray, "w 2"]


#: Windows of less area are none [m2].
_NOTHING_M2 = 1e-16
#: Right and left end of a part of a side: x, y, x, y [m].
Bounds = tuple[float, float, float, float]


class Eye(NamedTuple):
    """The view that is followed."""

    x: float
    y: float
    number: int
    order: int
    """Number of reflections."""
    first: int
    """Where the corners of its window begin."""
    corners: int
    """Number of these; 0 without a window."""
    rise_m: float
    """Height of the window above the source."""
    low_m: float
    """Height of the layer's floor above the source."""
    high_m: float
    """Height of its ceiling above the source."""
    span_m: tuple[float, float]
    """Lowest and highest place of interest above the source."""


@compiled
def is_within(sector: Float[np.ndarray, "v 4"], row: int, x: float, y: float, px: float, py: float) -> bool:
    """Whether a point (px, py) is in a sector of a view with its image at (x, y)."""
    rx, ry, lx, ly = sector[row, 0] - x, sector[row, 1] - y, sector[row, 2] - x, sector[row, 3] - y
    dx, dy = px - x, py - y
    right, left = rx * dy - ry * dx, dx * ly - dy * lx
    return right >= -NEAR_M * np.sqrt(rx * rx + ry * ry) and left >= -NEAR_M * np.sqrt(lx * lx + ly * ly)


@compiled
def is_in_window(window: FlatPolygon, px: float, py: float) -> bool:
    """Whether a point is in a convex window."""
    for k in range(len(window)):
        a, b = window[k], window[(k + 1) % len(window)]
        dx, dy = b[0] - a[0], b[1] - a[1]
        if dx * (py - a[1]) - dy * (px - a[0]) < -NEAR_M * np.sqrt(dx * dx + dy * dy):
            return False
    return True


@compiled
def _chord(window: FlatPolygon, x: float, y: float, ux: float, uy: float) -> tuple[float, float]:
    """From where to where a ray is in a convex window; from more to less if it is nowhere."""
    low, high = 0.0, np.inf
    for k in range(len(window)):
        a, b = window[k], window[(k + 1) % len(window)]
        dx, dy = b[0] - a[0], b[1] - a[1]
        size = np.sqrt(dx * dx + dy * dy)
        inside = (dx * (y - a[1]) - dy * (x - a[0])) / size + NEAR_M if size > 0 else 1.0
        gain = (dx * uy - dy * ux) / size if size > 0 else 0.0
        if gain > 0:
            low = max(low, -inside / gain)
        elif gain < 0:
            high = min(high, -inside / gain)
        elif inside < 0:
            return 1.0, 0.0
    return low, high


@compiled
def distance2(x: float, y: float, side: Bounds) -> float:
    """Squared distance of a point from a segment."""
    dx, dy, px, py = side[2] - side[0], side[3] - side[1], x - side[0], y - side[1]
    f = min(max((px * dx + py * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    return (px - f * dx) ** 2 + (py - f * dy) ** 2


@compiled
def put_sector(window: FlatPolygon, x: float, y: float, sector: Float[np.ndarray, "4"]) -> bool:
    """Put the sides of a window, seen from above, into a sector; False if the image is over the window."""
    aside = False
    for k in range(len(window)):
        p, q = window[k], window[(k + 1) % len(window)]
        aside = aside or (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) < 0
    if not aside:
        return False
    sector[0], sector[1], sector[2], sector[3] = window[0, 0], window[0, 1], window[0, 0], window[0, 1]
    for k in range(1, len(window)):
        px, py = window[k, 0] - x, window[k, 1] - y
        if (sector[0] - x) * py - (sector[1] - y) * px < 0:
            sector[0], sector[1] = window[k, 0], window[k, 1]
        if (sector[2] - x) * py - (sector[3] - y) * px > 0:
            sector[2], sector[3] = window[k, 0], window[k, 1]
    return True


@compiled
def seen_slopes(eye: Eye, window: Window, px: float, py: float) -> tuple[float, float]:
    """Least and most slope at which a corner is seen; the first is more if it is not."""
    ux, uy = px - eye.x, py - eye.y
    length = np.sqrt(ux * ux + uy * uy)
    if length < NEAR_M:
        return 1.0, 0.0
    least, steepest = eye.low_m / length, eye.high_m / length
    if eye.corners > 0:
        corners = window[eye.first : eye.first + eye.corners]
        from_m, to_m = _chord(corners, eye.x, eye.y, ux / length, uy / length)
        if to_m < from_m or to_m <= 0:
            return 1.0, 0.0
        far_slope, other = eye.rise_m / to_m, eye.rise_m / from_m if from_m > 0 else np.inf * eye.rise_m
        least, steepest = max(least, min(far_slope, other)), min(steepest, max(far_slope, other))
    if (steepest - least) * length < NEAR_M:  # at best where its layer ends
        return 1.0, 0.0
    return least, steepest


@compiled
def cut_to_seen(
    eye: Eye, window: Window, bound_m: float, polygon: FlatPolygon, n: int, spare: FlatPolygon
) -> int:
    """Cut a piece of an opening at some height above the source, in place, to what is seen; its number of corners."""
    x, y = eye.x, eye.y
    grown = bound_m / eye.rise_m if eye.corners > 0 else 1.0
    for k in range(eye.corners):
        if n == 0:
            return 0
        p, q = window[eye.first + k], window[eye.first + (k + 1) % eye.corners]
        ax, ay = x + grown * (p[0] - x), y + grown * (p[1] - y)
        n = cut_to_left(polygon, n, ax, ay, x + grown * (q[0] - x), y + grown * (q[1] - y), spare)
    n = without_doubles(polygon, n)
    return 0 if n == 0 or area_of(polygon, n) < _NOTHING_M2 else n


@compiled
def seen_part(eye: Eye, window: Window, bound_m: float, side: Bounds, bounds: Bounds) -> tuple[float, float]:
    """The part of a rim, from 0 at its right end to 1, that is in a sector and behind the window; nothing if reversed.

    Args:
        eye: The view.
        window: Corners of windows.
        bound_m: Height of the rim above the source.
        side: The triangle's side.
        bounds: The ends of what the sector leaves of it.
    """
    x, y, low, high = eye.x, eye.y, 0.0, 1.0
    dx, dy = side[2] - side[0], side[3] - side[1]
    for k in range(eye.corners + 2):
        px, py = x, y
        if k < eye.corners:
            grown = bound_m / eye.rise_m
            p, q = window[eye.first + k], window[eye.first + (k + 1) % eye.corners]
            px, py = x + grown * (p[0] - x), y + grown * (p[1] - y)
            wx, wy = grown * (q[0] - p[0]), grown * (q[1] - p[1])
        elif k == eye.corners:
            wx, wy = bounds[0] - x, bounds[1] - y
        else:
            wx, wy = -(bounds[2] - x), -(bounds[3] - y)
        size = np.sqrt(wx * wx + wy * wy)
        if size == 0:
            continue
        deep = (wx * (side[1] - py) - wy * (side[0] - px)) / size + NEAR_M
        gain = (wx * dy - wy * dx) / size
        if gain > 0:
            low = max(low, -deep / gain)
        elif gain < 0:
            high = min(high, -deep / gain)
        elif deep < 0:
            high = -1.0
    return low, high


@compiled
def cut_side(x: float, y: float, side: Bounds, sector: Float[np.ndarray, "4"]) -> Bounds:
    """Clip a side that faces away from the image to a sector."""
    rx, ry, lx, ly = side
    if (rx - x) * (sector[1] - y) - (ry - y) * (sector[0] - x) > 0:
        rx, ry = sector[0], sector[1]
    if (lx - x) * (sector[3] - y) - (ly - y) * (sector[2] - x) < 0:
        lx, ly = sector[2], sector[3]
    return rx, ry, lx, ly


@compiled
def cut_behind(
    x: float, y: float, tip_x: float, tip_y: float, right: bool, sector: Float[np.ndarray, "4"]
) -> Bounds:
    """Clip to a sector the right or left side at the tip opposite to the side that it came by.

    It has no width if it leaves nothing.
    """
    rx, ry, lx, ly = sector[0], sector[1], sector[2], sector[3]
    from_right = (rx - x) * (tip_y - y) - (ry - y) * (tip_x - x)
    from_left = (tip_x - x) * (ly - y) - (tip_y - y) * (lx - x)
    if right:
        if from_right <= 0:
            lx, ly = rx, ry
        elif from_left >= 0:
            lx, ly = tip_x, tip_y
    elif from_left <= 0:
        rx, ry = lx, ly
    elif from_right >= 0:
        rx, ry = tip_x, tip_y
    return rx, ry, lx, ly
