"""Noise of a depth camera that triangulates, added to an exact depth image.

Such a camera compares a pattern or picture from two places a baseline b apart. Depth comes from the shift between the
two, f b / z, so all errors of the shift grow with z squared. In this order, for each pixel:

- Sideways jitter: the ray is that of a place next to the pixel's centre. On a surface the depth there follows from the
  slope of the inverse depth, which on a plane is exact; at an edge it may be that of the other side.
- Spread along the view: Nguyen's 1.2 mm + 1.9 mm/m^2 (z - 0.4 m)^2, and more at grazing angles.
- Rounding: the shift is measured in steps, so depths are multiples in 1 / z.
- Missing returns (0): what only one of the two places sees, which next to a near edge is f b (1 / z_near - 1 / z_far)
  pixels of the background; surfaces hit at a grazing angle; surfaces too near or too far.

Left out: errors that neighbours share, glass, mirrors, dark and sunlit surfaces, more than one camera.
Reference: Nguyen, Izadi and Lovell, Modeling Kinect sensor noise for improved 3D reconstruction and tracking, 3DIMPVT
2012, eqs. (2)-(4); Khoshelham and Elberink, Sensors 12(2), 2012 (rounding).
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float32, UInt64

from robosim.support.checks import Range, checked
from robosim.support.compiled import compiled

#: A number for each pixel.
Pixels = Float32[np.ndarray, "h w"]


#: Focal length of the camera that the published numbers belong to [pixels].
NATIVE_FOCAL_PX = 585.0


@dataclass(frozen=True, kw_only=True)
@checked
class DepthNoise:
    """Errors of a depth camera; the defaults are those of a Kinect."""

    level: Annotated[float, Range(0, 100, "times the published noise of depth")] = 0.0
    """Scale of all deviations, of the rounding step and of the shadows: 0 none, 1 as published."""
    baseline_m: Annotated[float, Range(0, 10, "m")] = 0.075
    """Distance of the second view, to the left of the first [m]."""
    step_px: Annotated[float, Range(0, 100, "pixels")] = 0.125
    """Step in which the shift is measured [pixels of the published camera]."""
    lateral_px: Annotated[float, Range(0, 100, "pixels")] = 0.8
    """Standard deviation of the sideways jitter [pixels of the published camera]."""
    fading_deg: Annotated[float, Range(0.01, 90, "degrees")] = 75.0
    """Surfaces met at more than this from their normal begin to return nothing [deg]."""
    lost_deg: Annotated[float, Range(0.01, 90, "degrees")] = 85.0
    """Surfaces met at more than this from their normal return nothing [deg]."""
    min_range_m: Annotated[float, Range(0, 1000, "m")] = 0.15
    """Nearer things are not measured [m along the view]."""
    max_range_m: Annotated[float, Range(0.01, 1000, "m")] = 10.0
    """Farther things are not measured [m along the view]."""

    def __post_init__(self) -> None:
        if not (self.fading_deg < self.lost_deg and self.min_range_m < self.max_range_m):
            raise ValueError(
                f"fading_deg is {self.fading_deg} and lost_deg {self.lost_deg}, min_range_m {self.min_range_m} and "
                f"max_range_m {self.max_range_m}, expected fading below lost and min below max."
            )

    def sigma_m(self, depth_m: float) -> float:
        """Standard deviation along the view of a surface that is faced [m]."""
        return self.level * (0.0012 + 0.0019 * max(depth_m - 0.4, 0.0) ** 2)

    def apply(self, depth: Pixels, focal_px: float, rng: np.random.Generator) -> Pixels:
        """The measured depth image [m], 0 where nothing was measured, of a true one [m]; the same array at level 0.

        `focal_px` is the focal length of the image [pixels]; `rng` draws all of the noise.
        """
        if self.level == 0:
            return depth
        normals = rng.standard_normal(depth.shape, np.float32)
        bits = rng.integers(0, 2**64, depth.shape, np.uint64)
        fading, lost = math.cos(math.radians(self.fading_deg)), math.cos(math.radians(self.lost_deg))
        settings = np.array(
            [
                focal_px,
                self.level,
                self.level * self.lateral_px * focal_px / NATIVE_FOCAL_PX,
                self.level * self.step_px / (NATIVE_FOCAL_PX * self.baseline_m) if self.baseline_m else 0.0,
                min(self.level, 1.0) * focal_px * self.baseline_m,
                fading,
                lost,
                self.min_range_m,
                self.max_range_m,
            ]
        )
        return _measure(depth, normals, bits, settings)


@compiled
def _measure(depth: Pixels, normals: Pixels, bits: UInt64[np.ndarray, "h w"], settings: np.ndarray) -> Pixels:
    """All effects, pixel by pixel."""
    f, level, lateral, rounding, shift, fading, lost, nearest, farthest = settings
    h, w = depth.shape
    measured = np.zeros((h, w), np.float32)
    inverse = np.zeros((h, w), np.float32)
    for i in range(h):
        for j in range(w):
            if depth[i, j] > 0:
                inverse[i, j] = 1.0 / depth[i, j]
    for i in range(h):
        y = (i + 0.5 - 0.5 * h) / f
        reach = -np.inf  # right end, in the second view, of what lies left of here
        for j in range(w):
            z, q = float(depth[i, j]), float(inverse[i, j])
            if q == 0:
                continue
            place = j + shift * q
            hidden = place <= reach - 0.5
            reach = max(reach, place)
            if hidden or z < nearest or z > farthest:
                continue
            x = (j + 0.5 - 0.5 * w) / f
            across, right, left = _slope(inverse, i, j, 0, 1, f)
            along, below, above = _slope(inverse, i, j, 1, 0, f)
            # A plane n . p = d is n / d = (f q_u, f q_v, q - u q_u - v q_v), and the ray meets it at n . r = d q.
            a, b = f * across, f * along
            c = q - x * a - y * b
            norm = math.sqrt((a * a + b * b + c * c) * (1 + x * x + y * y))
            cosine = min(q / norm, 1.0) if norm > 0 else 1.0
            word = bits[i, j]
            chance = (word & np.uint64(0xFFFF)) / 65536.0
            if chance * (fading - lost) >= cosine - lost:
                continue
            # Sums of two uniform numbers: bounded, with standard deviation 1.
            du = lateral * 2.449489743 * (_uniform(word, 16) + _uniform(word, 28) - 1.0)
            dv = lateral * 2.449489743 * (_uniform(word, 40) + _uniform(word, 52) - 1.0)
            q = _inverse_depth_near(q, across, du, left, right, _uniform(word, 4))
            q = _inverse_depth_near(q, along, dv, above, below, _uniform(word, 10))
            z = 1.0 / q
            faced = max(z - 0.4, 0.0)
            sigma = 0.0012 + 0.0019 * faced * faced
            if cosine < 0.5:
                angle = math.acos(cosine)
                gap = max(0.5 * math.pi - angle, 0.05)
                sigma += 0.0001 / math.sqrt(z) * angle * angle / (gap * gap)
            z += level * sigma * normals[i, j]
            if z < nearest or z > farthest:
                continue
            if rounding > 0:
                steps = math.floor(1.0 / (z * rounding) + 0.5)
                if steps < 1:
                    continue
                z = 1.0 / (steps * rounding)
            measured[i, j] = z
    return measured


@compiled
def _uniform(word: int, shift: int) -> float:
    """Twelve bits of a word as a number in [0, 1)."""
    return ((word >> np.uint64(shift)) & np.uint64(0xFFF)) / 4096.0


@compiled
def _slope(inverse: Pixels, i: int, j: int, di: int, dj: int, f: float) -> tuple[float, float, float]:
    """Change of the inverse depth per pixel, and the inverse depth of what lies after and before an edge (0 if none).

    The flatter of the two sides is taken, as the steeper one may lead over an edge. An edge is where a neighbour
    lies farther off the plane through this pixel and its other neighbour than a corner of two walls would.
    """
    h, w = inverse.shape
    q = float(inverse[i, j])
    after = float(inverse[i + di, j + dj]) if i + di < h and j + dj < w else 0.0
    before = float(inverse[i - di, j - dj]) if i >= di and j >= dj else 0.0
    if after == 0 or before == 0:
        if after > 0:
            return after - q, 0.0, 0.0
        return (q - before, 0.0, 0.0) if before > 0 else (0.0, 0.0, 0.0)
    forward, backward = after - q, q - before
    slope = forward if abs(forward) < abs(backward) else backward
    # Two walls at right angles bend the inverse depth by some q / f a pixel.
    bend = 4.0 * q / f + 0.05 * q * q
    if abs(forward - backward) <= bend:
        return slope, 0.0, 0.0
    if abs(forward) > abs(backward):
        return slope, after, 0.0
    return slope, 0.0, before


@compiled
def _inverse_depth_near(
    q: float, slope: float, offset: float, before: float, after: float, place: float
) -> float:
    """Inverse depth at an offset from a pixel's centre; an edge of its surface is at a random place in the pixel."""
    if offset > 0 and after > 0 and place < offset:
        return after
    if offset < 0 and before > 0 and place < -offset:
        return before
    return max(q + slope * offset, 0.2 * q)
