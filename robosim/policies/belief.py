"""Where the target may be: a probability for each cell, from all that was measured so far and the map as known then.

Before anything is measured, places near to what was seen of the building are likelier than those far outside of it,
and what stands there, where the robot was and what its camera saw from near hold no target. Each measurement then
counts by its likelihood (`likelihood`), and measurements are multiplied. Places near each other have errors in
common, so only those some way apart count, each as part of an independent one; and none is believed altogether, so
that later ones can put right what an early one got wrong.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from robosim.policies.leads import filled, share_of
from robosim.policies.likelihood import Likelihood, normal
from robosim.policies.sightlines import in_sight
from robosim.policies.survey import Survey
from robosim.radio.measurement import Measurement, free_path_m
from robosim.support.checks import FREQUENCY_HZ, Range, checked
from slam.graph.landmarks import Transmitter
from slam.grid import GridFrame, MapEstimate
from slam.poses import wrap
from wireless.paths import LinkState

#: Cells along the side of a grid; more would not fit into memory.
MOST_CELLS = 4000
#: Transmitters in line of sight are looked for up to here [m].
_FARTHEST_M = 200.0
#: Squared errors of places that a graph tells, over their variances.
_TOLD = 2.0
#: Cells of which obstacles fill more hold no target.
_FULL = 0.6
#: The target is no nearer than this to where the robot was, or the search would have ended [m].
_BEEN_M = 0.3
#: How much less likely the target is where it would have been found, or where something else stands.
_EMPTY = 0.1
#: Nothing is less likely than this part of what is most likely before any measurement.
_LEAST_PRIOR = 0.01


@dataclass(frozen=True, kw_only=True)
@checked
class BeliefConfig:
    """Size of the grid, and how far measurements are trusted."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency; turns power into distance."""
    cell_m: Annotated[float, Range(0.01, 10, "m")] = 0.2
    """Side of a cell [m]."""
    half_side_m: Annotated[float, Range(1, 1000, "m")] = 30.0
    """Half the side of the grid around the robot's start [m]; it grows where the robot goes, and where a transmitter in
    line of sight may stand."""
    arrival_deg: Annotated[float, Range(0.01, 180, "degrees")] = 2.5
    """Standard deviation of directions of arrival, with that of the heading [deg]."""
    departure_deg: Annotated[float, Range(0.01, 180, "degrees")] = 2.5
    """Standard deviation of directions of departure [deg]."""
    power_db: Annotated[float, Range(0.01, 200, "dB")] = 2.5
    """Standard deviation of powers in line of sight [dB]: other paths add to them and take from them."""
    doubt: Annotated[float, Range(0, 1)] = 0.05
    """Probability that a measurement says nothing."""
    weight: Annotated[float, Range(0, 1)] = 0.6
    """Part of an independent measurement that each one counts as."""
    apart_m: Annotated[float, Range(0, 100, "m")] = 0.3
    """Measurements nearer to the last one do not count [m]."""
    beyond_m: Annotated[float, Range(0.1, 1e6, "m")] = 5.0
    """How far beyond what was seen the target may be: every so many metres it is less likely by a factor e [m]."""
    look_m: Annotated[float, Range(0, 100, "m")] = 1.2
    """How far the camera finds the target for sure; 0 if it does not look for it [m]."""
    look_deg: Annotated[float, Range(0, 360, "degrees")] = 80.0
    """Width of the camera's view in which it finds it for sure [deg]."""
    in_sight: Annotated[float, Range(0, 1)] = 0.02
    """How much less likely the target is where it would be in line of sight, if it is not."""
    ways: bool = True
    """Whether arrivals that come round corners tell of the target by the ways that lead there."""
    departures: bool = True
    """Whether directions of departure are known; they are not if the target's beams are not."""
    remembers: bool = True
    """Whether measurements are gathered on the way; if not, the belief is that of the last one alone."""

    def __post_init__(self) -> None:
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
        self._empty = np.zeros((n, n), bool)
        self._prior = np.zeros((n, n), np.float32)
        #: Of the cells, x, y [m].
        self.centres = _centres(self.frame)
        self._last: np.ndarray | None = None
        self._survey: Survey | None = None
        #: What follows from all that is taken in, until more is: it is asked for several times in a decision.
        self._probability: np.ndarray | None = None

    def probability(self) -> Float32[np.ndarray, "ny nx"]:
        """Of each cell to hold the target; they add up to 1. Not to be written to."""
        if self._probability is None:
            log = self._prior + self._log + self._located
            p = np.exp(log - log.max())
            self._probability = p / p.sum()
            self._probability.flags.writeable = False
        return self._probability

    def locate(self, found: Transmitter) -> None:
        """Take in where the mapper's graph puts the target, in place of what was taken in before.

        Its directions from many poses, weighed together with the poses' own errors, say more than each of them does.
        """
        c, self._probability = self.config, None
        covariance = _TOLD * found.covariance + c.cell_m**2 / 12 * np.eye(2)
        off = self.centres - found.xy
        square = np.einsum("yxi,ij,yxj->yx", off, np.linalg.inv(covariance), off, optimize=True)
        density = normal(np.exp(-0.5 * square))
        flat = np.float32(c.doubt / density.size)
        self._located = np.log(flat + np.float32(1 - c.doubt) * density)

    def add(self, measurement: Measurement, estimate: MapEstimate) -> bool:
        """Take in a measurement; says whether it counted, being far enough from the last one that did."""
        c, place = self.config, measurement.pose[:2]
        if self._last is not None and math.hypot(*(place - self._last)) < c.apart_m:
            return False
        self._last, self._probability = place.copy(), None
        self._make_room(_ends(measurement, c))
        survey = self.survey(estimate)
        surely = in_sight(survey.known, place, self.frame, c.half_side_m, through_unknown=False)
        off = self.centres - place
        distance = np.hypot(off[..., 0], off[..., 1])
        self._look(float(measurement.pose[2]), surely, off, distance)
        self._prior = self._before(estimate)
        prior = normal(np.exp(self._prior))
        likelihood = Likelihood(
            measurement,
            survey,
            off,
            distance,
            frequency_hz=c.frequency_hz,
            departures=c.departures,
            ways=c.ways,
        )
        density = likelihood.density(
            prior,
            np.where(surely, np.float32(c.in_sight), np.float32(1)) * prior,
            arrival_rad=math.radians(c.arrival_deg),
            departure_rad=math.radians(c.departure_deg),
            power_db=c.power_db,
            reach_m=c.half_side_m,
        )
        told = np.log(np.float32(c.doubt) + np.float32(1 - c.doubt) * density / prior)
        if c.remembers:
            self._log += np.float32(c.weight) * told
        else:
            self._log = told
        # Nothing is ruled out for good.
        np.maximum(self._log, self._log.max() - np.float32(15.0), out=self._log)
        return True

    def survey(self, estimate: MapEstimate) -> Survey:
        """A map over the belief's cells: whoever asks in the same decision gets what is worked out already."""
        kept = self._survey
        if kept is None or kept.estimate is not estimate or kept.frame is not self.frame:
            self._survey = kept = Survey(estimate, self.frame)
        return kept

    def _look(
        self,
        yaw: float,
        surely: Bool[np.ndarray, "ny nx"],
        off: Float[np.ndarray, "ny nx 2"],
        distance: Float[np.ndarray, "ny nx"],
    ) -> None:
        """The robot is where cells are so far off, and its camera sees no target ahead."""
        c = self.config
        if not c.remembers:
            self._empty[:] = False
        self._empty |= distance <= _BEEN_M
        if c.look_m > 0:
            near = surely & (distance <= c.look_m)
            aside = np.abs(wrap(np.arctan2(off[near, 1], off[near, 0]) - yaw))
            self._empty[near] |= aside <= math.radians(c.look_deg) / 2

    def _before(self, estimate: MapEstimate) -> Float32[np.ndarray, "ny nx"]:
        """Logarithm of the probability of each cell, but for a constant, before anything is measured."""
        unseen = (share_of(estimate.explored, estimate, self.frame) == 0).astype(np.uint8)
        away_m = self.config.cell_m * cv2.distanceTransform(unseen, cv2.DIST_L2, 5)
        if unseen.all():
            away_m[:] = 0
        prior = np.maximum(-away_m / np.float32(self.config.beyond_m), np.float32(math.log(_LEAST_PRIOR)))
        prior[self._empty | (filled(estimate, self.frame) > _FULL)] += np.float32(math.log(_EMPTY))
        return prior

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
        self._log, self._located, self._empty, self._prior = (
            np.pad(layer, sides, mode="edge")
            for layer in (self._log, self._located, self._empty, self._prior)
        )
        self.centres = _centres(self.frame)

    def rule_out(self, place: Float[np.ndarray, "2"], radius_m: float, strength: float = 3.0) -> None:
        """The target was looked for at a place, and not found."""
        near = np.hypot(*(self.centres - place).transpose(2, 0, 1)) <= radius_m
        self._log[near] -= np.float32(strength)
        self._probability = None

    def peak(self, radius_m: float = 0.5) -> tuple[Float[np.ndarray, "2"], float]:
        """The place with the most probability around it [m], and how much that is."""
        p = self.probability()
        n = 2 * round(radius_m / self.config.cell_m) + 1
        around = cv2.boxFilter(p, -1, (n, n), normalize=False, borderType=cv2.BORDER_CONSTANT)
        iy, ix = np.unravel_index(int(np.argmax(around)), around.shape)
        part = np.s_[max(iy - n // 2, 0) : iy + n // 2 + 1, max(ix - n // 2, 0) : ix + n // 2 + 1]
        mass = p[part]
        return (self.centres[part] * mass[..., None]).sum(axis=(0, 1)) / mass.sum(), float(around[iy, ix])


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
