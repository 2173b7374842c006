"""Bags that are cut off, damaged, impossible or too large, and odometry that cannot be."""

import bz2
import os
import re
import struct

import numpy as np
import pytest

from robosim.logs.bag import is_bag, read_bag
from robosim.logs.log_files import read_log
from robosim.logs.robot_log import BagTopics
from robosim.support.reading import FileError

pytest.importorskip("rosbags")
from rosbags.rosbag1 import Writer as Writer1

from tests.robosim.logs.made_bags import (
    FORMATS,
    STORE1,
    odometry,
    placed,
    transform,
)
from tests.robosim.logs.rounds import (
    POSES,
    RANGES,
    STEPS,
    TIMES,
    assert_hall,
    moving,
    recording,
    write_round,
)
from tests.robosim.logs.test_bag_dialects import by_transforms, record


def file_of(path):
    """The file with the messages of a bag."""
    return path if path.is_file() else next(one for one in path.iterdir() if one.suffix in (".db3", ".mcap"))


@pytest.mark.parametrize("share", [0.4, 0.8, 0.97])
@pytest.mark.parametrize("kind", FORMATS)
def test_read_bag_reads_what_a_cut_bag_holds(kind, share, tmp_path, caplog):
    file = file_of(write_round(tmp_path / "run", recording(kind == "ros1"), kind))
    cut = tmp_path / f"cut{file.suffix}"
    cut.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    log = read_log(cut)
    count = len(log.times)
    assert 0.5 * share * len(TIMES) <= count <= len(TIMES)
    assert np.allclose(log.displacement[log.known], STEPS[:count][log.known], atol=1e-5)
    whole = np.isfinite(log.range_m).all(axis=1)
    assert whole[:-1].all() and np.allclose(log.range_m[whole], RANGES[:count][whole], atol=1e-5)
    lost = re.search(r"(\d+) messages are read, about (\d+) are lost", caplog.text)
    if lost is None:  # only the index at the end is cut off
        assert count == len(TIMES) and share > 0.9
    else:
        assert sum(map(int, lost.groups())) == pytest.approx(81, rel=0.5)


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_read_bag_counts_the_messages_that_the_metadata_names(kind, tmp_path, caplog):
    path = write_round(tmp_path / "run", recording(), kind)
    file = file_of(path)
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    read_log(path)
    read, lost = re.search(r"(\d+) messages are read, (\d+) are lost", caplog.text).groups()
    assert int(read) + int(lost) == 81 and int(lost) > 10


@pytest.mark.parametrize("kind", ["sqlite", "mcap"])
def test_read_bag_needs_no_metadata(kind, tmp_path, caplog):
    path = write_round(tmp_path / "run", recording(), kind)
    (path / "metadata.yaml").unlink()
    assert is_bag(path)
    assert_hall(read_log(path))
    assert "lost" not in caplog.text


def test_read_bag_skips_a_damaged_chunk(tmp_path, caplog):
    """The second of four chunks; the index states how many messages are lost."""
    path = tmp_path / "run.bag"
    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat.BZ2)
    writer.chunk_threshold = 50_000
    with writer:
        to = {}
        for topic, time_s, one in sorted(recording(True), key=lambda row: row[1]):
            if topic not in to:
                to[topic] = writer.add_connection(topic, one.__msgtype__, typestore=STORE1)
            writer.write(to[topic], round(1e9 * time_s), STORE1.serialize_ros1(one, one.__msgtype__))
    content = bytearray(path.read_bytes())
    starts = [match.start() for match in re.finditer(b"BZh9", bytes(content))]
    content[starts[1] : starts[1] + 4] = b"\0\0\0\0"
    path.write_bytes(content)
    log = read_log(path)
    read, lost = map(int, re.search(r"(\d+) messages are read, (\d+) are lost", caplog.text).groups())
    assert read + lost == 81 and lost > 5
    rest = np.searchsorted(TIMES, log.times)
    assert len(rest) < len(TIMES) and np.allclose(log.range_m, RANGES[rest], atol=1e-5)


def test_read_bag_limits_what_chunks_unpack_to(tmp_path):
    packed = bz2.compress(bytes(1 << 20))
    chunk = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", 1 << 31)}
    path = tmp_path / "bomb.bag"
    head = b"#ROSBAG V2.0\n" + record({b"op": b"\x03", b"index_pos": bytes(8)}, b" ")
    path.write_bytes(head + record(chunk, packed))
    with pytest.raises(FileError, match=r"unpacks to 2147483648 bytes or more, .*Unpack it first"):
        read_bag(path)
    chunk[b"size"] = struct.pack("<I", 1 << 20)
    path.write_bytes(head + 2100 * record(chunk, packed))
    with pytest.raises(FileError, match=r"unpacks to \d+ bytes or more, .*Unpack it first"):
        read_bag(path)
    chunk[b"size"] = struct.pack("<I", 1000)  # less than it has
    path.write_bytes(head + record(chunk, packed))
    with pytest.raises(FileError, match="more than it declares"):
        read_bag(path)


@pytest.mark.parametrize("name", ["run.bag", "run.db3", "run.mcap", "run.log", "folder/run_0.db3"])
def test_read_log_rejects_named_pipes(name, tmp_path):
    pipe = tmp_path / name
    pipe.parent.mkdir(exist_ok=True)
    os.mkfifo(pipe)
    for path in {pipe, pipe if pipe.parent == tmp_path else pipe.parent}:
        with pytest.raises(FileError, match="a named pipe"):
            read_log(path)


def with_odometry(change):
    """The round with a change of the odometry of one message."""
    rows = recording()
    pose = [one for topic, _, one in rows if topic == "/odom"][20].pose.pose
    change(pose)
    return rows


def set_all(target, **values):
    for name, value in values.items():
        setattr(target, name, value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda pose: set_all(pose.position, x=np.nan),
            r"/odom is \(nan, .* at 110\.000000 s, expected numbers",
        ),
        (lambda pose: set_all(pose.position, y=-np.inf), r"/odom is \(.*-inf"),
        (
            lambda pose: set_all(pose.position, y=1e16),
            r"/odom is \(.*1e\+16.*expected numbers within 1e\+08 m",
        ),
        (lambda pose: set_all(pose.orientation, w=np.nan), "expected a quaternion of length 1"),
        (lambda pose: set_all(pose.orientation, w=7.0), "expected a quaternion of length 1"),
        (lambda pose: set_all(pose.orientation, z=0.0, w=0.0), "expected a quaternion of length 1"),
        (lambda pose: set_all(pose.orientation, x=1.0, z=0.0, w=0.0), "tips base_link by 180 degrees at 110"),
    ],
)
def test_read_bag_rejects_impossible_odometry(change, message, tmp_path):
    path = write_round(tmp_path / "run", with_odometry(change))
    with pytest.raises(FileError, match=message):
        read_bag(path)
    assert not read_bag(path, BagTopics(odometry_topic="none")).known[1:].any()


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e16])
@pytest.mark.parametrize("child", ["base_link", "laser"])
def test_read_bag_rejects_impossible_transforms_of_its_chain_only(value, child, tmp_path):
    rows = by_transforms()
    broken = transform(100.0, "base_link", "gripper", placed([value, 0, 0]))
    assert_hall(read_bag(write_round(tmp_path / "other", [*rows, ("/tf", 100.0, broken)])))
    for _, _, one in rows:
        transforms = getattr(one, "transforms", [])
        if transforms and transforms[0].child_frame_id == child:
            transforms[0].transform.translation.x = value
    with pytest.raises(FileError, match=f"the transform from .* to {child} is"):
        read_bag(write_round(tmp_path / "run", rows))


@pytest.mark.parametrize(
    ("places", "rate", "expected"),
    [
        (100.0, 1, "laser is 100 m from base_link"),
        (0.2, 1000, r"/scan lasts 1\.95e\+04 s by its headers, but 19\.5 s"),
    ],
)
def test_read_bag_states_sensors_far_away_and_times_in_milliseconds(places, rate, expected, tmp_path, caplog):
    rows = [
        ("/tf_static", 100.0, transform(0.0, "base_link", "laser", placed([places, 0, 0]))),
        *recording()[1:],
    ]
    for stamp in (one.header.stamp for topic, _, one in rows if topic != "/tf_static"):
        time_ns = rate * (10**9 * stamp.sec + stamp.nanosec)
        stamp.sec, stamp.nanosec = divmod(time_ns, 10**9)
    read_bag(write_round(tmp_path / "run", rows))
    assert re.search(expected, caplog.text)


@pytest.mark.parametrize("offset_s", [3 * 86400.0, -5.0])
@pytest.mark.parametrize("is_topic", [True, False])
def test_read_bag_leaves_odometry_of_another_clock_away(offset_s, is_topic, tmp_path, caplog):
    rows = recording() if is_topic else by_transforms()
    for topic, _, one in rows:
        if topic == "/scan":
            one.header.stamp.sec += int(offset_s)
    log = read_bag(write_round(tmp_path / "run", rows))
    assert not log.known[1:].any() and (log.displacement == 0).all()
    assert "another clock" in caplog.text
    assert (
        f"scans are from {100 + offset_s:.3f} to {119.5 + offset_s:.3f} s, odometry from 100.000"
        in caplog.text
    )


def test_read_bag_does_not_count_odometry_that_never_changes(tmp_path, caplog):
    rows = recording(has_odometry=False)
    rows += [("/odom", t, odometry(t, np.zeros(3))) for t in TIMES]
    log = read_bag(write_round(tmp_path / "run", rows))
    assert not log.known[1:].any()
    assert "/odom never changes" in caplog.text
    rows += moving("odom", "base_link", POSES)
    assert_hall(read_bag(write_round(tmp_path / "both", rows)))


def test_read_bag_states_what_it_lacks(tmp_path, caplog):
    read_bag(write_round(tmp_path / "run", recording(has_odometry=False)))
    assert "no odometry of base_link is used (0 topics of odometry, 0 transforms that move)" in caplog.text
