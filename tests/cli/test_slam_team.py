"""`robosim slam --team`: one map of several logs, and logs that are not recognised apart."""

import json

import numpy as np
import pytest

from robosim.cli import main
from robosim.plans.files import read_plan
from robosim.support.tum import read_tum
from slam.poses import between, compose
from tests.robot_logs import Drive
from tests.slam.beams import ranges
from tests.slam.corridors import BUILDING, EAST, WEST

pytest.importorskip("rosbags")
from tests.robosim.logs.made_bags import laser_scan, odometry, placed, transform
from tests.robosim.logs.rounds import BEARING, write_round

MOUNT = np.array([0.2, 0.0, 0.5])


class CorridorDrive(Drive):
    """Scans of the corridor instead of the room."""

    def fan(self, pose: np.ndarray) -> list[float]:
        """Ranges [m] from a pose."""
        reach = ranges(BUILDING, pose, bearing=self.bearing)
        return [float(value) for value in np.minimum(reach, 81.9)]


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """A CARMEN log from the west, a bag from the east with its laser askew, and a CARMEN log of another building."""
    folder = tmp_path_factory.mktemp("logs")
    (folder / "west.log").write_text(CorridorDrive(WEST).raw())
    (folder / "other.log").write_text(Drive().raw())
    # Odometry of the bag begins anywhere.
    frame = np.array([7.0, -3.0, 2.0])
    rows = [("/tf_static", 100.0, transform(0.0, "base_link", "laser", placed(MOUNT)))]
    for k, pose in enumerate(EAST):
        reach = ranges(BUILDING, compose(pose, MOUNT), bearing=BEARING)
        rows.append(("/odom", 100.0 + k, odometry(100.0 + k, compose(frame, between(EAST[0], pose)))))
        rows.append(("/scan", 100.0 + k, laser_scan(100.0 + k, BEARING, np.minimum(reach, 30.0))))
    write_round(folder / "east", rows)
    return folder


def test_slam_team_joins_a_carmen_log_and_a_bag(logs, tmp_path, capsys):
    """Poses of both bases in the frame of the first, a map of one corridor; the third log apart, with a line."""
    out = tmp_path / "out"
    east = next(logs.glob("east*"))
    main(["slam", *map(str, (logs / "west.log", east, logs / "other.log")), "--team", "--out", str(out)])
    text = " ".join(capsys.readouterr().out.split())
    assert "other: not placed relative to west" in text
    agreement = json.loads((out / "result.json").read_text())["agreement"]
    assert 0.8 <= agreement <= 1.0
    assert f"west, east: surfaces that several of them saw agree in {100 * agreement:.0f} %." in text
    assert ("check map.png" in text) == (agreement <= 0.95)
    for name, route in (("west", WEST), ("east", EAST)):
        expected = np.array([between(WEST[0], pose) for pose in route])
        off = read_tum(out / f"{name}.tum")[1] - expected
        assert np.hypot(*off[:, :2].T).max() < 0.4
        assert np.abs(np.sin(off[:, 2] / 2)).max() < 0.015
    result = json.loads((out / "result.json").read_text())
    assert [row["log"] for row in result["logs"]] == ["west", "east"]
    assert result["logs"][1]["loops_across"] >= 4
    assert np.linalg.eigvalsh(result["logs"][1]["start_covariance"]).min() > 0
    # From half a metre behind the first pose, which looks ahead, to half a metre beyond the east wall.
    plan = read_plan(out / "map.yaml")
    assert abs(plan.resolution_m * plan.occupancy.shape[1] - 50.0) < 0.4
    assert (out / "map.png").stat().st_size > 10_000
    assert {path.name for path in (out / "other").iterdir()} == {
        "map.yaml", "map.pgm", "map.png", "other.tum", "result.json",
    }  # fmt: skip


def test_slam_team_rejects_what_is_no_team_in_one_line(logs, tmp_path, fails):
    west, other = str(logs / "west.log"), str(logs / "other.log")
    assert "give two or more" in fails("slam", west, "--team", "--out", tmp_path / "a")
    assert "leave one away" in fails("slam", west, other, "--team", "--map", "flat")
    copy = tmp_path / "west.log"
    copy.write_text((logs / "west.log").read_text())
    assert f"{west}, {copy} have the same name" in fails("slam", west, copy, "--team")
    scans = tmp_path / "scans.txt"
    assert "belong to one log" in fails("slam", west, other, "--team", "--scans", scans)
    empty = tmp_path / "blind.log"
    empty.write_text("ODOM 0 0 0 0 0 0 1.0 host 1.0\nODOM 1 0 0 0 0 0 2.0 host 2.0\n")
    assert "blind.log" in fails("slam", west, empty, "--team")
