"""Logs located on known maps: the whole command on a room, and a laser that looks backwards."""

import json
from itertools import pairwise

import numpy as np

from robosim.cli import main
from robosim.logs.log_localization import locate_log
from robosim.logs.robot_log import RobotLog
from slam.poses import between, compose, wrap
from tests.robot_logs import ROOM, ROUTE, Drive
from tests.slam import beams
from tests.slam.mapping.test_localization import FURNITURE, SOLID, known_map

MOUNT = np.array([0.2, 0.05, np.pi])


def test_locate_log_gives_poses_of_the_robot():
    """Of a robot whose laser looks backwards: within 3 cm and 0.5 degrees, with the covariance of the robot's place."""
    bearing, route = np.radians(np.arange(-135, 135, 1.0)), ROUTE[:25]
    rng = np.random.default_rng(0)
    steps = [between(a, b) + rng.normal(0, [0.01, 0.01, 0.005]) for a, b in pairwise(route)]
    log = RobotLog(
        name="backwards",
        bearing_rad=bearing,
        range_m=np.array([beams.ranges(ROOM, compose(pose, MOUNT), bearing=bearing) for pose in route]),
        displacement=np.array([np.zeros(3), *steps]),
        known=np.ones(len(route), bool),
        times=np.arange(len(route)) * 1.0,
        mount=MOUNT,
    )
    located = locate_log(log, known_map(SOLID | FURNITURE))
    assert located.is_located.all() and not located.kidnapped
    off = located.poses - np.array(route)
    assert np.hypot(*off[5:, :2].T).max() < 0.03
    assert np.abs(np.degrees(wrap(off[5:, 2]))).max() < 0.5
    assert (np.linalg.eigvalsh(located.covariance) > 0).all()


def test_locate_log_gives_earlier_poses_with_their_own_covariance():
    """A narrow scanner sees one wall at first, at which another pose fits better: errors are within five deviations."""
    bearing, route = np.radians(np.arange(-35, 35, 1.0)), ROUTE[20:]
    rng = np.random.default_rng(0)
    steps = [between(a, b) + rng.normal(0, [0.01, 0.01, 0.005]) for a, b in pairwise(route)]
    log = RobotLog(
        name="narrow",
        bearing_rad=bearing,
        range_m=np.array([beams.ranges(ROOM, pose, bearing=bearing) for pose in route]),
        displacement=np.array([np.zeros(3), *steps]),
        known=np.ones(len(route), bool),
        times=np.arange(len(route)) * 1.0,
    )
    located = locate_log(log, known_map(SOLID | FURNITURE))
    assert located.is_located.all()
    off = (located.poses - np.array(route))[:, :2, None]
    squared = off.transpose(0, 2, 1) @ np.linalg.solve(
        located.covariance[:, :2, :2] + 0.025**2 * np.eye(2), off
    )
    assert squared.max() < 25


def test_slam_on_a_map_writes_poses_in_its_frame(tmp_path, capsys, monkeypatch):
    """The map of a drive, and a later part of the same drive in it, which begins anywhere."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "all.log").write_text(Drive().raw())
    (tmp_path / "part.log").write_text(Drive(ROUTE[10:40]).raw())
    main(["slam", "all.log", "--out", "whole"])
    main(["slam", "part.log", "--map", "whole/map.yaml", "--out", "part"])
    assert "part: located at 100 % of 30 scans" in capsys.readouterr().out
    poses = np.loadtxt("part/trajectory.tum")[:, 1:3]
    expected = np.array([between(ROUTE[0], pose) for pose in ROUTE[10:40]])
    assert np.hypot(*(poses - expected[:, :2]).T).max() < 0.08
    rows = np.loadtxt("part/covariance.csv", delimiter=",", skiprows=1)
    assert rows.shape == (30, 8) and rows[:, -1].all()
    assert 1e-3 < np.sqrt(rows[-1, 1]) < 0.05
    assert json.loads((tmp_path / "part" / "result.json").read_text())["kidnapped_s"] == []
