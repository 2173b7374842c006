"""Seeds of the fuzzer: robots, their logs, measured tables and scenes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from robosim.building.building import make_building
from robosim.building.mesh_export import export_mitsuba
from robosim.calibration.measured_paths import COLUMNS as MEASURED
from robosim.robot.calibration import COLUMNS, read_runs
from robosim.robot.robot_files import write_robot
from robosim.robot.robots import TURTLEBOT
from slam.actions import MOVES
from slam.odometry import calibrated
from tests.made_robots import MJCF, TWO, URDF
from tests.plans import two_rooms
from tests.robot_logs import ROUTE, Drive


def logs(folder: Path) -> None:
    """Logs of a real robot in every format."""
    (folder / "logs").mkdir(parents=True)
    Drive(ROUTE[:8], 31).write_all(folder / "logs")


def robots(folder: Path) -> None:
    """A robot whose odometry is known, its table of runs, a crowd, and a table of measured paths."""
    home, rng = folder / "robots", np.random.default_rng(7)
    home.mkdir(parents=True)
    rows = [[action.name.lower(), *rng.normal(0, 0.01, 6).round(5)] for action in MOVES for _ in range(11)]
    text = "\n".join(",".join(map(str, row)) for row in [COLUMNS, *rows])
    (home / "runs.csv").write_text(text)
    odometry = calibrated(*read_runs(home / "runs.csv"))
    write_robot(home / "robot.json", replace(TURTLEBOT, odometry=odometry))
    (home / "robot.urdf").write_text(URDF.replace("WHEELS", TWO))
    (home / "robot.xml").write_text(MJCF)
    crowd = pa.table(
        {"time": [0.0, 2, 1, 3], "id": ["a", "a", "b", "b"], "x": [0.0, 2, 5, 5], "y": [0.0, 0, 5, 6]}
    )
    csv.write_csv(crowd, home / "crowd.csv")
    pq.write_table(crowd, home / "crowd.parquet")
    columns = ",".join(MEASURED)
    (home / "paths.csv").write_text(
        "\n".join(
            [columns, *(",".join(map(str, row)) for row in rng.normal(0, 3, (9, len(MEASURED))).round(4))]
        )
    )
    (home / "robot.yaml").write_text("radius_m: 0.25\nmass_kg: 4\n")


def scenes(folder: Path) -> None:
    """A scene for Mitsuba."""
    export_mitsuba(make_building(two_rooms(0.8)), folder / "scenes")
