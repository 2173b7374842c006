"""Permittivity and conductivity of walls from received powers alone, fitted to half of the floor.

The predicted power of a reading is the incoherent sum of the powers of its traced paths, as fading over a wavelength is
not predictable, times the patterns of both antennas, plus the offset of the beacon:
    P = O_b + 10 log10 sum_i p_i(walls) cos^2(elevation_i) 10^((g(arrival_i - heading) + g_b(departure_i)) / 10),
    g(a) = cos(elevation) sum_k c_k cos(k a) + s_k sin(k a).
The receiver is a short vertical dipole (cos^2), whose pattern g contains the robot's body and needs headings. Readings
not received do not count. With a sensitivity S, weaker readings are reported as S: the prediction is the mean of
max(P + n, S) over normal errors n.

Least squares with normal priors: of the walls in the logarithm, of the patterns in decibels, of the offsets none.
Errors of near readings are alike, so that `_ALIKE` readings count as one, also in the standard deviations.
A layer resonates: permittivities at which it is another number of half wavelengths thick explain powers equally well.
So the thickness must be given, and the prior decides: several first permittivities are tried on some of the places. The
standard deviations are those around the best minimum, and other minima are reported with it. Paths are traced with the
first walls, and again with the fitted ones; in between only their powers are computed again (`Tracer.reweigh`).

Left out: quantised readings (1 dB adds 0.08 dB2 to the variance); an excess loss by furniture, which did not reduce the
error in the flat of `tests.benchmarks.warsaw_powers`.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.calibration.measured_powers import MeasuredPowers
from robosim.plans.floorplan import FloorPlan
from robosim.support.checks import FREQUENCY_HZ, Range, checked
from robosim.support.reading import FileError
from wireless.em.materials import Layer, Material
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer, TracerConfig

logger = logging.getLogger(__name__)

#: Standard deviations of the priors: logarithms of permittivity and conductivity; first order of a pattern [dB].
_PRIOR, _PATTERN_DB = (0.4, 1.0), 2.0
#: Error of a reading [dB], and how many readings that are near each other count as one.
_ERROR_DB, _ALIKE = 6.0, 9
#: First permittivities over that of the prior, half a resonance apart, and places that they are compared on.
_FIRST, _SOME = np.geomspace(0.5, 2, 7), 200
#: Share of the power of each link that its weakest paths may have together to be dropped.
_DROPPED = 0.005
#: Places and beacons within walls are moved by no more than this, and so far from walls [m].
_MOVED_M, _OFF_M = 0.5, 0.01
#: Names of the fitted parameters of walls.
WALL_PARAMETERS = ("relative_permittivity", "conductivity_spm")
#: Permittivities that differ by less than this share are of the same minimum.
_SAME = 0.1
#: Step of numerical derivatives by logarithms.
_STEP = 0.02
#: What is traced by default.
_PATHS = TracerConfig(max_reflections=2, max_transmissions=2, floor_ceiling=True, max_paths=30)


@dataclass(frozen=True, kw_only=True)
@checked
class PowerFitConfig:
    """Settings of the tracing, and prior knowledge of walls and antennas."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 2.44e9
    ceiling_m: Annotated[float, Range(0.1, 100, "m")] = 2.5
    """Height of the ceiling [m]."""
    permittivity: Annotated[float, Range(1, 100)] = 5.0
    """Relative permittivity of walls before the fit."""
    conductivity_spm: Annotated[float, Range(1e-4, 10, "S/m")] = 0.03
    """Conductivity of walls before the fit [S/m]."""
    thickness_m: Annotated[float, Range(1e-3, 2, "m")] = 0.1
    """Thickness of walls [m]."""
    sensitivity_dbm: Annotated[float | None, Range(-200, 100, "dBm")] = None
    """Lowest power of a reading [dBm]; None for no limit."""
    receiver_orders: Annotated[int, Range(0, 8)] = 2
    """Orders of the receiver's pattern over the azimuth from its heading."""
    beacon_orders: Annotated[int, Range(0, 8)] = 2
    """Orders of the pattern of each beacon."""
    tracer: TracerConfig = _PATHS
    """Settings of the tracer."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerFit:
    """Fitted walls and beacons, and how well they predict."""

    wall: Material
    """The fitted wall."""
    parameters: dict[str, tuple[float, float]]
    """Value and standard deviation: relative_permittivity, conductivity_spm [S/m], then by beacon the offset [dBm],
    then coefficients of patterns [dB]."""
    log_covariance: Float[np.ndarray, "2 2"]
    """Covariance of the logarithms of the two parameters of walls."""
    minima: list[tuple[float, float, float]]
    """Permittivity and conductivity [S/m] at each minimum on some of the places, and by how much its logarithm of the
    posterior is less than that of the best one."""
    predicted_dbm: Float[np.ndarray, "b n"]
    """Prediction of each reading, also of those not received; NaN where no path arrives."""
    rms_db: dict[str, tuple[float, float, float, float]]
    """By beacon, and "mean": root mean square error in the fitted half of the floor and in the held-out one, then the
    same of a logarithmic law of distance, fitted to the same readings of the beacon [dB]."""
    building: Building
    """The building that paths were traced in."""


class _Scene(NamedTuple):
    """A building with walls of a material, and the paths between beacons and places in it."""

    wall: Material
    building: Building
    tracer: Tracer
    paths: Paths


class _Model:
    """Predictions of some readings and their derivatives, from paths that were traced once."""

    def __init__(
        self,
        scene: _Scene,
        measured: MeasuredPowers,
        selected: Bool[np.ndarray, "b n"],
        config: PowerFitConfig,
    ) -> None:
        self._scene, self._selected = scene, selected.ravel()
        least_dbm = config.sensitivity_dbm
        self.measured_dbm, self._sensitivity_dbm = (
            measured.power_dbm[selected],
            -np.inf if least_dbm is None else least_dbm,
        )
        self._paths = paths = scene.paths.select(self._selected[scene.paths.link])
        base = scene.tracer.reweigh(paths, scene.building.materials)
        # Of a wall passed across its corner one face is not listed: the ratio is more exact than the power.
        power = paths.power * np.cos(paths.aoa_el) ** 2
        self._traced = np.divide(power, base, out=np.zeros(len(paths)), where=base > 0)
        orders = config.receiver_orders, config.beacon_orders
        columns, deviations, heading_rad = [], [], measured.heading_rad
        self.names = [*WALL_PARAMETERS, *(f"beacon {name}: offset_dbm" for name in measured.names)]
        if heading_rad is not None:
            columns += _harmonics(paths.aoa_az - heading_rad[paths.rx], paths.aoa_el, orders[0])
            self.names += [f"receiver: {harmonic}" for harmonic in _parts(orders[0])]
            deviations += [_PATTERN_DB / (1 + i // 2) for i in range(len(columns))]
        waves = _harmonics(paths.aod_az, paths.aod_el, orders[1])
        for i, name in enumerate(measured.names):
            columns += [wave * (paths.tx == i) for wave in waves]
            self.names += [f"beacon {name}: {harmonic}" for harmonic in _parts(orders[1])]
            deviations += [_PATTERN_DB / (1 + k // 2) for k in range(len(waves))]
        self._basis = np.array(columns).reshape(-1, len(paths))
        self._of_beacon = np.repeat(np.eye(len(measured.names)), selected.shape[1], axis=0)[self._selected]
        self._thickness_m = config.thickness_m
        prior = np.log([config.permittivity, config.conductivity_spm])
        self.mean = np.concatenate([prior, np.zeros(len(measured.names) + len(columns))])
        """Parameters before the fit: logarithms of the wall, offsets of beacons, coefficients of patterns."""
        self.precision = 1 / np.concatenate([_PRIOR, np.full(len(measured.names), np.inf), deviations])
        """Inverse standard deviations of the parameters."""
        self._last: tuple[bytes, Float[np.ndarray, " p"]] = b"", base

    def predict(self, x: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
        """Powers of the readings for some parameters, at least the sensitivity."""
        power_dbm, least_dbm = self._predict(x), self._sensitivity_dbm
        if least_dbm == -np.inf:
            return power_dbm
        above = (power_dbm - least_dbm) / _ERROR_DB
        return least_dbm + _ERROR_DB * (above * norm.cdf(above) + norm.pdf(above))

    def derivatives(self, x: Float[np.ndarray, " k"]) -> Float[np.ndarray, "m k"]:
        """Derivatives of `predict`."""
        here, powers = self._predict(x), self._powers(x)
        sums = np.maximum(self._sum(powers), 1e-300)
        patterns = [self._sum(powers * wave) / sums for wave in self._basis]
        walls = [(self._predict(x + step) - here) / _STEP for step in _STEP * np.eye(2, len(x))]
        above = (here - self._sensitivity_dbm) / _ERROR_DB
        return np.column_stack([*walls, self._of_beacon, *patterns]) * norm.cdf(above)[:, None]

    def solve(self, x: Float[np.ndarray, " k"]) -> OptimizeResult:
        """Parameters with the least sum of squared errors and deviations from the priors, near some first ones."""
        sigma = _ERROR_DB * np.sqrt(_ALIKE)
        return least_squares(
            lambda x: np.concatenate(
                [(self.predict(x) - self.measured_dbm) / sigma, (x - self.mean) * self.precision]
            ),
            x,
            lambda x: np.vstack([self.derivatives(x) / sigma, np.diag(self.precision)]),
            x_scale=np.where(self.precision > 0, 1 / np.maximum(self.precision, 1e-9), 10.0),
            ftol=1e-4,
            xtol=1e-4,
            max_nfev=20,
        )

    def start(self, first_permittivity: float) -> Float[np.ndarray, " k"]:
        """First parameters: those before the fit with another permittivity, and mean offsets."""
        x = self.mean + np.eye(len(self.mean))[0] * np.log(first_permittivity)
        error = self.measured_dbm - self.predict(x)
        x[2 : 2 + self._of_beacon.shape[1]] = error @ self._of_beacon / self._of_beacon.sum(axis=0)
        return x

    def covariance(self, x: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k k"]:
        """Covariance of solved parameters."""
        slopes = self.derivatives(x)
        return np.linalg.inv(slopes.T @ slopes / (_ERROR_DB**2 * _ALIKE) + np.diag(self.precision**2))

    def _predict(self, x: Float[np.ndarray, " k"]) -> Float[np.ndarray, " m"]:
        """Powers of the readings without the sensitivity."""
        sums = np.maximum(self._sum(self._powers(x)), 1e-300)
        return 10 * np.log10(sums) + self._of_beacon @ x[2 : 2 + self._of_beacon.shape[1]]

    def _powers(self, x: Float[np.ndarray, " k"]) -> Float[np.ndarray, " p"]:
        """Power of each path, patterns included; those of the last walls are stored."""
        key = x[:2].tobytes()
        if self._last[0] != key:
            wall = wall_of(x, self._thickness_m)
            materials = tuple(
                wall if material == self._scene.wall else material
                for material in self._scene.building.materials
            )
            self._last = key, self._traced * self._scene.tracer.reweigh(self._paths, materials)
        return self._last[1] * 10 ** (0.1 * (x[len(x) - len(self._basis) :] @ self._basis))

    def _sum(self, of_paths: Float[np.ndarray, " p"]) -> Float[np.ndarray, " m"]:
        """Sums over the paths of each reading."""
        return np.bincount(self._paths.link, of_paths, minlength=len(self._selected))[self._selected]


#: Number of calls of `on_done`.
STEPS = 5


def fit_powers(
    measured: MeasuredPowers,
    plan: FloorPlan,
    config: PowerFitConfig,
    on_done: Callable[[str], None] = lambda name: None,
) -> PowerFit:
    """Fit the walls of a plan that have no colour, offsets and patterns to half of the floor.

    Raises:
        ValueError: If a place or beacon is not on the free floor, or not between floor and ceiling.
    """
    fitted = ~np.isnan(measured.power_dbm) & ~measured.held_out
    prior = np.log([config.permittivity, config.conductivity_spm])
    scene = _traced(measured, plan, wall_of(prior, config.thickness_m), config)
    on_done("paths traced")
    if lost := int((fitted & (scene.paths.count() == 0)).sum()):
        logger.warning(f"{lost} readings at places that no path reaches do not count")
    fitted &= scene.paths.count() > 0
    for name, readings in zip(measured.names, fitted, strict=True):
        if not readings.any():
            raise ValueError(
                f"beacon {name} reaches no place with a reading, expected paths to places. Pass more walls "
                f"(max_transmissions is {config.tracer.max_transmissions}), or give a plan with doors."
            )
    used = fitted.any(axis=0)
    few = _Model(scene, measured, fitted & (np.cumsum(used) % max(1, used.sum() // _SOME) == 0), config)
    tried = sorted((few.solve(few.start(first)) for first in _FIRST), key=lambda solution: solution.cost)
    on_done("first walls chosen")
    x = _Model(scene, measured, fitted, config).solve(tried[0].x).x
    on_done("walls fitted")
    scene = _traced(measured, plan, wall_of(x, config.thickness_m), config)
    fitted &= scene.paths.count() > 0
    on_done("paths traced again")
    model = _Model(scene, measured, fitted, config)
    x = model.solve(x).x
    on_done("walls fitted again")
    predicted = _Model(scene, measured, np.ones_like(fitted), config).predict(x).reshape(fitted.shape)
    predicted[scene.paths.count() == 0] = np.nan
    covariance = model.covariance(x)
    deviation = np.sqrt(np.diag(covariance))
    deviation[:2] *= np.exp(x[:2])
    values = np.concatenate([np.exp(x[:2]), x[2:]])
    minima: list[tuple[float, float, float]] = []
    for trial in tried:
        permittivity, conductivity_spm = np.exp(trial.x[:2]).tolist()
        if all(abs(permittivity / other - 1) > _SAME for other, _, _ in minima):
            minima.append((permittivity, conductivity_spm, float(trial.cost - tried[0].cost)))
    return PowerFit(
        wall=wall_of(x, config.thickness_m),
        parameters=dict(zip(model.names, zip(values.tolist(), deviation.tolist(), strict=True), strict=True)),
        log_covariance=covariance[:2, :2],
        minima=minima,
        predicted_dbm=predicted,
        rms_db=_errors(measured, predicted),
        building=scene.building,
    )


def wall_of(x: Float[np.ndarray, " k"], thickness_m: float) -> Material:
    """A wall; the first parameters are the logarithms of its permittivity and conductivity."""
    permittivity, conductivity_spm = np.exp(x[:2]).tolist()
    layer = Layer(
        thickness_m=thickness_m,
        relative_permittivity=max(permittivity, 1.0),
        conductivity_spm=conductivity_spm,
    )
    return Material("fitted_wall", (layer,))


def _traced(measured: MeasuredPowers, plan: FloorPlan, wall: Material, config: PowerFitConfig) -> _Scene:
    """Trace from beacons to places, and drop the weakest paths of each link."""
    building = make_building(
        plan,
        config=BuildingConfig(height_m=config.ceiling_m, wall_material=wall, furniture_material=wall),
    )
    tracer = Tracer(building, frequency_hz=config.frequency_hz, config=config.tracer)
    paths = tracer.trace(
        _on_floor(building, measured.beacons, "beacon", measured.names),
        _on_floor(building, measured.places, "place", range(1, 1 + len(measured.places))),
    )
    # The strongest paths come first: what a path and the weaker ones of its link carry together.
    remaining = np.append(np.cumsum(paths.power[::-1])[::-1], 0.0)
    first, last = (np.searchsorted(paths.link, paths.link, side) for side in ("left", "right"))
    weak = remaining[:-1] - remaining[last] <= _DROPPED * (remaining[first] - remaining[last])
    return _Scene(wall, building, tracer, paths.select(~weak | (paths.rank == 0)))


def _on_floor(
    building: Building, points: Float[np.ndarray, "n 3"], what: str, names: Sequence[object]
) -> Float[np.ndarray, "n 3"]:
    """Points moved out of walls, if they lie near free floor."""
    points = points.copy()
    free = building.free.buffer(-_OFF_M)
    for i in np.flatnonzero(~shapely.contains_xy(free, *points[:, :2].T)).tolist():
        near = shapely.get_coordinates(shapely.shortest_line(free, shapely.Point(points[i, :2])))[0]
        if np.hypot(*(near - points[i, :2])) > _MOVED_M:
            raise FileError(
                f"{what} {names[i]} at ({points[i, 0]:g}, {points[i, 1]:g}) m is more than {_MOVED_M:g} m away from "
                "the free floor, expected on it. Give plan and table in one frame."
            )
        points[i, :2] = near
    for i in np.flatnonzero((points[:, 2] <= 0) | (points[:, 2] >= building.height_m)).tolist():
        raise FileError(
            f"{what} {names[i]} has z_m = {points[i, 2]:g}, expected between the floor at 0 and the ceiling at "
            f"{building.height_m:g} m. Check z_m and --ceiling."
        )
    return points


def _harmonics(
    azimuth_rad: Float[np.ndarray, " p"], elevation_rad: Float[np.ndarray, " p"], orders: int
) -> list[Float[np.ndarray, " p"]]:
    """Basis functions of a pattern, cosine before sine of each order."""
    level = np.cos(elevation_rad)
    return [level * wave(k * azimuth_rad) for k in range(1, orders + 1) for wave in (np.cos, np.sin)]


def _parts(orders: int) -> list[str]:
    """Names of these coefficients."""
    return [f"{wave}{k}_db" for k in range(1, orders + 1) for wave in ("cos", "sin")]


def _errors(
    measured: MeasuredPowers, predicted_dbm: Float[np.ndarray, "b n"]
) -> dict[str, tuple[float, float, float, float]]:
    """See `PowerFit.rms_db`."""
    errors = {}
    for i, name in enumerate(measured.names):
        power, received = measured.power_dbm[i], ~np.isnan(measured.power_dbm[i] - predicted_dbm[i])
        log_m = np.log10(np.maximum(np.linalg.norm(measured.places - measured.beacons[i], axis=1), 0.1))
        halves = received & ~measured.held_out, received & measured.held_out
        law = np.polyval(np.polyfit(log_m[halves[0]], power[halves[0]], 1), log_m)
        errors[name] = tuple(
            float(np.sqrt(np.mean((power - power_dbm)[half] ** 2)))
            for power_dbm in (predicted_dbm[i], law)
            for half in halves
        )
    return {**errors, "mean": tuple(np.mean(list(errors.values()), axis=0).tolist())}
