"""Seeds of the fuzzer: robots, their logs and maps, measured tables, antennas, scenes and movers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from robosim.building.building import make_building
from robosim.building.mesh_export import export_mitsuba
from robosim.calibration.measured_paths import COLUMNS as MEASURED
from robosim.calibration.measured_powers import COLUMNS as POWERS
from robosim.plans.files import write_ros
from robosim.robot.calibration import COLUMNS, read_runs
from robosim.robot.robot_files import write_robot
from robosim.robot.robots import TURTLEBOT
from slam.actions import MOVES
from slam.odometry import calibrated
from tests.made_robots import MJCF, TWO, URDF
from tests.plans import two_rooms
from tests.robot_logs import ROUTE, Drive


def logs(folder: Path) -> None:
    """Logs of a real robot in every format, and what is located with them: beacons, and the robot on a known map."""
    (folder / "logs").mkdir(parents=True)
    Drive(ROUTE[:8], 31).write_all(folder / "logs")
    home = folder / "localization"
    home.mkdir(parents=True)
    (home / "drive.clf").write_text(Drive(ROUTE[:8], 31).raw())
    write_ros(two_rooms(0.8), home / "map.yaml")
    (home / "along.tum").write_text("0 1 1 0 0 0 0 1\n9 2 1.5 0 0 0 0 1\n")
    route = [f"a,{0.3 * k},{0.5 + 0.1 * k},{0.5 + 0.05 * k},{-40 - k}" for k in range(20)]
    (home / "route.csv").write_text("\n".join(["beacon,time_s,x_m,y_m,power_dbm", *route]))


def robots(folder: Path) -> None:
    """A robot whose odometry is known, its table of runs, and tables of measured paths and powers."""
    home, rng = folder / "robots", np.random.default_rng(7)
    home.mkdir(parents=True)
    rows = [[action.name.lower(), *rng.normal(0, 0.01, 6).round(5)] for action in MOVES for _ in range(11)]
    text = "\n".join(",".join(map(str, row)) for row in [COLUMNS, *rows])
    (home / "runs.csv").write_text(text)
    found = calibrated(*read_runs(home / "runs.csv"))
    write_robot(home / "robot.json", replace(TURTLEBOT, odometry=found))
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
    readings = np.column_stack(
        [np.tile([1.0, 0.5, 0.5, 2.0], (40, 1)), rng.uniform(0, 4, (40, 2)), -1.0 - np.arange(40)]
    )
    (home / "powers.csv").write_text(
        "\n".join([",".join(POWERS), *(",".join(map(str, row)) for row in readings.round(3))])
    )
    route = [f"a,{k},{0.1 * k},{0.05 * k},0.3,{-40 - k}" for k in range(20)]
    (home / "route.csv").write_text("\n".join(["beacon,time_s,x_m,y_m,heading_rad,power_dbm", *route]))
    (home / "robot.yaml").write_text("radius_m: 0.25\nmass_kg: 4\n")
    (home / "wall.yaml").write_text(
        "name: clad\nlayers:\n- {material: glass, thickness_m: 0.006}\n"
        "- {relative_permittivity: 1.2, conductivity_spm: 0.01, thickness_m: 0.06}\n"
        "- {material: glass, thickness_m: 0.006}\n"
    )


def antennas(folder: Path) -> None:
    """Patterns of antennas: two cuts, and a grid."""
    home = folder / "antennas"
    home.mkdir(parents=True)
    cuts = [f"{angle} {min(abs(angle - 180), 25)}" for angle in range(0, 360, 10)]
    text = ["NAME a", "GAIN 8.15 dBi", "HORIZONTAL 36", *cuts, "VERTICAL 36", *cuts]
    (home / "a.msi").write_text("\n".join(text))
    grid = [f"{a},{e},{-abs(a - 180) / 60}" for a in range(0, 360, 30) for e in range(-90, 91, 30)]
    (home / "a.csv").write_text("\n".join(["azimuth_deg,elevation_deg,gain_dbi", *grid]))


def scenes(folder: Path) -> None:
    """A scene for Mitsuba, one that includes another, with meshes as text, and a material for one of its shapes."""
    home = folder / "scenes"
    export_mitsuba(make_building(two_rooms(0.8)), home)
    corners = [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (4, 0), (4, 4), (0, 4))]
    text = "\n".join(f"{x} {y} {z}" for x, y, z in corners)
    names = "".join(f"property float {axis}\n" for axis in "xyz")
    (home / "floor.ply").write_text(
        f"ply\nformat ascii 1.0\nelement vertex 8\n{names}element face 2\n"
        f"property list uchar int vertex_indices\nend_header\n{text}\n4 0 1 2 3\n4 4 5 6 7\n"
    )
    (home / "wall.obj").write_text("v 0 0 0\nv 4 0 0\nv 4 0 2\nv 0 0 2\nf 1 2 3\nf 1 3 4\n")
    shape = (
        '<shape type="{0}" id="{0}"><string name="filename" value="{1}"/>{2}<ref id="m" name="bsdf"/></shape>'
    )
    turn = '<transform name="to_world"><rotate z="1" angle="$turn"/><translate x="1"/></transform>'
    (home / "part.xml").write_text(
        '<scene version="2.1.0"><default name="turn" value="90"/><bsdf type="radio-material" id="m">'
        '<float name="relative_permittivity" value="5"/>'
        '<float name="conductivity" value="0.1"/><float name="thickness" value="0.2"/></bsdf>'
        f"{shape.format('obj', 'wall.obj', turn)}</scene>"
    )
    (home / "whole.xml").write_text(
        f'<scene version="2.1.0"><include filename="part.xml"/>{shape.format("ply", "floor.ply", "")}</scene>'
    )
    (home / "paint.yaml").write_text("layers:\n- {material: glass, thickness_m: 0.006}\n")


def movers(folder: Path) -> None:
    """A door, a crowd and a trolley in the building of two rooms."""
    home = folder / "movers"
    home.mkdir(parents=True)
    (home / "crowd.csv").write_text("time,id,x,y\n0,a,1,1\n9,a,2,1\n1,b,1,2\n3,b,2,2\n")
    (home / "trolley.tum").write_text("0 4 1 0 0 0 0 1\n9 5 1 0 0 0 0 1\n")
    (home / "movers.yaml").write_text(
        "- door: [3.1, 1.1]\n  width_m: 0.8\n  closed_deg: 90\n  open_deg: 0\n  open_s: [[0, 5], [9, 20]]\n"
        "- crowd: crowd.csv\n- {trajectory: trolley.tum, radius_m: 0.3, height_m: 1.0}\n"
    )
