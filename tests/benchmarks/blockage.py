"""Blockage: how a person who crosses a link weakens it, by each model, next to published measurements.

A link of 5 m at the height of the chest is crossed at right angles at nine places, by the person of TR 38.901 (0.3 m
wide, 1.7 m high), alone in free space. Of each crossing: the largest loss, the mean loss and the duration while at
least 5 dB are lost, the time from 10 % to 90 % of the largest loss, and the distance after which the loss in decibels
is correlated by less than 1/e. The loss behind a person is the median while the middle of the body is within 5 cm of
the link. Two people cross side by side, 1 m apart along the link.

Published: pedestrians at 73.5 GHz, mean over all events with antennas of 7 and of 60 degrees (MacCartney, Rappaport and
Rangan, IEEE GLOBECOM 2017). Antennas of that kind receive less of what passes the person at the sides, which point-like
antennas do not; widths and speeds of these pedestrians are not known. At 60 GHz, losses of a person who stands between
two antennas (Dieng, Zaharia and El Zein, 2025: 24 to 26 dB), and the median duration of fades among one to five people
in 20 hours (Collonge, Zaharia and El Zein, 2004: about 100 ms, attenuation mostly above 20 dB).

A body is no screen. Its loss is also that of an endless cylinder of dry skin (Gabriel, Lau and Gabriel, Phys. Med.
Biol. 41, 1996) of the same width, exactly, next to screens that are as high, at distances from the transmitter down to
that of a person who stands next to the antenna.
"""

from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.constants import epsilon_0, speed_of_light
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import make_building
from tests.benchmarks.harness import DEFAULT, Options, alternate, figure_of, free_places, plans_of, quartiles
from tests.benchmarks.results import Results
from tests.wireless.em.cylinder import cylinder_field
from wireless.em.screens import SCREEN_MODELS
from wireless.motion.blockage import block, find_blockage
from wireless.motion.bodies import PERSON_RADIUS_M, Bodies, people
from wireless.paths import Paths
from wireless.tracing.tracer import Tracer

FREQUENCIES_HZ = (28e9, 60e9, 73.5e9)
#: Length and height of the link [m], and where it is crossed, from the transmitter.
LINK_M, HEIGHT_M = 5.0, 1.2
CROSSED_M = np.arange(0.5, 4.6, 0.5)
#: Distance of two people along the link, and half of the width of steps that count as behind a person [m].
APART_M, BEHIND_M = 1.0, 0.05
#: A fade lasts while at least this is lost [dB].
FADE_DB = 5.0
#: Relative permittivity and conductivity [S/m] of dry skin by frequency, distances of a body from the transmitter, and
#: its height where the upper edge does not count [m].
SKIN = {28e9: (16.55, 25.82), 60e9: (7.98, 36.40)}
NEAR_M, ENDLESS_M = (0.25, 0.5, 1.0, 2.5), 100.0
#: How far to both sides of the link a person walks, and in which steps [m].
ASIDE_M, STEP_M = 1.5, 0.002
#: Mean duration [ms] and mean depth [dB] of published fades, by the antennas' width.
PUBLISHED = {"published, 7°": (299.0, 15.8), "published, 60°": (260.2, 11.5)}
#: Persons of the measurement of speed.
CROWD = 10


class Fade(NamedTuple):
    """One crossing."""

    largest_db: float
    mean_db: float
    duration_s: float
    edge_s: float
    decorrelation_m: float
    behind_db: float


def main(
    plan: Positional[str] = "office",
    *,
    speed: float = 1.2,
    links: int = 20,
    turns: int = 30,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Blockage: depth, duration and slope of fades by a crossing person at 28, 60 and 73.5 GHz, and time per link.

    Args:
        plan: Floor plan for the measurement of time.
        speed: Speed of the person [m/s].
        links: Links of that measurement.
        turns: Repetitions of that measurement.
        options: Of every benchmark.
    """
    results = Results()
    for hz, model, count in product(FREQUENCIES_HZ, SCREEN_MODELS, (1, 2)):
        crossed_m = CROSSED_M[CROSSED_M + (count - 1) * APART_M < LINK_M]
        fades = [fade_of(crossing_db(hz, x, model, count), speed) for x in crossed_m]
        row = f"{hz / 1e9:g} GHz, {model}" + (", two people" if count == 2 else "")
        for name, values, unit, digits in (
            ("largest loss", [fade.largest_db for fade in fades], "dB", 1),
            ("loss behind", [fade.behind_db for fade in fades], "dB", 1),
            ("mean loss", [fade.mean_db for fade in fades], "dB", 1),
            ("duration", [1e3 * fade.duration_s for fade in fades], "ms", 0),
            ("10 % to 90 %", [1e3 * fade.edge_s for fade in fades], "ms", 0),
            ("decorrelation", [fade.decorrelation_m for fade in fades], "m", 2),
        ):
            middle, spread = quartiles(values)
            results.add("fades", row, name, middle, unit, digits=digits, spread=spread, cases=len(fades))
    for row, (duration_ms, depth_db) in PUBLISHED.items():
        results.add("fades", f"73.5 GHz, {row}", "mean loss", depth_db, "dB", digits=1)
        results.add("fades", f"73.5 GHz, {row}", "duration", duration_ms, "ms", digits=0)
    results.add("fades", "60 GHz, published 2025", "loss behind", None, "dB", digits=0, spread=(24, 26))
    results.add("fades", "60 GHz, published 2004", "duration", 100, "ms", digits=0)
    for hz, x in product(SKIN, NEAR_M):
        for law, loss_db in behind_db(hz, x).items():
            results.add("body", f"{hz / 1e9:g} GHz, {x:g} m", law, loss_db, "dB", digits=1)
    measure_time(plan, links, turns, options.seed, results)
    results.figures["blockage"] = draw(speed)
    return options.finish("blockage", results)


def crossing_db(hz: float, x: float, model: str, count: int = 1) -> Float[np.ndarray, " n"]:
    """Loss of the link, for steps of people across it, the first at a distance from the transmitter."""
    aside = np.arange(-ASIDE_M, ASIDE_M, STEP_M)
    n = len(aside)
    tx = np.column_stack([np.full(n, -x), -aside, np.full(n, HEIGHT_M)])
    rx = tx + np.array([LINK_M, 0.0, 0.0])
    walkers = people(np.column_stack([APART_M * np.arange(count), np.zeros(count)]))
    factor = find_blockage(_direct(tx, rx, hz), walkers, model).factor
    return -20 * np.log10(np.abs(factor))


def behind_db(hz: float, x: float) -> dict[str, float]:
    """Median loss behind an endless body at a distance from the transmitter, of screens and of the exact cylinder."""
    aside = np.arange(-BEHIND_M, BEHIND_M, STEP_M)
    tx = np.column_stack([np.full(len(aside), -x), -aside, np.full(len(aside), ENDLESS_M / 2)])
    rx = tx + np.array([LINK_M, 0.0, 0.0])
    body = people(np.zeros((1, 2)), height_m=ENDLESS_M)
    factors = {model: find_blockage(_direct(tx, rx, hz), body, model).factor for model in SCREEN_MODELS}
    k, (eps, conductivity) = 2 * np.pi * hz / speed_of_light, SKIN[hz]
    skin = eps - 1j * conductivity / (2 * np.pi * hz * epsilon_0)
    # Turned about the body until the transmitter is on the x axis.
    source, observer = tx[:, 0] + 1j * tx[:, 1], rx[:, 0] + 1j * rx[:, 1]
    turned = observer * np.conj(source) / np.abs(source)
    places = k * np.column_stack([turned.real, turned.imag])
    for law, parallel in (("skin, upright electric field", True), ("skin, level electric field", False)):
        factors[law] = cylinder_field(
            k * PERSON_RADIUS_M, skin, k * np.abs(source), places, parallel=parallel
        )
    return {law: float(np.median(-20 * np.log10(np.abs(factor)))) for law, factor in factors.items()}


def _direct(tx: Float[np.ndarray, "n 3"], rx: Float[np.ndarray, "n 3"], hz: float) -> Paths:
    """The direct path of each of many links, level and along x."""
    n, zeros = len(tx), np.zeros(len(tx))
    gain = np.full((n, 2, 2), speed_of_light / hz / (4 * np.pi * LINK_M), complex)
    return Paths(
        tx_position=tx,
        rx_position=rx,
        frequency_hz=hz,
        tx=np.arange(n),
        rx=np.arange(n),
        gain=gain,
        power=np.abs(gain[:, 0, 0]) ** 2,
        delay_s=np.full(n, LINK_M / speed_of_light),
        aoa_az=np.full(n, -np.pi),
        aoa_el=zeros,
        aod_az=zeros,
        aod_el=zeros,
        order=np.zeros(n, np.uint8),
        interaction=np.zeros((n, 1), np.uint8),
        primitive=np.full((n, 1), -1),
        point=np.full((n, 1, 3), np.nan),
    )


def fade_of(loss_db: Float[np.ndarray, " n"], speed_m_s: float) -> Fade:
    """What one crossing does."""
    step_s, largest = STEP_M / speed_m_s, loss_db.max()
    faded = np.flatnonzero(loss_db >= FADE_DB)
    inside = loss_db[faded[0] : faded[-1] + 1] if len(faded) else np.zeros(0)
    falling = loss_db[: loss_db.argmax() + 1]
    edge = np.argmax(falling >= 0.9 * largest) - np.flatnonzero(falling <= 0.1 * largest)[-1]
    off = loss_db - loss_db.mean()
    correlation = np.correlate(off, off, "full")[len(off) - 1 :] / (off @ off)
    return Fade(
        largest_db=largest,
        mean_db=float(inside.mean()) if len(inside) else 0.0,
        duration_s=len(inside) * step_s,
        edge_s=float(edge) * step_s,
        decorrelation_m=float(np.argmax(correlation < np.exp(-1))) * STEP_M,
        behind_db=float(np.median(loss_db[np.abs(np.arange(len(loss_db)) * STEP_M - ASIDE_M) <= BEHIND_M])),
    )


def measure_time(name: str, links: int, turns: int, seed: int, results: Results) -> None:
    """Processor time of blockage of a link's paths by a crowd in a building."""
    (plan,) = plans_of((name,))
    building = make_building(plan)
    places = free_places(building.free, 2 * links + CROWD, np.random.default_rng(seed))
    ends = np.column_stack([places[: 2 * links], np.full(2 * links, HEIGHT_M)])
    tracer, crowd = Tracer(building), people(places[2 * links :])
    traced = [tracer.trace(one[None], other[None]) for one, other in zip(ends[::2], ends[1::2], strict=True)]
    full = [paths for paths in traced if len(paths) == tracer.config.max_paths]
    row = f"{plan.name}, {tracer.config.max_paths} paths, {CROWD} persons"
    actions = {model: partial(_block, full, crowd, model) for model in SCREEN_MODELS}
    for model, seconds in alternate(actions, turns=turns).items():
        middle, spread = quartiles(1e3 * seconds / max(len(full), 1))
        results.add("time", row, model, middle, "ms", digits=3, spread=spread, cases=len(full))


def _block(links: list[Paths], crowd: Bodies, model: str) -> None:
    for paths in links:
        block(paths, crowd, model)


def draw(speed_m_s: float) -> Any:
    """Loss over time as a person crosses the middle of the link, and depth over duration of all crossings."""
    figure, (left, right) = figure_of(2)
    aside = 1e3 * np.arange(-ASIDE_M, ASIDE_M, STEP_M) / speed_m_s
    for (i, hz), (model, phases) in product(enumerate(FREQUENCIES_HZ), SCREEN_MODELS.items()):
        style, marker, colour = ("-", "o", f"C{i}") if phases else (":", "x", f"C{i}")
        label = f"{hz / 1e9:g} GHz, {model}"
        left.plot(aside, -crossing_db(hz, LINK_M / 2, model), style, color=colour, lw=1.2, label=label)
        fades = [fade_of(crossing_db(hz, x, model), speed_m_s) for x in CROSSED_M]
        x, y = ([1e3 * fade.duration_s for fade in fades], [fade.mean_db for fade in fades])
        right.plot(x, y, marker, color=colour, ms=4, label=label)
    for (row, (duration_ms, depth_db)), marker in zip(PUBLISHED.items(), ("*", "P"), strict=True):
        right.plot(duration_ms, depth_db, marker, color="k", ms=11, label=f"{row}, 73.5 GHz")
    left.set(xlabel="time [ms]", ylabel="gain over the free path [dB]", xlim=(-400, 400))
    left.set_title(f"a person crosses the middle of a link of {LINK_M:g} m", fontsize=9)
    right.set(xlabel=f"duration of at least {FADE_DB:g} dB [ms]", ylabel="mean loss meanwhile [dB]")
    right.set_title("nine places of crossing", fontsize=9)
    left.legend(fontsize=7, loc="lower left")
    right.legend(fontsize=7)
    return figure
