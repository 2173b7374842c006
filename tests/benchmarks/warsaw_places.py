"""Places of beacons in a real flat from powers that a robot received, and the robot's place from powers of the beacons.

Beacons are located with the plan, with maps of the robot's own scans, and without either. The published data cover the
flat in four runs. Two of them have raw scans, each of a part of the flat: a beacon in a room that the robot does not
enter remains uncertain. The priors of the law of distance are fitted to the other three runs each, so that their
readings are most probable given the true places; places do not count for the choice.

The robot's place is the mean over candidates on the floor, weighted by their probability given the powers of all
beacons. Fingerprints are predicted at the candidates by walls and antennas that are fitted to the other half of the
floor (`tests.benchmarks.warsaw_powers`), or they are the readings in that half.
Data: Kolakowski, Sensors 21, 6270, 2021 (CC BY 4.0).
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.optimize import minimize
from tyro.conf import OmitArgPrefixes, Positional

from robosim.calibration.measured_powers import MeasuredPowers
from robosim.calibration.power_fit import fit_powers
from robosim.plans.floorplan import OCCUPIED, FloorPlan
from robosim.policies.sightlines import count_walls
from robosim.positioning.beacon_places import SHARES, BeaconConfig, locate_beacon
from robosim.positioning.power_route import PowerRoute, map_route
from robosim.support.reading import reading
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.measured_figures import draw_located
from tests.benchmarks.results import Results
from tests.benchmarks.warsaw_flat import CONFIG, RUNS, read_run
from tests.benchmarks.warsaw_powers import CONFIG as CONFIG_OF_WALLS
from tests.benchmarks.warsaw_powers import read_flat
from wireless.positioning.received_power import PowerLawConfig, log_evidence

#: Candidates of the receiver's place are so many cells apart. Error of a reading, and what one not received counts as.
_EVERY_CELLS, _ERROR_DB, _NOT_RECEIVED_DBM = 5, 5.0, -95.0
#: Runs begin after pauses of more than this [s].
_PAUSE_S = 60.0
#: Probability of the reported ellipses, and shares of the route and of each run that are drawn.
_HELD, _DRAWN_SHARES, _RUN_SHARES = 0.9, np.linspace(0.1, 1.0, 10), np.linspace(0.2, 1.0, 5)


def main(folder: Positional[Path], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Errors of beacon places in a real flat after a part of the route, and how often the 90 % ellipse holds them.

    Args:
        folder: The data set: anchors.csv, layout.csv, calibration_df.csv and the raw runs calib3 and calib4.
        options: Of every benchmark.
    """
    results = Results()
    plan, measured = read_flat(folder)
    route = _route(folder, measured)
    for share in SHARES:
        row = f"all runs, {100 * share:.0f} %"
        _add(results, row, "with the plan", [route], [plan], share)
        _add(results, row, "without a map", [route], [None], share)
    parts = [_within(route, route.time_s[begin], route.time_s[end]) for begin, end in _runs(route)]
    _add(results, "each of four runs", "with the plan", parts, [plan] * len(parts), 1.0)
    _add(results, "each of four runs", "without a map", parts, [None] * len(parts), 1.0)
    held_out: dict[str, list[PowerLawConfig]] = {}
    for name, used in (("with the plan", plan), ("without a map", None)):
        laws = [_fitted_law([other for other in parts if other is not run], used) for run in parts]
        held_out[name] = laws
        row = "each run, law of the other three"
        _add(results, row, name, parts, [used] * len(parts), 1.0, laws)
        for title, chosen in (
            ("law of the other three", laws),
            ("default law", [BeaconConfig().law] * len(parts)),
        ):
            fit = [_density(run, used, law) for run, law in zip(parts, chosen, strict=True)]
            each = sum(total for total, _ in fit) / sum(count for _, count in fit)
            results.add("likelihood", title, f"{name}: of a mean reading", each, digits=3, cases=24)
        for number, (run, law) in enumerate(zip(parts, laws, strict=True), 1):
            _add(results, f"run {number}, law of the other three", name, [run], [used], 1.0, [law])
    logs = [read_run(folder, run) for run in RUNS]
    mapped = [map_route(log, route, config=CONFIG) for log in logs]
    own = [one for _, one in mapped]
    for name, plans in (
        ("with the plan", [plan] * 2),
        ("with the robot's own map", [one for one, _ in mapped]),
        ("without a map", [None] * 2),
    ):
        _add(results, "each of two runs with scans", name, own, plans, 1.0)
    receiver = _receiver_errors(folder)
    results.figures["located"] = _draw_runs(parts, plan, held_out)
    results.figures["errors"] = _draw_errors(route, plan, receiver)
    for row, errors in receiver.items():
        results.add("receiver", row, "median", float(np.median(errors)), "m", digits=2, cases=len(errors))
        results.add("receiver", row, "90 %", float(np.percentile(errors, 90)), "m", digits=2)
    return options.finish("warsaw_places", results)


def _law(values: Float[np.ndarray, " 10"]) -> PowerLawConfig:
    """The law of parameters that have no bounds."""
    power, exponent, wall, *spreads = values.tolist()
    power_db, exponent_std, wall_std, pattern, shadowing, correlation, fading = np.exp(spreads).tolist()
    return PowerLawConfig(
        power_dbm=(power, power_db),
        exponent=(abs(exponent), exponent_std),
        wall_db=(abs(wall), wall_std),
        pattern_db=pattern,
        shadowing_db=shadowing,
        correlation_m=correlation,
        reading_db=fading,
        averaged=2.5,
    )


def _fitted_law(routes: list[PowerRoute], plan: FloorPlan | None) -> PowerLawConfig:
    """The law that makes readings most probable, given the places of beacons; power at 1 m keeps its wide prior."""
    begin = np.array([-45.0, 2.0, 3.0, *np.log([2.0, 0.2, 1.5, 1.0, 4.5, 2.5, 4.0])])

    def misfit(values: Float[np.ndarray, " 10"]) -> float:
        law = _law(values)
        return 0.5 * float(((values - begin)[3:] ** 2).sum()) - sum(_density(r, plan, law)[0] for r in routes)

    fit = minimize(misfit, begin, method="L-BFGS-B", options={"maxiter": 20})
    return replace(_law(fit.x), power_dbm=BeaconConfig().law.power_dbm)


def _density(route: PowerRoute, plan: FloorPlan | None, law: PowerLawConfig) -> tuple[float, int]:
    """Logarithm of the density of readings given the true places, and the number of their means."""
    total, count = 0.0, 0
    for name in route.names:
        readings = route.readings(name).thinned(0.5, 0.6, 400)
        place = route.true_xy[name][None]
        walls = np.zeros((len(readings.xy), 1))
        if plan is not None:
            free = plan.centres(plan.free)
            place = free[[np.hypot(*(free - place).T).argmin()]]  # not within the wall that it hangs on
            walls = count_walls(plan.occupancy == OCCUPIED, plan.to_cells(readings.xy), plan.to_cells(place))
        apart_m = np.hypot(*(readings.xy[:, None] - readings.xy).transpose(2, 0, 1))
        fading = law.reading_db**2 / np.minimum(readings.count, law.averaged) + 1 / 12
        noise = law.shadowing_db**2 * np.exp(-apart_m / law.correlation_m) + np.diag(fading)
        # `log_evidence` is up to a constant of the noise and of the number of heights.
        constant = 0.5 * (np.linalg.slogdet(noise)[1] + len(noise) * np.log(2 * np.pi)) + np.log(
            len(law.above_m)
        )
        total += float(log_evidence(readings, place, walls, law)[0] - constant)
        count += len(noise)
    return total, count


def _draw_runs(parts: list[PowerRoute], plan: FloorPlan, held_out: dict[str, list[PowerLawConfig]]) -> Figure:
    """Errors over the share of each run, and reliability of ellipses, by the law of the other three runs."""
    curves, inside = {}, {}
    for name, used in (("with the plan", plan), ("without a map", None)):
        of_shares = [_located(parts, [used] * len(parts), share, held_out[name]) for share in _RUN_SHARES]
        curves[name] = _RUN_SHARES, np.array([errors for errors, _ in of_shares])
        inside[f"{name}, whole run"] = of_shares[-1][1]
        inside[f"{name}, all shares"] = np.concatenate([probability for _, probability in of_shares])
    return draw_located(curves, inside)


def _draw_errors(route: PowerRoute, plan: FloorPlan, receiver: dict[str, Float[np.ndarray, " n"]]) -> Figure:
    """Errors of beacons over the share of the route, and the distribution of errors of the receiver's place."""
    figure = Figure(figsize=(10, 4), layout="constrained")
    axes = figure.subplots(1, 2)
    for name, beyond_m, used in (("with the plan", 0.3, plan), ("without a map", 3.0, None)):
        errors = [
            [
                np.hypot(*(locate_beacon(route.readings(one, share), used, beyond_m).xy - route.true_xy[one]))
                for one in route.names
            ]
            for share in _DRAWN_SHARES
        ]
        axes[0].plot(100 * _DRAWN_SHARES, np.median(errors, axis=1), "o-", label=name)
    axes[0].set(xlabel="readings used [%]", ylabel="median error of six beacons [m]", ylim=(0, None))
    for name, values in receiver.items():
        axes[1].plot(np.sort(values), np.linspace(0, 100, len(values)), label=name)
    axes[1].set(xlabel="error of the receiver's place [m]", ylabel="places [%]", xlim=(0, 6), ylim=(0, 100))
    for each in axes:
        each.grid(True, lw=0.3)
        each.legend(fontsize=8)
    return figure


def _receiver_errors(folder: Path) -> dict[str, Float[np.ndarray, " n"]]:
    """Errors of the receiver's place [m] in the held-out half of the floor, by what the fingerprints come from."""
    plan, measured = read_flat(folder)
    free = plan.centres(plan.free)
    floor = free[(np.round(free / plan.resolution_m).astype(int) % _EVERY_CELLS == 0).all(axis=1)]
    points = np.column_stack([floor, np.full(len(floor), measured.places[0, 2])])
    power = np.concatenate([measured.power_dbm, np.full((len(measured.names), len(points)), np.nan)], axis=1)
    assert measured.heading_rad is not None
    with_floor = MeasuredPowers(
        names=measured.names,
        beacons=measured.beacons,
        places=np.concatenate([measured.places, points]),
        heading_rad=np.concatenate([measured.heading_rad, np.zeros(len(points))]),
        power_dbm=power,
    )
    config = replace(CONFIG_OF_WALLS, receiver_orders=0)
    predicted = fit_powers(with_floor, plan, config).predicted_dbm[:, len(measured.places) :]
    fitted = ~measured.held_out
    of = measured.power_dbm[:, ~fitted].T, measured.places[~fitted, :2]
    return {
        f"readings at {fitted.sum()} places": _errors(
            *of, measured.power_dbm[:, fitted], measured.places[fitted, :2]
        ),
        "traced": _errors(*of, predicted, floor),
    }


def _errors(
    power_dbm: Float[np.ndarray, "n b"],
    truth: Float[np.ndarray, "n 2"],
    prints_dbm: Float[np.ndarray, "b m"],
    places: Float[np.ndarray, "m 2"],
) -> Float[np.ndarray, " n"]:
    """Distances of the mean of the places whose fingerprints are likely from the true ones [m]."""
    power, prints = (
        np.where(np.isnan(values), _NOT_RECEIVED_DBM, values) for values in (power_dbm, prints_dbm.T)
    )
    square = ((power[:, None] - prints) ** 2).sum(axis=2) / _ERROR_DB**2
    weight = np.exp(-0.5 * (square - square.min(axis=1, keepdims=True)))
    return np.asarray(np.hypot(*(weight @ places / weight.sum(axis=1, keepdims=True) - truth).T))


def _route(folder: Path, measured: MeasuredPowers) -> PowerRoute:
    """All readings in the order of time, as `robosim locate` reads them."""
    with reading(folder / "calibration_df.csv", "powers at places") as file:
        times = np.genfromtxt(file, delimiter=",", skip_header=1, usecols=[1]) / 1e9
    place, beacon = np.nonzero(np.isfinite(measured.power_dbm.T))
    assert measured.heading_rad is not None
    return PowerRoute(
        beacon=tuple(measured.names[i] for i in beacon),
        time_s=times[place],
        poses=np.column_stack([measured.places[place, :2], measured.heading_rad[place]]),
        power_dbm=measured.power_dbm[beacon, place],
        true_xy={name: at[:2] for name, at in zip(measured.names, measured.beacons, strict=True)},
    )


def _runs(route: PowerRoute) -> list[tuple[int, int]]:
    """First and last reading of each run."""
    pauses = np.flatnonzero(np.diff(route.time_s) > _PAUSE_S)
    begins, ends = [0, *(pauses + 1)], [*pauses, len(route.time_s) - 1]
    return [(int(a), int(b)) for a, b in zip(begins, ends, strict=True) if b - a > _PAUSE_S]


def _within(route: PowerRoute, begin_s: float, end_s: float) -> PowerRoute:
    """The readings between two times."""
    used = (route.time_s >= begin_s) & (route.time_s <= end_s)
    return PowerRoute(
        beacon=tuple(np.array(route.beacon)[used]),
        time_s=route.time_s[used],
        poses=route.poses[used],
        power_dbm=route.power_dbm[used],
        true_xy=route.true_xy,
    )


def _add(
    results: Results,
    row: str,
    name: str,
    routes: Iterable[PowerRoute],
    plans: Iterable[FloorPlan | None],
    share: float,
    laws: Iterable[PowerLawConfig] | None = None,
) -> None:
    """Add the median error over all beacons of all routes, and how often the ellipse of 90 % holds the true place."""
    errors, inside = _located(routes, plans, share, laws)
    results.add("beacons", row, f"{name}: median", float(np.median(errors)), "m", digits=2, cases=len(errors))
    held = 100 * float(np.mean(inside <= _HELD))
    results.add("beacons", row, f"{name}: in the ellipse", held, "%", digits=0)


def _located(
    routes: Iterable[PowerRoute],
    plans: Iterable[FloorPlan | None],
    share: float,
    laws: Iterable[PowerLawConfig] | None = None,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Errors of all beacons of all routes [m], and the probability of the smallest ellipse around the true place."""
    errors, inside = [], []
    for route, plan, law in zip(routes, plans, laws or repeat(BeaconConfig().law), strict=False):
        # A map of the robot's own ends where it has not been.
        beyond_m = 0.3 if plan is not None and plan.name == "flat" else 3.0
        for beacon in route.names:
            located = locate_beacon(route.readings(beacon, share), plan, beyond_m, BeaconConfig(law=law))
            off: Float[np.ndarray, 2] = located.xy - route.true_xy[beacon]
            errors.append(float(np.hypot(*off)))
            inside.append(-np.expm1(-0.5 * off @ np.linalg.solve(located.covariance, off)))
    return np.array(errors), np.array(inside)
