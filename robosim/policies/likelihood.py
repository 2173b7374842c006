"""Density of the target's position given one measurement: a mixture over link states, by their probabilities.

    line of sight   the target is along the arrival, as far away as the power implies, without known obstacles between,
                    unless the carrier passes walls
    first order     one corner or wall is along the arrival, from which the departure leads back to the target; or the
                    state is wrong, and the arrival is treated as of higher order
    higher order    the target is out of sight, no farther than a free wave of that power; the arrival comes from where
                    the route to the target begins, the departure from where the route back begins
                    (`route_directions`)
    outage          the target is out of sight

All densities include a prior over places, and each adds up to 1 over the grid.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.special import i0e, log_ndtr

from robosim.policies.route_directions import MapSurvey, RouteDirections
from robosim.policies.sightlines import bent_origins, in_sight
from robosim.radio.measurement import Measurement, free_path_m
from wireless.paths import LinkState
from wireless.tracing.tracer import OPAQUE_HZ

#: States of lower probability are left out.
_LEAST = 1e-3
#: Relative density without a known route, where 1 stands for no information.
_NO_ROUTE = 0.05

#: Shares and concentrations of the von Mises densities of errors of arrivals and departures relative to routes; the
#: rest is uniform. Fitted by maximum likelihood to 183 places of 18 searches in 9 scanned homes.
_ARRIVAL = {
    LinkState.FIRST_ORDER: ((0.2, 260.0), (0.7, 3.5)),
    LinkState.HIGHER_ORDER: ((0.15, 260.0), (0.65, 2.5)),
}
_DEPARTURE = {LinkState.FIRST_ORDER: ((0.95, 2.6),), LinkState.HIGHER_ORDER: ((0.8, 1.0),)}
#: Largest distance of the target over the length of a free wave of the same power: noise and other paths add power.
_FARTHER = {LinkState.FIRST_ORDER: 1.1, LinkState.HIGHER_ORDER: 1.2}
#: Share of the density of first order by single corners and walls; the rest is by routes.
_BY_BENDS = 0.5


#: Mean length of the first detected path, less what merged paths add, over the route around opaque walls, and over the
#: distance where waves pass walls, by state [m]: of paths traced at 2.4 to 60 GHz in eight scanned homes and two
#: generated offices. Ranges measured in an apartment at 4 GHz are longer than the distance by 0.10 m with a weak direct
#: path, by 1.04 m without.
BEYOND_ROUTE_M = {LinkState.FIRST_ORDER: 0.9, LinkState.HIGHER_ORDER: 2.0}
BEYOND_DISTANCE_M = {LinkState.FIRST_ORDER: 0.35, LinkState.HIGHER_ORDER: 0.75}
#: Density of a range that carries no information, and its share [1/m].
_UNIFORM, _WRONG = 1 / 50, 0.05


def range_density(
    measurement: Measurement,
    sigma_m: float,
    distance_m: Float[np.ndarray, "*cells"],
    route_m: Float[np.ndarray, "*cells"] | None = None,
) -> Float[np.ndarray, "*cells"]:
    """Density of a measured range given distances and, of opaque walls, lengths of routes around them [1/m].

    The first path is as long as the distance in line of sight. In other states it is longer by an exponential
    distribution, and with normal errors the density is that of their sum (Grushka, Analytical Chemistry 44, 1972).
    `sigma_m` includes the cells' size.
    """
    range_m, probability = measurement.range_m, measurement.probability
    beyond = (range_m - distance_m) / sigma_m
    density = probability[LinkState.LOS] * np.exp(-0.5 * beyond**2) / (math.sqrt(math.tau) * sigma_m)
    if route_m is not None:
        beyond = (range_m - route_m) / sigma_m
    for state, mean_m in (BEYOND_DISTANCE_M if route_m is None else BEYOND_ROUTE_M).items():
        excess_m = mean_m + measurement.range_merged_m
        k = sigma_m / excess_m
        density = density + probability[state] / excess_m * np.exp(
            0.5 * k**2 - k * beyond + log_ndtr(beyond - k)
        )
    unknown = _WRONG + (1 - _WRONG) * probability[LinkState.OUTAGE]
    return np.asarray(unknown * _UNIFORM + (1 - _WRONG) * density)


class Likelihood:
    """Likelihood of a measurement over all places of a grid."""

    def __init__(
        self,
        measurement: Measurement,
        survey: MapSurvey,
        offset: tuple[Float[np.ndarray, "1 nx"], Float[np.ndarray, "ny 1"]],
        distance: Float[np.ndarray, "ny nx"],
        *,
        frequency_hz: float,
        departures: bool,
        routes: bool,
    ) -> None:
        """Prepare values that several states need.

        The survey is over the grid of the offsets from the receiver to its cells (x and y) and their lengths [m].
        `departures` says whether directions of departure are known, `routes` whether arrivals are compared with routes.
        """
        self._m, self._survey, self._known = measurement, survey, survey.known
        self._frame, self._use_routes = survey.frame, routes
        self._departures = departures and bool(np.isfinite(measurement.aod_rad).all())
        self._place = measurement.pose[:2]
        self._offset, self._distance = offset, distance.astype(np.float32)
        self._is_opaque = frequency_hz >= OPAQUE_HZ
        self._free_m = 0.0
        if len(measurement.gain_db):
            self._free_m = float(np.clip(free_path_m(float(measurement.gain_db[0]), frequency_hz), 0.1, 1e3))

    def density(
        self,
        prior: Float32[np.ndarray, "ny nx"],
        hidden: Float32[np.ndarray, "ny nx"],
        *,
        arrival_rad: float,
        departure_rad: float,
        power_db: float,
        reach_m: float,
    ) -> Float32[np.ndarray, "ny nx"]:
        """Density of the target's position by the prior, and that without line of sight (`hidden`).

        Directions and powers (in line of sight) have these standard deviations; `reach_m` limits lines of sight.
        """
        probability = self._m.probability.astype(np.float32)
        if not len(self._m.aoa_rad):
            return normalise(hidden)
        first, higher = LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER
        total = probability[LinkState.OUTAGE] * normalise(hidden)
        if probability[LinkState.LOS] > _LEAST:
            straight = self._straight(arrival_rad, power_db, reach_m)
            total = total + probability[LinkState.LOS] * normalise(prior * straight)
        routes = None
        if self._use_routes and probability[first] + probability[higher] > _LEAST:
            routes = self._survey.routes(self._place)
        if probability[first] > _LEAST:
            guided = hidden * self._along_routes(routes, first)
            aod = float(self._m.aod_rad[0]) if self._departures else None
            aoa = float(self._m.aoa_rad[0])
            bent = guided * bent_origins(
                self._known, self._place, aoa, aod, departure_rad, self._free_m, self._frame
            )
            near = normalise(guided * self._within(first))
            single = normalise(bent) if bent.any() else near
            share = _BY_BENDS if self._use_routes else 1.0
            total = total + probability[first] * (share * single + (1 - share) * near)
        if probability[higher] > _LEAST:
            guided = hidden * self._along_routes(routes, higher) * self._within(higher)
            total = total + probability[higher] * normalise(guided)
        return np.asarray(total, np.float32)

    def _within(self, state: LinkState) -> Bool[np.ndarray, "ny nx"]:
        """Places no farther than a free wave of the measured power."""
        return np.asarray(self._distance <= _FARTHER[state] * self._free_m)

    def _straight(self, arrival_rad: float, power_db: float, reach_m: float) -> Float32[np.ndarray, "ny nx"]:
        """Likelihood in line of sight."""
        cell_m = self._frame.resolution_m
        c, s = math.cos(self._m.aoa_rad[0]), math.sin(self._m.aoa_rad[0])
        x, y = self._offset
        lateral, ahead = y * c - x * s, x * c + y * s
        near = np.maximum(self._distance, 0.5 * cell_m)
        # In other cells the density is too small for a number. With a margin, rays to these cells stay in them.
        width = 15 * (arrival_rad * (near + 1.5 * cell_m) + 0.6 * cell_m)
        beam = (np.abs(lateral) < width) & (ahead >= -2.5 * cell_m)
        near = near[beam]
        spread = np.hypot(arrival_rad * near, 0.5 * cell_m)
        power = 20 * np.log10(near / self._free_m) / np.hypot(power_db, 8.7 * 0.5 * cell_m / near)
        density = np.zeros(self._frame.shape, np.float32)
        density[beam] = np.exp(-0.5 * ((lateral[beam] / spread) ** 2 + power**2)) * (ahead[beam] >= -cell_m)
        if not self._is_opaque:
            return density
        far_m = min(2 * self._free_m + 1, reach_m)
        possibly = in_sight(self._known, self._place, self._frame, far_m, through_unknown=True, within=beam)
        density[~possibly] *= np.float32(0.05)
        return density

    def _along_routes(self, routes: RouteDirections | None, state: LinkState) -> Float32[np.ndarray, "ny nx"]:
        """Density of arrival and departure for each place of the target, over a uniform one."""
        ratio = np.ones(self._frame.shape, np.float32)
        if routes is None:
            return ratio
        agreement = _direction_ratio(routes.out, float(self._m.aoa_rad[0]), _ARRIVAL[state])
        if self._departures:
            agreement *= _direction_ratio(routes.back, float(self._m.aod_rad[0]), _DEPARTURE[state])
        ratio[:] = _NO_ROUTE
        ratio[routes.rows, routes.columns] = np.maximum(agreement, _NO_ROUTE)
        return ratio


def _direction_ratio(
    directions: Float32[np.ndarray, "ny nx 2"], angle_rad: float, parts: tuple[tuple[float, float], ...]
) -> Float32[np.ndarray, "ny nx"]:
    """Density of a measured direction given unit vectors of routes (0: no information), over a uniform one."""
    cosine = directions @ np.array([math.cos(angle_rad), math.sin(angle_rad)], np.float32)
    total = np.full(cosine.shape, 1.0 - sum(share for share, _ in parts), np.float32)
    for share, kappa in parts:
        # Von Mises: exp(kappa cos x) / (2 pi I0(kappa)), here with both sides scaled by exp(-kappa).
        total += (share / i0e(kappa)) * np.exp(kappa * (cosine - 1))
    return total


def normalise(
    density: Float[np.ndarray, "ny nx"] | Bool[np.ndarray, "ny nx"],
) -> Float32[np.ndarray, "ny nx"]:
    """A density that adds up to 1; uniform if all values are 0."""
    total = float(density.sum())
    if total <= 0:
        return np.full(density.shape, 1 / density.size, np.float32)
    return (density / total).astype(np.float32)
