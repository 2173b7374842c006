"""Second halves of logs of real robots, located on maps of their first halves, from unknown poses.

The reference is the trajectory of the whole log. Only poses that are given with a standard deviation below 0.1 m are
compared: at the others the robot sees nothing of the first half.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.logs.log_files import read_log
from robosim.logs.log_localization import locate_log
from robosim.logs.log_mapping import LogConfig, make_log_plan, map_log
from robosim.logs.robot_log import RobotLog
from robosim.navigation import known_map_of
from slam.poses import wrap
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results
from tests.benchmarks.robot_logs import TITLES

#: Largest standard deviation of poses that are compared [m].
KNOWN_M = 0.1


def main(logs: Positional[tuple[Path, ...]], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Errors of poses on known maps.

    Args:
        logs: CARMEN logs.
        options: Of every benchmark.
    """
    results, config = Results(), LogConfig()
    for path in logs:
        log = read_log(path)
        title, n = TITLES.get(log.name.removesuffix("-corrected"), log.name), len(log.times) // 2
        first, second = part_of(log, slice(0, n)), part_of(log, slice(n, None))
        whole = map_log(log, config)
        # At the poses of the whole log, so that what the second half corrects of the first is no error.
        plan = make_log_plan(first, whole.poses[:n], config.resolution_m, config.range_m)
        located = locate_log(second, known_map_of(plan), config)
        true = whole.poses[n:]
        is_compared = located.is_located & (located.deviation_m < KNOWN_M)
        off_m = np.hypot(*(located.poses - true)[is_compared, :2].T)
        off_deg = np.abs(np.degrees(wrap(located.poses[:, 2] - true[:, 2])))[is_compared]
        for name, value, unit, digits in (
            ("scans", len(second.times), "", 0),
            ("located", 100 * located.is_located.mean(), "%", 0),
            ("compared", 100 * is_compared.mean(), "%", 0),
            ("error, median", np.median(off_m), "m", 3),
            ("error, 95 %", np.quantile(off_m, 0.95), "m", 3),
            ("heading, median", np.median(off_deg), "°", 2),
            ("heading, 95 %", np.quantile(off_deg, 0.95), "°", 2),
            ("searched again", len(located.kidnapped), "", 0),
        ):
            results.add("halves", title, name, float(value), unit, digits=digits)
    return options.finish("localization", results)


def part_of(log: RobotLog, rows: slice) -> RobotLog:
    """Some scans of a log, which begin without a motion."""
    displacement = log.displacement[rows].copy()
    displacement[0] = 0.0
    bearing_rad = log.bearing_rad[rows] if log.bearing_rad.ndim == 2 else log.bearing_rad
    return replace(
        log,
        bearing_rad=bearing_rad,
        range_m=log.range_m[rows],
        displacement=displacement,
        known=log.known[rows],
        times=log.times[rows],
        reference=None,
        track=None,
    )
