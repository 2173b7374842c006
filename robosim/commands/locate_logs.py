"""`robosim slam --map`: logs located on a known map."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import results_folder
from robosim.logs.log_localization import Localized, locate_log
from robosim.logs.log_mapping import LogConfig
from robosim.logs.robot_log import RobotLog
from robosim.navigation import read_known_map
from robosim.support.files import write_json, write_whole
from robosim.support.progress import stages_tracked
from robosim.support.tum import write_tum
from wireless.support.counting import counted

#: Columns of covariance.csv, and entries of the covariance.
_COLUMNS = ("time_s", "xx_m2", "xy_m2", "x_yaw_m_rad", "yy_m2", "y_yaw_m_rad", "yaw_yaw_rad2", "is_located")
_ENTRIES = np.triu_indices(3)


def locate_logs(logs: Sequence[RobotLog], map_name: str, how: LogConfig, out: Path | None) -> None:
    """Locate each log on a map, and write a folder for each."""
    from robosim.drawing.plots import draw_maps

    (plan, known), results = read_known_map(map_name), list[dict[str, Any]]()
    with results_folder(out, "slam") as folder:
        for log in logs:
            place = folder if len(logs) == 1 else folder / log.name
            located = locate_log(log, known, how, stages_tracked(log.name, console))
            write_tum(place / "trajectory.tum", log.times, located.poses)
            write_whole(place / "covariance.csv", _covariances(log, located))
            shown = np.where(located.is_located[:, None], located.poses, np.nan)
            draw_maps(place / "map.png", {log.name: plan}, {log.name: shown})
            fraction = float(located.is_located.mean())
            result = {"log": log.name, "map": map_name, "scans": len(log.times), "located": fraction}
            result["kidnapped_s"] = [float(log.times[k]) for k in located.kidnapped]
            write_json(place / "result.json", result)
            results.append(result)
            deviation_m = located.deviation_m[located.is_located]
            about = (
                f", standard deviation {np.median(deviation_m):.3f} m (median)" if len(deviation_m) else ""
            )
            console.print(
                f"{log.name}: located at {100 * fraction:.0f} % of {counted(len(log.times), 'scan')}{about}; "
                f"searched for again {counted(len(located.kidnapped), 'time')}"
            )
    emit_result({"logs": results}, folder)
    console.print(f"Wrote trajectory.tum, covariance.csv, map.png and result.json in {folder}")


def _covariances(log: RobotLog, located: Localized) -> bytes:
    """Upper triangle of the covariance of each pose, and whether the robot was located."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(_COLUMNS)
    for time_s, covariance, is_located in zip(log.times, located.covariance, located.is_located, strict=True):
        rows.writerow([f"{time_s:.6f}", *(f"{value:.6g}" for value in covariance[_ENTRIES]), int(is_located)])
    return text.getvalue().encode()
