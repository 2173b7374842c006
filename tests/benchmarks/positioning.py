"""Places from radio paths that were measured in a real hall, against where the radios truly were.

The receiver is located from the paths of one place alone, with its clock unknown and known; at all places together,
with one unknown clock; and the transmitter from all places.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light
from tyro.conf import OmitArgPrefixes, Positional

from robosim.calibration.measured_paths import MeasuredHall, read_measured_paths
from robosim.support.progress import tracked
from slam.poses import wrap
from tests.benchmarks.harness import DEFAULT, Options, console
from tests.benchmarks.results import Results
from wireless.positioning.single_bounce import Located, MeasuredPaths, PositioningConfig, locate

#: Errors of Kaltiokallio et al., Robust snapshot radio SLAM, 2024 (arXiv:2404.10291), on the same paths.
PUBLISHED = {"RMSE": (0.36, "m", 2), "RMSE of the heading": (2.0, "°", 1)}
#: Search for a common offset around the median of single places, then around the best [m].
AROUND_M = (1.0, 0.3)


def main(
    paths: Positional[Path], *, turn_deg: float = 0.0, options: OmitArgPrefixes[Options] = DEFAULT
) -> Results:
    """Positioning: places of receivers and of the transmitter of a real hall from measured radio paths.

    Two minutes for 45 places.

    Args:
        paths: Table of paths (.csv), as `robosim calibrate-materials` reads it.
        turn_deg: Correction of the transmitter's heading in the table [deg].
        options: Of every benchmark.
    """
    hall, config, results = read_measured_paths(paths, np.radians(turn_deg)), PositioningConfig(), Results()
    seen = seen_from_transmitter(hall)
    with tracked(seen, "each place alone", console) as places:
        alone = [locate(place, config) for place in places]
    with tracked(seen, "clock known", console) as places:
        timed = [locate(place, config, offset_m=0.0) for place in places]
    truth = hall.receivers
    add_errors(results, "receiver, each place alone, clock unknown", alone, truth)
    add_errors(results, "receiver, clock known", timed, truth)
    together = locate_together(seen, config)
    add_errors(results, "receiver, one unknown clock for all places", together, truth)
    transmitter = [locate(seen_from_receiver(hall), config)]
    add_errors(results, "transmitter, from all places, clock unknown", transmitter, hall.transmitter[None])
    for name, (value, unit, digits) in PUBLISHED.items():
        results.add("places", "receiver, each place alone, published", name, value, unit, digits=digits)
    return options.finish("positioning", results)


def seen_from_transmitter(hall: MeasuredHall) -> list[MeasuredPaths]:
    """Paths of each place, which locate the receiver; the transmitter is known."""
    places = [hall.table[hall.table[:, 0] == number] for number in np.unique(hall.table[:, 0])]
    return [
        MeasuredPaths(
            known_xy=rows[:, 1:3], known_rad=rows[:, 3] + rows[:, 8], own_rad=rows[:, 9], length_m=rows[:, 7]
        )
        for rows in places
    ]


def seen_from_receiver(hall: MeasuredHall) -> MeasuredPaths:
    """All paths, which locate the transmitter; the receivers are known."""
    rows = hall.table
    return MeasuredPaths(
        known_xy=rows[:, 4:6], known_rad=rows[:, 6] + rows[:, 9], own_rad=rows[:, 8], length_m=rows[:, 7]
    )


def add_errors(results: Results, row: str, found: Sequence[Located], truth: Float[np.ndarray, "n 3"]) -> None:
    """Errors of places, headings and the clock, whose offset is 0 in truth."""
    poses = np.array([one.pose for one in found])
    off_m = np.hypot(*(poses - truth)[:, :2].T)
    off_deg = np.degrees([wrap(float(a - b)) for a, b in zip(poses[:, 2], truth[:, 2], strict=True)])
    clock_ns = np.array([one.offset_m for one in found]) / speed_of_light * 1e9
    results.add("places", row, "RMSE", _rms(off_m), "m", digits=2, cases=len(found))
    results.add("places", row, "median", np.median(off_m), "m", digits=2)
    results.add("places", row, "RMSE of the heading", _rms(off_deg), "°", digits=1)
    results.add("places", row, "median of the heading", np.median(np.abs(off_deg)), "°", digits=1)
    results.add("places", row, "RMSE of the clock", _rms(clock_ns), "ns", digits=2)


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def locate_together(places: Sequence[MeasuredPaths], config: PositioningConfig) -> list[Located]:
    """Find a radio at several places with one offset of its clock that is not known.

    Raises:
        ValueError: If the paths of a place are too few.
    """
    alone = [locate(paths, config) for paths in places]
    offset = float(np.median([found.offset_m for found in alone]))
    for half_m in AROUND_M:
        offset = least_between(
            lambda value: sum(locate(paths, config, offset_m=value).cost for paths in places), offset, half_m
        )
    return [locate(paths, config, offset_m=offset) for paths in places]


def least_between(cost: Callable[[float], float], middle: float, half: float) -> float:
    """The vertex of a parabola through the least of five costs around a value and its neighbours."""
    values = middle + np.linspace(-half, half, 5)
    costs = np.array([cost(float(value)) for value in values])
    k = int(np.clip(np.argmin(costs), 1, len(values) - 2))
    a, b, c = costs[k - 1 : k + 2]
    bend = a - 2 * b + c
    shift = 0.5 * (a - c) / bend if bend > 0 else 0.0
    return float(values[k] + np.clip(shift, -1, 1) * (values[1] - values[0]))
