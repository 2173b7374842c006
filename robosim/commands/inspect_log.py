"""`robosim slam --inspect`: what is read of a log, without a map."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from robosim.commands.output import console, emit_result
from robosim.logs.robot_log import BagTopics, RobotLog
from robosim.support.parts import Part
from robosim.support.reading import FileError


def inspect_logs(logs: Sequence[Path], scans: Path | None, topics: BagTopics, reader: Part) -> None:
    """Print what is read of logs, as far as they can be read; then raise the FileError of the first that cannot."""
    from robosim.logs.bag import is_bag, read_bag
    from robosim.logs.log_files import read_log

    reports: list[dict[str, Any]] = []
    errors: list[FileError] = []
    for path in logs:
        report: dict[str, Any] = {"log": path.name}
        try:
            if reader == "auto" and is_bag(path):
                log = read_bag(path, topics, report)
            else:
                log = read_log(path, scans, topics=topics, reader=reader)
            report |= _facts(log)
        except FileError as error:
            errors.append(error)
            report["error"] = str(error)
        reports.append(report)
        _print(report)
    emit_result({"logs": reports})
    if errors:
        raise errors[0]


def _facts(log: RobotLog) -> dict[str, Any]:
    """What any log holds."""
    return {
        "scans": len(log.times),
        "beams": log.range_m.shape[1],
        "scan_span_s": (log.times[0], log.times[-1]),
        "share_without_return": float((~np.isfinite(log.range_m)).mean()),
        "share_with_odometry": float(log.known[1:].mean()),
        "mount": log.mount,
    }


def _print(report: Mapping[str, Any]) -> None:
    """Print a report: tables of topics, the tree of frames, then a line for each fact."""
    console.print(f"{report['log']}")
    if topics := report.get("topics"):
        table = Table("topic", "type", "messages", "recorded from [s]", "to [s]", "read")
        for row in topics:
            first, last = (f"{time:.3f}" for time in row["span_s"])
            kind = "yes" if row["read"] else "no"
            table.add_row(row["topic"], row["type"], str(row["messages"]), first, last, kind)
        console.print(table)
    for row in report.get("frames", ()):
        kind = "" if row["kind"] == "root" else f" ({row['kind']})"
        console.print(f"{'  ' * row['depth']}{row['frame']}{kind}")
    spans = {
        name: f"{span[0]:.3f} to {span[1]:.3f} s"
        for name in ("scan_span_s", "odometry_span_s")
        if (span := report.get(name))
    }
    shares = {name: f"{100 * report[name]:.1f} %" for name in report if name.startswith("share_")}
    mount = (
        {"mount": "x {:.3f} m, y {:.3f} m, yaw {:.4f} rad".format(*report["mount"])}
        if "mount" in report
        else {}
    )
    texts = {**report, **spans, **shares, **mount}
    for name, label in _LABELS.items():
        if texts.get(name) is not None:
            console.print(f"{label}: {texts[name]}")
    for text in report.get("assumed", ()):
        console.print(f"assumed: {text}")


#: Names of facts, and what they are called for people.
_LABELS = {
    "scan_topic": "scans",
    "sensor_frame": "frame of the scans",
    "base_frame": "frame of the robot",
    "frame": "frame of the trajectory",
    "mount": "sensor on that frame",
    "odometry": "odometry",
    "scans": "number of scans",
    "beams": "beams of a scan",
    "scan_span_s": "time of the scans",
    "odometry_span_s": "time of the odometry",
    "share_at_limit": "beams at the limit of the sensor",
    "share_without_return": "beams without return",
    "share_with_odometry": "scans with known motion",
}
