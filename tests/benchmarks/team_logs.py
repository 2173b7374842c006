"""Logs of real robots, cut into sessions that overlap in time, mapped apart and joined; relative starts are unknown.

A session knows nothing of the others: its odometry is displacements, and its map begins at (0, 0, 0). Errors are
relative ones against the reference of the whole log, so that places of different sessions are compared too. Sessions of
different logs, and so of different buildings, must not be joined.
"""

from dataclasses import replace
from itertools import product
from pathlib import Path
from time import process_time

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional

from robosim.logs.log_files import read_log
from robosim.logs.log_mapping import map_log
from robosim.logs.robot_log import RobotLog
from robosim.logs.team_mapping import map_team
from robosim.logs.trajectory_scores import compare_trajectories
from slam.graph.joining import join_maps
from slam.graph.links import find_links
from slam.graph.tracker import Tracker
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.localization import part_of
from tests.benchmarks.results import Results
from tests.benchmarks.robot_logs import TITLES


def main(
    logs: Positional[tuple[Path, ...]],
    *,
    sessions: tuple[int, ...] = (2, 3),
    overlap: float = 0.25,
    apart: bool = True,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Errors of maps that are joined from sessions of a log, over those of the whole log; wrong joins.

    Args:
        logs: CARMEN logs with reference poses.
        sessions: Numbers of sessions that a log is cut into.
        overlap: Part of a session that the next one shares.
        apart: Also try to join first sessions with second ones of other logs.
        options: Of every benchmark.
    """
    results, halves = Results(), list[tuple[str, Tracker, Tracker]]()
    for path in logs:
        log = read_log(path)
        title = TITLES.get(log.name.removesuffix("-corrected"), log.name)
        start = process_time()
        _add(results, title, [(log, map_log(log).poses)], process_time() - start)
        for count in sessions:
            parts, start = cut_log(log, count, overlap), process_time()
            maps, row = map_team(parts), f"{title}, {count} sessions"
            seconds = process_time() - start
            _add(results, row, [(each.log, each.poses) for each in maps[0]], seconds)
            results.add("joined", row, "maps", len(maps), digits=0)
            across = sum(each.loops_across for each in maps[0]) / 2
            results.add("joined", row, "loops across", across, digits=0)
        if apart:
            first, second = (map_log(part).tracker for part in cut_log(log, 2, overlap))
            halves.append((title, first, second))
    pairs = [
        (first, second) for (one, first, _), (other, _, second) in product(halves, halves) if one != other
    ]
    if pairs:
        joined = sum(len(join_maps(pair, find_links(pair, 0, 1))) < 2 for pair in pairs)
        results.add("apart", "sessions of different logs", "pairs", len(pairs), digits=0)
        results.add("apart", "sessions of different logs", "joined", joined, digits=0)
    return options.finish("team_logs", results)


def cut_log(log: RobotLog, count: int, overlap: float) -> list[RobotLog]:
    """Cut a log into sessions of equal numbers of scans, which share a part with the next."""
    n = len(log.times)
    width = n / (count - (count - 1) * overlap)
    starts = [round(k * width * (1 - overlap)) for k in range(count)]
    ends = [min(round(start + width), n) for start in starts[:-1]] + [n]
    parts = []
    for k, (start, end) in enumerate(zip(starts, ends, strict=True)):
        reference = None if log.reference is None else log.reference[start:end]
        parts.append(
            replace(part_of(log, slice(start, end)), name=f"{log.name}-{k + 1}", reference=reference)
        )
    return parts


def _add(results: Results, row: str, runs: list[tuple[RobotLog, np.ndarray]], seconds: float) -> None:
    """Relative errors of poses in one frame, and processor time."""
    poses = np.concatenate([poses for _, poses in runs])
    reference = np.concatenate([log.reference for log, _ in runs if log.reference is not None])
    error = compare_trajectories(poses, reference)
    results.add("joined", row, "error", error["rpe_m"], "m", digits=3)
    results.add("joined", row, "heading", error["rpe_deg"], "°", digits=2)
    results.add("joined", row, "time", seconds, "s", digits=0)
