"""The belief over the target's position: a probability for each cell, from all measurements with their maps.

The prior decreases with the distance from the explored area; cells with obstacles, on the trajectory of the robot, or
in the near view of its camera hold no target. Each measurement is multiplied by its likelihood (`likelihood`).
Measurements from near places share errors: only those some distance apart count, each as a part of an independent one.
None is trusted completely, so that later ones can correct early errors.
"""

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32

from robosim.policies.likelihood import Likelihood, normalise, range_density
from robosim.policies.route_directions import MapSurvey
from robosim.policies.sightlines import in_sight
from robosim.radio.measurement import Measurement, free_path_m
from robosim.support.checks import FREQUENCY_HZ, Range, checked
from slam.graph.landmarks import Transmitter
from slam.grid import GridFrame, MapEstimate
from slam.poses import wrap
from wireless.paths import LinkState
from wireless.tracing.tracer import OPAQUE_HZ

#: Largest number of cells along a side of the grid, by memory.
MOST_CELLS = 4000
#: Largest distance of a transmitter in line of sight [m].
_FARTHEST_M = 200.0
#: Squared errors of positions of the pose graph, over their variances.
_GRAPH_VARIANCES = 2.0
#: Cells that obstacles fill more than this hold no target.
_FULL = 0.6
#: The target is no nearer to the robot's trajectory, since the search would have ended [m].
_BEEN_M = 0.3
#: Factor of the probability where the target would have been found, or where an obstacle is.
_EMPTY = 0.1
#: Least prior over the largest one.
_LEAST_PRIOR = 0.01
#: What silence excludes at most: maps and poses err.
_CERTAIN = 0.95
#: Least probability of a target that is received at one place and not at another.
_LEAST_BETWEEN = np.float32(0.03)
#: Silence on a whole walk excludes more than that at the place which excludes most: a power of its factor.
_WALK = 1.4


@dataclass(frozen=True, kw_only=True)
@checked
class BeliefConfig:
    """The grid, and the errors of measurements."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency, which relates power and distance."""
    cell_m: Annotated[float, Range(0.01, 10, "m")] = 0.2
    """Side of a cell [m]."""
    half_side_m: Annotated[float, Range(1, 1000, "m")] = 30.0
    """Half the side of the grid around the robot's start [m]; it grows towards the robot and towards a transmitter
    in line of sight."""
    arrival_deg: Annotated[float, Range(0.01, 180, "degrees")] = 2.5
    """Standard deviation of directions of arrival, with that of the heading [deg]."""
    departure_deg: Annotated[float, Range(0.01, 180, "degrees")] = 2.5
    """Standard deviation of directions of departure [deg]."""
    power_db: Annotated[float, Range(0.01, 200, "dB")] = 2.5
    """Standard deviation of powers in line of sight [dB], by the interference of other paths."""
    doubt: Annotated[float, Range(0, 1)] = 0.05
    """Probability that a measurement carries no information."""
    weight: Annotated[float, Range(0, 1)] = 0.6
    """Weight of each measurement, where 1 stands for an independent one."""
    apart_m: Annotated[float, Range(0, 100, "m")] = 0.3
    """Least distance between measurements that count [m]; on large maps a multiple of it."""
    beyond_m: Annotated[float, Range(0.1, 1e6, "m")] = 5.0
    """Distance from the explored area at which the prior is smaller by a factor of e, and to which routes lead [m]."""
    look_m: Annotated[float, Range(0, 100, "m")] = 1.2
    """Distance within which the camera surely finds the target [m]; 0 if it does not look for it."""
    look_deg: Annotated[float, Range(0, 360, "degrees")] = 80.0
    """Width of the view in which it does [deg]."""
    in_sight: Annotated[float, Range(0, 1)] = 0.02
    """Factor of the probability in line of sight, if the state is another."""
    routes: bool = True
    """Whether arrivals around corners are compared with routes to the target."""
    departures: bool = True
    """Whether directions of departure are known, which requires the beams of the target."""
    silence: bool = False
    """Whether places are excluded from which a target would have been received, also out of sight."""
    remembers: bool = True
    """Whether all measurements count; otherwise the last one alone."""

    def __post_init__(self) -> None:
        if self.half_side_m > MOST_CELLS / 2 * self.cell_m:
            raise ValueError(
                f"half_side_m is {self.half_side_m:g} and cell_m {self.cell_m:g}, expected a grid of at most "
                f"{MOST_CELLS} cells a side. Take larger cells."
            )


class Around(NamedTuple):
    """Cells of the belief seen from a place."""

    surely: Bool[np.ndarray, "ny nx"]
    """Whether each is in sight, through known free cells."""
    offset: tuple[Float[np.ndarray, "1 nx"], Float[np.ndarray, "ny 1"]]
    """From the place to each, along x and along y [m]."""
    distance: Float[np.ndarray, "ny nx"]
    """Lengths of these [m]."""


class TargetBelief:
    """A probability for each cell of a grid around the robot's start."""

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
        #: Largest probability of reception of a target in each cell where nothing was received, and least where
        #: something was.
        self._silent, self._received = np.zeros((n, n), np.float32), np.ones((n, n), np.float32)
        #: Logarithm of the factor of all ranges, and of places where the target was not found.
        self._factor = np.zeros((n, n), np.float32)
        #: Centres of the cells (x, y) [m].
        self.centres = _centres(self.frame)
        self._last: np.ndarray | None = None
        self._survey: MapSurvey | None = None
        #: Cached until the belief changes: it is read several times per decision.
        self._probability: np.ndarray | None = None

    def probability(self) -> Float32[np.ndarray, "ny nx"]:
        """Probability of each cell; they add up to 1. Read-only."""
        if self._probability is None:
            log = self._prior + self._log + self._located
            if self.config.silence:
                between = np.maximum(self._received - _CERTAIN * self._silent, _LEAST_BETWEEN)
                log += _WALK * np.log(between)
            log += self._factor
            p = np.exp(log - log.max())
            self._probability = p / p.sum()
            self._probability.flags.writeable = False
        return self._probability

    def locate(self, transmitter: Transmitter) -> None:
        """Set the position of the target by the mapper's pose graph, instead of an earlier one.

        The graph combines directions from many poses with the errors of the poses.
        """
        c, self._probability = self.config, None
        covariance = _GRAPH_VARIANCES * transmitter.covariance + c.cell_m**2 / 12 * np.eye(2)
        offset = self.centres - transmitter.xy
        square = np.einsum("yxi,ij,yxj->yx", offset, np.linalg.inv(covariance), offset, optimize=True)
        density = normalise(np.exp(-0.5 * square))
        flat = np.float32(c.doubt / density.size)
        self._located = np.log(flat + np.float32(1 - c.doubt) * density)

    def add(self, measurement: Measurement, estimate: MapEstimate) -> bool:
        """Add a measurement; returns whether it counted, being far enough from the last one that did."""
        c, place = self.config, measurement.pose[:2]
        apart_m = c.apart_m * estimate.size_factor
        if self._last is not None and math.hypot(*(place - self._last)) < apart_m:
            return False
        self._last = place.copy()
        self.add_received(measurement, estimate)
        return True

    def add_received(self, measurement: Measurement, estimate: MapEstimate) -> None:
        """Add a measurement of another robot, whatever its distance from the last one."""
        c, place = self.config, measurement.pose[:2]
        self._probability = None
        self._grow(_ends(measurement, c))
        survey = self.survey(estimate)
        surely = in_sight(survey.known, place, self.frame, c.half_side_m, through_unknown=False)
        x, y = self.frame.axes()
        offset = x[None] - place[0], y[:, None] - place[1]
        distance = np.hypot(*offset)
        around = Around(surely, offset, distance)
        self._exclude_seen(measurement.pose, around)
        self._prior = self._log_prior(survey)
        if c.silence:
            routes = survey.routes(place)
            received = routes.received(distance[routes.rows, routes.columns])
            # An estimated path may be noise: the link state says so.
            if measurement.state != LinkState.OUTAGE:
                expected = np.zeros_like(self._received)
                expected[routes.rows, routes.columns] = received
                expected[surely] = 1.0
                np.minimum(self._received, expected, out=self._received)
            else:
                silent = self._silent[routes.rows, routes.columns]
                np.maximum(silent, received, out=silent)
        self._weigh(measurement, survey, around)
        if math.isfinite(measurement.range_m):
            sigma_m = math.hypot(measurement.range_sigma_m, 0.5 * c.cell_m)
            density = range_density(measurement, sigma_m, distance, self._wave_m(survey, place, distance))
            self._factor += (c.weight * np.log(density)).astype(np.float32)
        # No cell is excluded permanently.
        np.maximum(self._log, self._log.max() - np.float32(15.0), out=self._log)

    def _wave_m(
        self, survey: MapSurvey, place: Float[np.ndarray, "2"], distance: Float[np.ndarray, "ny nx"]
    ) -> Float[np.ndarray, "ny nx"] | None:
        """Length of the route from each cell [m], its distance if no route is known; None where waves pass walls."""
        if self.config.frequency_hz < OPAQUE_HZ:
            return None
        length_m, routes = distance.copy(), survey.routes(place)
        around = length_m[routes.rows, routes.columns]
        np.maximum(around, routes.length_m, out=around, where=np.isfinite(routes.length_m))
        return length_m

    def _weigh(self, measurement: Measurement, survey: MapSurvey, around: Around) -> None:
        """Multiply the belief by the likelihood of a measurement."""
        c = self.config
        prior = normalise(np.exp(self._prior))
        likelihood = Likelihood(
            measurement, survey, around.offset, around.distance, frequency_hz=c.frequency_hz,
            departures=c.departures, routes=c.routes,
        )  # fmt: skip
        density = likelihood.density(
            prior,
            np.where(around.surely, np.float32(c.in_sight), np.float32(1)) * prior,
            arrival_rad=math.radians(c.arrival_deg),
            departure_rad=math.radians(c.departure_deg),
            power_db=c.power_db,
            reach_m=c.half_side_m,
        )
        evidence = np.log(np.float32(c.doubt) + np.float32(1 - c.doubt) * density / prior)
        if c.remembers:
            self._log += np.float32(c.weight) * evidence
        else:
            self._log = evidence

    def survey(self, estimate: MapEstimate) -> MapSurvey:
        """A map over the belief's cells, cached for the decision."""
        survey = self._survey
        if survey is None or survey.estimate is not estimate or survey.frame is not self.frame:
            self._survey = survey = MapSurvey(estimate, self.frame, self.config.beyond_m)
        return survey

    def _exclude_seen(self, pose: Float[np.ndarray, "3"], around: Around) -> None:
        """Exclude cells at the robot, and in the near view of its camera."""
        c, (x, y, yaw) = self.config, pose.tolist()
        if not c.remembers:
            self._empty[:] = False
        reach_m = max(c.look_m, _BEEN_M)
        rows, columns, _ = self.frame.window((x - reach_m, y - reach_m), (x + reach_m, y + reach_m))
        distance, empty = around.distance[rows, columns], self._empty[rows, columns]
        empty |= distance <= _BEEN_M
        if c.look_m > 0:
            angle = np.arctan2(around.offset[1][rows], around.offset[0][:, columns]) - yaw
            is_ahead = np.abs(wrap(angle)) <= math.radians(c.look_deg) / 2
            empty |= is_ahead & around.surely[rows, columns] & (distance <= c.look_m)

    def _log_prior(self, survey: MapSurvey) -> Float32[np.ndarray, "ny nx"]:
        """Logarithm of the prior of each cell, up to a constant."""
        explored, filled = survey.shares(self.frame)
        unseen = (explored == 0).astype(np.uint8)
        distance_m = self.config.cell_m * cv2.distanceTransform(unseen, cv2.DIST_L2, 5)
        if unseen.all():
            distance_m[:] = 0
        prior = np.maximum(-distance_m / np.float32(self.config.beyond_m), np.float32(math.log(_LEAST_PRIOR)))
        prior[self._empty | (filled > _FULL)] += np.float32(math.log(_EMPTY))
        return prior

    def _grow(self, points: Float[np.ndarray, "n 2"]) -> None:
        """Extend the grid by its edge values where points [m] are near the edge."""
        c, (ny, nx) = self.config, self.frame.shape
        cells, ahead = self.frame.to_cells(points), 0.5 * c.half_side_m / c.cell_m
        (column, row), (far_column, far_row) = cells.min(axis=0), cells.max(axis=0)
        pads = [math.ceil(max(0.0, ahead - left)) for left in (column, nx - far_column, row, ny - far_row)]
        if not any(pads) or max(nx + sum(pads[:2]), ny + sum(pads[2:])) > MOST_CELLS:
            return
        # In large parts, so that this is rare.
        left, right, below, above = (pad + round(ahead) if pad else 0 for pad in pads)
        self.frame = self.frame.padded(left, right, below, above)
        sides = ((below, above), (left, right))
        for name in ("_log", "_located", "_empty", "_prior", "_silent", "_received", "_factor"):
            setattr(self, name, np.pad(getattr(self, name), sides, mode="edge"))
        self.centres = _centres(self.frame)

    def rule_out(self, place: Float[np.ndarray, "2"], radius_m: float, strength: float = 3.0) -> None:
        """Reduce the belief around a place [m] where the target was not found."""
        near = np.hypot(*(self.centres - place).transpose(2, 0, 1)) <= radius_m
        self._factor[near] -= np.float32(strength)
        self._probability = None

    def peak(self, radius_m: float = 0.5) -> tuple[Float[np.ndarray, "2"], float]:
        """The place with the most probability within a radius [m], and that probability."""
        p = self.probability()
        n = 2 * round(radius_m / self.config.cell_m) + 1
        around = cv2.boxFilter(p, -1, (n, n), normalize=False, borderType=cv2.BORDER_CONSTANT)
        iy, ix = np.unravel_index(int(np.argmax(around)), around.shape)
        window = np.s_[max(iy - n // 2, 0) : iy + n // 2 + 1, max(ix - n // 2, 0) : ix + n // 2 + 1]
        mass = p[window]
        return (self.centres[window] * mass[..., None]).sum(axis=(0, 1)) / mass.sum(), float(around[iy, ix])


def _ends(measurement: Measurement, config: BeliefConfig) -> Float[np.ndarray, "n 2"]:
    """The robot's place [m], and that of a transmitter which is probably in line of sight."""
    place = measurement.pose[:2]
    if not len(measurement.aoa_rad) or measurement.probability[LinkState.LOS] < 0.5:
        return place[None]
    far_m = min(free_path_m(float(measurement.gain_db[0]), config.frequency_hz), _FARTHEST_M)
    aoa = float(measurement.aoa_rad[0])
    return np.array([place, place + far_m * np.array([math.cos(aoa), math.sin(aoa)])])


def _centres(frame: GridFrame) -> Float[np.ndarray, "ny nx 2"]:
    """Centres of the cells (x, y) [m]."""
    return frame.centres(np.ones(frame.shape, bool)).reshape(*frame.shape, 2)
