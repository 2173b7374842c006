"""Statistics of paths in generated offices against a standard and measurements in other offices, at 28 and 140 GHz.

Path loss follows n 10 log10(d / 1 m) above free space at 1 m: exponent n and the spread about it (shadowing) of links
in line of sight and of all others. Links weaker than -150 dB do not count, as a sounder would not receive them.
Antennas are isotropic and vertically polarised. Intervals are of 95 %, by bootstrap over offices.

The standard is Indoor-Office of TR 38.901 (Tables 7.4.1-1 and 7.5-6), up to 100 GHz: its path loss at the distances of
the traced links, and its medians of spreads. Measured are exponents and shadowing of all directions together in an
office of New York (Ju et al., 2021), as the authors' simulator for ns-3 has them. No office is that of the
measurements: only statistics can agree.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light
from tyro.conf import OmitArgPrefixes

from robosim.building.building import make_building
from robosim.generator.generate import GeneratorConfig, generate_plan
from tests.benchmarks.harness import DEFAULT, Options, free_places, ratio_interval, run_units
from tests.benchmarks.results import Results
from wireless.channel import Channel
from wireless.tracing.tracer import Tracer, TracerConfig

#: Heights of transmitters and receivers [m], and how many there are in an office.
_TX_M, _RX_M, _TRANSMITTERS, _RECEIVERS = 2.4, 1.5, 4, 60
#: Distances that the standard is valid from [m], and least gain of a link [dB].
_NEAREST_M, _LEAST_GAIN_DB = 1.0, -150.0
#: Most paths of a link.
_PATHS = 400
_IN_SPACE = TracerConfig(floor_ceiling=True, max_transmissions=2)
#: What is traced, and share of the usual furniture, which reaches the ceiling; None for drawn shares.
TRACED = {
    "walls": (TracerConfig(), None),
    "and floor, ceiling, two passed walls": (_IN_SPACE, None),
    "the same without furniture": (_IN_SPACE, 0.0),
    "the same, walls scatter by 0.3": (replace(_IN_SPACE, scattering=0.3), 0.0),
}
STATES = {"line of sight": True, "no line of sight": False}
#: Carriers [GHz], and the highest of the standard.
FREQUENCIES_GHZ, _STANDARD_GHZ = (28, 140), 100
#: Path loss exponent and shadowing [dB] by carrier [GHz] and state.
MEASURED = {
    (28, "line of sight"): (1.2, 3.0),
    (28, "no line of sight"): (2.7, 9.8),
    (140, "line of sight"): (1.8, 2.9),
    (140, "no line of sight"): (2.7, 6.6),
}
#: Names, units and units over those of the standard (s, degrees) of spreads.
QUANTITIES = (
    ("delay spread", "ns", 1e9),
    ("azimuth spread, arrival", "°", 1.0),
    ("azimuth spread, departure", "°", 1.0),
)
#: Slope over log10(1 + f in GHz), and value at 0, of the mean of log10 of each.
SPREADS = {
    "line of sight": ((-0.01, -7.692), (-0.19, 1.781), (0.0, 1.60)),
    "no line of sight": ((-0.28, -7.173), (-0.11, 1.863), (0.0, 1.62)),
}


def main(*, offices: int = 12, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Path loss, shadowing, delay and angular spreads in generated offices next to TR 38.901 and measurements.

    Args:
        offices: Offices, with seeds from 0.
        options: Of every benchmark.
    """
    results = Results()
    units = {
        f"{number} {frequency} {name}": (number, frequency, name)
        for frequency in FREQUENCIES_GHZ
        for name in TRACED
        for number in range(offices)
    }
    traced = run_units(trace_office, units, options.folder("indoor_office"), workers=options.workers)
    for frequency, (state, is_sight) in product(FREQUENCIES_GHZ, STATES.items()):
        table = f"{frequency} GHz, {state}"
        homes: list[Float[np.ndarray, "6 n"]] = []
        for name in TRACED:
            each = (traced[f"{number} {frequency} {name}"] for number in range(offices))
            homes = [links[:, links[0] == is_sight] for links in each]
            add_links(results, table, f"traced: {name}", homes, frequency)
        if frequency <= _STANDARD_GHZ:
            add_standard(results, table, homes, frequency, state)
        exponent, shadowing_db = MEASURED[frequency, state]
        results.add(table, "measured", "path loss exponent", exponent, digits=2)
        results.add(table, "measured", "shadowing", shadowing_db, "dB", digits=1)
    return options.finish("indoor_office", results)


def trace_office(number: int, frequency_ghz: int, name: str) -> Float[np.ndarray, "6 n"]:
    """Links of an office: line of sight, distance [m], loss [dB], delay spread [ns], azimuth spreads [deg]."""
    config, furniture = TRACED[name]
    plan = generate_plan(number, config=GeneratorConfig(style="office", furniture=furniture))
    building = make_building(plan)
    rng = np.random.default_rng(number)
    tx, rx = (
        np.column_stack([free_places(building.free.buffer(-0.3), count, rng), np.full(count, height_m)])
        for count, height_m in ((_TRANSMITTERS, _TX_M), (_RECEIVERS, _RX_M))
    )
    tracer = Tracer(building, frequency_hz=frequency_ghz * 1e9, config=replace(config, max_paths=_PATHS))
    paths = tracer.trace(tx, rx, workers=1)
    channel = Channel.from_paths(paths)
    gain_db = 10 * np.log10(np.maximum(channel.power(coherent=False).sum(axis=(2, 3)), 1e-30))
    distance_m = np.linalg.norm(tx[:, None] - rx, axis=2)
    used = (gain_db >= _LEAST_GAIN_DB) & (distance_m >= _NEAREST_M)
    is_sight = np.zeros(distance_m.shape, bool)
    is_sight[paths.tx[paths.order == 0], paths.rx[paths.order == 0]] = True
    columns = (
        is_sight,
        distance_m,
        -gain_db,
        1e9 * channel.delay_spread_s(),
        np.degrees(channel.angular_spread_rad("aoa_az")),
        np.degrees(channel.angular_spread_rad("aod_az")),
    )
    return np.array([column[used].astype(float) for column in columns])


def standard_loss_db(
    distance_m: Float[np.ndarray, " n"], frequency_ghz: float, state: str
) -> Float[np.ndarray, " n"]:
    """Path loss of Indoor-Office of TR 38.901, Table 7.4.1-1 [dB]."""
    sight = 32.4 + 17.3 * np.log10(distance_m) + 20 * np.log10(frequency_ghz)
    if STATES[state]:
        return sight
    return np.maximum(sight, 17.3 + 38.3 * np.log10(distance_m) + 24.9 * np.log10(frequency_ghz))


def fit_exponent(
    offices: list[Float[np.ndarray, "6 n"]], frequency_ghz: float
) -> tuple[float, tuple[float, float] | None, float]:
    """Path loss exponent over 1 m by least squares, its interval by bootstrap over offices, and shadowing [dB]."""
    free_db = 20 * np.log10(4 * np.pi * frequency_ghz * 1e9 / speed_of_light)
    steps = [10 * np.log10(links[1]) for links in offices]
    losses = [links[2] - free_db for links in offices]
    moments = np.array([(step @ loss, step @ step) for step, loss in zip(steps, losses, strict=True)])
    exponent, spread = ratio_interval(*moments.T)
    rest_db = np.concatenate(losses) - exponent * np.concatenate(steps)
    return exponent, spread, float(np.sqrt((rest_db**2).mean()))


def add_links(
    results: Results, table: str, row: str, offices: list[Float[np.ndarray, "6 n"]], frequency_ghz: float
) -> None:
    """Add exponent, shadowing and medians of spreads of links of one state."""
    exponent, spread, shadowing_db = fit_exponent(offices, frequency_ghz)
    links = np.concatenate(offices, axis=1)
    results.add(table, row, "path loss exponent", exponent, digits=2, spread=spread, cases=links.shape[1])
    results.add(table, row, "shadowing", shadowing_db, "dB", digits=1)
    for (quantity, unit, _), values in zip(QUANTITIES, links[3:], strict=True):
        results.add(table, row, quantity, float(np.nanmedian(values)), unit, digits=1)


def add_standard(
    results: Results, table: str, offices: list[Float[np.ndarray, "6 n"]], frequency_ghz: float, state: str
) -> None:
    """Add what the standard has at the distances of links."""
    lossy = [links.copy() for links in offices]
    for links in lossy:
        links[2] = standard_loss_db(links[1], frequency_ghz, state)
    results.add(table, "TR 38.901", "path loss exponent", fit_exponent(lossy, frequency_ghz)[0], digits=2)
    results.add(table, "TR 38.901", "shadowing", 3.0 if STATES[state] else 8.03, "dB", digits=1)
    for (quantity, unit, factor), (slope, at) in zip(QUANTITIES, SPREADS[state], strict=True):
        median = factor * 10 ** (slope * np.log10(1 + frequency_ghz) + at)
        results.add(table, "TR 38.901", quantity, median, unit, digits=1)
