"""`robosim slam` on bags: the report of what is read, and poses in the frame that users expect."""

import json

import numpy as np
import pytest

from robosim.cli import main
from robosim.support.tum import write_tum
from slam.poses import between, compose

pytest.importorskip("rosbags")
from tests.robosim.logs.made_bags import laser_scan, odometry, placed, transform
from tests.robosim.logs.rounds import BEARING, POSES, TIMES, hall_ranges, recording, write_round

BACKWARDS = np.array([0.3, 0.0, np.pi])
EXPECTED = np.array([between(POSES[0], pose) for pose in POSES])


@pytest.fixture(scope="module")
def backwards(tmp_path_factory):
    """A bag of a robot whose laser looks backwards, 0.3 m ahead of its centre."""
    rows = [("/tf_static", 100.0, transform(0.0, "base_link", "laser", placed(BACKWARDS)))]
    for t, pose in zip(TIMES, POSES, strict=True):
        rows.append(("/odom", t, odometry(t, pose)))
        rows.append(("/scan", t, laser_scan(t, BEARING, hall_ranges(compose(pose, BACKWARDS), BEARING))))
    return write_round(tmp_path_factory.mktemp("bags") / "run", rows)


def poses_of(path):
    """Poses of a TUM file."""
    rows = np.loadtxt(path)
    return np.column_stack([rows[:, 1:3], 2 * np.arctan2(rows[:, 6], rows[:, 7])])


def test_slam_gives_poses_map_and_errors_of_the_base(backwards, tmp_path):
    write_tum(tmp_path / "truth.tum", TIMES, POSES)
    out = tmp_path / "out"
    main(["slam", str(backwards), "--reference", str(tmp_path / "truth.tum"), "--out", str(out)])
    for name in ("odometry", "matching", "trajectory"):
        off = poses_of(out / f"{name}.tum") - EXPECTED
        assert np.abs(off[:, :2]).max() < 0.03
        assert np.abs(np.sin(off[:, 2] / 2)).max() < 0.01
    errors = json.loads((out / "result.json").read_text())["trajectories"]["graph"]
    assert errors["ate_m"] < 0.02 and errors["rpe_m"] < 0.02 and errors["rpe_deg"] < 0.5
    # The hall of 6 m x 4 m around the first pose of the base, which looks along +y from (4.5, 2).
    text = (out / "map.yaml").read_text()
    corner = json.loads(text.partition("origin:")[2].partition("\n")[0])
    assert np.allclose(corner[:2], [-2.5, -1.5 - 0.5], atol=0.12)


def test_slam_gives_poses_of_a_frame(backwards, tmp_path):
    main(["slam", str(backwards), "--frame", "laser", "--out", str(tmp_path / "out")])
    laser = [compose(pose, BACKWARDS) for pose in POSES]
    expected = np.array([between(laser[0], pose) for pose in laser])
    assert np.allclose(poses_of(tmp_path / "out" / "trajectory.tum")[:, :2], expected[:, :2], atol=0.03)


def test_slam_inspect_reports_what_is_read(backwards, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["slam", "--inspect", str(backwards)])
    text = capsys.readouterr().out
    assert "base_link (root)\n  laser (static)" in text
    for words in (
        "/scan",
        "sensor_msgs/LaserScan",
        "odometry: /odom",
        "100.000 to 119.500 s",
        "number of scans: 40",
    ):
        assert words in text
    main(["slam", "--inspect", str(backwards), "--json"])
    (report,) = json.loads(capsys.readouterr().out)["logs"]
    assert report["frame"] == "base_link" and report["mount"] == pytest.approx(BACKWARDS)
    assert {row["topic"]: row["messages"] for row in report["topics"]} == {
        "/odom": 40,
        "/scan": 40,
        "/tf_static": 1,
    }
    assert report["share_with_odometry"] == 1 and report["assumed"] == []
    assert not list(tmp_path.iterdir())


def test_slam_inspect_reports_a_bag_that_cannot_be_mapped(tmp_path, capsys):
    path = write_round(tmp_path / "run", recording(scans=False))
    with pytest.raises(SystemExit):
        main(["slam", "--inspect", str(path)])
    captured = capsys.readouterr()
    assert "has no topic of LaserScan" in " ".join(captured.err.split())
    assert "base_link (root)\n  laser (static)" in captured.out
