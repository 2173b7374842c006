"""RGB-D cameras: pinhole geometry, and both engines against exact depth and against each other."""

from pathlib import Path

import numpy as np
import pytest
import shapely
import trimesh
from scipy.spatial.transform import Rotation

from robosim.building.building import Building, make_building
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan
from tests.benchmarks.true_depth import DepthJudge, plain_depth
from tests.robosim.camera.pictures import ROOM, room, same

ENGINES = ("pyrender", "embree")
#: What the camera promises, away from silhouettes.
ABSOLUTE_M, RELATIVE = 1e-3, 1e-3


def flat() -> Building:
    """Two rooms with a door between them, a column and a slanted wall of steps."""
    occupancy = np.zeros((90, 120), np.uint8)
    occupancy[:, 60:62] = 1
    occupancy[40:58, 60:62] = 0
    occupancy[20:28, 25:33] = 1
    for i in range(40):
        occupancy[i, 120 - 40 + i :] = 1
    return make_building(FloorPlan(occupancy=occupancy, resolution_m=0.05, name="two rooms"))


def poses(building: Building, config: CameraConfig, count: int, seed: int = 0) -> list[np.ndarray]:
    """Camera poses at random places 0.2 m or more from walls."""
    rng = np.random.default_rng(seed)
    inside = building.free.buffer(-0.2)
    x0, y0, x1, y1 = inside.bounds
    found: list[np.ndarray] = []
    while len(found) < count:
        x, y, yaw = rng.uniform((x0, y0, -np.pi), (x1, y1, np.pi))
        if inside.contains(shapely.Point(x, y)):
            found.append(camera_pose(np.array([x, y, yaw]), config))
    return found


def test_camera_pose_is_a_right_handed_frame_that_looks_ahead():
    """Axes: x right, y down, z forward: at yaw 90 deg that is +x, -z, +y of `map`. A swapped sign mirrors pictures."""
    T = camera_pose(np.array([1.0, 2.0, np.pi / 2]), CameraConfig(height_m=0.8))
    assert np.allclose(T[:3, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-15)
    assert np.array_equal(T[:, 3], [1.0, 2.0, 0.8, 1.0])
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize("backend", ENGINES)
@pytest.mark.parametrize(("width", "height", "hfov"), [(128, 128, 90.0), (200, 75, 60.0), (33, 130, 100.0)])
def test_depth_of_an_empty_room_is_exact(backend, width, height, hfov):
    """Along z, a ray leaves a box where it meets the first of six planes: a closed form for each pixel."""
    config = CameraConfig(width=width, height=height, hfov_deg=hfov)
    T = camera_pose(np.array([0.3, -0.4, 0.7]), config)
    rays = config.directions() @ T[:3, :3].T
    low, high = np.array([-ROOM[0] / 2, -ROOM[1] / 2, 0.0]), np.array([ROOM[0] / 2, ROOM[1] / 2, ROOM[2]])
    to_wall = np.abs(np.where(rays > 0, high, low) - T[:3, 3])
    expected = np.divide(to_wall, np.abs(rays), out=np.full(rays.shape, np.inf), where=rays != 0)
    with make_camera([room()], config, backend=backend) as camera:
        depth = camera.render(T).depth
    assert depth.shape == (height, width)
    assert depth.dtype == np.float32
    assert np.abs(depth / expected.min(axis=-1) - 1).max() < 1e-4


@pytest.mark.parametrize("backend", ENGINES)
def test_a_point_appears_where_the_intrinsics_say(backend):
    """A square of 0.8 by 0.8 pixels about the centre of one pixel colours that pixel and no other."""
    config = CameraConfig(width=97, height=64, hfov_deg=75.0)
    T = camera_pose(np.array([5.0, -2.0, 2.1]), config)
    for row, column in [(0, 0), (63, 96), (31, 48), (10, 80)]:
        corners = np.array([[-0.4, -0.4], [0.4, -0.4], [0.4, 0.4], [-0.4, 0.4]]) + np.array(
            [column + 0.5, row + 0.5]
        )
        rays = np.column_stack([corners, np.ones(4)]) @ np.linalg.inv(config.K).T
        points = 3.0 * rays @ T[:3, :3].T + T[:3, 3]
        red = np.tile(np.array([255, 0, 0, 255], np.uint8), (4, 1))
        square = trimesh.Trimesh(points, [[0, 2, 1], [0, 3, 2]], vertex_colors=red, process=False)
        with make_camera([square], config, backend=backend) as camera:
            rgb, depth = camera.render(T)
        assert np.argwhere(depth > 0).tolist() == [[row, column]]
        assert depth[row, column] == pytest.approx(3.0, abs=1e-4)
        assert rgb[row, column].tolist() == [255, 0, 0]
        assert np.count_nonzero(rgb) == 1


def test_directions_and_intrinsics_agree():
    """K times the direction of a pixel is its centre, (column + 0.5, row + 0.5)."""
    config = CameraConfig(width=40, height=30, hfov_deg=80.0)
    at = config.directions() @ config.K.T
    column, row = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    assert np.allclose(at[..., 0], column, atol=1e-12)
    assert np.allclose(at[..., 1], row, atol=1e-12)


def test_the_judge_of_depth_agrees_with_trying_all_triangles():
    """Embree's choice of the first triangle against a plain loop in double precision; 1e-6 m, measured 2e-12."""
    building, config = flat(), CameraConfig(width=24, height=24)
    judge = DepthJudge(building.mesh, config)
    for T in poses(building, config, 4):
        rays = (config.directions() @ T[:3, :3].T).reshape(-1, 3)
        expected = plain_depth(building.mesh, T[:3, 3], rays).reshape(24, 24)
        view = judge.look(T)
        assert np.abs(view.depth - expected)[view.sure].max() < 1e-6
        assert view.sure.mean() > 0.98


@pytest.mark.parametrize("backend", ENGINES)
def test_depth_in_a_building_equals_the_ray_cast(backend):
    """Every pixel but those at silhouettes (below 2 %) is within 1 mm + 0.1 %; measured at most 0.2 mm.

    The shaded mesh is drawn, the plain one judged: a crack between patches would show as a pixel that sees
    through a wall.
    """
    building, config = flat(), CameraConfig()
    judge = DepthJudge(building.mesh, config)
    with make_camera([shaded_mesh(building)], config, backend=backend) as camera:
        views = [(camera.render(T), judge.look(T)) for T in poses(building, config, 12)]
    for frame, truth in views:
        error = np.abs(frame.depth - truth.depth)[truth.sure]
        assert (error <= ABSOLUTE_M + RELATIVE * truth.depth[truth.sure]).all()
        assert truth.sure.mean() > 0.98
        assert frame.rgb.min() > 0  # a building is closed: no background shows


@pytest.mark.parametrize(
    "name", ["gibson/dev/Roxboro.glb_topdownmap.out", "gibson/train/Colebrook.glb_topdownmap.out"]
)
def test_depth_in_a_real_building_equals_the_ray_cast(shared: Path, name: str):
    """As in the building above, on floor plans that were measured."""
    building, config = make_building(read_plan(shared / "maps" / name)), CameraConfig()
    judge = DepthJudge(building.mesh, config)
    with make_camera([shaded_mesh(building)], config) as camera:
        for T in poses(building, config, 20):
            depth, truth = camera.render(T).depth, judge.look(T)
            error = np.abs(depth - truth.depth)[truth.sure]
            assert (error <= ABSOLUTE_M + RELATIVE * truth.depth[truth.sure]).all()
            assert truth.sure.mean() > 0.98


def test_both_engines_see_the_same_colours():
    """Interpolated colours differ by 1 of 255 at most, silhouettes apart; measured 1."""
    building, config = flat(), CameraConfig()
    mesh, judge = shaded_mesh(building), DepthJudge(building.mesh, config)
    with make_camera([mesh], config) as drawn, make_camera([mesh], config, backend="embree") as cast:
        for T in poses(building, config, 6):
            inner = judge.look(T).sure
            difference = np.abs(drawn.render(T).rgb.astype(int) - cast.render(T).rgb)[inner]
            assert np.quantile(difference, 0.999) <= 1


def test_culling_changes_no_bit():
    """What a level camera cannot see is not drawn, and the pictures are the same as with all of it.

    Judge: the same camera that draws every part. In these 40 views it leaves out more than half of them.
    """
    building, config = flat(), CameraConfig(width=100, height=80)
    with make_camera([shaded_mesh(building)], config) as camera:
        views = poses(building, config, 40, seed=5)
        culled = [camera.render(T) for T in views]
        seen = [len(camera._visibility.parts(*camera._scenery.to_local(T))) for T in views]
        everything = np.arange(len(camera._pass._counts))
        camera._visibility.parts = lambda R, t: everything
        whole = [camera.render(T) for T in views]
    assert np.mean(seen) < 0.5 * len(everything)
    assert all(same(a, b) for a, b in zip(culled, whole, strict=True))


def test_a_tilted_camera_sees_all():
    """Pitched by 30 deg and rolled, depth still equals the ray cast; culling is for level cameras only."""
    building, config = flat(), CameraConfig()
    judge = DepthJudge(building.mesh, config)
    with make_camera([shaded_mesh(building)], config) as camera:
        for T in poses(building, config, 4):
            T[:3, :3] = T[:3, :3] @ Rotation.from_euler("xz", [-30.0, 20.0], degrees=True).as_matrix()
            truth = judge.look(T)
            error = np.abs(camera.render(T).depth - truth.depth)[truth.sure]
            assert (error <= ABSOLUTE_M + RELATIVE * truth.depth[truth.sure]).all()


@pytest.mark.parametrize("backend", ENGINES)
def test_ten_kilometres_from_the_origin_nothing_changes(backend):
    """In single precision a vertex 10 km away would be off by 1 mm, and depth by more; here by 1e-6 at most."""
    config, far = CameraConfig(), np.array([8192.0, -6144.0, 0.0])
    T = camera_pose(np.array([0.3, -0.4, 0.7]), config)
    shifted = room()
    shifted.apply_translation(far)
    T_far = T.copy()
    T_far[:3, 3] += far
    with make_camera([room()], config, backend=backend) as near_camera:
        expected = near_camera.render(T)
    with make_camera([shifted], config, backend=backend) as camera:
        got = camera.render(T_far)
    assert np.abs(got.depth - expected.depth).max() < 1e-6
    assert np.abs(got.rgb.astype(int) - expected.rgb).max() <= 1


@pytest.mark.parametrize("backend", ENGINES)
def test_beyond_the_far_plane_nothing_is_seen(backend):
    """Depth 0 and black beyond far_m; nearer pixels as before. One wall is 2.3 m away, others nearer."""
    T = camera_pose(np.array([0.3, 0.0, np.pi]), CameraConfig())
    with make_camera([room()], CameraConfig(), backend=backend) as camera:
        whole = camera.render(T)
    with make_camera([room()], CameraConfig(far_m=2.0), backend=backend) as camera:
        cut = camera.render(T)
    beyond = whole.depth > 2.0
    assert 0.1 < beyond.mean() < 0.9
    assert not cut.depth[beyond].any()
    assert not cut.rgb[beyond].any()
    assert np.array_equal(cut.depth[~beyond], whole.depth[~beyond])


@pytest.mark.parametrize("backend", ENGINES)
def test_a_closed_camera_says_so(backend, view):
    """Closing twice is allowed; taking pictures afterwards is not."""
    camera = make_camera([room()], CameraConfig(), backend=backend)
    camera.close()
    camera.close()
    with pytest.raises(RuntimeError, match="closed"):
        camera.render(view)


@pytest.mark.parametrize("backend", ENGINES)
def test_bad_arguments_are_rejected(backend, view):
    """Nothing to see, corners that are not numbers, poses that are not poses."""
    with pytest.raises(ValueError, match="no triangles"):
        make_camera([], CameraConfig(), backend=backend)
    broken = room()
    broken.vertices[0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        make_camera([broken], CameraConfig(), backend=backend)
    with make_camera([room()], CameraConfig(), backend=backend) as camera:
        view[0, 0] = np.nan
        with pytest.raises(ValueError, match="finite numbers"):
            camera.render(view)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": 0}, "width is 0"),
        ({"hfov_deg": 180.0}, "hfov_deg is 180"),
        ({"near_m": 0.0}, "near_m is 0"),
        ({"near_m": 2.0, "far_m": 1.0}, "near_m is 2"),
        ({"far_m": np.inf}, "far_m is inf"),
        ({"height_m": np.nan}, "height_m is nan"),
    ],
)
def test_impossible_cameras_are_rejected(arguments, message):
    """Each message names the field and its value."""
    with pytest.raises(ValueError, match=message):
        CameraConfig(**arguments)
