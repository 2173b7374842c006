"""Values that are well formed and cannot be true: what is written, and what the line says of it.

Each row replaces a text in a good file. A value is rejected in one line that names the file, or a warning or the report
states it: no row is read in silence. Impossible values of bags are in `tests/robosim/logs`.
"""

from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import pytest

from robosim.cli import main
from tests.fuzz.small_files import COMMANDS, FILES, STOPS, write_files

_GAZEBO = '<gazebo reference="base_scan"><sensor type="ray" name="s">{}</sensor></gazebo></robot>'
_SWEEP = _GAZEBO.format("<horizontal><min_angle>{}</min_angle><max_angle>{}</max_angle></horizontal>")
_CAMERA = _GAZEBO.replace("base_scan", "camera_link").replace("ray", "camera")


class Row(NamedTuple):
    """A value that cannot be true."""

    file: str
    old: str
    """Text of the good file that is replaced, wherever it is."""
    new: str
    expected: str
    """Part of what is said."""


ROWS = [Row(*row) for row in (
    ("map.yaml", "resolution: 0.05", "resolution: 0", "resolution is '0', expected a positive number"),
    ("map.yaml", "origin: [0,", "origin: [.nan,", "origin is ['.nan'"),
    ("map.yaml", "origin: [0, 0, 0]", "origin: [0, 0, 90]", "was it meant in degrees?"),
    ("map.yaml", "occupied_thresh: 0.65", "occupied_thresh: 65", "expected a probability"),
    ("map.yaml", "negate: 0", "negate: 7", "negate is '7', expected one of"),
    ("map.yaml", "negate: 0", "negate: 0\nresolution: 0.1", "the key 'resolution' is there twice"),
    ("cart.urdf", 'mass value="0.2"', 'mass value="2e8"', "the mass of left is 2e+08 kg, expected up to"),
    ("cart.urdf", 'mass value="3"', 'mass value="-3"', "the mass of link 'base' is -3.0 kg"),
    ("cart.urdf", 'radius="0.05"', 'radius="1000"', "height_m is 1000.1, expected"),
    ("cart.urdf", 'xyz="0 0.15', 'xyz="0 -0.15', "as many on the left as on the right"),
    ("cart.urdf", 'ixx="0.02"', 'ixx="-0.02"', "the inertia of base is zero or negative"),
    ("cart.urdf", 'ixx="0.02"', 'ixx="1e9"', "inertia of base is that of mass outside of the robot"),
    ("cart.urdf", 'xyz="0.05 0 0.1"', 'xyz="0.05 0 50"', "inertia of base is that of mass outside of the robot"),
    ("cart.urdf", 'xyz="0.2 0 0.24"', 'xyz="0.2 0 -5"', "height_m is -4.99"),
    ("cart.urdf", 'axis xyz="0 0 1"', 'limit lower="3" upper="-3"/><axis xyz="0 0 1"', "left_joint, 3 to -3, do not"),
    ("cart.urdf", "</robot>", _CAMERA.format("<horizontal_fov>0</horizontal_fov>"), "horizontal_fov of sensor s is 0"),
    ("cart.urdf", "</robot>", _CAMERA.format("<horizontal_fov>9</horizontal_fov>"), "hfov_deg is 515.66"),
    ("cart.urdf", "</robot>", _CAMERA.format("<image><width>0</width></image>"), "width of sensor s is 0"),
    ("cart.urdf", "</robot>", _SWEEP.format(0, 12.6),
     "<horizontal> of sensor s is from 0 to 12.6"),
    ("cart.urdf", "</robot>", _SWEEP.format(1, 1), "<horizontal> of sensor s is from 1 to 1"),
    ("cart.urdf", "</robot>", _GAZEBO.format("<range><min>5</min><max>1</max></range>"), "<range> of sensor s is"),
    ("cart.urdf", "</robot>", _GAZEBO.replace("base_scan", "roof").format(""), "on 'roof', which is no link"),
    ("disk.xml", 'fovy="75"', 'fovy="0"', "hfov_deg is 0.0, expected"),
    ("disk.xml", 'fovy="75"', 'fovy="75" resolution="0 0"', "hfov_deg is nan, expected"),
    ("disk.xml", 'size="0.03 0.01"', 'size="1000 0.01"', "height_m is 1000.3"),
    ("robot.yaml", "mass_kg: 4", "wheel_radius_m: 0", "wheel_radius_m is 0"),
    ("robot.yaml", "mass_kg: 4", "mass_kg: 4\nmass_kg: 5", "the key 'mass_kg' is there twice"),
    ("robot.yaml", "mass_kg: 4", "camera: {ahead_m: 8}", "camera.ahead_m is 8, but the hull reaches 0.25 m"),
    ("sector.msi", "8.15 dBi", "60 dBi", "times the power that it is given"),
    ("sector.msi", "8.15 dBi", "-60 dBi", "Are its gains relative?"),
    ("sector.msi", "8.15 dBi", "8.15 dBi\nGAIN 3 dBi", "line 3 begins with GAIN again"),
    ("sector.msi", "HORIZONTAL 36", "HORIZONTAL 35", "more than its cut announces"),
    ("sector.msi", "\n10 ", "\n0 9\n10 ", "has the angle 0 twice"),
    ("grid.csv", "gain_dbi\n", "azimuth_deg\n", "azimuth_deg"),
    ("grid.csv", "\n0,0,", "\n0,0,60\n0,0,", "gives a direction another gain"),
    ("route.csv", ",-40\n", ",100\n", "--not-received 100"),
    ("route.csv", ",power_dbm", ",power_dbm,x_m", "column 'x_m' is there twice"),
    ("route.csv", ",0.5", ",900.5", "route.csv: half of the positions are more than"),
    ("route.csv", "POWERS", "-60", "all 24 powers of beacon 'a' are -60 dBm"),
    ("powers.csv", "0.5,0.5,2.0", "0.5,0.5,-10000", "powers.csv: beacon a has z_m = -10000"),
    ("powers.csv", "0.5,0.5,2.0", "90000,0.5,2", "beacon 'a' is at (90000, 0.5) m, outside of the plan"),
    ("powers.csv", "POWERS", "-60", "all 64 powers of beacon 'a' are -60 dBm"),
    ("movers.yaml", "[[5, 15]]", "[[15, 5]]", "open_s is 15 to 5 s"),
    ("movers.yaml", "[[5, 15]]", "[[-5, -1]]", "open_s is -5 to -1 s"),
    ("movers.yaml", "[3.1, 1.1]", "[100000, 1.1]", "movers.yaml: entry 1: door is at (100000, 1.1) m"),
    ("crowd.csv", "9,a,1,1.5", "9,a,100000,1.5", "a body moves at 1.111e+04 m/s"),
    ("crowd.csv", "9,a", "0,a", "id a has two rows at time 0"),
    ("cart.tum", "9 1 1.5", "9 1e5 1.5", "a body moves at 1.111e+04 m/s"),
    ("wall.yaml", "thickness_m: 0.06", "thickness_m: -0.06", "thickness_m is -0.06"),
    ("wall.yaml", "thickness_m: 0.06", "thickness_m: 100", "thickness_m is 100"),
    ("wall.yaml", "permittivity: 2.2", "permittivity: -2", "relative_permittivity is -2"),
    ("room.yaml", "z_m: 0", "z_m: -10000", "z_m of table is -10000"),
    ("room.yaml", "at: [0.7, 0.7]", "at: [100000, 0.7]", "outside of the building"),
    ("room.yaml", "unit_m: 0.5", "unit_m: 0.000001", "m from its origin, expected more than 0.001 m"),
    ("room.yaml", "unit_m: 0.5", "unit_m: 1000", "reaches to 1e+03 m"),
    ("house.yaml", "slab: 0.25", "slab: -1", "slab is -1"),
    ("house.yaml", "offset: [0, 0]", "offset: [100000, 0]", "house.yaml: storey 1 is 100000 m from storey 0"),
    ("suite.yaml", "[0.6, 0.5, 90]", "[0.5, 0.5, 90]", "tasks[1] is tasks[0] again"),
    ("suite.yaml", "[2.5, 1.5]", "[0.5, 0.5]", "tasks[0] starts at its target"),
    ("suite.yaml", "[0.5, 0.5, 90]", "[0.5, 0.5, 900]", "yaw of tasks[0] is 900, expected -360 to 360 degrees"),
    ("suite.yaml", "[0.5, 0.5, 90]", "[500, 0.5, 90]", "task 0 of m: start is (500, 0.5) m"),
    ("plan.svg", 'r="30"', 'r="nan"', "r of <circle> is 'nan'"),
    ("plan.svg", 'r="30"', 'r="-30"', "r is '-30', expected 0 or more"),
    ("plan.svg", "600cm", "1200cm", "by width a unit is 0.02 m, by height 0.01 m; give --unit"),
    ("plan.svg", "0 0 600 400", "0 0 0 400", "of positive size"),
    ("floor.ply", "face 1", "face 3", "it announces 7 vertices and faces"),
    ("floor.ply", "4 0 1 2 3", "3 0 0 0", "shape p has an area of 0 m2"),
    ("scene.xml", '"5"', '"-5"', "relative_permittivity is -5"),
    ("scene.xml", '<scale value="50"/>', '<scale value="0"/>', "shape q has an area of 0 m2"),
    ("scene.xml", '<scale value="50"/>', f'<matrix value="{"1 0 0 0 0 " * 3}0"/>', "expected 0 0 0 1"),
    ("scans.txt", "-1.5 1.5", "1.5 -1.5", "expected rising ones"),
    ("scans.txt", "2.5", "-1", "none of its beams hits anything"),
    ("scans.txt", "2.5", "900", "Are its ranges in metres?"),
    ("log.tum", "\n5 0.5", "\n5 50000", "odometry goes 50000 m"),
    ("log.tum", "\n5 0.5 0 0 0 0 0 1", "\n5 0.5 0 0 0 0 0 7", "a quaternion of length 7"),
    ("drive.clf", "2.5", "500", "none of its beams hits anything"),
    ("drive.clf", "FLASER 180 ", "ROBOTLASER1 0 0 7 0.9 80 0.01 0 180 ", "0.9 rad between beams"),
)]  # fmt: skip


def changed(text: str, row: Row) -> str:
    """A file with a value that cannot be true; POWERS stands for all powers of a table."""
    if row.old == "POWERS":
        head, *lines = text.splitlines()
        return "\n".join([head, *(f"{line.rpartition(',')[0]},{row.new}" for line in lines)])
    assert row.old in text
    return text.replace(row.old, row.new)


class _Stopped(BaseException):
    """All has been read."""


def run(name: str, folder: Path, capsys, caplog) -> tuple[int, str, str]:
    """Exit status, errors, and all that is said by the command that reads a file."""
    status = 0
    with ExitStack() as stack:
        for stop in STOPS:
            stack.enter_context(patch(stop, side_effect=_Stopped))
        try:
            main(COMMANDS[name].format(folder).split())
        except _Stopped:
            pass
        except SystemExit as error:
            status = int(error.code or 0)
    printed = capsys.readouterr()
    return status, printed.err, " ".join((printed.out + printed.err + caplog.text).split())


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_read_good_files(name, tmp_path, capsys, caplog):
    write_files(tmp_path)
    status, errors, printed = run(name, tmp_path, capsys, caplog)
    assert status == 0, errors
    assert not any(row.expected in printed for row in ROWS if row.file == name)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.file}: {row.new[:40]}")
def test_commands_reject_or_state_impossible_values(row, tmp_path, capsys, caplog):
    write_files(tmp_path)
    (tmp_path / row.file).write_text(changed(FILES[row.file], row))
    status, errors, printed = run(row.file, tmp_path, capsys, caplog)
    assert row.expected in printed
    assert status in (0, 2)
    if status:
        assert errors.count("\n") == 1 and errors.startswith(f"robosim: {tmp_path}"), errors
