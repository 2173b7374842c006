"""Ranges that receivers of several bands measure indoors, and the density that a belief has of them.

Links between random places of floor plans are traced, and their first path is detected in the bandwidth and noise of
the band. Of each link state: how much longer ranges are than the distance, and the mean logarithm of the belief's
density at them, next to that of an excess which is the same in all bands (exponential, of means of homes at 28 GHz).
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.stats import exponnorm, norm
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import make_building
from robosim.plans.files import read_plan
from robosim.policies.likelihood import range_density
from robosim.radio.link import RadioLink, RadioLinkConfig, first_path_m
from robosim.radio.measurement import Measurement
from slam.planning.marching import march
from tests.benchmarks.harness import DEFAULT, Options, run_units
from tests.benchmarks.results import Results
from wireless.paths import LinkState
from wireless.sounding.first_path import range_merged_m
from wireless.tracing.tracer import OPAQUE_HZ

BANDS = ("wifi-2.4", "wifi-5", "uwb-6.5", "28ghz", "60ghz")
#: Standard deviation of the device [m], whose own errors are not simulated.
_DEVICE_M = 0.15
#: Mean excess in all bands, of homes at 28 GHz: what the density is compared with [m].
_ONE_LAW_M = {LinkState.FIRST_ORDER: 1.4, LinkState.HIGHER_ORDER: 3.6}
#: Density of a range that carries no information, and its share, as in the belief [1/m].
_UNIFORM, _WRONG = 1 / 50, 0.05
_TRANSMITTERS, _RECEIVERS, _NEAREST_M = 4, 40, 0.5
_STATES = {
    "line of sight": LinkState.LOS,
    "first order": LinkState.FIRST_ORDER,
    "higher order": LinkState.HIGHER_ORDER,
}


def main(*plans: Positional[Path], options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Excess of ranges by band and link state, and their density in a belief.

    Args:
        plans: Floor plans.
        options: Of every benchmark.
    """
    results = Results()
    units = {f"{plan.stem} {band}": (str(plan), band, options.seed) for plan in plans for band in BANDS}
    measured = run_units(measure, units, options.folder("ranging"), workers=options.workers)
    for band in BANDS:
        links = np.concatenate([measured[f"{plan.stem} {band}"] for plan in plans])
        for name, state in _STATES.items():
            of = links[links[:, 0] == state]
            detected = of[np.isfinite(of[:, 1])]
            excess_m, log_density, log_one_law = detected[:, 1:].T
            results.add(band, name, "mean excess", float(excess_m.mean()), "m", digits=2, cases=len(detected))
            results.add(band, name, "standard deviation", float(excess_m.std()), "m", digits=2)
            results.add(band, name, "detected", 100 * len(detected) / len(of), "%", digits=0)
            results.add(band, name, "log density", float(log_density.mean()), digits=2)
            results.add(band, name, "the same in all bands", float(log_one_law.mean()), digits=2)
    return options.finish("ranging", results)


def measure(path: str, band: str, seed: int) -> Float[np.ndarray, "n 4"]:
    """Links: state, excess of the range [m], logarithms of the belief's density and of that of one law for all bands.

    The excess is NaN where no peak is detected.
    """
    plan = read_plan(path)
    link = RadioLink(make_building(plan), RadioLinkConfig().in_band(band))
    sounding, is_opaque = link.config.sounding, link.config.frequency_hz >= OPAQUE_HZ
    merged_m = range_merged_m(1e6 * sounding.bandwidth_mhz)
    rng = np.random.default_rng(seed)
    cells = np.argwhere(plan.free)
    centre = plan.to_map(cells[:, ::-1] + 0.5)
    nothing = Measurement(np.zeros(3), *(np.zeros(0) for _ in range(5)), np.zeros(4), range_merged_m=merged_m)
    sigma_m = float(np.hypot(_DEVICE_M, merged_m))
    rows = []
    for target in rng.choice(len(cells), _TRANSMITTERS, replace=False):
        link.place(centre[target])
        route_m = march(plan.free, tuple(cells[target].tolist()), plan.resolution_m)
        for k in rng.choice(len(cells), _RECEIVERS, replace=False):
            paths = link.trace(centre[k])
            distance_m = float(np.linalg.norm(centre[k] - centre[target]))
            if not len(paths) or distance_m < _NEAREST_M:
                continue
            state = int(paths.link_state()[0, 0])
            range_m = first_path_m(paths, sounding)
            measurement = replace(nothing, range_m=range_m, probability=np.eye(len(LinkState))[state])
            lengths_m = np.maximum([route_m[tuple(cells[k])]], distance_m) if is_opaque else None
            density = range_density(measurement, sigma_m, np.array([distance_m]), lengths_m)
            one_law = one_law_density(measurement, sigma_m, distance_m)
            rows.append([state, range_m - distance_m, *np.log(density), np.log(one_law)])
    return np.array(rows)


def one_law_density(measurement: Measurement, sigma_m: float, distance_m: float) -> float:
    """Density of a range with the excess that is the same in all bands [1/m]."""
    state, rest_m = measurement.state, measurement.range_m - distance_m
    if state == LinkState.LOS:
        density = norm.pdf(rest_m, 0, sigma_m)
    else:
        density = exponnorm.pdf(rest_m, _ONE_LAW_M[state] / sigma_m, 0, sigma_m)
    return float(_WRONG * _UNIFORM + (1 - _WRONG) * density)
