"""The target: drawn in exact black and white, found where projection puts it, and not seen through walls."""

import cv2
import numpy as np
import pytest
import trimesh

from robosim.building.building import make_building
from robosim.camera.cameras import make_camera
from robosim.camera.depth_noise import DepthNoise
from robosim.camera.model import RGBD, CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.camera.target import DICTIONARY, MarkerRecogniser, PerfectRecogniser, TargetConfig, target_mesh
from robosim.plans.floorplan import FloorPlan
from slam.poses import between
from tests.plans import two_rooms

PLACE = np.array([3.2, 2.9])


@pytest.fixture(scope="module")
def hall() -> trimesh.Trimesh:
    """A hall of 8 m by 6 m, as cameras see it."""
    plan = FloorPlan(occupancy=np.zeros((60, 80), np.uint8), resolution_m=0.1, name="hall")
    return shaded_mesh(make_building(plan))


def looking(distance_m: float, bearing: float, turn: float = 0.0) -> np.ndarray:
    """Robot pose at a distance from the target, which lies `turn` to the left of straight ahead."""
    x, y = PLACE + distance_m * np.array([np.cos(bearing), np.sin(bearing)])
    return np.array([x, y, (bearing + np.pi - turn + np.pi) % (2 * np.pi) - np.pi])


def detect(rgb: np.ndarray) -> dict[int, np.ndarray]:
    """Markers that OpenCV finds with its default settings, and their corners."""
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY))
    corners, ids, _ = detector.detectMarkers(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
    return {} if ids is None else {int(i): c[0] for i, c in zip(ids.ravel(), corners, strict=True)}


def marker_corners(position_xy, *, config, yaw):
    """Outer corners of the four markers, clockwise from the upper left one as of OpenCV, x, y, z [m] in `map`."""
    across_up = config.marker_m / 2 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    side = np.column_stack([np.full(4, config.box_m / 2), across_up])
    angles = yaw + np.arange(4) * np.pi / 2
    turns = [np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in angles]
    return np.stack([side @ turn for turn in turns]) + np.array([*position_xy, config.marker_height_m])


@pytest.mark.parametrize("backend", ["pyrender", "embree"])
@pytest.mark.parametrize("side", range(4))
def test_each_side_is_recognised_where_it_is(hall, side, backend):
    """From 1.2 m, 10 degrees off each side's normal, at 256 x 256: the id, and corners within a pixel.

    OpenCV counts from the centre of the first pixel. A mirrored marker is not found at all; one turned by a
    quarter has its corners in another order, 30 pixels off.
    """
    config, marker = CameraConfig(width=256, height=256), TargetConfig(marker_id=23)
    T = camera_pose(looking(1.2, 0.3 + side * np.pi / 2 + np.radians(10), 0.15), config)
    with make_camera([hall, target_mesh(PLACE, config=marker, yaw=0.3)], config, backend=backend) as camera:
        found = detect(camera.render(T).rgb)
    corners = marker_corners(PLACE, config=marker, yaw=0.3)[side]
    seen = (corners - T[:3, 3]) @ T[:3, :3] @ config.K.T
    expected = seen[:, :2] / seen[:, 2:] - 0.5
    assert list(found) == [23]
    assert np.abs(found[23] - expected).max() < 1.0


@pytest.mark.parametrize(
    ("size", "distance_m", "at_least"), [(128, 1.0, 0.9), (128, 1.5, 0.4), (256, 2.0, 0.9), (256, 3.0, 0.3)]
)
def test_the_target_is_recognised_from_afar(hall, size, distance_m, at_least):
    """Share of views within 30 degrees of a side's normal in which the marker is found."""
    config, rng = CameraConfig(width=size, height=size), np.random.default_rng(0)
    found = 0
    with make_camera([hall, target_mesh(PLACE)], config) as camera:
        for _ in range(40):
            bearing, turn = np.radians(rng.uniform(-30, 30)), rng.uniform(-0.3, 0.3)
            pose = looking(distance_m * rng.uniform(0.93, 1.07), bearing, turn)
            found += 7 in detect(camera.render(camera_pose(pose, config)).rgb)
    assert found / 40 >= at_least


def test_the_marker_is_plain_black_and_white(hall):
    """Drawn head-on, its pixels are 0 or 255 and nothing between, in the pattern of the dictionary."""
    target = TargetConfig()
    config = CameraConfig(width=400, height=400, hfov_deg=20.0, height_m=target.marker_height_m)
    with make_camera([hall, target_mesh(PLACE)], config) as camera:
        rgb, depth = camera.render(camera_pose(looking(1.5, 0.0), config))
    distance = 1.5 - target.box_m / 2
    cell_px = config.focal_px * target.marker_m / distance / 6
    centres = (200 + (np.arange(6) - 2.5) * cell_px).astype(int)
    pattern = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(DICTIONARY), 7, 6)
    assert np.array_equal(rgb[np.ix_(centres, centres)], np.repeat(pattern[:, :, None], 3, axis=2))
    assert set(np.unique(rgb[np.abs(depth - distance) < 1e-3])) == {0, 255}


def test_the_target_hangs_clear_of_robots():
    """From 1.44 m up to the ceiling; the radio's middle is where it is said to be.

    Whatever hangs above 1.44 m is higher than the cameras and bodies of robots, and than what mappers look at.
    """
    mesh = target_mesh(np.zeros(2), ceiling_m=2.7)
    assert mesh.bounds == pytest.approx(np.array([[-0.16, -0.16, 1.44], [0.16, 0.16, 2.7]]))
    radio = mesh.vertices[mesh.vertices[:, 2] < 1.57]
    assert 0.5 * (radio.min(axis=0) + radio.max(axis=0)) == pytest.approx([0.0, 0.0, 1.5])


def test_faces_look_outwards():
    """Each normal points away from the axis or along it; a face turned inwards would not be drawn."""
    mesh = target_mesh(PLACE, yaw=0.7)
    outward = ((mesh.triangles_center[:, :2] - PLACE) * mesh.face_normals[:, :2]).sum(axis=1)
    level = np.abs(mesh.face_normals[:, 2]) < 0.5
    assert (outward[level] > 0).all()
    assert mesh.volume > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"marker_id": 50}, "marker_id is 50"),
        ({"marker_m": 0.0}, "marker_m is 0"),
        ({"marker_height_m": 1.2}, "marker_height_m 1.2"),
        ({"radio_height_m": 0.0}, "radio_height_m is 0"),
    ],
)
def test_impossible_targets_are_rejected(arguments, message):
    """Each message names the field and its value."""
    with pytest.raises(ValueError, match=message):
        TargetConfig(**arguments)


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
