"""Meshes placed in a building: what camera, lidar, robots, radio and the map's truth make of them, by closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from scipy.constants import speed_of_light

from robosim.building.building import BuildingConfig, make_building
from robosim.building.extrusion import PLACED
from robosim.building.footprint import filled, footprint
from robosim.building.mesh_export import export_mesh
from robosim.building.reach import reach
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.lidar import LidarConfig, rplidar_a1
from robosim.plans.floorplan import MapError
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.plans.furnishings.pieces import Table, make_piece
from robosim.policies.shortest import TrueMapper
from robosim.radio.receivers import random_transmitters, receiver_grid
from robosim.radio.scene import RadioConfig, RadioScene
from robosim.robot.dynamic import World
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.mjcf import export_mjcf
from robosim.robot.robots import RobotConfig
from robosim.task.tasks import make_task
from slam.sensing.projection import Band, scan_from_depth
from tests.plans import room
from tests.slam import beams
from wireless.paths import Interaction
from wireless.tracing.scenes import PlanScene, SpaceScene
from wireless.tracing.tracer import Tracer, TracerConfig

WIDTH, DEPTH, HEIGHT = 6.0, 4.0, 2.5
TABLE = Table(width_m=1.6, depth_m=1.0, height_m=0.74, top_m=0.03, leg_m=0.06)
AT, YAW = np.array([3.0, 2.0]), 0.4


def table(yaw=YAW, **sizes) -> Furnishing:
    sizes = {"width_m": 1.6, "depth_m": 1.0, **sizes}
    return make_piece("table", at=(float(AT[0]), float(AT[1])), yaw_rad=yaw, **sizes)


def furnished(*furnishings):
    return make_building(
        room(WIDTH, DEPTH), config=BuildingConfig(tolerance_m=0.0), furnishings=furnishings or (table(),)
    )


@pytest.fixture(scope="module")
def building():
    """A room with one table that stands askew in the middle."""
    return furnished()


def legs_m() -> np.ndarray:
    """Lowest and highest corners (x, y) of the four legs in the table's frame, (4, 2, 2)."""
    x, y, leg = TABLE.width_m / 2, TABLE.depth_m / 2, TABLE.leg_m
    return np.array(
        [
            [
                (a * (x - leg / 2) - leg / 2, b * (y - leg / 2) - leg / 2),
                (a * (x - leg / 2) + leg / 2, b * (y - leg / 2) + leg / 2),
            ]
            for a in (-1, 1)
            for b in (-1, 1)
        ]
    )


def to_map(points: np.ndarray) -> np.ndarray:
    c, s = np.cos(YAW), np.sin(YAW)
    return points @ np.array([[c, s], [-s, c]]) + AT


def ring(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Corners of a rectangle of the table's frame in `map`."""
    return to_map(np.array([low, [high[0], low[1]], high, [low[0], high[1]]]))


def exact_depth(T: np.ndarray, config: CameraConfig) -> np.ndarray:
    """Depth by the slab method: rays against the boxes of the table, and from within the box that the room is."""
    rays = config.directions() @ T[:3, :3].T
    nearest = slab(T[:3, 3], rays, np.zeros(3), np.array([WIDTH, DEPTH, HEIGHT]))[1]
    c, s = np.cos(-YAW), np.sin(-YAW)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    start, rays = turn @ (T[:3, 3] - [*AT, 0]), rays @ turn.T
    x, y = TABLE.width_m / 2, TABLE.depth_m / 2
    boxes = [(np.array([-x, -y, TABLE.clearance_m]), np.array([x, y, TABLE.height_m]))]
    boxes += [(np.array([*low, 0.0]), np.array([*high, TABLE.clearance_m])) for low, high in legs_m()]
    for low, high in boxes:
        enter, leave = slab(start, rays, low, high)
        nearest = np.where((enter < leave) & (enter > 0), np.minimum(enter, nearest), nearest)
    return nearest


def slab(start, rays, low, high):
    """Where rays enter and leave a box."""
    with np.errstate(divide="ignore"):
        a, b = (low - start) / rays, (high - start) / rays
    return np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)


@pytest.mark.parametrize("backend", ["pyrender", "embree"])
@pytest.mark.parametrize("height_m", [0.35, 1.25])
def test_depth_of_a_table_is_that_of_its_boxes(building, backend, height_m):
    """From above the top and from below it: each pixel whose neighbours agree within 1 mm, and 98 % of all."""
    config = CameraConfig(width=160, height=120, height_m=height_m)
    T = camera_pose(np.array([0.8, 1.1, 0.3]), config)
    with make_camera([shaded_mesh(building)], config, backend=backend) as camera:
        depth = camera.render(T).depth
    exact = exact_depth(T, config)
    off = np.abs(depth - exact)
    assert (off < 1e-4).mean() > 0.98
    spread = np.zeros(exact.shape)
    spread[1:-1, 1:-1] = np.ptp(
        [exact[1 + i : 119 + i, 1 + j : 159 + j] for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0
    )
    assert off[(spread < 0.2) & (spread > 0)].max() < 1e-4
    hit = exact < exact_depth_of_room(T, config) - 1e-9
    assert hit.mean() > 0.02  # the table is in the picture


def exact_depth_of_room(T, config):
    return slab(T[:3, 3], config.directions() @ T[:3, :3].T, np.zeros(3), np.array([WIDTH, DEPTH, HEIGHT]))[1]


def segments(*rings) -> list[tuple[float, ...]]:
    return [(*a, *b) for corners in rings for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]


@pytest.mark.parametrize(("height_m", "what"), [(0.2, "legs"), (0.725, "top"), (1.0, "nothing")])
def test_a_lidar_sees_what_is_at_its_height(building, height_m, what):
    """Below the top its beams pass and hit the legs; at its height, the top; above, the walls. All 360 beams."""
    pose = np.array([1.0, 1.2, 0.5])
    outline = np.array([[0, 0], [WIDTH, 0], [WIDTH, DEPTH], [0, DEPTH]])
    half = np.array([TABLE.width_m, TABLE.depth_m]) / 2
    things = {"legs": [ring(*leg) for leg in legs_m()], "top": [ring(-half, half)], "nothing": []}
    scan = rplidar_a1([building.mesh], LidarConfig(level=0.0, height_m=height_m)).true_scan(pose)
    exact = beams.ranges(segments(outline, *things[what]), pose, bearing=scan.bearing_rad)
    empty = beams.ranges(segments(outline), pose, bearing=scan.bearing_rad)
    np.testing.assert_allclose(scan.range_m, exact, atol=2e-5)
    seen = {"legs": (4, 30), "top": (25, 120), "nothing": (0, 0)}[what]
    assert seen[0] <= (exact < empty - 1e-6).sum() <= seen[1]


def robot(height_m: float, radius_m: float = 0.1) -> RobotConfig:
    """A robot of a height."""
    made = RobotConfig(radius_m=radius_m, mast_m=height_m - 0.15 * radius_m, camera=None)
    assert made.height_m == pytest.approx(height_m, abs=1e-12)
    return made


@pytest.mark.parametrize("world", [KinematicWorld, World])
def test_a_robot_drives_under_what_is_higher_and_stops_at_what_is_lower(world):
    """Tables of 0.71 and 0.47 m clearance, robots of 0.6 m: the first is passed, the second stops the hull."""
    ends = {}
    for top_m in (0.74, 0.5):
        simulated = world(furnished(table(yaw=0.0, height_m=top_m)), robot=robot(0.6))
        simulated.reset(np.array([1.0, 2.0, 0.0]))
        for _ in range(16):
            motion = simulated.move(np.array([0.25, 0.0, 0.0]))
            assert motion.penetration_m < 5e-3
        ends[top_m] = simulated.pose[0], motion.collided
    assert ends[0.74] == (pytest.approx(5.0, abs=0.01), False)
    exact = 3.0 - 0.8 - 0.1
    assert ends[0.5] == (pytest.approx(exact, abs=1e-8 if world is KinematicWorld else 2e-3), True)


@pytest.mark.parametrize("world", [KinematicWorld, World])
def test_a_leg_stops_a_robot_that_the_top_lets_pass(world):
    """On the line of a leg, whose face is 2.2 m along x."""
    simulated = world(furnished(table(yaw=0.0)), robot=robot(0.6))
    simulated.reset(np.array([1.0, 2.0 - 0.5 + 0.03, 0.0]))
    for _ in range(8):
        simulated.move(np.array([0.25, 0.0, 0.0]))
    assert simulated.pose[0] == pytest.approx(2.1, abs=1e-8 if world is KinematicWorld else 2e-3)


def test_a_robot_as_high_as_the_clearance_just_passes():
    """And a hundredth of a millimetre more is too much."""
    for height_m, floor_m2 in ((0.71, 4 * 0.06**2), (0.71 + 1e-5, 1.6)):
        taken = furnished().taken(height_m)
        assert taken.area == pytest.approx(floor_m2, abs=1e-5)


def test_nowhere_does_a_hull_come_nearer_than_its_radius():
    """Random moves among pieces, in both physics: the centre keeps a radius from all that is lower than the robot."""
    pieces = [
        make_piece("table", at=(1.5, 1.2), yaw_rad=0.5),
        make_piece("chair", at=(1.5, 2.2), yaw_rad=2.6),
        make_piece("plant", at=(3.3, 2.8)),
        make_piece("sofa", at=(4.6, 3.2), yaw_rad=3.0),
        make_piece("shelf", at=(4.8, 1.0), yaw_rad=1.2),
    ]
    building = furnished(*pieces)
    for world, deepest_m in ((KinematicWorld, 1e-7), (World, 5e-3)):
        for height_m in (0.3, 1.25):
            simulated = world(building, robot=robot(height_m))
            rng = np.random.default_rng(3)
            edge = building.floor(height_m).boundary
            simulated.reset(np.array([*reach(building, 0.1, height_m).widest(), 0.0]))
            bumps = 0
            for _ in range(120):
                motion = simulated.move(np.array([0.25, 0.0, rng.uniform(-0.8, 0.8)]))
                bumps += motion.collided
                assert shapely.distance(shapely.Point(simulated.pose[:2]), edge) > 0.1 - deepest_m
            assert bumps > 5


@pytest.mark.parametrize("height_m", [0.2, 0.5, 0.63, 0.9])
def test_a_footprint_is_the_shadow_of_what_is_lower(height_m):
    """A convex body that hangs at 0.3 to 0.9 m: the hull of its corners below the height and of its section there."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.3)
    hanging = Furnishing(mesh=sphere, at=(0.4, -0.2), z_m=0.6, yaw_rad=0.3)
    shadow = footprint(hanging.bodies, height_m)
    below = sphere.slice_plane((0, 0, height_m - 0.6), (0, 0, -1)).vertices
    hull = (
        shapely.convex_hull(shapely.MultiPoint(hanging.to_map(below)[:, :2]))
        if len(below)
        else shapely.Point()
    )
    assert shadow.symmetric_difference(hull).area < 1e-9
    assert (shadow.area == 0) == (height_m < 0.3)


def test_what_a_level_fills_is_the_section_there():
    """A solid ring (torus) of 0.5 and 0.1 m: an annulus of closed form, with its hole; inside out it is the same."""
    torus = trimesh.creation.torus(0.5, 0.1, major_sections=256, minor_sections=128)
    lying = Furnishing(mesh=torus, at=(0.0, 0.0), z_m=0.1)
    half = np.sqrt(0.1**2 - 0.05**2)
    exact = np.pi * ((0.5 + half) ** 2 - (0.5 - half) ** 2)
    for mesh in (torus, trimesh.Trimesh(torus.vertices, torus.faces[:, ::-1], process=False)):
        one = replace(lying, mesh=mesh)
        assert one.bodies.oriented.all()
        assert filled(one.bodies, 0.15).area == pytest.approx(exact, rel=2e-3)
        assert len(filled(one.bodies, 0.15).interiors) == 1
        assert footprint(one.bodies, 1.0).area == pytest.approx(np.pi * (0.6**2 - 0.4**2), rel=1e-3)


def test_sheets_count_with_a_millimetre():
    """An upright board of no thickness, 0.8 m long: it stops robots, and is seen from both sides."""
    corners = np.array([[-0.4, 0, 0], [0.4, 0, 0], [0.4, 0, 1], [-0.4, 0, 1.0]])
    board = Furnishing(mesh=trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False), at=(3.0, 2.0))
    building = furnished(board)
    assert building.taken(1.0).area == pytest.approx(0.8e-3, rel=0.01)
    simulated = KinematicWorld(building)
    simulated.reset(np.array([3.0, 1.0, np.pi / 2]))
    for _ in range(6):
        simulated.move(np.array([0.25, 0.0, 0.0]))
    assert simulated.pose[1] == pytest.approx(2.0 - 0.0005 - 0.1, abs=1e-6)
    config = CameraConfig(width=32, height=32, height_m=0.5)
    with make_camera([shaded_mesh(building)], config) as camera:
        for y, yaw in ((1.0, np.pi / 2), (3.0, -np.pi / 2)):
            assert camera.render(camera_pose(np.array([3.0, y, yaw]), config)).depth[16, 16] == pytest.approx(
                1.0, abs=1e-5
            )


def test_a_low_robot_maps_what_stops_it_and_nothing_else(building):
    """The scan of a robot of 0.3 m before a table: legs and walls, never the top, which hangs at 0.71 m.

    To a robot of 1.25 m the top in the same picture is an obstacle nearer than the legs behind.
    """
    config = CameraConfig(width=128, height=128, height_m=0.28)
    T = camera_pose(np.array([0.8, 1.1, 0.3]), config)
    with make_camera([shaded_mesh(building)], config) as camera:
        depth = camera.render(T).depth
    low, high = (scan_from_depth(depth, config, Band(high_m=top)) for top in (0.4, 1.35))
    outline = np.array([[0, 0], [WIDTH, 0], [WIDTH, DEPTH], [0, DEPTH]])
    bearing = np.arctan(low.left.astype(float))
    exact = beams.ranges(
        segments(outline, *(ring(*leg) for leg in legs_m())), np.array([0.8, 1.1, 0.3]), bearing=bearing
    )
    range_m = low.depth_m * np.hypot(1, low.left)
    # Columns on the edge of a leg may go to either side.
    assert (np.abs(range_m - exact) < 0.02)[np.isfinite(low.depth_m)].mean() > 0.95
    assert (high.depth_m < low.depth_m - 0.1).sum() > 10


def test_the_truth_about_the_floor_depends_on_the_robot(building):
    """What is reached, what the truthful map calls an obstacle, and how far it is to drive."""
    under, standing = (reach(building, 0.1, height_m) for height_m in (0.6, 1.25))
    assert under.part_at(AT) and not standing.part_at(AT)
    assert under.overhung.sum() * 0.05**2 == pytest.approx(1.6 - 4 * 0.06**2, rel=0.05)
    assert not standing.overhung.any()
    for height_m, taken in ((0.6, False), (1.25, True)):
        estimate = TrueMapper(building, lambda: np.zeros(3), height_m).estimate()
        iy, ix = estimate.frame.index(AT[None])
        assert bool(estimate.obstacle[iy[0], ix[0]]) is taken
    straight, around = (
        make_task(one, np.random.default_rng(0), start=np.array([1.0, 2.0, 0.0]), target=np.array([5.0, 2.0]))
        for one in (under, standing)
    )
    assert straight.shortest_m == pytest.approx(3.7, abs=0.06)  # a cell
    assert around.shortest_m > 3.8


def test_nothing_is_drawn_into_things(building):
    """Targets of 60 tasks stand clear of the table, though the robot fits under it.

    So do transmitters and receivers at the height of its top; higher ones stand over it.
    """
    clear = building.floor(HEIGHT)
    places = reach(building, 0.1, 0.6)
    for seed in range(60):
        task = make_task(places, np.random.default_rng(seed), min_path_m=1.0)
        assert clear.contains(shapely.Point(task.target))
    for height_m, count in ((0.73, 0), (1.0, 5)):
        top = shapely.Polygon(ring(-np.array([0.8, 0.5]), np.array([0.8, 0.5])))
        sent = random_transmitters(building, 200, height_m, np.random.default_rng(1))
        received = receiver_grid(building, 0.15, height_m).position
        for points in (sent, received):
            inside = shapely.contains_xy(top, points[:, :2]).sum()
            assert inside == 0 if count == 0 else inside > count
    scene = RadioScene(replace(room(WIDTH, DEPTH), furnishings=(table(),)), RadioConfig(height_m=0.73))
    with pytest.raises(
        ValueError, match=r"tx is \(3, 2\) m, outside of the free space of room at this height"
    ):
        scene.places(((3.0, 2.0),), "tx")
    assert len(scene.places(((3.0, 2.0, 0.8),), "tx")) == 1


WOOD = 1.99 - 1j * 0.0047 * 28**1.0718 / (2 * np.pi * 28e9 * 8.8541878128e-12)


def test_a_link_over_a_table_is_the_image_of_its_top(building):
    """Two rays: the path over the top is as long as from the mirrored transmitter, and as weak as Fresnel says.

    The ratio is that of a field in the plane of incidence, of wood by ITU-R P.2040. Lengths agree to 1e-9 m, gains to
    1e-5 of theirs.
    """
    tx, rx = np.array([2.6, 1.9, 1.2]), np.array([3.5, 2.15, 1.0])
    tracer = Tracer(building, config=TracerConfig(max_reflections=1, diffraction=False))
    assert isinstance(tracer.scene, SpaceScene)
    paths = tracer.trace(tx[None], rx[None])
    bounced = np.flatnonzero((paths.order == 1) & np.isclose(paths.point[:, 0, 2], TABLE.height_m))
    assert len(bounced) == 1
    image = tx * (1, 1, -1) + (0, 0, 2 * TABLE.height_m)
    length = np.linalg.norm(rx - image)
    assert paths.delay_s[bounced[0]] * speed_of_light == pytest.approx(length, abs=1e-9)
    cos_i = (tx[2] + rx[2] - 2 * TABLE.height_m) / length
    root = np.sqrt(WOOD - (1 - cos_i**2))
    ratio = (WOOD * cos_i - root) / (WOOD * cos_i + root)
    exact = speed_of_light / 28e9 / (4 * np.pi * length) * abs(ratio)
    gain = np.abs(paths.gain[bounced[0]]).reshape(-1)
    assert gain[0] == pytest.approx(exact, rel=1e-5)
    at = paths.point[bounced[0], 0]
    share = (tx[2] - TABLE.height_m) / (tx[2] + rx[2] - 2 * TABLE.height_m)
    np.testing.assert_allclose(at[:2], tx[:2] + share * (rx - tx)[:2], atol=1e-9)


@pytest.mark.parametrize(
    ("rx", "seen"),
    [((3.2, 2.0, 0.4), False), ((5.0, 2.0, 0.6), True), ((2.4, 1.75, 0.9), True), ((3.0, 2.0, 0.70), False)],
)
def test_a_table_blocks_sight_as_geometry_says(building, rx, seen):
    """From (1, 2, 1.5): into its shadow, over its edge, and onto its top; by the slab method too."""
    tx = np.array([1.0, 2.0, 1.5])
    rx = np.array(rx)
    c, s = np.cos(-YAW), np.sin(-YAW)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    a, b = turn @ (tx - [*AT, 0]), turn @ (rx - [*AT, 0])
    x, y = TABLE.width_m / 2, TABLE.depth_m / 2
    enter, leave = slab(a, b - a, np.array([-x, -y, TABLE.clearance_m]), np.array([x, y, TABLE.height_m]))
    assert bool(enter < leave and enter < 1) != seen
    paths = Tracer(building, config=TracerConfig(max_reflections=0, diffraction=False)).trace(
        tx[None], rx[None]
    )
    assert (len(paths) == 1) == seen


def test_under_the_table_radio_goes_on_as_between_boards(building):
    """Two terminals below the top have line of sight, and its underside and the floor as mirrors."""
    tx, rx = np.array([2.6, 1.9, 0.3]), np.array([3.4, 2.1, 0.4])
    config = TracerConfig(max_reflections=1, diffraction=False, floor_ceiling=True, max_paths=100)
    paths = Tracer(building, config=config).trace(tx[None], rx[None])
    z = paths.point[paths.order == 1, 0, 2]
    assert (paths.order == 0).sum() == 1
    assert np.isclose(z, TABLE.clearance_m).sum() == 1
    assert np.isclose(z, 0.0).sum() == 1
    assert not np.isclose(z, HEIGHT).any()  # the ceiling is behind the top
    assert not np.isclose(z, TABLE.height_m).any()


def test_a_table_edge_bends_waves_into_its_shadow(building):
    """Behind the top no ray is direct, and the strongest is bent at one of its edges, at its height."""
    tx, rx = np.array([[1.0, 2.0, 1.5]]), np.array([[3.2, 2.0, 0.4]])
    paths = Tracer(building, config=TracerConfig(max_reflections=0, diffraction_reflections=0)).trace(tx, rx)
    assert len(paths) > 0
    assert (paths.interaction[:, 0] == Interaction.DIFFRACTION).all()
    heights = paths.point[:, 0, 2]
    assert np.any(np.isclose(heights, TABLE.height_m) | np.isclose(heights, TABLE.clearance_m))


def test_without_things_a_plan_stays_a_plan(building, caplog):
    """And a pillar up to the ceiling is still one: the fast engine is left only where it must be, and says so."""
    caplog.set_level("INFO")
    assert isinstance(Tracer(building.bare).scene, PlanScene)
    pillar = make_piece("cupboard", at=(3.0, 2.0), height_m=HEIGHT, material="partition")
    assert isinstance(Tracer(furnished(pillar)).scene, PlanScene)
    assert "in space" not in caplog.text
    Tracer(building)
    assert "no extruded floor plan: it is traced in space" in caplog.text


def test_bare_is_the_building_without_them(building):
    """Shell, materials of its faces and free floor are those of an empty room."""
    empty = make_building(room(WIDTH, DEPTH), config=BuildingConfig(tolerance_m=0.0))
    assert building.floor(0.3) is not building.free
    assert empty.floor(0.3) is empty.free
    np.testing.assert_array_equal(building.bare.mesh.vertices, empty.mesh.vertices)
    np.testing.assert_array_equal(building.bare.mesh.faces, empty.mesh.faces)
    np.testing.assert_array_equal(building.walls_2d, empty.walls_2d)
    names = [str(building.materials[i]) for i in building.face_material[building.face_kind == PLACED]]
    assert set(names) == {"wood"}
    assert building.of_material("wood").area == pytest.approx(table().mesh.area)


def test_exported_meshes_have_them(building, tmp_path):
    """Each thing is an object of its own in GLB, at its height and in its colour."""
    scene = trimesh.load(export_mesh(building, tmp_path / "building.glb"))
    part = scene.geometry["1 table"]
    assert part.bounds[1, 2] == pytest.approx(TABLE.height_m, abs=1e-6)
    assert (part.visual.vertex_colors[:, :3] == building.furnishings[0].colour).all()
    import mujoco

    model = mujoco.MjModel.from_xml_path(
        str(export_mjcf(building, tmp_path / "room.xml", robot=robot(0.6), pose=np.array([*AT, 0.0])))
    )
    assert model.nmesh >= 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"at": (9.0, 2.0)},
            "table at (9, 2) m stands in a wall or outside of the building; the nearest free floor",
        ),
        ({"z_m": -0.1}, "reaches 0.1 m below the floor, expected z = 0 or more. Give it z_m: 0.1."),
        ({"z_m": 2.0}, "reaches to 2.74 m, expected at most the ceiling at 2.5 m."),
    ],
)
def test_a_thing_that_cannot_be_there_is_rejected(change, words):
    with pytest.raises(MapError) as rejected:
        furnished(replace(table(), **change))
    assert words in str(rejected.value)
