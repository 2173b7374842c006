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
from tests.benchmarks.harness import DEFAULT, Options, run_units
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
    results, folder = Results(), options.folder("team_logs")
    units = {f"{path.stem} {count}": (path, count, overlap) for path in logs for count in (1, *sessions)}
    errors = run_units(join_sessions, units, folder, workers=options.workers)
    for name, (path, count, _) in units.items():
        row = _title(path) if count == 1 else f"{_title(path)}, {count} sessions"
        for column, (value, unit, digits) in errors[name].items():
            results.add("joined", row, column, value, unit, digits=digits)
    halves = {f"{path.stem} half {part}": (path, part, overlap) for path in logs for part in (0, 1) if apart}
    trackers = run_units(track_half, halves, folder, workers=options.workers)
    pairs = [
        [trackers[f"{one.stem} half 0"], trackers[f"{other.stem} half 1"]]
        for one, other in product(logs, logs)
        if apart and one != other
    ]
    if pairs:
        joined = sum(len(join_maps(pair, find_links(pair, 0, 1))) < 2 for pair in pairs)
        results.add("apart", "sessions of different logs", "pairs", len(pairs), digits=0)
        results.add("apart", "sessions of different logs", "joined", joined, digits=0)
    return options.finish("team_logs", results)


def join_sessions(path: Path, count: int, overlap: float) -> dict[str, tuple[float, str, int]]:
    """Cut a log, map its sessions and join them; values, units and digits by column."""
    start = process_time()
    maps = map_team(cut_log(read_log(path), count, overlap))
    seconds = process_time() - start
    poses = np.concatenate([session.poses for session in maps[0]])
    references = [session.log.reference for session in maps[0] if session.log.reference is not None]
    error = compare_trajectories(poses, np.concatenate(references))
    across = sum(session.loops_across for session in maps[0]) / 2
    return {
        "error": (error["rpe_m"], "m", 3),
        "heading": (error["rpe_deg"], "°", 2),
        "maps": (len(maps), "", 0),
        "loops across": (across, "", 0),
        "time": (seconds, "s", 0),
    }


def track_half(path: Path, part: int, overlap: float) -> Tracker:
    """Map one of two sessions of a log."""
    return map_log(cut_log(read_log(path), 2, overlap)[part]).tracker


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


def _title(path: Path) -> str:
    """Name of a log on the page."""
    name = path.name.partition(".")[0]
    return TITLES.get(name.removesuffix("-corrected"), name)
