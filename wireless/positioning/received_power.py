"""Where a transmitter is, from powers received along a route, without directions: a law of distance with walls.

For a candidate place at a distance d from a reading, with w walls between,

    P = P1 - 10 n log10(d / 1 m) - L w + 20 log10(cos(elevation)) + g(azimuth of arrival - heading) + s + e.

The shadowing s is a Gaussian process whose correlation decreases exponentially with the distance between readings
(Gudmundson, Electronics Letters 27, 1991), so that a hundred readings in one place are not a hundred measurements; e is
independent. Power at 1 m P1, exponent n, loss of a wall L, and the receiver's pattern g of first order, which contains
the robot's body, have normal priors. P is linear in them, so the density of all readings given the candidate has a
closed form (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, section 2.7).

The antennas at both ends are short vertical dipoles at different heights: below the transmitter there is no peak.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Shaped
from scipy.linalg import solve_triangular

from robosim.support.checks import Range, checked

#: Least power of a dipole over its largest, as reflections fill its null.
_NULL = 0.05
#: A candidate is no nearer to a reading [m].
_NEAREST_M = 0.2
#: Variance of rounding to 1 dB.
_ROUNDING = 1 / 12
#: Candidates that are computed together, by memory.
_TOGETHER = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerReadings:
    """Received powers of one transmitter along a route."""

    xy: Float[np.ndarray, "n 2"]
    """Positions of the receiver [m]."""
    heading_rad: Float[np.ndarray, " n"]
    """Its headings; NaN where unknown."""
    power_dbm: Float[np.ndarray, " n"]
    """Powers."""
    count: Float[np.ndarray, " n"]
    """Number of readings that each of them is the mean of."""

    def thinned(self, step_m: float, turn_rad: float, n_max: int) -> "PowerReadings":
        """Means of successive readings within a distance and a turn, which grow until there are at most so many."""
        starts = self._starts(step_m, turn_rad)
        while len(starts) > n_max:
            step_m, turn_rad = 1.2 * step_m, 1.2 * turn_rad
            starts = self._starts(step_m, turn_rad)
        if not starts:
            return self
        count = np.add.reduceat(self.count, starts)

        def mean(values: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, " m"]:
            return np.asarray(np.add.reduceat(values * self.count, starts) / count)

        return PowerReadings(
            xy=np.column_stack([mean(self.xy[:, 0]), mean(self.xy[:, 1])]),
            heading_rad=np.angle(mean(np.exp(1j * self.heading_rad))),
            power_dbm=mean(self.power_dbm),
            count=count,
        )

    def _starts(self, step_m: float, turn_rad: float) -> list[int]:
        """First of each group of successive readings."""
        starts: list[int] = []
        for i, (xy, heading_rad) in enumerate(zip(self.xy, self.heading_rad, strict=True)):
            if starts:
                turn = (heading_rad - self.heading_rad[starts[-1]] + math.pi) % math.tau - math.pi
                if math.hypot(*(xy - self.xy[starts[-1]])) <= step_m and not abs(turn) > turn_rad:
                    continue
            starts.append(i)
        return starts


@dataclass(frozen=True, kw_only=True)
@checked
class PowerLawConfig:
    """Means and standard deviations of what determines powers."""

    power_dbm: Annotated[tuple[float, float], Range(-300, 300, "dBm")] = (-45.0, 15.0)
    """Power at 1 m: mean [dBm] and standard deviation [dB]."""
    exponent: Annotated[tuple[float, float], Range(0, 10)] = (2.0, 0.5)
    """Exponent of the distance: mean and standard deviation."""
    wall_db: Annotated[tuple[float, float], Range(0, 100, "dB")] = (5.0, 2.0)
    """Loss of a wall: mean and standard deviation [dB]."""
    pattern_db: Annotated[float, Range(0, 100, "dB")] = 3.0
    """Standard deviations of cosine and sine of the receiver's pattern [dB]."""
    above_m: Annotated[tuple[float, ...], Range(0, 1000, "m")] = (0.7, 1.1)
    """Heights above or below the receiver that are equally probable [m]."""
    shadowing_db: Annotated[float, Range(0.01, 100, "dB")] = 4.0
    """Standard deviation of the shadowing [dB]."""
    correlation_m: Annotated[float, Range(0.01, 1000, "m")] = 3.0
    """Distance over which its correlation decreases by a factor of e [m]."""
    reading_db: Annotated[float, Range(0.01, 100, "dB")] = 4.0
    """Standard deviation of a reading by fading [dB]."""
    averaged: Annotated[float, Range(1, 1000, "readings")] = 4.0
    """Most readings in one place whose fading is independent."""


def log_evidence(
    readings: PowerReadings,
    candidates: Float[np.ndarray, "m 2"],
    walls: Shaped[np.ndarray, "n m"],
    config: PowerLawConfig | None = None,
) -> Float[np.ndarray, " m"]:
    """Logarithm of the density of all readings for each candidate place [m], up to a constant."""
    c = config or PowerLawConfig()
    if not len(readings.xy):
        return np.zeros(len(candidates))
    apart_m = np.hypot(*(readings.xy[:, None] - readings.xy).transpose(2, 0, 1))
    variance = c.reading_db**2 / np.minimum(readings.count, c.averaged) + _ROUNDING
    covariance = c.shadowing_db**2 * np.exp(-apart_m / c.correlation_m) + np.diag(variance)
    root = np.linalg.cholesky(covariance)
    evidence = np.empty((len(c.above_m), len(candidates)))
    for i, above_m in enumerate(c.above_m):
        for start in range(0, len(candidates), _TOGETHER):
            batch = slice(start, start + _TOGETHER)
            offset, factors = _terms(readings, candidates[batch], walls[:, batch], above_m, c)
            # White noise of unit variance: of the readings less their mean, and of what unknowns of unit variance add.
            rest = solve_triangular(root, readings.power_dbm[:, None] - offset, lower=True)
            flat = factors.reshape(len(offset), -1)
            white = solve_triangular(root, flat, lower=True).reshape(factors.shape)
            precision = np.eye(factors.shape[2]) + np.einsum("nmk,nml->mkl", white, white, optimize=True)
            along = np.einsum("nmk,nm->mk", white, rest, optimize=True)
            explained = (along * np.linalg.solve(precision, along[..., None])[..., 0]).sum(axis=1)
            evidence[i, batch] = -0.5 * ((rest**2).sum(axis=0) - explained + np.linalg.slogdet(precision)[1])
    return np.asarray(np.logaddexp.reduce(evidence, axis=0))


def _terms(
    readings: PowerReadings,
    candidates: Float[np.ndarray, "m 2"],
    walls: Shaped[np.ndarray, "n m"],
    above_m: float,
    c: PowerLawConfig,
) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, "n m k"]]:
    """Mean of each power for each candidate, and what each unknown adds to it per standard deviation [dB]."""
    dx, dy = (candidates - readings.xy[:, None]).transpose(2, 0, 1)
    level_m = np.maximum(np.hypot(dx, dy), _NEAREST_M)
    distance_m = np.hypot(level_m, above_m)
    level = level_m / distance_m
    decades = -10 * np.log10(distance_m)
    ahead = np.arctan2(dy, dx) - readings.heading_rad[:, None]
    pattern = np.nan_to_num(c.pattern_db * level * np.array([np.cos(ahead), np.sin(ahead)]))
    unknown = (c.power_dbm[1] * np.ones_like(level), c.exponent[1] * decades, -c.wall_db[1] * walls, *pattern)
    mean = c.power_dbm[0] + c.exponent[0] * decades - c.wall_db[0] * walls
    return mean + 10 * np.log10(level**2 + _NULL), np.stack(unknown, axis=-1)
