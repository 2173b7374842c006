"""Logs in bags of ROS 1 and 2: the made hall's scans and poses come back, whatever the format and the sensor."""

import json
import logging

import numpy as np
import pytest

from robosim.cli import main
from robosim.logs.bag import is_bag, read_bag
from robosim.logs.log_files import read_log
from robosim.logs.robot_log import BagTopics
from robosim.support.reading import FileError
from slam.poses import compose, to_map

pytest.importorskip("rosbags")
from tests.robosim.logs.made_bags import (
    FORMATS,
    MOUNT,
    MOUNT_Z,
    header,
    laser_scan,
    message,
    odometry,
    placed,
    transform,
    write_bag,
)
from tests.robosim.logs.rounds import (
    BEARING,
    LASER,
    POSES,
    RANGES,
    STEPS,
    TIMES,
    assert_hall,
    hall_ranges,
    recording,
)


@pytest.mark.parametrize("kind", FORMATS)
def test_read_log_gives_scans_and_the_motion_of_the_base_of_each_format(kind, tmp_path):
    path = write_bag(tmp_path / "run", kind, recording(kind == "ros1"))
    assert is_bag(path)
    log = read_log(path)
    assert log.name == "run"
    assert log.bearing_rad == pytest.approx(BEARING, abs=1e-6)
    assert log.mount == pytest.approx(MOUNT)
    assert_hall(log)


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_a_file_of_a_ros2_bag_is_a_bag_too(kind, tmp_path):
    path = write_bag(tmp_path / "run", kind, recording())
    file = next(one for one in path.iterdir() if one.suffix in (".db3", ".mcap"))
    assert is_bag(file)
    assert_hall(read_log(file))


def test_transforms_that_change_are_odometry(tmp_path):
    rows = [row for row in recording() if row[0] != "/odom"]
    rows += [
        ("/tf", t, transform(t, "odom", "base_link", placed(pose)))
        for t, pose in zip(TIMES, POSES, strict=True)
    ]
    assert_hall(read_bag(write_bag(tmp_path / "run", "mcap", rows)))


def test_a_laser_that_hangs_upside_down_is_mirrored(tmp_path):
    pose = np.array([MOUNT[0], MOUNT[1], 0.0])
    rows = [
        ("/tf_static", 0.0, transform(0.0, "base_link", "laser", placed(pose, MOUNT_Z, inverted=True))),
        *(("/odom", t, odometry(t, one)) for t, one in zip(TIMES, POSES, strict=True)),
    ]
    for t, one in zip(TIMES, POSES, strict=True):
        seen = hall_ranges(compose(one, pose), -BEARING)
        rows.append(("/scan", t, laser_scan(t, BEARING, seen)))
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    direct = np.array([hall_ranges(compose(one, pose), log.beams()[k]) for k, one in enumerate(POSES)])
    assert log.range_m == pytest.approx(direct, abs=1e-5)
    assert (np.diff(log.beams(), axis=1) > 0).all()


def test_reversed_scans_turn_round_with_their_times(tmp_path):
    rows = [row for row in recording(scans=False)]
    for t, ranges in zip(TIMES, RANGES, strict=True):
        rows.append(("/scan", t, laser_scan(t, BEARING[::-1], ranges[::-1], step_s=1e-3)))
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert_hall(log)
    assert log.beam_s is not None
    assert log.beam_s[0] == pytest.approx(0.359)
    assert log.beam_s[-1] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("turn", [1, -1])
def test_beams_of_each_scan_have_times_of_their_own(turn, tmp_path):
    """Drivers send fewer beams of some scans, and leave times out of some."""
    rows = [row for row in recording(scans=False)]
    for k, (t, ranges) in enumerate(zip(TIMES, RANGES, strict=True)):
        n, step_s = (40, 360, 180)[k % 3], 1e-3 if k != 4 else 0.0
        rows.append(("/scan", t, laser_scan(t, BEARING[::turn][:n], ranges[::turn][:n], step_s=step_s)))
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert log.beam_s is not None
    for k, late_s in enumerate(log.beam_s):
        n = (40, 360, 180)[k % 3]
        expected = np.arange(n)[::turn] * (1e-3 if k != 4 else 0.0)
        assert late_s[:n] == pytest.approx(expected, abs=1e-6)


def test_ranges_are_missing_or_hit_nothing_as_the_standard_says(tmp_path):
    rows, ranges = recording(scans=False), RANGES.copy()
    ranges[:, :4] = np.nan, np.inf, 0.02, 31.0
    for t, one in zip(TIMES, ranges, strict=True):
        rows.append(("/scan", t, laser_scan(t, BEARING, one)))
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert np.isnan(log.range_m[:, [0, 2]]).all()
    assert (log.range_m[:, [1, 3]] == np.inf).all()


def test_of_several_echoes_the_first_counts(tmp_path):
    rows = recording(scans=False)
    for t, ranges in zip(TIMES, RANGES, strict=True):
        plain = laser_scan(t, BEARING, ranges)
        echoes = [
            message("sensor_msgs/msg/LaserEcho", echoes=np.array([r, r + 1] if k else [], np.float32))
            for k, r in enumerate(ranges)
        ]
        values = {name: getattr(plain, name) for name in plain.__dataclass_fields__ if name != "__msgtype__"}
        many = message(
            "sensor_msgs/msg/MultiEchoLaserScan", **{**values, "ranges": echoes, "intensities": []}
        )
        rows.append(("/echoes", t, many))
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert np.isnan(log.range_m[:, 0]).all()
    assert log.range_m[:, 1:] == pytest.approx(RANGES[:, 1:], abs=1e-5)


def cloud(time_s, points):
    """A PointCloud2 with padding, and a field before x."""

    def field(name, offset):
        return message("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=7, count=1)

    data = np.zeros((len(points), 6), np.float32)
    data[:, 1:4] = points
    return message(
        "sensor_msgs/msg/PointCloud2",
        header=header(time_s, "laser", False),
        height=1,
        width=len(points),
        fields=[field("intensity", 0), field("x", 4), field("y", 8), field("z", 12)],
        is_bigendian=False,
        point_step=24,
        row_step=24 * len(points),
        data=data.view(np.uint8).ravel(),
        is_dense=True,
    )


def test_point_clouds_become_scans_of_a_slice(tmp_path):
    rows, bearing = recording(scans=False), np.radians(np.arange(-180, 180, 0.25))
    for k, t in enumerate(TIMES):
        seen = hall_ranges(LASER[k], bearing)
        points = np.column_stack([seen * np.cos(bearing), seen * np.sin(bearing), np.full(len(seen), 0.05)])
        floor = np.column_stack([0.3 * np.cos(bearing), 0.3 * np.sin(bearing), np.full(len(seen), -MOUNT_Z)])
        none = np.array([[np.nan] * 3, [0.0] * 3])
        rows.append(("/points", t, cloud(t, np.concatenate([points, floor, none]))))
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert log.displacement[:, 2] == pytest.approx(STEPS[:, 2], abs=1e-5)
    assert np.nanmin(log.range_m) > 0.5
    # The slice has the axes of the base, and its origin at the sensor.
    expected = np.array(
        [hall_ranges([*LASER[k][:2], pose[2]], log.beams()[k]) for k, pose in enumerate(POSES)]
    )
    assert np.nanpercentile(np.abs(log.range_m - expected), 90) < 0.03


def test_read_bag_rejects_clouds_without_a_point_in_the_slice(tmp_path):
    rows = [*recording(scans=False), *(("/points", t, cloud(t, np.array([[2.0, 0.0, 5.0]]))) for t in TIMES)]
    with pytest.raises(FileError, match=r"none of the 28800 beams of /points hits anything, .* --slice-m"):
        read_bag(write_bag(tmp_path / "run", "mcap", rows))


WIDTH, HEIGHT, FOCAL = 64, 48, 55.0


def camera_info(scale=1, offset=(0, 0), **changes):
    """CameraInfo of a picture of so many times the size, of which images show the middle region from an offset on."""
    none = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    (x, y), focal = offset, scale * FOCAL
    centre = scale * (WIDTH - 1) / 2 + x, scale * (HEIGHT - 1) / 2 + y
    values = {
        "header": header(TIMES[0], "camera", False),
        "height": scale * HEIGHT,
        "width": scale * WIDTH,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": np.array([focal, 0, centre[0], 0, focal, centre[1], 0, 0, 1.0]),
        "r": np.eye(3).ravel(),
        "p": np.zeros(12),
        "binning_x": 0,
        "binning_y": 0,
        "roi": message("sensor_msgs/msg/RegionOfInterest", **none | changes.pop("region", {})),
    }
    return message("sensor_msgs/msg/CameraInfo", **values | changes)


def depth_recording(infos, name="image"):
    """The round with depth images of a camera that looks ahead, 0.4 m above the base: roll -90, yaw -90 degrees."""
    rows = [row for row in recording(scans=False) if row[0] != "/tf_static"]
    optical = message("geometry_msgs/msg/Quaternion", x=-0.5, y=0.5, z=-0.5, w=0.5)
    vector = message("geometry_msgs/msg/Vector3", x=0.1, y=0.0, z=0.4)
    rows.append(("/tf_static", 0.0, transform(0.0, "base_link", "camera", (vector, optical))))
    column = np.arctan2((WIDTH - 1) / 2 - np.arange(WIDTH), FOCAL)
    for k, t in enumerate(TIMES):
        seen = hall_ranges(compose(POSES[k], np.array([0.1, 0.0, 0.0])), column) * np.cos(column)
        depth = np.tile(np.round(1000 * seen).astype(np.uint16), (HEIGHT, 1))
        image = message(
            "sensor_msgs/msg/Image",
            header=header(t, "camera", False),
            height=HEIGHT,
            width=WIDTH,
            encoding="16UC1",
            is_bigendian=0,
            step=2 * WIDTH,
            data=depth.view(np.uint8).ravel(),
        )
        rows.append((f"/camera/depth/{name}", t, image))
    return rows + [(f"/camera/{name}/camera_info", TIMES[0], info) for name, info in infos.items()]


REGION = {"x_offset": 40, "y_offset": 30, "height": HEIGHT, "width": WIDTH}


@pytest.mark.parametrize(
    "infos",
    [
        {"depth": camera_info()},
        {"depth": camera_info(scale=2, binning_x=2, binning_y=2)},
        {"depth": camera_info(offset=(40, 30), height=96, width=128, region=REGION)},
        {"depth": camera_info(), "colour": camera_info(scale=2)},
        {"depth": camera_info(height=0, width=0)},
    ],
)
def test_depth_images_become_scans_of_a_slice(infos, tmp_path):
    """Intrinsics are of the whole picture before binning, and of the image's namespace."""
    log = read_bag(write_bag(tmp_path / "run", "mcap", depth_recording(infos)))
    seen = np.isfinite(log.range_m)
    assert 60 < seen[0].sum() <= 120
    expected = np.array(
        [hall_ranges(compose(pose, np.array([0.1, 0, 0])), log.beams()[k]) for k, pose in enumerate(POSES)]
    )
    assert np.percentile(np.abs(log.range_m - expected)[seen], 90) < 0.02


@pytest.mark.parametrize(
    ("name", "changes", "is_noted"),
    [
        (
            "image_rect",
            {"p": camera_info().k.reshape(3, 3) @ np.eye(3, 4), "k": camera_info(scale=2).k},
            False,
        ),
        ("image_rect", {}, False),
        ("image_raw", {"p": camera_info(scale=2).k.reshape(3, 3) @ np.eye(3, 4)}, True),
        ("image_raw", {"d": np.array([0.1, 0, 0, 0, 0])}, True),
    ],
)
def test_rectified_depth_images_are_of_the_projection_matrix(name, changes, is_noted, tmp_path):
    """sensor_msgs/CameraInfo: K describes raw images, with distortion D, and P rectified ones."""
    report: dict = {}
    changes = {key: value.ravel() for key, value in changes.items()}
    rows = depth_recording({"depth": camera_info(**changes)}, name)
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows), report=report)
    seen = np.isfinite(log.range_m)
    expected = np.array(
        [hall_ranges(compose(pose, np.array([0.1, 0, 0])), log.beams()[k]) for k, pose in enumerate(POSES)]
    )
    assert 60 < seen[0].sum() <= 120
    assert np.percentile(np.abs(log.range_m - expected)[seen], 90) < 0.02
    assert any("distortion is not undone" in note for note in report["assumed"]) == is_noted


def test_read_bag_rejects_depth_images_of_another_size(tmp_path):
    rows = depth_recording({"depth": camera_info(scale=2)})
    with pytest.raises(
        FileError, match="depth image has 64 x 48 pixels, expected 128 x 96 by its CameraInfo"
    ):
        read_bag(write_bag(tmp_path / "run", "mcap", rows))
    rows = depth_recording({"depth": camera_info(width=WIDTH + 10)})
    for topic, _, one in rows:
        if topic == "/camera/depth/image":
            one.width += 10
    with pytest.raises(FileError, match="its rows have 128 bytes, expected 148 of 74 points or more"):
        read_bag(write_bag(tmp_path / "wide", "mcap", rows))


def test_scans_out_of_order_and_twice_are_sorted_and_reported(tmp_path, caplog):
    rows = recording()
    scans = [row for row in rows if row[0] == "/scan"]
    mixed = [*(row for row in rows if row[0] != "/scan"), *scans[1::-1], *scans[2:], scans[7]]
    mixed = [(topic, 200 + 0.01 * k, one) for k, (topic, _, one) in enumerate(mixed)]
    with caplog.at_level(logging.WARNING):
        assert_hall(read_bag(write_bag(tmp_path / "run", "mcap", mixed)))
    assert "2 scans come before an earlier one" in caplog.text
    assert "1 have the time of another" in caplog.text


def test_without_times_in_headers_those_of_the_recording_count(tmp_path):
    rows = []
    for topic, time_s, one in recording():
        if topic == "/tf_static":
            rows.append((topic, time_s, one))
            continue
        one.header.stamp.sec = one.header.stamp.nanosec = 0
        rows.append((topic, time_s - (0.01 if topic == "/scan" else 0.0), one))
    assert_hall(read_bag(write_bag(tmp_path / "run", "mcap", rows)))


def test_a_point_cloud_without_transforms_warns_of_its_height(tmp_path, caplog):
    rows = [("/points", t, cloud(t, np.array([[2.0, 0.0, 0.3], [1.0, 1.0, -0.2]]))) for t in TIMES]
    with caplog.at_level(logging.WARNING):
        log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert "--slice-m counts from the sensor" in caplog.text
    assert np.isfinite(log.range_m[0]).sum() == 1


def test_several_topics_are_listed_and_chosen(tmp_path):
    rows = recording()
    rows.append(("/rear", TIMES[0], laser_scan(TIMES[0], BEARING, RANGES[0])))
    path = write_bag(tmp_path / "run", "mcap", rows)
    with pytest.raises(FileError, match=r"2 topics of scans: /rear, /scan\. Choose one by --scan-topic"):
        read_bag(path)
    assert_hall(read_bag(path, BagTopics(scan_topic="/scan")))
    with pytest.raises(FileError, match="'/front' is no topic of scans"):
        read_bag(path, BagTopics(scan_topic="/front"))


def test_bags_without_scans_name_their_topics(tmp_path):
    path = write_bag(tmp_path / "run", "mcap", recording(scans=False))
    with pytest.raises(FileError, match="its topics are /odom"):
        read_bag(path)


def test_without_odometry_scans_alone_give_the_motion(tmp_path, caplog):
    path = write_bag(tmp_path / "run", "mcap", recording(has_odometry=False))
    with caplog.at_level(logging.WARNING):
        log = read_bag(path)
    assert not log.known[1:].any()
    assert "scans alone" in caplog.text


def test_the_motion_before_odometry_begins_is_unknown(tmp_path):
    rows = [row for row in recording() if row[0] != "/odom" or row[1] >= TIMES[3]]
    log = read_bag(write_bag(tmp_path / "run", "mcap", rows))
    assert log.known.tolist() == [True, False, False, False, *[True] * (len(TIMES) - 4)]
    assert (log.displacement[1:4] == 0).all()
    assert log.displacement[4:] == pytest.approx(STEPS[4:], abs=1e-5)


def test_a_tipped_laser_is_rejected(tmp_path):
    tipped = message("geometry_msgs/msg/Quaternion", x=0.0, y=0.5, z=0.0, w=0.866)
    vector = message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.3)
    rows = [row for row in recording() if row[0] != "/tf_static"]
    rows.append(("/tf_static", 0.0, transform(0.0, "base_link", "laser", (vector, tipped))))
    with pytest.raises(FileError, match="tipped by 60 degrees"):
        read_bag(write_bag(tmp_path / "run", "mcap", rows))


def test_the_command_maps_a_bag(tmp_path):
    path = write_bag(tmp_path / "run", "mcap", recording())
    main(["slam", str(path), "--out", str(tmp_path / "out")])
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["scans"] == len(TIMES)
    poses = np.loadtxt(tmp_path / "out" / "trajectory.tum")[:, 1:3]
    assert to_map(POSES[0], poses) == pytest.approx(POSES[:, :2], abs=0.03)
