"""Sounding and path estimation: speed against error.

Three measurements, all with the reference's base station sending to its robot. Speed: traced links are sounded by
full waveforms and by the closed form, and estimated by each estimator, on one worker and on all; rates are medians of
warm rounds. Lone paths: error of the azimuth of arrival over SNR, beside the Cramér-Rao bound
(`wireless.sounding.bounds`), azimuths at random. Traced plans: how far the strongest estimated path is from the
strongest true one (between isotropic antennas), for each link state, beside the published shares; and from the
nearest of those true ones that are nearly as strong; and how well a perfect receiver would do that cannot tell apart
paths that look alike (`tests.benchmarks.resolution`).

A link for which no path is found counts as wrong by half a turn. On plans links count whose strongest path has an SNR
(`wireless.estimates`) of 10 dB or more. Over lone paths, SNR is the energy of the path in the whole measurement
over that of noise in one of its entries, of which there are over ten thousand, some 40 dB more: below some 20 dB
a path drowns in the strongest of them. That the closed form has the law of waveforms, the tests say.
"""

import copy
import os
import platform
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console, Group

from robosim.building.building import BuildingConfig
from robosim.plans.floorplan import FloorPlan
from robosim.radio.scene import RadioConfig
from robosim.support.files import write_json
from robosim.support.progress import tracked
from tests.benchmarks.arrivals import (
    PUBLISHED,
    TX_PER_PLAN,
    arrival_error_rad,
    on_plan,
    pooled,
    trace_links,
)
from tests.benchmarks.estimation_report import plot, tables
from wireless.antennas.codebook import terminal_named
from wireless.estimation.estimators import ESTIMATORS, PathEstimator, estimator_named
from wireless.estimation.sage import SageEstimator
from wireless.sounding.bounds import arrival_bound_rad, window_share
from wireless.sounding.sounder import Rays, Sounder
from wireless.sounding.waveform import measure_waveform
from wireless.tracing.blocks import available_cores

#: Energies of lone paths in the whole measurement [dB].
SNRS_DB = (10.0, 15.0, 17.5, 20.0, 22.5, 25.0, 27.5, 30.0, 35.0, 40.0, 50.0, 60.0, 70.0, 80.0)
#: Links that speed is measured on, and those of them that are sounded by waveforms, which are slow.
SPEED_LINKS, WAVEFORM_LINKS = 1000, 12
_ROUNDS = 3


def run(
    plans: Sequence[FloorPlan],
    *,
    out: Path,
    links: int = 2000,
    tolerance_m: float | None = None,
    workers: int | None = None,
    seed: int = 0,
    console: Console | None = None,
) -> Group:
    """Measure speed and errors; write `estimation.json` and `estimation.png`, and return tables.

    Args:
        plans: Floor plans.
        out: Folder for the files.
        links: Links in each plan, and a quarter as many lone paths at each SNR.
        tolerance_m: How far walls may be moved to save corners [m]; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        workers: Most threads; None for one on each available core. Errors do not depend on it.
        seed: Seed of places, phases and noise.
        console: Where progress is shown; None for nowhere.

    Raises:
        ValueError: If there are too few links.
    """
    if links < 4 * TX_PER_PLAN:
        raise ValueError(f"links is {links}, expected at least {4 * TX_PER_PLAN} in each plan.")
    workers = workers or available_cores()
    rng = np.random.default_rng(seed)
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
    estimators: dict[str, PathEstimator] = {}
    prepare_s = {}
    for name in ESTIMATORS:
        begin = perf_counter()
        estimators[name] = _limited(estimator_named(name, sounder), workers)
        prepare_s[name] = perf_counter() - begin
    radio = RadioConfig(building=BuildingConfig(tolerance_m=tolerance_m))
    with tracked(plans, "tracing", console) as shown:
        traced = [trace_links(plan, links, rng, radio) for plan in shown]
    errors = [
        row
        for plan, paths in zip(plans, traced, strict=True)
        for row in on_plan(plan.name, paths, sounder, estimators, rng)
    ]
    summary = pooled(errors)
    with tracked(SNRS_DB, "lone paths", console) as steps:
        lone = [lone_paths(sounder, estimators, snr_db, max(links // 4, 10), rng) for snr_db in steps]
    speed = speeds(sounder, estimators, Rays.from_paths(traced[0])[:SPEED_LINKS], workers, rng)
    report = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "workers": workers,
        "seed": seed,
        "links_per_plan": links,
        "tolerance_m": tolerance_m,
        "prepare_s": prepare_s,
        "speed": speed,
        "lone_paths": lone,
        "pooled": summary,
        "plans": errors,
        "published": PUBLISHED,
    }
    write_json(Path(out) / "estimation.json", report)
    plot(report, Path(out) / "estimation.png")
    return Group(*tables(report))


def strongest_energy_db(sounder: Sounder, rays: Rays) -> Float[np.ndarray, " links"]:
    """Energy of each link's first path in the whole measurement, over that of noise in an entry."""
    a = sounder.rx_response(rays.aoa_az[:, 0], rays.aoa_el[:, 0])
    b = sounder.tx_response(rays.aod_az[:, 0], rays.aod_el[:, 0])
    energy = np.abs(rays.gain[:, 0]) ** 2 * np.sum(np.abs(a) ** 2, axis=1) * np.sum(np.abs(b) ** 2, axis=1)
    with np.errstate(divide="ignore"):
        return sounder.config.snr_per_gain_db + 10 * np.log10(energy)


def lone_paths(
    sounder: Sounder,
    estimators: dict[str, PathEstimator],
    snr_db: float,
    count: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Errors of lone paths from and to azimuths at random, beside the bound."""
    aoa, aod = rng.uniform(-np.pi, np.pi, (2, count, 1))
    zero = np.zeros_like(aoa)
    unit = Rays(gain=zero + 1 + 0j, delay_s=zero, aoa_az=aoa, aoa_el=zero, aod_az=aod, aod_el=zero)
    gain = 10 ** ((snr_db - strongest_energy_db(sounder, unit)) / 20)
    rays = Rays(gain=gain[:, None] + 0j, delay_s=zero, aoa_az=aoa, aoa_el=zero, aod_az=aod, aod_el=zero)
    tensor = sounder.measure(rays, rng)
    in_window_db = snr_db + 10 * float(np.log10(window_share(sounder)))
    bound = arrival_bound_rad(sounder, aoa[:, 0], in_window_db)
    row: dict[str, Any] = {"snr_db": snr_db, "links": count, "bound_deg": _rms_deg(bound)}
    for name, estimator in estimators.items():
        error = arrival_error_rad(estimator, tensor, aoa)[:, 0]
        row[name] = {
            "rms_deg": _rms_deg(error),
            "above_bound_db": 20 * float(np.log10(_rms_deg(error) / row["bound_deg"])),
            "within_5_deg": float(np.mean(error <= np.deg2rad(5))),
        }
    return row


def _rms_deg(error_rad: np.ndarray) -> float:
    return float(np.rad2deg(np.sqrt(np.mean(error_rad**2))))


def speeds(
    sounder: Sounder,
    estimators: dict[str, PathEstimator],
    rays: Rays,
    workers: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    """Rates on one worker and on all, of sounding and of estimating traced links."""
    n, few = len(rays), rays[:WAVEFORM_LINKS]
    tensor = sounder.measure(rays, rng)
    waveform_s = _median_s(partial(measure_waveform, sounder, few, rng), 1) / len(few)
    counts = tuple(dict.fromkeys((1, workers)))
    closed_s = {w: _median_s(partial(sounder.measure, rays, rng, workers=w)) / n for w in counts}
    return {
        "links": n,
        "rays_per_link": float(np.mean(np.sum(np.abs(rays.gain) > 0, axis=1))),
        "waveform_links": len(few),
        "waveform_ms": 1e3 * waveform_s,
        "closed_ms": 1e3 * closed_s[1],
        "ratio": waveform_s / closed_s[1],
        "sounding_links_per_s": {w: 1 / s for w, s in closed_s.items()},
        "estimating_links_per_s": {
            name: {w: n / _median_s(partial(_limited(estimator, w).estimate, tensor)) for w in counts}
            for name, estimator in estimators.items()
        },
    }


def _limited(estimator: PathEstimator, workers: int) -> PathEstimator:
    """The same estimator on so many threads, if it is one that uses threads of its own."""
    if isinstance(estimator, SageEstimator):
        estimator = copy.copy(estimator)
        estimator.workers = workers
    return estimator


def _median_s(work: Callable[[], Any], rounds: int = _ROUNDS) -> float:
    """Median duration of some rounds of work."""
    times = []
    for _ in range(rounds):
        begin = perf_counter()
        work()
        times.append(perf_counter() - begin)
    return float(np.median(times))
