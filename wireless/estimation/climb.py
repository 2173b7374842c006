"""Maximum likelihood along one coordinate of a path: its delay, its arrival or its departure.

A path seen along one coordinate x is a curve c(x) in as many dimensions as the tensor has there. The tensor,
contracted with the path's estimate along the other two, leaves vectors v; with the parts g of the curve that
have oscillators of their own and the parts o of the others, the log-likelihood gained by the path is

    S(x) = (sum over g, o of |c_g(x)^H v_go|)^2 / |c(x)|^2

where the other two have unit norm: the size of a path is the same for all arrays, phases between arrays are
free.

Curves are tables. Each interval of x has 4 nodes, its ends among them, and is a cubic of its own: kinks at
nodes, such as at the rim of an array's view, do no harm. The top is where the slope is zero, so that it is
found to machine precision.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex

from robosim.support.compiled import compiled

#: Most halvings of a bracket around a top.
MAX_HALVINGS = 40


class Curve(NamedTuple):
    """A curve as a table."""

    table: Complex[np.ndarray, "nodes dims"]
    """Nodes, 3 to an interval; one more at the end of a curve that is not closed."""
    round_trip: bool
    """Whether the curve is closed: the last interval ends at the first node."""
    parts: int
    """Parts that have oscillators of their own."""
    step: float
    """Half the width of a bracket around a top [intervals]."""


class Spot(NamedTuple):
    """A place on a curve."""

    point: Complex[np.ndarray, " dims"]
    slope: Complex[np.ndarray, " dims"]
    """Derivative of the point by the coordinate in intervals."""


@compiled
def place(curve: Curve, x: float, spot: Spot) -> None:
    """Put the point and the slope of a curve at a coordinate, in intervals, into `spot`."""
    table, round_trip, nodes = curve.table, curve.round_trip, len(curve.table)
    n = nodes // 3
    j = int(np.floor(x))
    if not round_trip:
        j = min(max(j, 0), n - 1)
    u = x - j
    w = (
        -4.5 * (u - 1 / 3) * (u - 2 / 3) * (u - 1),
        13.5 * u * (u - 2 / 3) * (u - 1),
        -13.5 * u * (u - 1 / 3) * (u - 1),
        4.5 * u * (u - 1 / 3) * (u - 2 / 3),
    )
    s = (
        -13.5 * u * u + 18 * u - 5.5,
        40.5 * u * u - 45 * u + 9,
        -40.5 * u * u + 36 * u - 4.5,
        13.5 * u * u - 9 * u + 1,
    )
    first = 3 * (j % n) if round_trip else 3 * j
    # Real and imaginary parts alike, as plain numbers: processors take several of them at once.
    last = (first + 3) % nodes if round_trip else first + 3
    a, b = table[first].view(np.float64), table[first + 1].view(np.float64)
    c = table[first + 2].view(np.float64)
    e = table[last].view(np.float64)
    at, along = spot.point.view(np.float64), spot.slope.view(np.float64)
    for d in range(len(at)):
        at[d] = w[0] * a[d] + w[1] * b[d] + w[2] * c[d] + w[3] * e[d]
        along[d] = s[0] * a[d] + s[1] * b[d] + s[2] * c[d] + s[3] * e[d]


@compiled
def gain(curve: Curve, v: Complex[np.ndarray, "dims others"], x: float, spot: Spot) -> tuple[float, float]:
    """S at x, and the slope of its logarithm."""
    place(curve, x, spot)
    norm, norm_slope, total, total_slope, (point, slope) = 0.0, 0.0, 0.0, 0.0, spot
    ports = len(point) // curve.parts
    for g in range(curve.parts):
        for d in range(g * ports, (g + 1) * ports):
            c, s = point[d], slope[d]
            norm += c.real * c.real + c.imag * c.imag
            norm_slope += 2 * (c.real * s.real + c.imag * s.imag)
        for o in range(v.shape[1]):
            re, im, re_slope, im_slope = 0.0, 0.0, 0.0, 0.0
            for d in range(g * ports, (g + 1) * ports):
                c, s, value = point[d], slope[d], v[d, o]
                re += c.real * value.real + c.imag * value.imag
                im += c.real * value.imag - c.imag * value.real
                re_slope += s.real * value.real + s.imag * value.imag
                im_slope += s.real * value.imag - s.imag * value.real
            size = np.sqrt(re * re + im * im)
            if size > 0:
                total += size
                total_slope += (re * re_slope + im * im_slope) / size
    if norm <= 0 or total <= 0:
        return 0.0, 0.0
    return total * total / norm, 2 * total_slope / total - norm_slope / norm


@compiled
def climb(curve: Curve, v: Complex[np.ndarray, "dims others"], x: float, n_steps: int, spot: Spot) -> float:
    """Coordinate of the top near x; the curve's point there is left in `spot`.

    Args:
        curve: The curve.
        v: The tensor contracted with the other coordinates.
        x: Where to start, in intervals.
        n_steps: How many steps before and after x to look first.
        spot: Takes the point.
    """
    round_trip, step, end = curve.round_trip, curve.step, len(curve.table) // 3
    best, top, rise = -1.0, x, 0.0
    for i in range(-n_steps, n_steps + 1):
        at = x + i * step
        if round_trip or 0 <= at <= end:
            value, steep = gain(curve, v, at, spot)
            if value > best:
                best, top, rise = value, at, steep
    low, high = (top, top + step) if rise > 0 else (top - step, top)
    if not round_trip:
        low, high = max(low, 0.0), min(high, float(end))
    edge = high if rise > 0 else low
    edge_value, steep = gain(curve, v, edge, spot)
    if steep * rise >= 0:  # no top in the bracket: take the better end
        top = edge if edge_value > best else top
    else:
        d_low, d_high = (rise, steep) if rise > 0 else (steep, rise)
        tolerance = 0.01 * step / np.sqrt(1 + best)
        side = 0
        for _ in range(MAX_HALVINGS):
            top = (low * d_high - high * d_low) / (d_high - d_low)
            _, steep = gain(curve, v, top, spot)
            if steep > 0:
                change, low, d_low = top - low, top, steep
                if side > 0:
                    d_high /= 2
                side = 1
            else:
                change, high, d_high = high - top, top, steep
                if side < 0:
                    d_low /= 2
                side = -1
            if change < tolerance or high - low < tolerance:
                break
    place(curve, top, spot)
    return float(top % end) if round_trip else float(top)
