"""Robots from URDF and MJCF: what is told is read, what is no differential drive is rejected."""

from pathlib import Path

import numpy as np
import pytest

from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.robot_files import read_robot, write_robot
from robosim_support.reading import FileError
from slam.poses import between

_WHEEL = """
<joint name="{side}_joint" type="continuous"><parent link="base"/><child link="{side}"/>
  <origin xyz="{x} {y} 0.04" rpy="-1.570796 0 0"/><axis xyz="0 0 {axis}"/></joint>
<link name="{side}"><collision><geometry><cylinder length="0.02" radius="0.05"/></geometry></collision>
  <inertial><mass value="0.2"/><inertia ixx="1e-4" iyy="1e-4" izz="2.5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
URDF = """<?xml version="1.0"?>
<!-- ${a comment} -->
<robot name="cart">
<link name="footprint"/>
<joint name="up" type="fixed"><parent link="footprint"/><child link="base"/><origin xyz="0 0 0.01"/></joint>
<link name="base"><visual><geometry><mesh filename="package://cart/body.stl"/></geometry></visual>
  <collision><origin xyz="0.1 0 0.1"/><geometry><box size="0.4 0.2 0.1"/></geometry></collision>
  <inertial><origin xyz="0.05 0 0.1"/><mass value="3"/>
    <inertia ixx="0.02" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
WHEELS
<joint name="scan_joint" type="fixed"><parent link="base"/><child link="base_scan"/>
  <origin xyz="0.2 0 0.24"/></joint><link name="base_scan"/>
<joint name="camera_joint" type="fixed"><parent link="base"/><child link="camera_link"/>
  <origin xyz="0.28 0 0.14"/></joint><link name="camera_link"/>
</robot>"""
TWO = _WHEEL.format(side="left", x=0, y=0.15, axis=1) + _WHEEL.format(side="right", x=0, y=-0.15, axis=-1)
MJCF = """<mujoco model="disk"><worldbody><geom type="plane" size="5 5 .1"/>
<body name="base" pos="1 2 0.05"><freejoint/>
  <geom type="cylinder" size="0.2 0.03" mass="4"/>
  <camera name="eye" pos="0.1 0 0.3" fovy="75" xyaxes="0 -1 0 0 0 1"/>
  <body name="l" pos="0 0.15 -0.02"><joint name="l" axis="0 -1 0" damping="0.01"/>
    <geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.1"/></body>
  <body name="r" pos="0 -0.15 -0.02"><joint name="r" axis="0 -1 0" damping="0.01"/>
    <geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.1"/></body>
  <body name="caster" pos="0.15 0 -0.04"><joint axis="0 0 1"/><geom type="sphere" size="0.01" mass="0.02"/></body>
</body></worldbody>
<actuator><velocity joint="l"/><velocity joint="r"/></actuator><sensor><jointvel joint="l"/></sensor>
<keyframe><key qpos="0 0 .06 1 0 0 0 0 0 0"/></keyframe></mujoco>"""


def _write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_a_urdf_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = read_robot(_write(tmp_path, "cart.urdf", URDF.replace("WHEELS", TWO)))
    assert robot.wheel_radius_m == pytest.approx(0.05, rel=1e-4) and robot.track_m == pytest.approx(0.3)
    assert robot.mass_kg == pytest.approx(3.0)
    # The box, and wheels 2 cm thick beside it.
    corners = np.array(robot.outline_m)
    np.testing.assert_allclose(corners.min(axis=0), [-0.1, -0.16], atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), [0.3, 0.16], atol=1e-6)
    assert robot.radius_m == pytest.approx(0.16) and robot.mast_m == pytest.approx(0.16)
    assert robot.sensors is not None and robot.sensors.camera_m is not None
    assert robot.sensors.lidar_m == pytest.approx((0.2, 0.25)) and robot.sensors.camera_m == pytest.approx(
        (0.28, 0.15)
    )
    assert (
        "does not tell speeds" in caplog.text and "field of view" in caplog.text and "--lidar" in caplog.text
    )


@pytest.mark.parametrize(("name", "text"), [("cart.urdf", URDF.replace("WHEELS", TWO)), ("disk.xml", MJCF)])
def test_mujoco_drives_the_model_itself(tmp_path: Path, name: str, text: str) -> None:
    robot = read_robot(_write(tmp_path, name, text))
    world = World(open_floor(), robot=robot)
    mass = sum(
        world.model.body(k).mass[0] for k in range(world.model.nbody) if "model/" in world.model.body(k).name
    )
    assert mass == pytest.approx(3.4 if name == "cart.urdf" else 4.22)
    start = np.array([2.0, 2.0, 0.3])
    for wanted in ((0.5, 0.0, 0.0), (0.0, 0.0, 1.0), (-0.25, 0.0, 0.0), (0.0, 0.0, -0.175)):
        world.reset(start)
        assert not world.move(np.array(wanted)).collided
        np.testing.assert_allclose(between(start, world.pose), wanted, atol=1e-3)


def test_a_disk_in_mjcf_stays_a_disk(tmp_path: Path) -> None:
    robot = read_robot(_write(tmp_path, "disk.xml", MJCF))
    assert robot.outline_m == () and robot.radius_m == pytest.approx(0.2, rel=0.01)
    assert robot.sensors is not None and robot.sensors.camera_m == pytest.approx((0.1, 0.35))
    assert robot.sensors.hfov_deg == 75.0 and robot.sensors.lidar == "none"


def test_four_wheels_turn_on_an_axle_between(tmp_path: Path) -> None:
    four = "".join(
        _WHEEL.format(side=f"{end}_{side}", x=x, y=y, axis=1)
        for end, x in (("front", 0.2), ("rear", 0.0))
        for side, y in (("left", 0.15), ("right", -0.15))
    )
    robot = read_robot(_write(tmp_path, "four.urdf", URDF.replace("WHEELS", four)))
    assert robot.model is None and robot.track_m == pytest.approx(0.3)
    np.testing.assert_allclose(
        np.array(robot.outline_m)[:, 0].max(), 0.2, atol=1e-3
    )  # 0.3 m, of an axle at 0.1 m


def test_a_robot_that_was_read_is_written_and_read(tmp_path: Path) -> None:
    robot = read_robot(_write(tmp_path, "cart.urdf", URDF.replace("WHEELS", TWO)))
    write_robot(tmp_path / "robot.json", robot)
    assert read_robot(tmp_path / "robot.json") == robot


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (URDF.replace("WHEELS", ""), "expected as many on the left as on the right"),
        (URDF.replace("WHEELS", _WHEEL.format(side="left", x=0, y=0.15, axis=1)), "left_joint at y = 0.15 m"),
        (URDF.replace("WHEELS", TWO.replace("0.02", "${width}")), "expand it with the program xacro first"),
        (URDF.replace("WHEELS", TWO).replace("collision>", "visual>"), "nothing of it collides"),
        (URDF[:300], "not readable as a robot"),
        ("<mujoco/>", "nothing of it collides"),
    ],
)
def test_what_is_no_differential_drive_is_an_error(tmp_path: Path, text: str, reason: str) -> None:
    path = _write(tmp_path, "robot.urdf", text)
    with pytest.raises(FileError, match=reason) as error:
        read_robot(path)
    assert "robot.urdf" in str(error.value) and "\n" not in str(error.value)
