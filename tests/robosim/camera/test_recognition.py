"""The target in pictures: where it is, and that nothing is seen through walls."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.camera.cameras import make_camera
from robosim.camera.depth_noise import DepthNoise
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


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize(("bearing_deg", "distance_m"), [(180, 1.2), (160, 1.2), (205, 1.5), (180, 2.4)])
def test_the_marker_shows_where_the_target_is(camera, bearing_deg, distance_m, noise):
    """Up to 25 degrees off the normal, within 3 cm of the target's middle, with the depth noise of a Kinect too."""
    bearing = np.deg2rad(bearing_deg)
    place = TARGET + distance_m * np.array([np.cos(bearing), np.sin(bearing)])
    pose = np.array([*place, bearing + np.pi + 0.1])
    frame = camera.render(camera_pose(pose, CONFIG))
    measured = DepthNoise(level=noise).apply(frame.depth, float(CONFIG.focal_px), np.random.default_rng(0))
    found = MarkerRecogniser(CONFIG).find(frame._replace(depth=measured), _local(pose))
    assert found is not None
    assert np.hypot(*(found - _local(pose))) < 0.03


def test_a_marker_without_depths_is_placed_by_its_size(camera):
    """Within 6 cm from 1.2 m."""
    pose = np.array([TARGET[0] - 1.2, TARGET[1], 0.1])
    frame = camera.render(camera_pose(pose, CONFIG))
    found = MarkerRecogniser(CONFIG).find(frame._replace(depth=np.zeros_like(frame.depth)), _local(pose))
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
