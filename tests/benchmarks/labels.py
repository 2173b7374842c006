"""Agreement of traced link states and angles with the published labels of mmwRobotNav.

Intervals are of 95 %, by bootstrap over buildings. Rules are also chosen on half of the buildings and reported on the
other half (`tests.benchmarks.label_rules`).

A link is in the clear if its receiver lies in the same piece of free space as the transmitter and its cell has eight
free neighbours: the published receivers are shifted by a cell against their plan, so that many of the others stand on
walls or behind them, where a tie decides.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, make_building
from robosim.plans.files import read_plan
from robosim.training.label_links import TRACER, published_mesh
from tests.benchmarks.harness import DEFAULT, Options, ratio_interval, run_units
from tests.benchmarks.label_rules import add_halves, paths_by_rule
from tests.benchmarks.results import Results
from wireless.formats.mmwrobotnav_measurements import (
    FileError,
    find_measurements,
    link_states,
    read_measurements,
)
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer

STATES = ("outage", "line of sight", "first order", "higher order")
NEAR_RAD = np.radians(5.0)
#: The published receiver: samples [s], elements of an array, and directions that it looks in.
SAMPLE_S, ELEMENTS, DIRECTIONS = 2.5e-9, 8, 360


def main(
    data: Positional[Path], plans: Positional[Path], *, options: OmitArgPrefixes[Options] = DEFAULT
) -> Results:
    """Labels: how many traced link states and angles agree with the published ones of mmwRobotNav.

    19 minutes of processor time for 18 buildings. Goes on after a kill if it is given the same folder.

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with `NAME.glb_topdownmap.out` for each building.
        options: Of every benchmark.
    """
    units = {
        f"{name} {number}": (data, plan_file(plans, name), name, number)
        for name, number in find_measurements(data)
    }
    found = run_units(compare, units, options.folder("labels"), workers=options.workers)
    buildings = {
        name: [found[unit] for unit in units if units[unit][2] == name] for _, _, name, _ in units.values()
    }
    results = Results()
    links = {
        name: {key: np.concatenate([one[key] for one in own], axis=-1) for key in own[0]}
        for name, own in buildings.items()
    }
    for name, own in {**{name: [own] for name, own in links.items()}, "all": list(links.values())}.items():
        summarise(name, own, results)
    same = {name: (own["by_rule"] == own["published"]).sum(axis=1) for name, own in links.items()}
    add_halves(results, same, {name: len(own["published"]) for name, own in links.items()})
    return options.finish("labels", results)


def summarise(name: str, buildings: Sequence[dict[str, np.ndarray]], results: Results) -> None:
    """Add what links of a building, or of all, agree in; the confusion of all links by their states.

    Of several buildings, shares have a 95 % interval by bootstrap over buildings.
    """

    def add(words: str, share: Callable[[dict[str, np.ndarray]], Bool[np.ndarray, " n"]]) -> None:
        hits = [share(links) for links in buildings]
        total = np.array([len(hit) for hit in hits])
        value, spread = ratio_interval(np.array([hit.sum() for hit in hits]), total)
        results.add(
            "agreement", name, words, 100 * value, "%", digits=1, cases=int(total.sum()),
            spread=spread and (100 * spread[0], 100 * spread[1]),
        )  # fmt: skip

    add("same link state", lambda links: links["published"] == links["computed"])
    add("in the clear", lambda links: (links["published"] == links["computed"])[links["clear"]])
    for state in (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER):
        for key, words in (
            ("strongest_off", "direction within 5°"),
            ("cluster_off", "as received within 5°"),
        ):

            def near(links: dict[str, np.ndarray], key: str = key, state: int = state) -> np.ndarray:
                both = (links["published"] == state) & ~np.isnan(links["strongest_off"])
                return np.asarray(links[key][both] < NEAR_RAD)

            add(f"{STATES[state]}: {words}", near)
    if name == "all":
        published, computed = (
            np.concatenate([links[key] for links in buildings]) for key in ("published", "computed")
        )
        for row, column in np.ndindex(4, 4):
            count = np.sum((published == row) & (computed == column))
            results.add("confusion", f"published {STATES[row]}", f"computed {STATES[column]}", count)
        add_disagreements(published, computed, results)


def add_disagreements(
    published: Int[np.ndarray, " n"], computed: Int[np.ndarray, " n"], results: Results
) -> None:
    """Add the largest shares of the links whose states differ."""
    n = int((published != computed).sum())
    counts = {
        (row, column): np.sum((published == row) & (computed == column))
        for row, column in np.ndindex(4, 4)
        if row != column
    }
    for (row, column), count in sorted(counts.items(), key=lambda each: -each[1])[:4]:
        words = f"published {STATES[row]}, computed {STATES[column]}"
        results.add("disagreements", words, "share", 100 * count / max(n, 1), "%", digits=0, cases=n)


def plan_file(plans: Path, name: str) -> Path:
    """The plan of a building.

    Raises:
        FileError: If there is none.
    """
    path = plans / f"{name}.glb_topdownmap.out"
    if not path.is_file():
        raise FileError(
            f"{path}: no such plan, but there are measurements of {name}. Give the folder of its grid."
        )
    return path


@lru_cache(maxsize=1)
def prepared(plan: Path) -> tuple[Building, Tracer]:
    """Building and tracer of a plan, cached for the next transmitter."""
    building = make_building(read_plan(plan))
    return building, Tracer(published_mesh(building.plan, building.height_m), config=TRACER)


def compare(data: Path, plan: Path, name: str, number: int) -> dict[str, np.ndarray]:
    """Trace the links of a transmitter, and compare them with the published ones.

    Returns:
        published, computed: Link states (n).
        by_rule: Link states by each of `label_rules.RULES` (n_rules, n).
        clear: Whether the link is in the transmitter's own piece of free space and off border cells (n).
        strongest_off: Angle between the strongest computed path's arrival and the published estimate [rad]; NaN for
            none (n).
        cluster_off: The same of what a receiver with beams would report as the strongest path (n).

    Raises:
        ValueError: If receivers lie outside of the plan, or on no regular grid.
    """
    measured = read_measurements(data, name, number)
    building, tracer = prepared(plan)
    tx = measured.tx_position
    rx = np.column_stack([measured.rx_position, np.full(len(measured.rx_position), tx[2])])
    try:
        paths, by_rule = paths_by_rule(tx, rx, measured.rx_cell, tracer)
    except ValueError as error:
        raise ValueError(f"{name} {number}: {error}") from error
    estimate = measured.aoa_az[:, 0]
    return {
        "published": measured.state,
        "by_rule": by_rule,
        "computed": link_states(paths)[0],
        "clear": in_the_clear(building, tx[:2], measured.rx_position),
        "strongest_off": _nearest(paths.strongest(), estimate),
        "cluster_off": _apart(received_azimuth(paths), estimate),
    }


def in_the_clear(
    building: Building, tx: Float[np.ndarray, "2"], rx: Float[np.ndarray, "n 2"]
) -> Bool[np.ndarray, " n"]:
    """Which receivers are in the transmitter's own piece of free space, in cells with eight free neighbours.

    Raises:
        ValueError: If receivers lie outside of the plan.
    """
    plan = building.plan
    cell = np.floor(plan.to_cells(rx)).astype(np.int64)
    if not ((cell >= 0) & (cell < plan.shape[::-1])).all():
        raise ValueError(
            f"{plan.name}: receivers from {rx.min(axis=0)} to {rx.max(axis=0)} m do not fit on this plan. "
            "Do data and plan belong together?"
        )
    inner = cv2.erode(np.pad(plan.free, 1).astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0
    parts = shapely.get_parts(building.free)
    own = parts[np.argmin(shapely.distance(parts, shapely.Point(tx)))]
    return inner[cell[:, 1], cell[:, 0]] & shapely.contains_xy(own, rx)


def received_azimuth(paths: Paths) -> Float[np.ndarray, " n_rx"]:
    """Azimuth of arrival that a receiver with beams reports as the strongest path [rad]; NaN without paths.

    Paths in one sample of delay and one beam add up, incoherently since their phases are random. The beam is
    that of a uniform line of `ELEMENTS` half a wavelength apart, looking in `DIRECTIONS`. One transmitter only.
    """
    look = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    found = np.full(len(paths.rx_position), np.nan)
    start = np.searchsorted(paths.rx, np.arange(len(found) + 1))
    for i in np.flatnonzero(np.diff(start)):
        some = slice(start[i], start[i + 1])
        power, azimuth, delay = paths.power[some], paths.aoa_az[some], paths.delay_s[some]
        in_beam = _beam(look[:, None] - azimuth) * power
        in_sample = np.sinc((delay[:, None] - delay) / SAMPLE_S) ** 2
        found[i] = look[np.argmax((in_beam @ in_sample).max(axis=1))]
    return found


def _beam(off: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    """Power of a beam, 1 at its peak, at angles off it; nothing behind it."""
    phase = np.pi / 2 * np.sin(off)
    safe = np.where(np.abs(phase) < 1e-9, 1e-9, phase)
    factor = np.sin(ELEMENTS * safe) / (ELEMENTS * np.sin(safe))
    return np.where(np.cos(off) > 0, factor**2, 0.0)


def _apart(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Angle between directions [rad]."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)


def _nearest(paths: Paths, estimate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Least angle between a link's paths and its estimate [rad]; NaN without paths."""
    off = np.full(len(estimate), np.inf)
    np.minimum.at(off, paths.rx, _apart(paths.aoa_az, estimate[paths.rx]))
    return np.where(np.isinf(off), np.nan, off)
