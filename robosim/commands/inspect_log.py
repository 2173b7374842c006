"""`robosim slam --inspect`: what is read of a log, without a map."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from robosim.commands.output import console, emit_result
from robosim.logs.robot_log import BagTopics
from robosim.support.parts import Part
from robosim.support.reading import FileError

#: Facts of a report, and what they are called for people.
_LABELS = {
    "scan_topic": "scans",
    "sensor_frame": "frame of the scans",
    "base_frame": "frame of the robot",
    "frame": "frame of the trajectory",
    "mount": "sensor on that frame (x [m], y [m], yaw [rad])",
    "odometry": "odometry",
    "scans": "number of scans",
    "beams": "beams of a scan",
    "scan_span_s": "time of the scans",
    "odometry_span_s": "time of the odometry",
    "share_at_limit": "beams at the limit of the sensor",
    "share_without_return": "beams without return",
    "share_with_odometry": "scans with known motion",
}


def inspect_logs(logs: Sequence[Path], scans: Path | None, topics: BagTopics, reader: Part) -> None:
    """Print what is read of logs, as far as they can be read; then raise the FileError of the first that cannot."""
    from robosim.logs.bag import is_bag, read_bag
    from robosim.logs.log_files import read_log
    from robosim.logs.log_mapping import LogConfig, check_reach

    reports, errors = list[dict[str, Any]](), list[FileError]()
    for path in logs:
        report: dict[str, Any] = {"log": path.name}
        try:
            is_read_by_us = reader == "auto" and is_bag(path)
            log = (
                read_bag(path, topics, report)
                if is_read_by_us
                else read_log(path, scans, None, None, topics, reader)
            )
            report |= {
                "scans": len(log.times),
                "beams": log.range_m.shape[1],
                "scan_span_s": (log.times[0], log.times[-1]),
                "share_without_return": float((~np.isfinite(log.range_m)).mean()),
                "share_with_odometry": float(log.known[1:].mean()),
                "mount": log.mount,
            }
            try:
                check_reach(log, LogConfig().range_m)
            except FileError as error:
                report.setdefault("assumed", []).append(f"it cannot be mapped, {error}")
        except FileError as error:
            errors.append(error)
            report["error"] = str(error)
        reports.append(report)
        _print(report)
    emit_result({"logs": reports})
    if errors:
        raise errors[0]


def _print(report: Mapping[str, Any]) -> None:
    """Print a report: tables of topics, the tree of frames, then a line for each fact."""
    console.print(report["log"])
    if "topics" in report:
        table = Table("topic", "type", "messages", "recorded [s]", "read")
        for row in report["topics"]:
            is_read = "yes" if row["read"] else "no"
            table.add_row(
                row["topic"], row["type"], str(row["messages"]), _text("span_s", row["span_s"]), is_read
            )
        console.print(table)
    for row in report.get("frames", ()):
        console.print(f"{'  ' * row['depth']}{row['frame']} ({row['kind']})")
    for name, label in _LABELS.items():
        if report.get(name) is not None:
            console.print(f"{label}: {_text(name, report[name])}")
    for text in report.get("assumed", ()):
        console.print(f"assumed: {text}")


def _text(name: str, value: Any) -> str:
    if name.endswith("span_s"):
        return "{:.3f} to {:.3f} s".format(*value)
    if name == "mount":
        return ", ".join(f"{number:.4f}" for number in value)
    return f"{100 * value:.1f} %" if name.startswith("share_") else str(value)
