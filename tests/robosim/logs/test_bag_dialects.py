"""Bags that say the same in other words: names of types, frames, order, versions of formats. The log is the same."""

import bz2
import struct

import numpy as np
import pytest

from robosim.logs.bag import read_bag
from robosim.logs.robot_log import BagTopics
from robosim.support.reading import FileError
from slam.poses import between, compose

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1

from tests.robosim.logs.made_bags import (
    FORMATS,
    MOUNT,
    STORE1,
    laser_scan,
    message,
    odometry,
    placed,
    transform,
)
from tests.robosim.logs.rounds import (
    BEARING,
    POSES,
    TIMES,
    assert_hall,
    assert_poses,
    hall_ranges,
    moving,
    recording,
    write_round,
)

IDENTITY = np.zeros(3)


def by_transforms(is_ros1=False):
    """The round with odometry as a transform."""
    return recording(is_ros1, has_odometry=False) + moving("odom", "base_link", POSES, is_ros1=is_ros1)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize(
    "names",
    [
        {"TFMessage": "tf/msg/tfMessage"},
        {"LaserScan": "laser_scan/msg/LaserScan", "Odometry": "my_msgs/msg/WheelPose"},
        {"LaserScan": "acme_driver/msg/Sweep", "TFMessage": "tf/msg/tfMessage"},
    ],
)
def test_read_bag_knows_types_by_their_fields(kind, names, tmp_path):
    is_ros1 = kind == "ros1"
    assert_hall(read_bag(write_round(tmp_path / "a", by_transforms(is_ros1), kind, names=names)))
    assert_hall(read_bag(write_round(tmp_path / "b", recording(is_ros1), kind, names=names)))


@pytest.mark.parametrize("compression", list(Writer1.CompressionFormat))
def test_read_bag_unpacks_chunks_of_ros1(compression, tmp_path):
    assert_hall(read_bag(write_round(tmp_path / "run", recording(True), "ros1", compression=compression)))


@pytest.mark.parametrize("seed", range(3))
def test_read_bag_is_independent_of_the_order_and_of_duplicates(seed, tmp_path):
    rng = np.random.default_rng(seed)
    rows = recording() if seed else by_transforms()
    rows += [rows[k] for k in rng.integers(1, len(rows), 20)]
    rows = [rows[k] for k in rng.permutation(len(rows))]
    rows = [(topic, 500 + 0.01 * k, one) for k, (topic, _, one) in enumerate(rows)]
    assert_hall(read_bag(write_round(tmp_path / "run", rows)))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("seed", range(2))
def test_read_bag_is_independent_of_the_dialect(seed, kind, tmp_path):
    """Slashes before names of frames, topics that are not read, order within a bag, and its compression."""
    rng, is_ros1 = np.random.default_rng(seed), kind == "ros1"
    rows = by_transforms(is_ros1) if seed else recording(is_ros1)
    for _, _, one in rows:
        for each in (one, *getattr(one, "transforms", ())):
            for owner, name in ((getattr(each, "header", each), "frame_id"), (each, "child_frame_id")):
                if hasattr(owner, name) and rng.random() < 0.5:
                    setattr(owner, name, f"/{getattr(owner, name)}")
    rows += [("/other", 0.0, message("std_msgs/msg/String", data="x", is_ros1=is_ros1))] * 9
    rows = [(rows[k][0], 500 + 0.01 * i, rows[k][2]) for i, k in enumerate(rng.permutation(len(rows)))]
    options = {"compression": list(Writer1.CompressionFormat)[seed - 2]} if is_ros1 else {}
    assert_hall(read_bag(write_round(tmp_path / "run", rows, kind, **options)))


def tilted(angle, axis=0):
    """A rotation about x or y."""
    turn = [0.0, 0.0, 0.0, np.cos(angle / 2)]
    turn[axis] = np.sin(angle / 2)
    return message("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0), message(
        "geometry_msgs/msg/Quaternion", *map(float, turn)
    )


def test_read_bag_composes_several_moving_transforms(tmp_path):
    rows = recording(has_odometry=False) + moving("odom", "base_footprint", POSES)
    times = np.arange(TIMES[0], TIMES[-1] + 0.1, 0.1)
    rows.append(
        ("/tf_static", 100.0, transform(0.0, "base_footprint", "base_stabilized", placed(IDENTITY, 0.1)))
    )
    for t in times:
        place = tilted(np.radians(0.5) * np.sin(7 * t), 1)
        rows.append(("/tf", t, transform(t, "base_stabilized", "base_link", place)))
    for frame in (None, "base_footprint", "base_stabilized"):
        log = read_bag(write_round(tmp_path / str(frame), rows), BagTopics(frame=frame))
        assert log.known.all()
        assert_poses(log.odometry(), [between(POSES[0], pose) for pose in POSES], atol=0.01)


def test_read_bag_joins_frames_that_meet_in_a_common_ancestor(tmp_path):
    """Of Create 3: base_footprint is below base_link, and odometry is that of base_footprint."""
    offset = np.array([0.1, 0.02, 0.2])
    rows = recording(has_odometry=False)
    rows.append(("/tf_static", 100.0, transform(0.0, "base_link", "base_footprint", placed(offset))))
    for t, pose in zip(TIMES, POSES, strict=True):
        rows.append(("/odom", t, odometry(t, compose(pose, offset), child="base_footprint")))
    assert_hall(read_bag(write_round(tmp_path / "run", rows)))
    log = read_bag(write_round(tmp_path / "foot", rows), BagTopics(frame="base_footprint"))
    expected = [between(compose(POSES[0], offset), compose(pose, offset)) for pose in POSES]
    assert_poses(log.odometry(), expected)
    assert np.allclose(log.mount, between(offset, MOUNT), atol=1e-6)


def test_read_bag_inverts_transforms(tmp_path):
    """The odometry frame is published as a child of the base, and the base as one of the laser."""
    rows = [row for row in recording(has_odometry=False) if row[0] == "/scan"]
    rows += moving("base_link", "odom", np.array([between(pose, IDENTITY) for pose in POSES]))
    rows.append(("/tf_static", 100.0, transform(0.0, "laser", "base_link", placed(between(MOUNT, IDENTITY)))))
    assert_hall(read_bag(write_round(tmp_path / "run", rows)))


def test_read_bag_prefers_odometry_to_the_map(tmp_path):
    """A mapper corrects map > odom; odometry is odom > base_link, also with prefixes of a robot's name."""
    drift = np.column_stack([0.1 * np.arange(40), 0.2 * np.arange(40), 0.01 * np.arange(40)])
    rows = [row for row in recording() if row[0] == "/scan"]
    for _, _, one in rows:
        one.header.frame_id = "r1/laser"
    rows.append(("/tf_static", 100.0, transform(0.0, "r1/base_link", "r1/laser", placed(MOUNT))))
    rows += moving("map", "r1/odom", drift) + moving("r1/odom", "r1/base_link", POSES)
    assert_hall(read_bag(write_round(tmp_path / "run", rows)))


@pytest.mark.parametrize("yaw", [0.0, np.pi])
def test_read_bag_gives_the_pose_of_the_base_or_of_a_frame(yaw, tmp_path):
    mount = np.array([0.3, 0.0, yaw])
    rows = [("/tf_static", 100.0, transform(0.0, "base_link", "laser", placed(mount)))]
    for t, pose in zip(TIMES, POSES, strict=True):
        rows.append(("/odom", t, odometry(t, pose)))
        rows.append(("/scan", t, laser_scan(t, BEARING, hall_ranges(compose(pose, mount), BEARING))))
    path = write_round(tmp_path / "run", rows)
    log, sensor = read_bag(path), read_bag(path, BagTopics(frame="laser"))
    assert_poses(log.odometry(), [between(POSES[0], pose) for pose in POSES])
    assert np.allclose(log.mount, mount)
    laser = [compose(pose, mount) for pose in POSES]
    assert_poses(sensor.odometry(), [between(laser[0], pose) for pose in laser])
    assert np.allclose(sensor.mount, 0)
    with pytest.raises(
        FileError, match="no transform leads from 'lidar' to base_link, expected one of base_link, laser"
    ):
        read_bag(path, BagTopics(frame="lidar"))


def test_read_bag_mirrors_a_laser_that_hangs_upside_down_in_its_own_frame(tmp_path):
    mount = np.array([0.2, 0.1, 0.0])
    rows = [("/tf_static", 100.0, transform(0.0, "base_link", "laser", placed(mount, inverted=True)))]
    for t, pose in zip(TIMES, POSES, strict=True):
        rows.append(("/odom", t, odometry(t, pose)))
        rows.append(("/scan", t, laser_scan(t, BEARING, hall_ranges(compose(pose, mount), -BEARING))))
    log = read_bag(write_round(tmp_path / "run", rows), BagTopics(frame="laser"))
    laser = [compose(pose, mount) for pose in POSES]
    assert_poses(log.odometry(), [between(laser[0], pose) for pose in laser])
    assert np.allclose(log.range_m[7], hall_ranges(laser[7], log.beams()[7]), atol=1e-5)


def test_read_bag_gives_only_the_own_trajectory_of_a_sensor_that_turns_on_the_robot(tmp_path):
    pan = np.column_stack([np.full(40, 0.2), np.zeros(40), 0.05 * np.arange(40)])
    rows = moving("odom", "base_link", POSES) + moving("base_link", "laser", pan)
    laser = [compose(pose, each) for pose, each in zip(POSES, pan, strict=True)]
    rows += [
        ("/scan", t, laser_scan(t, BEARING, hall_ranges(pose, BEARING)))
        for t, pose in zip(TIMES, laser, strict=True)
    ]
    path = write_round(tmp_path / "run", rows)
    with pytest.raises(
        FileError, match=r"laser moves on base_link by .* Give its own trajectory by --frame laser"
    ):
        read_bag(path)
    log = read_bag(path, BagTopics(frame="laser"))
    assert_poses(log.odometry(), [between(laser[0], pose) for pose in laser])


def record(header, data=b""):
    """A record of ROS 1."""
    fields = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value for name, value in header.items()
    )
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


def old_messages():
    """Name, type, definition, time and content of the messages of the round, with headers of before 2010."""
    for topic, time_s, one in by_transforms(True):
        kind = "tf/tfMessage" if "tf" in topic else "sensor_msgs/LaserScan"
        text, _ = STORE1.generate_msgdef(one.__msgtype__)
        text = text.replace("std_msgs/Header", "roslib/Header").replace(
            "std_msgs/msg/Header", "roslib/Header"
        )
        stamp = struct.pack("<II", int(time_s), round(1e9 * (time_s % 1)))
        yield (
            topic.encode(),
            kind.encode(),
            text.encode(),
            stamp,
            bytes(STORE1.serialize_ros1(one, one.__msgtype__)),
        )


def test_read_bag_of_version_12(tmp_path):
    content, known = b"#ROSBAG V1.2\n" + record({b"op": b"\x03", b"index_pos": bytes(8)}, b" " * 99), set()
    for topic, kind, text, stamp, data in old_messages():
        if topic not in known:
            header = {b"op": b"\x01", b"topic": topic, b"md5": b"0" * 32, b"type": kind, b"def": text}
            content += record(header)
            known.add(topic)
        header = {b"op": b"\x02", b"topic": topic, b"md5": b"0" * 32, b"type": kind}
        content += record({**header, b"sec": stamp[:4], b"nsec": stamp[4:]}, data)
    path = tmp_path / "old.bag"
    path.write_bytes(content)
    assert_hall(read_bag(path))
    path.write_bytes(content.replace(b"V1.2", b"V1.1"))
    with pytest.raises(FileError, match=r"version V1\.1, expected V1\.2 or V2\.0\. Convert it by rosbag fix"):
        read_bag(path)


@pytest.mark.parametrize("is_cut", [False, True])
def test_read_bag_with_an_index_of_another_form(is_cut, tmp_path):
    """Of 2010: entries of the index have 20 bytes, topics are named in each record."""
    inner, entries = b"", {}
    for topic, kind, text, stamp, data in old_messages():
        if topic not in entries:
            connection = {b"op": b"\x07", b"topic": topic, b"conn": struct.pack("<I", len(entries))}
            more = record({b"type": kind, b"md5sum": b"0" * 32, b"message_definition": text})[4:-4]
            inner += record(connection, more)
            entries[topic] = (struct.pack("<I", len(entries)), [])
        number, stamps = entries[topic]
        inner += record({b"op": b"\x02", b"conn": number, b"time": stamp}, data)
        stamps.append(stamp)
    chunk = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", len(inner))}
    body = record(chunk, bz2.compress(inner))
    index = b"".join(
        record(
            {
                b"op": b"\x04",
                b"ver": struct.pack("<I", 1),
                b"conn": number,
                b"count": struct.pack("<I", len(stamps)),
            },
            b"".join(stamp + bytes(12) for stamp in stamps),
        )
        for number, stamps in entries.values()
    )
    at = struct.pack("<Q", 0 if is_cut else 13 + len(body))
    head = {b"op": b"\x03", b"index_pos": at, b"conn_count": bytes(4), b"chunk_count": b"\x01\0\0\0"}
    path = tmp_path / "old.bag"
    path.write_bytes(b"#ROSBAG V2.0\n" + record(head, b" " * 99) + body + (b"" if is_cut else index))
    assert_hall(read_bag(path))


def test_read_bag_reads_the_transforms_of_the_robot_of_the_scans(tmp_path, caplog):
    """Two robots with the same frames publish transforms in namespaces of their own, as robots of Nav2 do."""
    rows = []
    for robot, poses, mount in (("r2", POSES[::-1], IDENTITY), ("r1", POSES, MOUNT)):
        rows.append((f"/{robot}/tf_static", 99.0, transform(0.0, "base_link", "laser", placed(mount))))
        rows += [(f"/{robot}/tf", t, one) for _, t, one in moving("odom", "base_link", poses)]
    rows += [(f"/r1{topic}", t, one) for topic, t, one in recording() if topic == "/scan"]
    log = read_bag(write_round(tmp_path / "run", rows))
    assert_hall(log)
    assert np.allclose(log.mount, MOUNT)
    assert "/r2/tf, /r2/tf_static do not count" in caplog.text


@pytest.mark.parametrize("robot", ["r1", "r2"])
def test_read_bag_warns_of_odometry_of_another_robot(robot, tmp_path, caplog):
    """Two robots below one map, as in the bag of a team."""
    rows = [row for row in recording() if row[0] == "/scan"]
    for _, _, scan in rows:
        scan.header.frame_id = "r1/laser"
    rows.append(("/tf_static", 100.0, transform(0.0, "r1/base_link", "r1/laser", placed(MOUNT))))
    for name, poses in (("r1", POSES), ("r2", POSES[::-1])):
        rows += moving("map", f"{name}/base_link", poses)
        rows += [
            (f"/{name}/odom", t, odometry(t, pose, child=f"{name}/base_link"))
            for t, pose in zip(TIMES, poses, strict=True)
        ]
    topics = BagTopics(odometry_topic=f"/{robot}/odom")
    assert_hall(read_bag(write_round(tmp_path / "run", rows), topics))
    assert ("/r2/odom is of r2/base_link, which moves by" in caplog.text) == (robot == "r2")


def test_read_bag_leaves_out_transforms_of_a_frame_to_itself(tmp_path):
    """They are left out by tf2 too."""
    rows = [("/tf_static", 98.0, transform(0.0, "laser", "laser", placed(IDENTITY))), *recording()]
    assert_hall(read_bag(write_round(tmp_path / "run", rows)))


@pytest.mark.parametrize(
    ("topic", "name", "frames"),
    [
        ("/scan", "frame_id", "laser, rear"),
        ("/odom", "frame_id", "odom > base_link, rear > base_link"),
        ("/odom", "child_frame_id", "odom > base_link, odom > rear"),
    ],
)
def test_read_bag_rejects_topics_of_several_frames(topic, name, frames, tmp_path):
    """Two lasers, or two frames of odometry, that publish in a topic have places of their own."""
    rows = recording()
    for owner in [content for each, _, content in rows if each == topic][::2]:
        setattr(owner if hasattr(owner, name) else owner.header, name, "rear")
    with pytest.raises(FileError, match=f"{topic} has messages of the frames {frames}, expected a single"):
        read_bag(write_round(tmp_path / "run", rows))


def test_read_bag_rejects_a_clock_that_was_reset(tmp_path):
    """A simulation that is started again repeats its times; a part of a bag that comes late is sorted."""
    rows = [row for row in recording() if row[0] != "/tf_static"]
    parts = [rows[:20], rows[60:], rows[20:60]]
    late = [
        (topic, 500 + k, content)
        for k, (topic, _, content) in enumerate(row for each in parts for row in each)
    ]
    mount = [row for row in recording() if row[0] == "/tf_static"]
    assert_hall(read_bag(write_round(tmp_path / "late", mount + late)))
    again = [(topic, 500 + t, one) for topic, t, one in recording() if topic == "/scan"]
    for _, _, one in again:
        one.header.stamp.nanosec += 1000
    with pytest.raises(
        FileError, match=r"the clock goes back from 119\.500 to 100\.000 s, and 39 scans of two runs"
    ):
        read_bag(write_round(tmp_path / "run", mount + rows + again))
