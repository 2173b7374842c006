"""`robosim slam`."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from rich.table import Table
from tyro.conf import OmitArgPrefixes, Positional, arg

from robosim.commands.inspect_log import inspect_logs
from robosim.commands.join_logs import join_logs
from robosim.commands.locate_logs import locate_logs
from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import results_folder
from robosim.logs.log_mapping import LogConfig, make_log_plan, map_log
from robosim.logs.robot_log import BagTopics, RobotLog
from robosim.parts import LogReaderPart
from robosim.plans.floorplan import FloorPlan
from robosim.support.progress import stages_tracked

_DEFAULTS, _TOPICS = LogConfig(), BagTopics()


def slam(
    logs: Positional[tuple[Path, ...]],
    *,
    scans: Path | None = None,
    reference: Path | None = None,
    beam_seconds: tuple[float, float] | None = None,
    how: Annotated[OmitArgPrefixes[LogConfig], arg(name="")] = _DEFAULTS,
    topics: Annotated[OmitArgPrefixes[BagTopics], arg(name="")] = _TOPICS,
    reader: LogReaderPart = "auto",
    map: str | None = None,
    team: bool = False,
    inspect: bool = False,
    out: Path | None = None,
) -> None:
    """Make maps and trajectories from logs of real robots.

    Writes a folder for each log: trajectory.tum (from the graph), matching.tum (each scan matched to those before,
    without loop closure) and odometry.tum for evo; map.yaml and map.pgm, a plan for other commands; map.png,
    trajectories.png and result.json: errors against the reference, if the log has one, number of loops, seconds.

    With --team the logs are those of several robots, or of one on several days, whose relative starts are unknown.
    Logs that show the same places share one map: map.yaml, map.pgm, map.png with all trajectories, and NAME.tum of each
    log, in the frame of the first. A log that is not recognised without doubt on the others' maps, as of another
    building, is not joined: its map lies apart, in a folder of its name, and a line says so.

    With --map the robot is located on a known map, from an unknown pose: trajectory.tum, covariance.csv, map.png and
    result.json, in the frame of the map.

    Poses of bags are those of base_link or base_footprint, or of --frame. With --inspect, nothing is mapped or written:
    topics, frames, odometry, times and beams without return are printed, and what was assumed.

    Example: robosim slam intel.log.gz --out out/intel
    Example: robosim slam monday.bag tuesday.bag --team --out out/both

    Args:
        logs: CARMEN logs with laser scans (.log, .clf, packed by gzip or not), ROS bags (.bag, .mcap, folders of ROS
            2), or odometry as a TUM file with --scans.
        scans: Scans for a TUM file, one per line: time [s], first and last bearing [rad], and ranges [m].
        reference: Trajectory to compare with, as a TUM file, instead of that in the log.
        beam_seconds: Times of the first and the last beam after a scan's time [s], such as 0 0.1, for a lidar that
            turns. Scans are corrected for the motion of the robot between them.
        how: How the map is made.
        topics: What is read of bags.
        reader: Reader of the logs: auto takes the first that matches a file; module:Name is your own.
        map: Floor plan in which the robot is located, such as map.yaml of an earlier run; no map is made then.
        team: Join the maps of several logs that overlap by a fifth or more, in one frame.
        inspect: Print what is read of the logs, without a map.
        out: Output folder; by default a new one under runs/.
    """
    from robosim.logs.log_files import read_log
    from robosim.logs.trajectory_scores import compare_trajectories, count_filled_cells
    from robosim.support.files import write_json
    from robosim.support.tum import write_tum

    if not logs:
        raise ValueError("there is no log. Give one or more, such as robosim slam intel.log.gz.")
    if len(logs) > 1 and (scans or reference):
        raise ValueError("--scans and --reference belong to one log: give one log with them.")
    if team and map is not None:
        raise ValueError(
            "--team makes a map, and --map locates each log on one, in its frame already: leave one away."
        )
    if inspect:
        inspect_logs(logs, scans, topics, reader)
        return
    read = [read_log(path, scans, reference, beam_seconds, topics, reader) for path in logs]
    names = [log.name for log in read]
    if twice := [str(path) for path, name in zip(logs, names, strict=True) if names.count(name) > 1]:
        raise ValueError(
            f"{', '.join(twice)} have the same name: their results would lie in the same folder. Give a log once, or "
            "rename one of them."
        )
    if team:
        join_logs(read, how, out)
        return
    if map is not None:
        locate_logs(read, map, how, out)
        return
    table = Table(
        "log", "", "ATE [m]", "RPE 1-5 m [m]", "[deg]", "along the path [m]", "[deg] ", "cells", "loops", "s"
    )
    results: list[dict[str, Any]] = []
    with results_folder(out, "slam") as folder:
        for log in read:
            place = folder if len(read) == 1 else folder / log.name
            trajectories, rows = {"odometry": log.odometry()}, {}
            made = {}
            for name, loops in (("matching", False), ("graph", True)):
                made[name] = map_log(
                    log, how, loops=loops, watched=stages_tracked(f"{log.name}, {name}", console)
                )
                trajectories[name] = made[name].poses
            log = made["graph"].log
            if log.reference is not None:
                trajectories["reference"] = log.reference
            for name, poses in trajectories.items():
                row: dict[str, Any] = {"cells": count_filled_cells(log, poses)}
                if log.reference is not None and name != "reference":
                    row |= compare_trajectories(poses, log.reference)
                if name in made:
                    row |= {"loops": made[name].loops, "seconds": made[name].seconds}
                rows[name] = row
                file = {"graph": "trajectory"}.get(name, name)
                write_tum(place / f"{file}.tum", log.times, poses)
                _add(table, log.name, name, row)
            _write_maps(place, log, trajectories, how)
            result = {"log": log.name, "scans": len(log.range_m), "trajectories": rows}
            write_json(place / "result.json", result)
            results.append(result)
    emit_result({"logs": results}, folder)
    console.print(table)
    console.print(
        f"Wrote trajectory.tum, map.yaml, map.png, trajectories.png, result.json and more in {folder}"
    )
    last = folder if len(read) == 1 else folder / read[-1].name
    console.print(f"Next: robosim plan {quote(str(last / 'map.yaml'))}")


def _write_maps(
    folder: Path, log: RobotLog, trajectories: dict[str, Float[np.ndarray, "n 3"]], how: LogConfig
) -> None:
    """Maps of the scans by the graph and by the reference, and pictures of them and of all trajectories."""
    from robosim.drawing.plots import draw_maps, draw_trajectories
    from robosim.plans.files import write_ros

    plans: dict[str, FloorPlan] = {
        name: make_log_plan(log, trajectories[name], how.resolution_m, how.range_m)
        for name in ("graph", "reference")
        if name in trajectories
    }
    write_ros(plans["graph"], folder / "map.yaml")
    draw_maps(folder / "map.png", plans, trajectories)
    draw_trajectories(folder / "trajectories.png", log, trajectories)


def _add(table: Table, log: str, name: str, row: dict[str, Any]) -> None:
    def shown(key: str, digits: int) -> str:
        return f"{row[key]:.{digits}f}" if key in row else ""

    table.add_row(
        log if name == "odometry" else "",
        name,
        shown("ate_m", 3),
        shown("rpe_m", 3),
        shown("rpe_deg", 2),
        shown("path_rpe_m", 3),
        shown("path_rpe_deg", 2),
        shown("cells", 0),
        shown("loops", 0),
        shown("seconds", 1),
    )
