"""What one measurement says of the target's place: a density for each link state, mixed by their probabilities.

    line of sight   the target lies along the arrival, as far away as its power says, with nothing known between
    first order     one corner or wall lies along the arrival, from where the departure leads back to the target;
                    or it was taken for one, and the arrival leads as in higher order
    higher order    the target is out of sight, no farther than a free wave of that power; its arrival comes from where
                    the way to the target begins, and its departure left where the way from there begins (`leads`)
    outage          the target is out of sight

All densities are after a prior of places, and each adds up to 1 over the grid.
"""

import math

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy.special import i0e

from robosim.policies.leads import Leads
from robosim.policies.sightlines import bent, in_sight
from robosim.policies.survey import Survey
from robosim.radio.measurement import Measurement, free_path_m
from wireless.paths import LinkState

#: States of lesser probability are left out.
_LEAST = 1e-3
#: Where no way is known the arrival leads nowhere: so likely is it there, beside 1 if it told nothing.
_NO_WAY = 0.05

#: Parts and concentrations of von Mises densities that errors of leading arrivals and departures are made of; the rest
#: is uniform. Fitted by maximum likelihood to 183 places on 18 searches in 9 scanned homes, first and higher order.
_ARRIVAL = {
    LinkState.FIRST_ORDER: ((0.2, 260.0), (0.7, 3.5)),
    LinkState.HIGHER_ORDER: ((0.15, 260.0), (0.65, 2.5)),
}
_DEPARTURE = {LinkState.FIRST_ORDER: ((0.95, 2.6),), LinkState.HIGHER_ORDER: ((0.8, 1.0),)}
#: How far measured powers reach beyond free waves of the same power: noise, and other paths that add to them.
_FARTHER = {LinkState.FIRST_ORDER: 1.1, LinkState.HIGHER_ORDER: 1.2}
#: Part of the first order's density that is told by single corners and walls; the rest by where arrivals lead.
_BY_BENDS = 0.5


class Likelihood:
    """One measurement held against all places of a grid."""

    def __init__(
        self,
        measurement: Measurement,
        survey: Survey,
        off: Float[np.ndarray, "ny nx 2"],
        distance: Float[np.ndarray, "ny nx"],
        *,
        frequency_hz: float,
        departures: bool,
        ways: bool,
    ) -> None:
        """Prepare what several states need.

        Args:
            measurement: What was measured.
            survey: The map as known then, over the grid.
            off: From where it was measured to the centres of the grid's cells, x, y [m].
            distance: The same's length [m].
            frequency_hz: Carrier frequency.
            departures: Whether directions of departure are known.
            ways: Whether arrivals that come round corners tell by the ways that lead there.
        """
        self._m, self._survey, self._known = measurement, survey, survey.known
        self._frame, self._departures, self._ways = survey.frame, departures, ways
        self._place = measurement.pose[:2]
        self._off, self._distance = off, distance.astype(np.float32)
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
        """Density of the target's place given the measurement.

        Args:
            prior: How likely each place is without it.
            hidden: The same, if the target is not in line of sight.
            arrival_rad: Standard deviation of directions of arrival.
            departure_rad: Standard deviation of directions of departure.
            power_db: Standard deviation of powers in line of sight.
            reach_m: How far lines of sight are followed.
        """
        probability = self._m.probability.astype(np.float32)
        if not len(self._m.aoa_rad):
            return normal(hidden)
        total = probability[LinkState.OUTAGE] * normal(hidden)
        if probability[LinkState.LOS] > _LEAST:
            straight = self._straight(arrival_rad, power_db, reach_m)
            total = total + probability[LinkState.LOS] * normal(prior * straight)
        way = None
        if self._ways and probability[LinkState.FIRST_ORDER] + probability[LinkState.HIGHER_ORDER] > _LEAST:
            way = self._survey.leads(self._place)
        if probability[LinkState.FIRST_ORDER] > _LEAST:
            led = hidden * self._led(way, LinkState.FIRST_ORDER)
            aod = float(self._m.aod_rad[0]) if self._departures else None
            once = led * bent(
                self._known,
                self._place,
                float(self._m.aoa_rad[0]),
                aod,
                departure_rad,
                self._free_m,
                self._frame,
            )
            near = normal(led * self._within(LinkState.FIRST_ORDER))
            single = normal(once) if once.any() else near
            share = _BY_BENDS if self._ways else 1.0
            total = total + probability[LinkState.FIRST_ORDER] * (share * single + (1 - share) * near)
        if probability[LinkState.HIGHER_ORDER] > _LEAST:
            led = hidden * self._led(way, LinkState.HIGHER_ORDER) * self._within(LinkState.HIGHER_ORDER)
            total = total + probability[LinkState.HIGHER_ORDER] * normal(led)
        return np.asarray(total, np.float32)

    def _within(self, state: LinkState) -> Bool[np.ndarray, "ny nx"]:
        """Places no farther than a free wave of the measured power."""
        return np.asarray(self._distance <= _FARTHER[state] * self._free_m)

    def _straight(self, arrival_rad: float, power_db: float, reach_m: float) -> Float32[np.ndarray, "ny nx"]:
        """Likelihood in line of sight: along the arrival, as far as the power says, nothing known between."""
        cell_m = self._frame.resolution_m
        near = np.maximum(self._distance, 0.5 * cell_m)
        c, s = math.cos(self._m.aoa_rad[0]), math.sin(self._m.aoa_rad[0])
        aside = self._off[..., 1] * c - self._off[..., 0] * s
        ahead = self._off[..., 0] * c + self._off[..., 1] * s
        spread = np.hypot(arrival_rad * near, 0.5 * cell_m)
        power = 20 * np.log10(near / self._free_m) / np.hypot(power_db, 8.7 * 0.5 * cell_m / near)
        density = np.exp(-0.5 * ((aside / spread) ** 2 + power**2)).astype(np.float32)
        density[ahead < -cell_m] = 0
        far_m = min(2 * self._free_m + 1, reach_m)
        possibly = in_sight(self._known, self._place, self._frame, far_m, through_unknown=True)
        density[~possibly] *= np.float32(0.05)
        return density

    def _led(self, way: Leads | None, state: LinkState) -> Float32[np.ndarray, "ny nx"]:
        """How much likelier arrival and departure are if the target is at each place than from anywhere."""
        likelier = np.ones(self._frame.shape, np.float32)
        if way is None:
            return likelier
        part = _likelier(way.out, float(self._m.aoa_rad[0]), _ARRIVAL[state])
        if self._departures:
            part *= _likelier(way.back, float(self._m.aod_rad[0]), _DEPARTURE[state])
        likelier[:] = _NO_WAY
        likelier[way.rows, way.columns] = np.maximum(part, _NO_WAY)
        return likelier


def _likelier(
    directions: Float32[np.ndarray, "ny nx 2"], angle_rad: float, parts: tuple[tuple[float, float], ...]
) -> Float32[np.ndarray, "ny nx"]:
    """Density of a measured direction about those of the ways, over a uniform one; unit vectors of 0 tell nothing."""
    cosine = directions @ np.array([math.cos(angle_rad), math.sin(angle_rad)], np.float32)
    total = np.full(cosine.shape, 1.0 - sum(share for share, _ in parts), np.float32)
    for share, kappa in parts:
        # Von Mises: exp(kappa cos x) / (2 pi I0(kappa)), here with both sides scaled by exp(-kappa).
        total += (share / i0e(kappa)) * np.exp(kappa * (cosine - 1))
    return total


def normal(density: Float[np.ndarray, "ny nx"] | Bool[np.ndarray, "ny nx"]) -> Float32[np.ndarray, "ny nx"]:
    """The same, adding up to 1; even if there is nothing of it."""
    total = float(density.sum())
    if total <= 0:
        return np.full(density.shape, 1 / density.size, np.float32)
    return (density / total).astype(np.float32)
