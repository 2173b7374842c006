"""The target in pictures: where it is, and that nothing is seen through walls."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.camera.cameras import make_camera
from robosim.camera.model import RGBD, CameraConfig, camera_pose
from robosim.camera.recognition import MarkerRecogniser, PerfectRecogniser
from robosim.camera.rendering.shading import shaded_mesh
from robosim.camera.target import target_mesh
from slam.poses import between
from tests.plans import two_rooms

TARGET = np.array([4.6, 1.5])
CONFIG = CameraConfig(width=256, height=256)


@pytest.fixture(scope="module")
def camera():
    with make_camera([shaded_mesh(make_building(two_rooms(0.8))), target_mesh(TARGET)], CONFIG) as camera:
        yield camera


def _local(pose):
    return between(pose, np.array([*TARGET, 0.0]))[:2]


@pytest.mark.parametrize("bearing_deg", [180, 160, 200, 90])
def test_the_marker_tells_where_the_target_is(camera, bearing_deg):
    """From 1.2 m, up to 20 degrees off a side's normal: within 6 cm of the target's middle."""
    bearing = np.deg2rad(bearing_deg)
    place = TARGET + 1.2 * np.array([np.cos(bearing), np.sin(bearing)])
    pose = np.array([*place, bearing + np.pi + 0.1])
    found = MarkerRecogniser(CONFIG).find(camera.render(camera_pose(pose, CONFIG)), _local(pose))
    assert found is not None
    assert np.hypot(*(found - _local(pose))) < 0.06


@pytest.mark.parametrize(
    ("pose", "seen"),
    [
        ((2.0, 1.5, 0.0), True),  # through the door
        ((0.2, 1.5, 0.3), True),  # far, at the edge of the picture
        ((2.0, 0.3, 0.0), False),  # behind the wall
        ((2.0, 1.5, 3.0), False),  # behind the robot
        ((4.5, 1.5, 0.0), False),  # above the picture
    ],
)
def test_a_perfect_recogniser_sees_what_is_in_the_picture(camera, pose, seen):
    pose = np.array(pose)
    found = PerfectRecogniser(CONFIG).find(camera.render(camera_pose(pose, CONFIG)), _local(pose))
    assert (found is not None) == seen
    if seen:
        assert found == pytest.approx(_local(pose), abs=1e-9)


def test_nothing_is_found_in_the_dark():
    nothing = RGBD(np.zeros((256, 256, 3), np.uint8), np.zeros((256, 256), np.float32))
    for recogniser in (MarkerRecogniser(CONFIG), PerfectRecogniser(CONFIG)):
        assert recogniser.find(nothing, _local(np.array([2.0, 1.5, 0.0]))) is None
