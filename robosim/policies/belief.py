"""Where the target may be: a probability for each cell, from all that was measured so far and the map as known then.

Each measurement says something for each link state that it may have had:

    line of sight   the target lies along the arrival, as far away as its power says, with nothing known between
    first order     one corner or wall lies along the arrival, from where the departure leads back to the target
    higher order    the target is out of sight, no farther than a free wave of that power
    outage          the target is out of sight

These densities are mixed by the probabilities of the states, and measurements multiplied. Places near each other
have errors in common, so only those some way apart count, each as part of an independent one; and none is believed
altogether, so that later ones can put right what an early one got wrong.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from robosim.policies.sightlines import Knowledge, bent, in_sight, knowledge
from robosim.radio.measurement import Measurement, free_path_m
from robosim.support.checks import FREQUENCY_HZ, check_numbers
from slam.graph.landmarks import Transmitter
from slam.grid import GridFrame, MapEstimate
from wireless.paths import LinkState

#: Cells along the side of a grid; more would not fit into memory.
MOST_CELLS = 4000
#: Transmitters in line of sight are looked for up to here [m].
_FARTHEST_M = 200.0
#: Squared errors of places that a graph tells, over their variances.
_TOLD = 2.0


@dataclass(frozen=True, kw_only=True)
class BeliefConfig:
    """Size of the grid, and how far measurements are trusted."""

    frequency_hz: float = 28e9
    """Carrier frequency; turns power into distance."""
    cell_m: float = 0.2
    """Side of a cell [m]."""
    half_side_m: float = 30.0
    """Half the side of the grid around the robot's start [m]; it grows where the robot goes, and where a transmitter in
    line of sight may stand."""
    arrival_deg: float = 2.5
    """Standard deviation of directions of arrival, with that of the heading [deg]."""
    departure_deg: float = 2.5
    """Standard deviation of directions of departure [deg]."""
    power_db: float = 2.5
    """Standard deviation of powers in line of sight [dB]: other paths add to them and take from them."""
    doubt: float = 0.05
    """Probability that a measurement says nothing."""
    weight: float = 0.4
    """Part of an independent measurement that each one counts as."""
    apart_m: float = 0.15
    """Measurements nearer to the last one do not count [m]."""
    in_sight: float = 0.02
    """How much less likely the target is where it would be in line of sight, if it is not."""
    departures: bool = True
    """Whether directions of departure are known; they are not if the target's beams are not."""
    remembers: bool = True
    """Whether measurements are gathered on the way; if not, the belief is that of the last one alone."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            frequency_hz=FREQUENCY_HZ,
            cell_m=(0.01, 10, "m"),
            half_side_m=(1, 1000, "m"),
            arrival_deg=(0.01, 180, "degrees"),
            departure_deg=(0.01, 180, "degrees"),
            power_db=(0.01, 200, "dB"),
            doubt=(0, 1),
            weight=(0, 1),
            apart_m=(0, 100, "m"),
            in_sight=(0, 1),
        )
        if self.half_side_m > MOST_CELLS / 2 * self.cell_m:
            raise ValueError(
                f"half_side_m is {self.half_side_m:g} and cell_m {self.cell_m:g}, expected a grid of at most "
                f"{MOST_CELLS} cells a side. Take larger cells."
            )


class TargetBelief:
    """A probability for each cell of a grid around where the robot started."""

    def __init__(self, start: Float[np.ndarray, "2"], config: BeliefConfig | None = None) -> None:
        c = self.config = config or BeliefConfig()
        n = 2 * math.ceil(c.half_side_m / c.cell_m) + 1
        corner = start - 0.5 * n * c.cell_m
        self.frame = GridFrame(
            origin_xy=(float(corner[0]), float(corner[1])), resolution_m=c.cell_m, shape=(n, n)
        )
        self._log = np.zeros((n, n), np.float32)
        self._located = np.zeros((n, n), np.float32)
        self._centres = _centres(self.frame)
        self._last: np.ndarray | None = None

    def probability(self) -> Float32[np.ndarray, "ny nx"]:
        """Of each cell to hold the target; they add up to 1."""
        log = self._log + self._located
        p = np.exp(log - log.max())
        return p / p.sum()

    def locate(self, found: Transmitter) -> None:
        """Take in where the mapper's graph puts the target, in place of what was taken in before.

        Its directions from many poses, weighed together with the poses' own errors, say more than each of them does.
        """
        c = self.config
        covariance = _TOLD * found.covariance + c.cell_m**2 / 12 * np.eye(2)
        off = self._centres - found.xy
        square = np.einsum("yxi,ij,yxj->yx", off, np.linalg.inv(covariance), off, optimize=True)
        density = _normal(np.exp(-0.5 * square))
        flat = np.float32(c.doubt / density.size)
        self._located = np.log(flat + np.float32(1 - c.doubt) * density)

    def add(self, measurement: Measurement, estimate: MapEstimate) -> bool:
        """Take in a measurement; says whether it counted, being far enough from the last one that did."""
        place = measurement.pose[:2]
        if self._last is not None and math.hypot(*(place - self._last)) < self.config.apart_m:
            return False
        self._last = place.copy()
        self._make_room(_ends(measurement, self.config))
        known = knowledge(estimate, beside_m=0.2)
        density = self._density(measurement, known)
        flat = np.float32(self.config.doubt / density.size)
        told = np.log(flat + (1 - np.float32(self.config.doubt)) * density)
        if self.config.remembers:
            self._log += np.float32(self.config.weight) * told
        else:
            self._log = told
        # Nothing is ruled out for good.
        np.maximum(self._log, self._log.max() - np.float32(15.0), out=self._log)
        return True

    def _make_room(self, points: Float[np.ndarray, "n 2"]) -> None:
        """Let the grid grow where points (x, y) [m] come near its edge: as likely there as at the edge."""
        c, (ny, nx) = self.config, self.frame.shape
        cells, ahead = self.frame.to_cells(points), 0.5 * c.half_side_m / c.cell_m
        (column, row), (far_column, far_row) = cells.min(axis=0), cells.max(axis=0)
        pads = [math.ceil(max(0.0, ahead - left)) for left in (column, nx - far_column, row, ny - far_row)]
        if not any(pads) or max(nx + sum(pads[:2]), ny + sum(pads[2:])) > MOST_CELLS:
            return
        # More at once, so that this is seldom done.
        left, right, below, above = (pad + round(ahead) if pad else 0 for pad in pads)
        self.frame = self.frame.padded(left, right, below, above)
        sides = ((below, above), (left, right))
        self._log, self._located = (np.pad(log, sides, mode="edge") for log in (self._log, self._located))
        self._centres = _centres(self.frame)

    def rule_out(self, place: Float[np.ndarray, "2"], radius_m: float, strength: float = 3.0) -> None:
        """The target was looked for at a place, and not found."""
        near = np.hypot(*(self._centres - place).transpose(2, 0, 1)) <= radius_m
        self._log[near] -= np.float32(strength)

    def peak(self, radius_m: float = 0.5) -> tuple[Float[np.ndarray, "2"], float]:
        """The place with the most probability around it [m], and how much that is."""
        p = self.probability()
        n = 2 * round(radius_m / self.config.cell_m) + 1
        around = cv2.boxFilter(p, -1, (n, n), normalize=False, borderType=cv2.BORDER_CONSTANT)
        iy, ix = np.unravel_index(int(np.argmax(around)), around.shape)
        part = np.s_[max(iy - n // 2, 0) : iy + n // 2 + 1, max(ix - n // 2, 0) : ix + n // 2 + 1]
        mass = p[part]
        return (self._centres[part] * mass[..., None]).sum(axis=(0, 1)) / mass.sum(), float(around[iy, ix])

    def _density(self, measurement: Measurement, known: Knowledge) -> Float32[np.ndarray, "ny nx"]:
        """Density of the target's place given one measurement."""
        place = measurement.pose[:2]
        surely, _ = in_sight(known, place, self.frame, self.config.half_side_m)
        hidden = np.where(surely, np.float32(self.config.in_sight), np.float32(1.0))
        probability = measurement.probability.astype(np.float32)
        total = probability[LinkState.OUTAGE] * _normal(hidden)
        if not len(measurement.aoa_rad):
            return (
                total / probability[LinkState.OUTAGE]
                if probability[LinkState.OUTAGE] > 0
                else _normal(hidden)
            )
        free_m = self._free_m(float(measurement.gain_db[0]))
        distance = np.hypot(*(self._centres - place).transpose(2, 0, 1)).astype(np.float32)
        if probability[LinkState.LOS] > 1e-3:
            total = total + probability[LinkState.LOS] * self._straight(measurement, known, free_m, distance)
        if probability[LinkState.FIRST_ORDER] > 1e-3:
            spread = math.radians(self.config.departure_deg)
            aoa = float(measurement.aoa_rad[0])
            aod = float(measurement.aod_rad[0]) if self.config.departures else None
            once = bent(known, place, aoa, aod, spread, free_m, self.frame) * hidden
            total = total + probability[LinkState.FIRST_ORDER] * _normal(once if once.any() else hidden)
        if probability[LinkState.HIGHER_ORDER] > 1e-3:
            near = hidden * (distance <= 1.2 * free_m)
            total = total + probability[LinkState.HIGHER_ORDER] * _normal(near)
        return total

    def _straight(
        self,
        measurement: Measurement,
        known: Knowledge,
        free_m: float,
        distance: Float32[np.ndarray, "ny nx"],
    ) -> Float32[np.ndarray, "ny nx"]:
        """Density in line of sight: along the arrival, as far as the power says, nothing known between."""
        c, place = self.config, measurement.pose[:2]
        near = np.maximum(distance, 0.5 * c.cell_m)
        off = self._centres - place
        aside = off[..., 1] * math.cos(measurement.aoa_rad[0]) - off[..., 0] * math.sin(
            measurement.aoa_rad[0]
        )
        ahead = off[..., 0] * math.cos(measurement.aoa_rad[0]) + off[..., 1] * math.sin(
            measurement.aoa_rad[0]
        )
        spread = np.hypot(np.radians(c.arrival_deg) * near, 0.5 * c.cell_m)
        power = 20 * np.log10(near / free_m) / np.hypot(c.power_db, 8.7 * 0.5 * c.cell_m / near)
        density = np.exp(-0.5 * ((aside / spread) ** 2 + power**2)).astype(np.float32)
        density[ahead < -c.cell_m] = 0
        _, possibly = in_sight(known, place, self.frame, min(2 * free_m + 1, c.half_side_m))
        density[~possibly] *= np.float32(0.05)
        return _normal(density)

    def _free_m(self, gain_db: float) -> float:
        """Length of a free wave that lost so much [m] (Friis)."""
        return float(np.clip(free_path_m(gain_db, self.config.frequency_hz), 0.1, 1e3))


def _ends(measurement: Measurement, config: BeliefConfig) -> Float[np.ndarray, "n 2"]:
    """The robot's place (x, y) [m], and where a transmitter stands that is in line of sight for all that is known."""
    place = measurement.pose[:2]
    if not len(measurement.aoa_rad) or measurement.probability[LinkState.LOS] < 0.5:
        return place[None]
    far_m = min(free_path_m(float(measurement.gain_db[0]), config.frequency_hz), _FARTHEST_M)
    aoa = float(measurement.aoa_rad[0])
    return np.array([place, place + far_m * np.array([math.cos(aoa), math.sin(aoa)])])


def _centres(frame: GridFrame) -> Float[np.ndarray, "ny nx 2"]:
    """Centres of the cells (x, y) [m]."""
    return frame.centres(np.ones(frame.shape, bool)).reshape(*frame.shape, 2)


def _normal(density: Float[np.ndarray, "ny nx"] | Bool[np.ndarray, "ny nx"]) -> Float32[np.ndarray, "ny nx"]:
    """The same, adding up to 1; even if there is nothing of it."""
    total = float(density.sum())
    if total <= 0:
        return np.full(density.shape, 1 / density.size, np.float32)
    return (density / total).astype(np.float32)
