"""Episodes as ROS 2 bags in MCAP: opened by rosbags and mcap, and mapped again by `robosim slam`."""

import json
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from robosim.cli import main
from robosim.episode_config import EpisodeConfig
from robosim.logs.bag import read_bag
from robosim.logs.log_mapping import map_log
from robosim.logs.robot_log import BagTopics, RobotLog
from robosim.recording.bag_export import BAG, LAYOUT, export_bag
from robosim.recording.episode_file import read_episode
from robosim.robot.robots import RobotConfig
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from slam.actions import Velocity
from slam.poses import between, compose, wrap
from tests.plans import two_rooms

pytest.importorskip("rosbags")
TOPICS = {
    "/arrivals", "/belief", "/camera/camera_info", "/camera/depth", "/camera/image", "/goal", "/link_state", "/map",
    "/odom", "/plan", "/scan", "/tf", "/tf_static", "/true_pose",
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An episode of `fused` with a lidar, and its bag."""
    place = tmp_path_factory.mktemp("episode")
    simulator = SimulatorConfig(physics="kinematic", camera="plan", robot=RobotConfig(lidar="rplidar-a1"))
    config = EpisodeConfig(
        goal="fused", simulator=simulator, mapper="classical", link_states="true", seed=2, max_steps=25
    )
    start, target = np.array([1.0, 1.0, 0.0]), np.array([5.5, 2.4])
    record_episode(two_rooms(0.8), config, place, start=start, target=target, video=False)
    export_bag(place)
    return place


@pytest.fixture(scope="module")
def messages(folder):
    """Messages of the bag by topic."""
    from rosbags.highlevel import AnyReader

    found = {}
    with AnyReader([folder / BAG]) as reader:
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found.setdefault(connection.topic, []).append((1e-9 * time_ns, message))
    return found


def yaw_of(quaternion):
    return 2 * np.arctan2(quaternion.z, quaternion.w)


def test_all_topics_are_in_the_bag(folder, messages):
    assert set(messages) == TOPICS
    times = np.loadtxt(folder / "trajectory.tum")[:, 0]
    assert [t for t, _ in messages["/odom"]] == pytest.approx(times[:-1], abs=1e-8)
    assert read_episode(folder).times == pytest.approx(times, abs=1e-8)
    assert json.loads((folder / LAYOUT).read_text())["layout"]


def test_late_subscribers_receive_fixed_transforms_and_the_map(folder):
    """Listeners of tf2 receive fixed transforms of publishers with transient durability only."""
    from rosbags.interfaces import QosDurability
    from rosbags.rosbag2 import Reader

    with Reader(folder / BAG) as reader:
        offered = {each.topic: each.ext.offered_qos_profiles for each in reader.connections}
    lasting = {topic for topic, qos in offered.items() if qos}
    assert lasting == {"/tf_static", "/map"}
    assert {offered[topic][0].durability for topic in lasting} == {QosDurability.TRANSIENT_LOCAL}


def test_mcap_opens_it(folder):
    reader = pytest.importorskip("mcap.reader")
    with (folder / BAG / f"{BAG}.mcap").open("rb") as file:
        summary = reader.make_reader(file).get_summary()
    assert {one.topic for one in summary.channels.values()} == TOPICS


def test_transforms_lead_from_the_map_to_the_estimated_and_the_true_robot(folder, messages):
    episode = read_episode(folder)
    by_child = {}
    for _, message in messages["/tf"]:
        one = message.transforms[0]
        at, turn = one.transform.translation, one.transform.rotation
        by_child.setdefault(one.child_frame_id, []).append(np.array([at.x, at.y, yaw_of(turn)]))
    for k, (correction, odometry) in enumerate(zip(by_child["odom"], by_child["base_link"], strict=True)):
        off = compose(correction, odometry) - episode.estimates[k]
        assert np.abs([off[0], off[1], wrap(off[2])]).max() < 1e-9
        assert by_child["base_link_true"][k][:2] == pytest.approx(episode.poses[k][:2], abs=1e-12)


def test_velocities_of_odometry_lead_from_one_pose_to_the_next(messages):
    """nav_msgs/Odometry: the twist is in the child frame; a constant one moves by its matrix exponential."""
    times, odometry = zip(*messages["/odom"], strict=True)
    poses = [
        np.array([each.pose.pose.position.x, each.pose.pose.position.y, yaw_of(each.pose.pose.orientation)])
        for each in odometry
    ]
    for k, each in enumerate(odometry):
        linear, w = each.twist.twist.linear, each.twist.twist.angular.z
        rates = np.array([[0, -w, linear.x], [w, 0, linear.y], [0, 0, 0]])
        end = expm(rates * (times[k] - times[k - 1] if k else 1.0))
        displacements = between(poses[max(k - 1, 0)], poses[k])
        assert [*end[:2, 2], np.arctan2(end[1, 0], end[0, 0])] == pytest.approx(displacements, abs=1e-6)
    assert max(abs(each.twist.twist.linear.x) for each in odometry) > 0.1


def test_map_and_pictures_are_those_of_the_episode(folder, messages):
    steps = list(read_episode(folder).steps())
    last = messages["/map"][-1][1]
    cells = last.data.reshape(last.info.height, last.info.width)
    values = steps[-1].map_layer.values
    assert ((cells == 100) == ((values == 2) | (values == 3))).all()
    assert ((cells == 0) == (values == 1)).all()
    picture, depth = messages["/camera/image"][3][1], messages["/camera/depth"][3][1]
    assert (picture.data.reshape(128, 128, 3) == steps[3].sensed.rgb).all()
    assert depth.data.view("<u2").reshape(128, 128) == pytest.approx(1000 * steps[3].sensed.depth, abs=0.01)
    assert messages["/link_state"][0][1].data == steps[0].estimated.measurement.state.name.lower()


def test_arrows_of_paths_have_their_direction_additional_length_and_strength(folder, messages):
    """From the robot, where the strongest path is opaque and 30 dB less are as faint as it gets."""
    steps = list(read_episode(folder).steps())
    several = max(range(len(steps)), key=lambda k: len(steps[k].estimated.measurement.aoa_rad))
    measured, arrows = steps[several].estimated.measurement, messages["/arrivals"][several][1].markers
    assert arrows[0].action == 3 and len(arrows) == 1 + len(measured.aoa_rad) > 2
    assert [arrow.scale.x - 0.6 for arrow in arrows[1:]] == pytest.approx(
        299792458.0 * (measured.delay_s - measured.delay_s.min()), abs=1e-6
    )
    strength = [arrow.color.a for arrow in arrows[1:]]
    assert strength[0] == 1.0 and np.all(np.diff(strength) <= 0) and min(strength) >= 0.2
    for arrow, azimuth in zip(arrows[1:], measured.aoa_rad, strict=True):
        assert wrap(yaw_of(arrow.pose.orientation) - azimuth) == pytest.approx(0, abs=1e-9)
        assert (arrow.pose.position.x, arrow.pose.position.y) == tuple(measured.pose[:2])


def test_velocities_are_recorded_and_in_the_bag(tmp_path):
    """Of each step, as the robot moved, and in the bag at its time. It arrives, at times at full speed."""
    from rosbags.highlevel import AnyReader

    simulator = SimulatorConfig(physics="kinematic", camera="plan")
    options = {"goal": "oracle", "controller": "velocity", "mapper": "classical", "seed": 2, "max_steps": 40}
    start, target = np.array([1.0, 1.0, 0.0]), np.array([5.5, 2.4])
    config = EpisodeConfig(simulator=simulator, **options)
    result = record_episode(two_rooms(0.8), config, tmp_path, start=start, target=target, video=False)
    assert result["arrived"] and result["simulated_s"] == pytest.approx(0.5 * result["steps"])
    episode = read_episode(tmp_path)
    seen = [step.decided.command for step in episode.steps()]
    assert all(isinstance(one, Velocity) for one in seen) and max(one.v_mps for one in seen) == 0.5
    for (v, w, s), before, after in zip(seen, episode.poses, episode.poses[1:], strict=False):
        assert wrap(after[2] - before[2] - w * s) == pytest.approx(0, abs=1e-9)
        assert np.hypot(*(after - before)[:2]) <= v * s + 1e-9
    with AnyReader([export_bag(tmp_path)]) as reader:
        chosen = [one for one in reader.connections if one.topic == "/cmd_vel"]
        found = [(1e-9 * t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages(chosen)]
    assert [(one.twist.linear.x, one.twist.angular.z) for _, one in found] == [one[:2] for one in seen]
    assert [time_s for time_s, _ in found] == pytest.approx(episode.times[:-1])


def direct_log(folder):
    """The log of the lidar without a bag, with ranges in single precision as in ROS."""
    episode = read_episode(folder)
    scans = [step.sensed.laser for step in episode.steps()]
    odometry = list(accumulate(episode.columns["odometry"][1:], compose, initial=np.zeros(3)))[: len(scans)]
    return RobotLog(
        name="direct",
        bearing_rad=scans[0].bearing_rad,
        range_m=np.array([scan.range_m for scan in scans]).astype(np.float32).astype(float),
        displacement=np.array([np.zeros(3), *(between(a, b) for a, b in pairwise(odometry))]),
        known=np.ones(len(scans), bool),
        times=np.loadtxt(folder / "trajectory.tum")[: len(scans), 0],
    )


def test_the_bag_maps_like_the_log_that_it_was_made_of(folder):
    log, direct = read_bag(folder / BAG), direct_log(folder)
    assert log.bearing_rad == pytest.approx(direct.bearing_rad, abs=1e-6)
    assert log.range_m == pytest.approx(direct.range_m, abs=1e-6)
    assert log.displacement == pytest.approx(direct.displacement, abs=1e-9)
    # Bearings in ROS are of single precision.
    direct = replace(direct, bearing_rad=log.bearing_rad)
    assert map_log(log).poses == pytest.approx(map_log(direct).poses, abs=1e-6)


def test_depth_images_of_the_bag_make_scans_too(folder):
    depth = read_bag(folder / BAG, BagTopics(scan_topic="/camera/depth", slice_m=0.8))
    scans = read_bag(folder / BAG)
    assert len(depth.times) == len(scans.times)
    near = np.isfinite(depth.range_m[0])
    assert near.sum() > 100
    seen = np.interp(depth.beams()[0][near], scans.beams()[0], scans.range_m[0])
    assert np.median(np.abs(depth.range_m[0][near] - seen)) < 0.05


def test_without_a_lidar_the_depth_images_are_mapped(folder, tmp_path):
    from rosbags.highlevel import AnyReader
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    copy = tmp_path / "copy"
    with (
        AnyReader([folder / BAG]) as reader,
        Writer(copy, version=9, storage_plugin=StoragePlugin.MCAP) as writer,
    ):
        chosen = [one for one in reader.connections if one.topic != "/scan"]
        to = {one.topic: writer.add_connection(one.topic, one.msgtype, typestore=store) for one in chosen}
        for connection, time_ns, raw in reader.messages(chosen):
            writer.write(to[connection.topic], time_ns, raw)
    assert np.isfinite(read_bag(copy).range_m).sum() > 100


def test_the_command_writes_the_bag_again(folder, tmp_path, capsys):
    main(["export", str(folder), "--out", str(tmp_path / "out")])
    assert (tmp_path / "out" / BAG / "metadata.yaml").is_file()
    again = (tmp_path / "out" / BAG / f"{BAG}.mcap").read_bytes()
    assert again == (folder / BAG / f"{BAG}.mcap").read_bytes()
