"""Robots from URDF and MJCF: what is stated is read, what is no differential drive is rejected."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from robosim.robot.calibration import open_floor
from robosim.robot.dynamic import World
from robosim.robot.model_file import model_of
from robosim.robot.robot_files import read_robot, write_robot
from robosim.support.reading import FileError
from slam.poses import between
from tests.made_robots import MJCF, TWO, URDF, WHEEL


def _write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_a_urdf_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    robot = read_robot(_write(tmp_path, "cart.urdf", URDF.replace("WHEELS", TWO)))
    assert robot.wheel_radius_m == pytest.approx(0.05, rel=1e-4) and robot.track_m == pytest.approx(0.3)
    assert robot.mass_kg == pytest.approx(3.0)
    # The box, and wheels 2 cm thick next to it.
    corners = np.array(robot.outline_m)
    np.testing.assert_allclose(corners.min(axis=0), [-0.1, -0.16], atol=1e-6)
    np.testing.assert_allclose(corners.max(axis=0), [0.3, 0.16], atol=1e-6)
    # The lidar is above the box.
    assert robot.hull.radius_m == pytest.approx(0.16) and robot.mast_m == pytest.approx(0.25)
    assert (robot.laser.ahead_m, robot.laser.height_m) == pytest.approx((0.2, 0.25))
    assert robot.camera is not None
    assert (robot.camera.ahead_m, robot.camera.height_m) == pytest.approx((0.28, 0.15))
    assert (
        "does not state speeds" in caplog.text and "field of view" in caplog.text and "--lidar" in caplog.text
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


@pytest.mark.parametrize("seed", range(3))
def test_model_of_sums_the_masses_that_a_file_states(tmp_path: Path, seed: int) -> None:
    base_kg, wheel_kg = np.random.default_rng(seed).uniform(0.1, 50, 2)
    text = URDF.replace("WHEELS", TWO).replace('mass value="3"', f'mass value="{base_kg}"')
    (tmp_path / "cart.urdf").write_text(text.replace('mass value="0.2"', f'mass value="{wheel_kg}"'))
    model = model_of(tmp_path / "cart.urdf")
    assert model.report()["total_mass_kg"] == pytest.approx(base_kg + 2 * wheel_kg)
    assert model.mass_kg == pytest.approx(base_kg)


def test_a_disk_in_mjcf_stays_a_disk(tmp_path: Path) -> None:
    robot = read_robot(_write(tmp_path, "disk.xml", MJCF))
    assert robot.outline_m == () and robot.hull.radius_m == pytest.approx(0.2, rel=0.01)
    assert robot.camera is not None and robot.camera.hfov_deg == 75.0 and robot.lidar == "none"
    assert (robot.camera.ahead_m, robot.camera.height_m) == pytest.approx((0.1, 0.35))


def test_four_wheels_turn_on_an_axle_between(tmp_path: Path) -> None:
    four = "".join(
        WHEEL.format(side=f"{end}_{side}", x=x, y=y, axis=1)
        for end, x in (("front", 0.2), ("rear", 0.0))
        for side, y in (("left", 0.15), ("right", -0.15))
    )
    robot = read_robot(_write(tmp_path, "four.urdf", URDF.replace("WHEELS", four)))
    assert robot.model is None and robot.track_m == pytest.approx(0.3)
    np.testing.assert_allclose(
        np.array(robot.outline_m)[:, 0].max(), 0.2, atol=1e-3
    )  # 0.3 m, of an axle at 0.1 m


def test_meshes_are_found_in_their_package(tmp_path: Path) -> None:
    box, mesh = (
        '<box size="0.4 0.2 0.1"/>',
        '<mesh filename="package://cart/meshes/body.stl" scale="0.001 0.001 0.001"/>',
    )
    text = URDF.replace("WHEELS", TWO)
    (tmp_path / "cart" / "urdf").mkdir(parents=True)
    path = _write(tmp_path / "cart" / "urdf", "cart.urdf", text.replace(box, mesh))
    with pytest.raises(FileError, match=r"package:/+cart/meshes/body.stl"):
        read_robot(path)
    (tmp_path / "cart" / "meshes").mkdir()
    trimesh.creation.box((400, 200, 100)).export(tmp_path / "cart" / "meshes" / "body.stl")
    of_box = read_robot(_write(tmp_path, "box.urdf", text))
    np.testing.assert_allclose(read_robot(path).outline_m, of_box.outline_m, atol=1e-6)


def test_a_robot_that_was_read_is_written_and_read(tmp_path: Path) -> None:
    robot = read_robot(_write(tmp_path, "cart.urdf", URDF.replace("WHEELS", TWO)))
    write_robot(tmp_path / "robot.json", robot)
    assert read_robot(tmp_path / "robot.json") == robot


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (URDF.replace("WHEELS", ""), "expected as many on the left as on the right"),
        (URDF.replace("WHEELS", WHEEL.format(side="left", x=0, y=0.15, axis=1)), "left_joint at y = 0.15 m"),
        (URDF.replace("WHEELS", TWO.replace("0.02", "${width}")), "expand it with the program xacro first"),
        (URDF.replace("WHEELS", TWO).replace("collision>", "visual>"), "nothing of it collides"),
        (URDF[:300], "not readable as a robot"),
        (
            URDF.replace("WHEELS", TWO).replace('"0.4 0.2 0.1"', '"400 200 0.1"'),
            "the reach of outline_m is 2",
        ),
        ("<mujoco/>", "nothing of it collides"),
    ],
)
def test_what_is_no_differential_drive_is_an_error(tmp_path: Path, text: str, reason: str) -> None:
    path = _write(tmp_path, "robot.urdf", text)
    with pytest.raises(FileError, match=reason) as error:
        read_robot(path)
    assert "robot.urdf" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(("x", "y"), [(-0.12, 0), (0.0, 0), (0.18, 0), (0.05, 0.1), (0.05, -0.1), (0, 0.2)])
def test_a_described_robot_drives_straight_wherever_its_mass_is(tmp_path: Path, x: float, y: float) -> None:
    """The hull reaches 0.1 m behind the axle and 0.3 m ahead, the wheels 0.15 m to the sides.

    Without casters beyond the mass, and in line with it, the robot would tip.
    """
    text = URDF.replace("WHEELS", TWO).replace(
        '<inertial><origin xyz="0.05 0', f'<inertial><origin xyz="{x} {y}'
    )
    world = World(open_floor(), robot=read_robot(_write(tmp_path, "cart.urdf", text)))
    world.reset(start := np.array([2.0, 2.0, 0.3]))
    world.move(np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(between(start, world.pose), [0.5, 0, 0], atol=2e-3)


def test_a_centre_of_mass_beyond_the_wheels_is_noted(tmp_path: Path) -> None:
    text = URDF.replace("WHEELS", TWO).replace(
        '<inertial><origin xyz="0.05 0', '<inertial><origin xyz="0.05 -0.2'
    )
    path = _write(tmp_path, "cart.urdf", text)
    assert any(
        "0.2 m to the right of the axle's middle, beyond its wheels" in each for each in model_of(path).notes
    )
    assert read_robot(path).model is None


@pytest.mark.parametrize("is_framed", [False, True])
@pytest.mark.parametrize("yaw_deg", [0, 180, 90, 30])
def test_the_pose_at_which_mjcf_starts_does_not_matter(tmp_path: Path, yaw_deg: int, is_framed: bool) -> None:
    """The pose of a free body, or of a frame around it, is where it starts: camera and wheels go with it."""
    turned = f'<body name="base" euler="0 0 {yaw_deg}"'
    text = MJCF.replace('<body name="base"', turned)
    if is_framed:
        text = MJCF.replace("<body", f'<frame pos="3 0 0" euler="0 0 {yaw_deg}"><body', 1)
        text = text.replace("</worldbody>", "</frame></worldbody>")
    path = _write(tmp_path, "disk.xml", text)
    assert any(f"turned by {yaw_deg} degrees" in each for each in model_of(path).notes) == (yaw_deg != 0)
    robot = read_robot(path)
    assert robot.camera is not None and robot.camera.ahead_m == pytest.approx(0.1)
    world = World(open_floor(), robot=robot)
    for wanted in ((0.5, 0.0, 0.0), (0.0, 0.0, 1.0)):
        world.reset(start := np.array([2.0, 2.0, 0.3]))
        world.move(np.array(wanted))
        np.testing.assert_allclose(between(start, world.pose), wanted, atol=1e-3)


def test_a_base_of_which_y_points_ahead_may_be_turned_to_x(tmp_path: Path) -> None:
    text = MJCF
    for own, turned in (
        ('<body name="base"', '<body name="base" euler="0 0 -90"'),
        ('pos="0.1 0 0.3"', 'pos="0 0.1 0.3"'),
        ("0 -1 0 0 0 1", "1 0 0 0 0 1"),
        ('pos="0 0.15', 'pos="-0.15 0'),
        ('pos="0 -0.15', 'pos="0.15 0'),
        ('axis="0 -1 0"', 'axis="1 0 0"'),
        ("90 0 0", "0 90 0"),
        ("0.15 0 -0.04", "0 0.15 -0.04"),
    ):
        assert own in text
        text = text.replace(own, turned)
    robot = read_robot(_write(tmp_path, "disk.xml", text))
    assert robot.camera is not None and robot.camera.ahead_m == pytest.approx(0.1)


def test_wheels_turn_on_joints_in_frames(tmp_path: Path) -> None:
    text = MJCF.replace('0.15 -0.02"', '0.15 0"').replace('mass="0.1"/>', 'mass="0.1"/></frame>')
    for name in ("l", "r"):
        framed = f'<frame pos="0 0 -0.02" euler="90 0 0"><joint name="{name}" axis="0 0 1"/></frame>'
        hinge = f'<joint name="{name}" axis="0 -1 0" damping="0.01"/>'
        text = text.replace(hinge, framed + '<frame pos="0 0 -0.02">')
    world = World(open_floor(), robot=read_robot(_write(tmp_path, "disk.xml", text)))
    world.reset(start := np.array([2.0, 2.0, 0.3]))
    world.move(np.array([0.5, 0.0, 0.0]))
    np.testing.assert_allclose(between(start, world.pose), [0.5, 0, 0], atol=1e-3)


def test_a_robot_of_which_only_wheels_collide_is_noted(tmp_path: Path) -> None:
    text = URDF.replace("WHEELS", TWO)
    start, end = text.index("<collision><origin"), text.index("</collision>")
    model = model_of(_write(tmp_path, "cart.urdf", text[:start] + text[end + len("</collision>") :]))
    assert "nothing but the wheels collides: the hull is their outline" in model.notes


def test_two_robots_in_a_file_are_an_error(tmp_path: Path) -> None:
    start, end = MJCF.index('<body name="base"'), MJCF.index("</body></worldbody>") + len("</body>")
    other = MJCF[start:end].replace('name="', 'name="other_').replace("1 2 0.05", "1 3 0.05")
    path = _write(
        tmp_path,
        "two.xml",
        MJCF[:end] + other + MJCF[end:].replace("qpos", "ctrl").replace("0 0 .06 1 0 0 0 0 0 0", "0 0"),
    )
    with pytest.raises(FileError, match="its wheels hang on base, other_base, which no joint connects"):
        model_of(path)
