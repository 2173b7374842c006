"""How far off estimated arrivals are on traced plans: shares of links by link state and estimator.

Of each link counts how far the strongest estimated path is from the strongest true one (between isotropic antennas),
and from the nearest of those true ones that are nearly as strong; beside it, how well a perfect receiver would do that
cannot tell apart paths that look alike (`tests.benchmarks.resolution`). A link for which no path is found counts as
wrong by half a turn. Links count whose strongest path has an SNR (`wireless.estimates`) of 10 dB or more.
"""

import itertools
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.plans.floorplan import FloorPlan
from robosim.radio.receivers import receiver_grid
from robosim.radio.scene import RadioConfig, RadioScene
from tests.benchmarks.resolution import strongest_sum_rad
from wireless.estimates import wrapped
from wireless.estimation.estimators import ESTIMATORS, PathEstimator
from wireless.paths import LinkState, Paths
from wireless.sounding.sounder import Rays, Sounder

#: Errors of which shares are given [deg].
WITHIN_DEG = (1.0, 5.0, 10.0)
#: Links whose strongest path is weaker are left out of shares [dB], as the reference's robot ignores them.
LEAST_SNR_DB = 10.0
#: True paths at most this much weaker than the strongest are its rivals [dB]: their order is within what the gains of
#: traced paths are worth, and a robot that goes by one of them goes by a path all the same.
RIVAL_DB = 3.0
#: What is listed like an estimator, but is the limit of resolution (`tests.benchmarks.resolution`).
LIMIT = "limit"
#: Transmitters in each plan, and the grid of receivers [m]; as in the reference.
TX_PER_PLAN, GRID_M = 10, 0.15
#: Link states that have paths.
REACHED = (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER)
#: Published shares of links within so many degrees, by state; those not given are left out. The text of the
#: paper has 0.85 for first-order links within 5 degrees, its figure reads about 0.81; 0.6 is an upper bound.
#: Reference: arXiv 2110.14789.
PUBLISHED: dict[str, dict[float, float]] = {
    "LOS": {1.0: 0.79, 5.0: 0.98},
    "FIRST_ORDER": {1.0: 0.48, 5.0: 0.85},
    "HIGHER_ORDER": {1.0: 0.36, 10.0: 0.6},
}


def trace_links(
    plan: FloorPlan, links: int, rng: np.random.Generator, config: RadioConfig | None = None
) -> Paths:
    """Paths from random transmitters to random receivers of the reference's grid.

    Args:
        plan: The floor plan.
        links: Number of links.
        rng: Source of places.
        config: How the plan is traced; as in the reference if not given.

    Raises:
        ValueError: If the plan has too few places for so many links.
    """
    config = RadioConfig() if config is None else config
    scene = RadioScene(plan, config)
    grid = receiver_grid(scene.building, GRID_M, config.height_m).position
    need = TX_PER_PLAN + links // TX_PER_PLAN
    if need > len(grid):
        most = TX_PER_PLAN * max(len(grid) - TX_PER_PLAN, 0)
        raise ValueError(
            f"links is {links}, but {plan.name} has room for {most} links of {TX_PER_PLAN} transmitters on a "
            f"grid of {GRID_M} m. Ask for fewer, or take a larger plan."
        )
    places = grid[rng.permutation(len(grid))[:need]]
    return scene.tracer.trace(places[:TX_PER_PLAN], places[TX_PER_PLAN:])


def on_plan(
    name: str, paths: Paths, sounder: Sounder, estimators: dict[str, PathEstimator], rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Errors of arrival on traced links, a row for each link state and estimator."""
    rays = Rays.from_paths(paths)
    state = paths.link_state().ravel()
    with np.errstate(divide="ignore"):
        snr_db = sounder.budget_db + 20 * np.log10(np.abs(rays.gain[:, 0]))
    heard = snr_db >= LEAST_SNR_DB
    tensor = sounder.measure(rays, rng)
    error_rad = {
        kind: arrival_error_rad(estimator, tensor, rays.aoa_az) for kind, estimator in estimators.items()
    }
    error_rad[LIMIT] = np.abs(wrapped(strongest_sum_rad(sounder, rays, rng)[:, None] - rays.aoa_az))
    rival = np.abs(rays.gain) >= np.abs(rays.gain[:, :1]) * 10 ** (-RIVAL_DB / 20)
    return [
        {
            "plan": name,
            "state": one.name,
            "estimator": kind,
            "links": int(np.sum(heard & (state == one))),
            "unheard": int(np.sum(~heard & (state == one))),
            "error_deg": np.rad2deg(error[heard & (state == one), 0]),
            "near_deg": np.rad2deg(np.where(rival, error, np.pi).min(axis=1)[heard & (state == one)]),
        }
        for one in REACHED
        for kind, error in error_rad.items()
    ]


def pooled(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each link state and estimator over all plans; lists of errors become shares in all rows."""
    summary: list[dict[str, Any]] = []
    for state, kind in itertools.product([one.name for one in REACHED], (*ESTIMATORS, LIMIT)):
        mine = [row for row in rows if (row["state"], row["estimator"]) == (state, kind)]
        if not mine:
            continue
        error, near = (np.concatenate([row[key] for row in mine]) for key in ("error_deg", "near_deg"))
        counts = {key: sum(row[key] for row in mine) for key in ("links", "unheard")}
        quantiles = np.quantile(error, np.linspace(0, 1, 201)) if len(error) else []
        summary.append(
            {
                "state": state,
                "estimator": kind,
                **counts,
                "within": _within(error),
                "within_of_rivals": _within(near),
                "quantiles_deg": quantiles,
            }
        )
    for row in rows:
        row["within"] = _within(row.pop("error_deg"))
        row["within_of_rivals"] = _within(row.pop("near_deg"))
    return summary


def _within(error_deg: np.ndarray) -> dict[float, float]:
    """Share of errors within so many degrees."""
    return {most: float(np.mean(error_deg <= most)) if len(error_deg) else np.nan for most in WITHIN_DEG}


def arrival_error_rad(
    estimator: PathEstimator, tensor: np.ndarray, aoa_rad: Float[np.ndarray, "links rays"]
) -> Float[np.ndarray, "links rays"]:
    """How far the strongest estimated path is from each true one; half a turn where there is none."""
    got = estimator.estimate(tensor)
    return np.where(got.count[:, None] > 0, np.abs(wrapped(got.aoa_rad[:, :1] - aoa_rad)), np.pi)
