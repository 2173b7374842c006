"""Cameras and lidars of descriptions: what is declared counts more than names, and names of holders count nothing."""

import math
from pathlib import Path

import pytest

from robosim.robot.model_file import Model, model_of
from robosim.support.reading import FileError
from tests.made_robots import MJCF, TWO, URDF

CART = URDF.replace("WHEELS", TWO)
CAMERA = 'pos="0.1 0 0.3" fovy="75"'


def _model(folder: Path, text: str) -> Model:
    path = folder / ("robot.urdf" if "<robot" in text else "robot.xml")
    path.write_text(text)
    return model_of(path)


def _link(name: str, xyz: str, parent: str = "base", rpy: str = "0 0 0") -> str:
    return (
        f'<link name="{name}"/><joint name="{name}_j" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )


@pytest.mark.parametrize(
    ("optics", "hfov_deg"),
    [
        ('fovy="45" resolution="640 480"', 57.822),
        ('fovy="45" resolution="1920 1080"', 72.734),
        ('fovy="45"', 45.0),
        ('sensorsize="0.0048 0.0036" focal="0.004 0.004" resolution="640 480"', 61.928),
        ('sensorsize="0.0048 0.0036" focalpixel="400 400" resolution="640 480"', 77.320),
    ],
)
def test_find_camera_takes_fovy_as_vertical(tmp_path: Path, optics: str, hfov_deg: float) -> None:
    """2 atan(tan(fovy / 2) w / h), or 2 atan(w / 2 f)."""
    camera = _model(tmp_path, MJCF.replace(CAMERA, f'pos="0.1 0 0.3" {optics}')).camera
    assert camera is not None and camera.hfov_deg == pytest.approx(hfov_deg, abs=0.001)


@pytest.mark.parametrize(
    "other",
    [
        '<worldbody><camera name="of_world" pos="0.2 0 3" fovy="30"/>',
        None,
    ],
)
def test_find_camera_takes_the_one_on_the_robot(tmp_path: Path, other: str | None) -> None:
    chase = '<freejoint/><camera name="chase" pos="-3 0 3" fovy="30"/><camera name="track" mode="track" pos="0 0 1"/>'
    text = MJCF.replace("<worldbody>", other, 1) if other else MJCF.replace("<freejoint/>", chase)
    camera = _model(tmp_path, text).camera
    assert camera is not None and camera.name == "eye" and camera.hfov_deg == pytest.approx(75)
    assert tuple(camera.place) == pytest.approx((0.1, 0, 0.35))


@pytest.mark.parametrize(
    "holder", ["camera_standoff_1", "camera_mount", "camera_bottom_screw_frame", "camera_base_link"]
)
@pytest.mark.parametrize("own_link", ["camera_link", "front_realsense", "robot1/camera"])
def test_find_camera_ignores_what_holds_it(tmp_path: Path, holder: str, own_link: str) -> None:
    text = CART.replace("camera_link", own_link).replace("</robot>", _link(holder, "0.1 0 0.02") + "</robot>")
    # The holder comes first in the file and in the tree.
    text = text.replace(
        f'<parent link="base"/><child link="{own_link}"/>',
        f'<parent link="{holder}"/><child link="{own_link}"/>',
    )
    camera = _model(tmp_path, text).camera
    assert camera is not None and camera.name == own_link
    assert tuple(camera.place) == pytest.approx((0.38, 0, 0.17))


def test_find_camera_takes_the_optical_frame(tmp_path: Path) -> None:
    turn = f"{-math.pi / 2} 0 {-math.pi / 2}"
    frames = _link("camera_depth_frame", "0 0.02 0", "camera_link") + _link(
        "camera_depth_optical_frame", "0.01 0 0.01", "camera_depth_frame", turn
    )
    model = _model(tmp_path, CART.replace("</robot>", frames + "</robot>"))
    assert model.camera is not None and model.camera.name == "camera_depth_optical_frame"
    assert tuple(model.camera.place) == pytest.approx((0.29, 0.02, 0.16))
    assert not model.notes


def test_find_camera_says_which_of_several_it_takes(tmp_path: Path) -> None:
    rear = _link("rear_camera_link", "-0.1 0 0.2", rpy=f"0 0 {math.pi}")
    text = CART.replace('<joint name="scan_joint"', rear + '<joint name="scan_joint"')
    model = _model(tmp_path, text)
    assert model.camera is not None and model.camera.name == "camera_link"
    assert any("camera_link is taken, not rear_camera_link" in note for note in model.notes)


def test_find_camera_takes_gazebo_sensors(tmp_path: Path) -> None:
    tags = """<gazebo reference="eye"><sensor type="depth" name="d435"><pose>0.01 0 0 0 0 0</pose>
      <camera><horizontal_fov>1.2</horizontal_fov></camera></sensor></gazebo>
      <gazebo reference="head"><sensor type="gpu_lidar" name="rp"/></gazebo></robot>"""
    text = CART.replace("</robot>", _link("eye", "0.2 0 0.3") + _link("head", "0 0 0.4") + tags)
    model = _model(tmp_path, text)
    assert model.camera is not None and model.lidar is not None
    assert tuple(model.camera.place) == pytest.approx((0.21, 0, 0.31))
    assert model.camera.hfov_deg == pytest.approx(math.degrees(1.2))
    assert tuple(model.lidar.place) == pytest.approx((0, 0, 0.41))


def test_find_camera_says_of_holders_without_a_camera(tmp_path: Path) -> None:
    model = _model(tmp_path, CART.replace("camera_link", "camera_mount"))
    assert model.camera is None and any("camera_mount are named after" in note for note in model.notes)


def test_find_lidar_places_a_gazebo_sensor_by_relative_to(tmp_path: Path) -> None:
    """0.1 m ahead of the camera at (0.28, 0, 0.15), though it belongs to the base."""
    tags = """<gazebo reference="base"><sensor type="gpu_lidar" name="rp"><pose relative_to="camera_link">0.1 0 0 0 0 0
      </pose></sensor></gazebo></robot>"""
    lidar = _model(tmp_path, CART.replace("</robot>", tags)).lidar
    assert lidar is not None and tuple(lidar.place) == pytest.approx((0.38, 0.0, 0.15))


@pytest.mark.parametrize("pose", ['degrees="true">0 0 0 0 0 90', 'rotation_format="quat_xyzw">1 0 0 0 0 0 1'])
def test_poses_of_gazebo_sensors_in_other_units_are_rejected(tmp_path: Path, pose: str) -> None:
    tags = f'<gazebo reference="base"><sensor type="lidar" name="rp"><pose {pose}</pose></sensor></gazebo></robot>'
    with pytest.raises(FileError, match=r"pose of sensor rp is .*, expected x, y, z \[m\], roll, pitch, yaw"):
        _model(tmp_path, CART.replace("</robot>", tags))


def test_find_camera_places_gazebo_cameras_in_their_sensor(tmp_path: Path) -> None:
    """The pose of a camera is in the frame of its sensor, here turned by 90 degrees to the left and back."""
    half = math.pi / 2
    tags = f"""<gazebo reference="base"><sensor type="camera" name="c"><pose>0.1 0 0.2 0 0 {half}</pose>
      <camera><pose>0.03 -0.05 0 0 0 {-half}</pose><horizontal_fov>1</horizontal_fov></camera>
      </sensor></gazebo></robot>"""
    model = _model(tmp_path, CART.replace("</robot>", tags))
    assert model.camera is not None and tuple(model.camera.place) == pytest.approx((0.15, 0.03, 0.21))
    assert tuple(model.camera.view) == pytest.approx((1, 0, 0)) and not model.notes


def test_find_camera_leaves_out_orthographic_cameras(tmp_path: Path) -> None:
    """Their `fovy` is a length."""
    text = MJCF.replace(CAMERA, f'{CAMERA} projection="orthographic"')
    assert _model(tmp_path, text).camera is None


@pytest.mark.parametrize(
    ("link", "note"),
    [
        (_link("lidar_link", "0.1 0.2 0.2"), "lidar_link is 0.2 m to the left"),
        (_link("eye_camera", "0.1 -0.06 0.2"), "eye_camera is 0.06 m to the right"),
        (_link("eye_camera", "0.1 0 0.2", rpy="0 0.2 0"), "eye_camera does not look straight ahead"),
        (_link("eye_camera", "0.1 0.04 0.2", rpy="0 0.1 0"), None),
    ],
)
def test_sensors_are_noted_where_their_mount_is_simplified(
    tmp_path: Path, link: str, note: str | None
) -> None:
    bare = CART.replace("camera_link", "front").replace("base_scan", "top")
    notes = _model(tmp_path, bare.replace("</robot>", link + "</robot>")).notes
    assert len(notes) == (note is not None) and all(str(note) in each for each in notes)
