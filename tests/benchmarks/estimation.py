"""Sounding and path estimation: speed against error, the reference's base station sending to its robot.

Speed: traced links are sounded by full waveforms and by the closed form, and estimated by each estimator, one thread.
Lone paths: error of the azimuth of arrival over SNR, against the Cramér-Rao bound. SNR is the energy of the path in
the whole measurement over that of noise in one of its over ten thousand entries; below some 20 dB a path drowns in
the strongest of them. Traced plans: how far the strongest estimated path is from the strongest true one (between
isotropic antennas), and from the nearest of those true ones that are nearly as strong, by link state; and how well a
perfect receiver would do that does not resolve paths that look alike (`resolution`). A link for which no path is
found counts as wrong by half a turn. Intervals are of 95 %, by bootstrap over plans.
"""

import copy
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import BuildingConfig
from robosim.plans.floorplan import FloorPlan
from robosim.radio.receivers import receiver_grid
from robosim.radio.scene import RadioConfig, RadioScene
from robosim.support.progress import tracked
from tests.benchmarks.harness import DEFAULT, Options, alternate, console, plans_of, quartiles, ratio_interval
from tests.benchmarks.resolution import strongest_sum_rad
from tests.benchmarks.results import Results
from tests.wireless.sounding.arrival_bounds import arrival_bound_rad, window_share
from tests.wireless.sounding.waveforms import measure_waveform
from wireless.antennas.codebook import terminal_named
from wireless.estimates import wrapped
from wireless.estimation.estimators import ESTIMATORS, PathEstimator, estimator_named
from wireless.estimation.sage import SageEstimator
from wireless.paths import LinkState, Paths
from wireless.sounding.sounder import Rays, Sounder

#: Energies of lone paths in the whole measurement [dB].
SNRS_DB = (10.0, 15.0, 17.5, 20.0, 22.5, 25.0, 27.5, 30.0, 35.0, 40.0, 50.0, 60.0, 70.0, 80.0)
#: Links that estimators are timed on, and those of them that are sounded by waveforms, which are slow.
TIMED, BY_WAVEFORM = 1000, 12
#: Errors of which shares are given [deg].
WITHIN_DEG = (1.0, 5.0, 10.0)
#: Links whose strongest path is weaker do not count [dB], as the reference's robot ignores them.
LEAST_SNR_DB = 10.0
#: True paths at most this much weaker than the strongest are its rivals [dB]: their order is within what the gains of
#: traced paths are worth, and a robot that follows one of them follows a path all the same.
RIVAL_DB = 3.0
#: Lines of sight whose strongest path is within 5 degrees in the reference [%].
PUBLISHED_WITHIN = 98.0
#: Transmitters in each plan, and the grid of receivers [m], as in the reference.
TX_PER_PLAN, GRID_M = 10, 0.15
STATES = {
    LinkState.LOS: "line of sight",
    LinkState.FIRST_ORDER: "first order",
    LinkState.HIGHER_ORDER: "higher order",
}


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    links: int = 2000,
    tolerance: float | None = None,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Sounding and estimation of paths: links a second against the error of the angle of arrival.

    Args:
        plans: Floor plans, or folders of them, that links are traced in.
        links: Links of each plan, and a quarter as many lone paths at each SNR.
        tolerance: How far walls may be moved to save corners [m]; straight walls under staircases if not given, except
            in published grids; 0 keeps every cell.
        options: Of every benchmark.
    """
    if links < 4 * TX_PER_PLAN:
        raise ValueError(f"links is {links}, expected at least {4 * TX_PER_PLAN} in each plan.")
    rng, results = np.random.default_rng(options.seed), Results()
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
    estimators = {name: single_threaded(estimator_named(name, sounder)) for name in ESTIMATORS}
    found, radio = plans_of(plans), RadioConfig(building=BuildingConfig(tolerance_m=tolerance))
    with tracked(found, "tracing", console) as shown:
        traced = [trace_links(plan, links, rng, radio) for plan in shown]
    add_arrivals([arrival_errors(paths, sounder, estimators, rng) for paths in traced], results)
    row = "strongest path, published: within 5°"
    results.add("arrivals", row, STATES[LinkState.LOS], PUBLISHED_WITHIN, "%", digits=1)
    with tracked(SNRS_DB, "lone paths", console) as steps:
        for snr_db in steps:
            add_lone_paths(sounder, estimators, snr_db, max(links // 4, 10), rng, results)
    add_speed(sounder, estimators, Rays.from_paths(traced[0])[:TIMED], rng, results)
    return options.finish("estimation", results)


def single_threaded(estimator: PathEstimator) -> PathEstimator:
    """The same estimator on one thread."""
    if isinstance(estimator, SageEstimator):
        estimator = copy.copy(estimator)
        estimator.workers = 1
    return estimator


def trace_links(plan: FloorPlan, links: int, rng: np.random.Generator, config: RadioConfig) -> Paths:
    """Paths from random transmitters to random receivers of the reference's grid.

    Raises:
        ValueError: If the plan has too few places for so many links.
    """
    scene = RadioScene(plan, config)
    grid = receiver_grid(scene.building, GRID_M, config.height_m).position
    need = TX_PER_PLAN + links // TX_PER_PLAN
    if need > len(grid):
        raise ValueError(
            f"links is {links}, but {plan.name} has only {len(grid)} places on a grid of {GRID_M} m."
        )
    places = grid[rng.permutation(len(grid))[:need]]
    return scene.tracer.trace(places[:TX_PER_PLAN], places[TX_PER_PLAN:])


def arrival_errors(
    paths: Paths, sounder: Sounder, estimators: dict[str, PathEstimator], rng: np.random.Generator
) -> dict[str, Any]:
    """Errors of arrival on traced links that are strong enough.

    Returns:
        state: Link states (n).
        And by estimator and "perfect receiver", error of the strongest path, and of the nearest rival [deg] (n 2).
    """
    rays, state = Rays.from_paths(paths), paths.link_state().ravel()
    with np.errstate(divide="ignore"):
        strong = sounder.budget_db + 20 * np.log10(np.abs(rays.gain[:, 0])) >= LEAST_SNR_DB
    tensor = sounder.measure(rays, rng)
    error_rad = {name: arrival_error_rad(one, tensor, rays.aoa_az) for name, one in estimators.items()}
    strongest = strongest_sum_rad(sounder, rays, rng)
    error_rad["perfect receiver"] = np.abs(wrapped(strongest[:, None] - rays.aoa_az))
    rival = np.abs(rays.gain) >= np.abs(rays.gain[:, :1]) * 10 ** (-RIVAL_DB / 20)
    return {"state": state[strong]} | {
        name: np.rad2deg(np.column_stack([one[:, 0], np.where(rival, one, np.pi).min(axis=1)]))[strong]
        for name, one in error_rad.items()
    }


def arrival_error_rad(
    estimator: PathEstimator, tensor: np.ndarray, aoa_rad: Float[np.ndarray, "links rays"]
) -> Float[np.ndarray, "links rays"]:
    """How far the strongest estimated path is from each true one [rad]; half a turn where there is none."""
    got = estimator.estimate(tensor)
    return np.where(got.count[:, None] > 0, np.abs(wrapped(got.aoa_rad[:, :1] - aoa_rad)), np.pi)


def add_arrivals(found: list[dict[str, Any]], results: Results) -> None:
    """Shares of links within some degrees, by link state and estimator; intervals by bootstrap over plans."""
    columns = (("strongest path", 0), ("any path at most 3 dB weaker", 1))
    for name in (each for each in found[0] if each != "state"):
        for (state, words), (of, column) in product(STATES.items(), columns):
            errors_deg = [plan[name][plan["state"] == state, column] for plan in found]
            total = np.array([len(each) for each in errors_deg])
            for most in WITHIN_DEG if total.any() else ():
                share, spread = ratio_interval(np.array([(each <= most).sum() for each in errors_deg]), total)
                results.add(
                    "arrivals", f"{of}, {name}: within {most:g}°", words, 100 * share, "%", digits=1,
                    cases=int(total.sum()), spread=spread and (100 * spread[0], 100 * spread[1]),
                )  # fmt: skip


def strongest_energy_db(sounder: Sounder, rays: Rays) -> Float[np.ndarray, " links"]:
    """Energy of each link's first path in the whole measurement, over that of noise in an entry."""
    a = sounder.rx_response(rays.aoa_az[:, 0], rays.aoa_el[:, 0])
    b = sounder.tx_response(rays.aod_az[:, 0], rays.aod_el[:, 0])
    energy = np.abs(rays.gain[:, 0]) ** 2 * np.sum(np.abs(a) ** 2, axis=1) * np.sum(np.abs(b) ** 2, axis=1)
    with np.errstate(divide="ignore"):
        return sounder.config.snr_per_gain_db + 10 * np.log10(energy)


def add_lone_paths(
    sounder: Sounder,
    estimators: dict[str, PathEstimator],
    snr_db: float,
    count: int,
    rng: np.random.Generator,
    results: Results,
) -> None:
    """Errors of lone paths from and to azimuths at random, against the bound."""
    aoa, aod = rng.uniform(-np.pi, np.pi, (2, count, 1))
    zero = np.zeros_like(aoa)
    unit = Rays(gain=zero + 1 + 0j, delay_s=zero, aoa_az=aoa, aoa_el=zero, aod_az=aod, aod_el=zero)
    gain = 10 ** ((snr_db - strongest_energy_db(sounder, unit)) / 20)
    rays = Rays(gain=gain[:, None] + 0j, delay_s=zero, aoa_az=aoa, aoa_el=zero, aod_az=aod, aod_el=zero)
    tensor = sounder.measure(rays, rng)
    in_window_db = snr_db + 10 * float(np.log10(window_share(sounder)))
    bound = _rms_deg(arrival_bound_rad(sounder, aoa[:, 0], in_window_db))
    row = f"{snr_db:g} dB"
    results.add("lone paths", row, "bound", bound, "°")
    for name, estimator in estimators.items():
        error = arrival_error_rad(estimator, tensor, aoa)[:, 0]
        results.add("lone paths", row, name, _rms_deg(error), "°", cases=count, bar=bound)
        results.add(
            "lone paths", row, f"{name}, within 5°", 100 * np.mean(error <= np.deg2rad(5)), "%", digits=1
        )


def _rms_deg(error_rad: np.ndarray) -> float:
    return float(np.rad2deg(np.sqrt(np.mean(error_rad**2))))


def add_speed(
    sounder: Sounder,
    estimators: dict[str, PathEstimator],
    rays: Rays,
    rng: np.random.Generator,
    results: Results,
) -> None:
    """Rates of sounding and of estimating traced links, one thread."""
    few, tensor = rays[:BY_WAVEFORM], sounder.measure(rays, rng)
    actions = {
        "sounding, waveform": lambda: measure_waveform(sounder, few, rng),
        "sounding, closed form": lambda: sounder.measure(rays, rng, workers=1),
    } | {f"estimating, {name}": lambda one=one: one.estimate(tensor) for name, one in estimators.items()}
    for name, seconds in alternate(actions, turns=3).items():
        count = len(few) if "waveform" in name else len(rays)
        middle, spread = quartiles(count / seconds)
        results.add("speed", name, "links a CPU second", middle, spread=spread, cases=count)
