"""The robot in its building: accuracy of moves, walls that hold, and the same again.

Distances from walls are judged by GEOS, on the outline that the building was made from.
"""

import subprocess
import sys
from dataclasses import replace

import mujoco
import numpy as np
import pytest
import shapely

import robosim.robot.dynamic as world_module
from robosim.building.building import Building, make_building
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.collision import WallSolids, solids
from robosim.robot.dynamic import PhysicsConfig, World
from robosim.robot.odometry import NoiseModel
from robosim.robot.robots import RobotConfig
from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.poses import between
from tests.plans import room
from tests.robots import ROBOTS

AHEAD = np.array([FORWARD_M, 0.0, 0.0])
LEFT = np.array([0.0, 0.0, TURN_RAD])
#: The bar of the whole project: no hull deeper in a wall than this.
DEEPEST_M = 5e-3


def cluttered(**kwargs) -> FloorPlan:
    """A hall of 5 m by 5 m with columns of all sizes, ragged walls, and convex and concave corners."""
    rng = np.random.default_rng(7)
    occupancy = np.full((100, 100), FREE, np.uint8)
    for x, y, w, h in zip(*rng.integers(8, 88, (2, 9)), *rng.integers(1, 16, (2, 9)), strict=True):
        occupancy[y : y + h, x : x + w] = OCCUPIED
    iy, ix = np.indices(occupancy.shape)
    occupancy[ix + iy < 25] = OCCUPIED
    return FloorPlan(occupancy=occupancy, **{"resolution_m": 0.05, "name": "cluttered", **kwargs})


def turned_to(x: float, y: float, yaw_deg: float) -> np.ndarray:
    return np.array([x, y, np.radians(yaw_deg)])


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_moves_end_where_they_were_sent(name):
    """0.25 m ahead, 10 degrees, and both with slip: within 0.15 mm and 0.01 degrees, in fewer than 200 steps."""
    world = World(make_building(room()), robot=ROBOTS[name])
    world.reset(turned_to(2.0, 1.5, 17))
    for wanted in (
        AHEAD,
        LEFT,
        -LEFT,
        -AHEAD,
        [0.2456, -0.002, -2e-4],
        [-0.0015, 0.0196, 0.1965],
        [0.1, -0.05, 0.5],
    ):
        before = world.pose
        motion = world.move(np.array(wanted))
        error = between(before, motion.pose) - wanted
        assert np.hypot(*error[:2]) < 1.5e-4 and abs(error[2]) < np.radians(0.01)
        assert not motion.collided and motion.penetration_m == 0
        assert motion.physics_steps < 200
        assert motion.duration_s == pytest.approx(motion.physics_steps * 0.005)
    assert (world.move(np.zeros(3)).pose == world.pose).all()


def test_noise_survives_the_physics():
    """Without obstacles, motions are the noise model's samples: errors are 1/10 of its deviations."""
    world, rng, noise = World(make_building(room(8, 8))), np.random.default_rng(0), NoiseModel()
    errors = []
    for k in range(60):
        if k % 6 == 0:
            world.reset(np.array([4.0, 4.0, rng.uniform(-3, 3)]))
        wanted = noise.actuation(Action(int(rng.integers(3))), rng)
        before = world.pose
        errors.append(between(before, world.move(wanted).pose) - wanted)
    assert (np.abs(errors).max(axis=0) < [2e-4, 2e-4, np.radians(0.02)]).all()


def test_poses_go_in_and_come_out_exactly():
    """Also 10 km from the origin, on a turned plan: within 1e-9 m and rad; yaw wrapped to [-pi, pi)."""
    for origin in ((0.0, 0.0, 0.0), (1e4, -1e4, 0.7)):
        plan = room(origin=origin)
        world = World(make_building(plan))
        for yaw in (-np.pi, -1.0, 0.0, 3.1, np.pi, 7.0):
            pose = np.append(plan.to_map(np.array([30.0, 25.0])), yaw)
            world.reset(pose)
            np.testing.assert_allclose(world.pose[:2], pose[:2], rtol=0, atol=1e-9)
            assert -np.pi <= world.pose[2] < np.pi
            assert np.exp(1j * world.pose[2]) == pytest.approx(np.exp(1j * yaw), abs=1e-9)


def test_physics_does_not_feel_where_the_plan_lies():
    """The same drive against a wall at the origin and 10 km away: the same within 1e-6 m."""
    ends = []
    for x, y in ((0.0, 0.0), (1e4, -2e4)):
        world = World(make_building(room(origin=(x, y, 0.0))))
        world.reset(np.array([x + 3.5, y + 1.5, 0.4]))
        for wanted in (AHEAD, AHEAD, LEFT):
            world.move(wanted)
        ends.append(world.pose - [x, y, 0.0])
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-6)


DRIVES = """
import numpy as np
from robosim.building.building import make_building
from robosim.robot.dynamic import World
from tests.robosim.robot.test_world import cluttered, turned_to, errands
world = World(make_building(cluttered()))
print(errands(world, seed=3).hex())
"""


def errands(world: World, seed: int) -> bytes:
    """The poses of a few moves and drives among walls, bit for bit."""
    rng = np.random.default_rng(seed)
    world.reset(turned_to(2.5, 2.6, 40))
    poses = []
    for _ in range(12):
        poses.append(world.move(AHEAD + rng.normal(0, 0.005, 3)).pose)
        poses.append(world.drive(rng.uniform(-0.5, 0.5), rng.uniform(-3, 3), 0.33).pose)
    return np.array(poses).tobytes()


def test_the_same_again_bit_for_bit():
    """After a reset, whatever was before; in another world; in another process."""
    building = make_building(cluttered())
    world = World(building)
    first = errands(world, 3)
    errands(world, 4)
    assert errands(world, 3) == first
    assert errands(World(building), 3) == first
    run = subprocess.run([sys.executable, "-c", DRIVES], capture_output=True, text=True, check=True, cwd=".")
    assert run.stdout.strip() == first.hex()


def test_walls_that_sleep_change_no_motion(monkeypatch):
    """Sixty moves along and into walls end alike bit by bit, whether walls are worked out at each step or not.

    At least 5 of them meet a wall.
    """

    def drive() -> tuple[np.ndarray, bool]:
        world, rng = World(make_building(cluttered())), np.random.default_rng(3)
        world.reset(turned_to(2.4, 4.6, 0))
        motions = [world.move((AHEAD, AHEAD, LEFT, -LEFT)[rng.integers(4)]) for _ in range(60)]
        rows = np.array([[*one.pose, one.collided, one.penetration_m, one.physics_steps] for one in motions])
        return rows, bool(world.model.opt.enableflags & mujoco.mjtEnableBit.mjENBL_SLEEP)

    asleep, sleeps = drive()
    monkeypatch.setattr(world_module, "_let_walls_sleep", lambda model: None)
    awake, watches = drive()
    assert (sleeps, watches) == (True, False)
    assert asleep[:, 3].sum() >= 5  # walls were met
    np.testing.assert_array_equal(asleep, awake)


@pytest.mark.parametrize("name", sorted(ROBOTS))
@pytest.mark.parametrize("wall_line", ["cell_edge", "cell_centre"])
def test_walls_hold_against_any_driving(name, wall_line, monkeypatch):
    """105 reckless moves among columns, corners and slopes: never deeper than 5 mm in a wall."""
    robot = ROBOTS[name]
    building = make_building(cluttered(wall_line=wall_line))
    world, rng = World(building, robot=robot), np.random.default_rng(1)
    lines, places = building.free.boundary, building.free.buffer(-robot.hull.radius_m - 1e-3)
    collided, states, step = 0, [], mujoco.mj_step

    def watched(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        step(model, data)
        states.append(np.append(data.joint("robot").qpos, np.hypot(*data.joint("robot").qvel[:2])))

    monkeypatch.setattr(mujoco, "mj_step", watched)
    for k in range(105):
        if k % 15 == 0:
            world.reset(_draw(places, rng))
        kind = rng.random()
        if kind < 0.5:
            motion = world.move(AHEAD + rng.normal(0, [0.05, 0.01, 0.02]))
        elif kind < 0.7:
            motion = world.move(np.array([0.0, rng.choice([-0.03, 0.03]), rng.choice([-0.2, 0.2])]))
        else:
            motion = world.drive(rng.uniform(-0.6, 0.6), rng.uniform(-5, 5), rng.uniform(0.1, 1.5))
        collided += motion.collided
        depth_m = robot.hull.radius_m - shapely.distance(shapely.Point(motion.pose[:2]), lines)
        assert building.free.contains(shapely.Point(motion.pose[:2]))
        assert depth_m < DEEPEST_M and motion.penetration_m < DEEPEST_M
        assert depth_m < motion.penetration_m + 1.5e-3  # a tilted hull is not quite above the axle
    assert collided > 20
    _, _, height, _, qx, qy, _, speed = np.array(states).T
    assert np.abs(height).max() < 5e-3 and np.degrees(2 * np.hypot(qx, qy).max()) < 4
    assert speed.max() < 0.6


def _draw(places: shapely.Geometry, rng: np.random.Generator) -> np.ndarray:
    x0, y0, x1, y1 = places.bounds
    while True:
        x, y = rng.uniform([x0, y0], [x1, y1])
        if shapely.contains_xy(places, x, y):
            return np.array([x, y, rng.uniform(-np.pi, np.pi)])


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_a_blocked_robot_gives_up_and_stands_still(name):
    """Head on into a wall: collided, touching it within 1 mm, and at rest: within 0.1 mm for a second."""
    robot = ROBOTS[name]
    world = World(make_building(room()), robot=robot)
    world.reset(np.array([4 - robot.hull.radius_m - 0.1, 1.5, 0.0]))
    motion = world.move(AHEAD)
    assert motion.collided and 0 < motion.penetration_m < DEEPEST_M
    assert motion.pose[0] == pytest.approx(4 - robot.hull.radius_m, abs=1e-3)
    assert motion.physics_steps < 200
    later = world.drive(0.0, 0.0, 1.0).pose
    np.testing.assert_allclose(later, motion.pose, rtol=0, atol=1e-4)
    again = world.move(AHEAD)
    assert again.collided and again.physics_steps < 60


@pytest.mark.parametrize("name", sorted(ROBOTS))
@pytest.mark.parametrize("pushes_deg", [0, 40, 70])
def test_a_robot_at_a_wall_can_turn_and_leave(name, pushes_deg):
    """Pressed against a wall it turns by 10 degrees within 0.1, and after 18 turns drives away freely."""
    world = World(make_building(room()), robot=ROBOTS[name])
    world.reset(turned_to(3.7, 1.5, pushes_deg))
    for _ in range(3):
        world.move(AHEAD)
    for _ in range(18):
        before = world.pose
        motion = world.move(LEFT)
        assert abs(between(before, motion.pose)[2] - TURN_RAD) < np.radians(0.1)
        assert not motion.collided
    before = world.pose
    motion = world.move(AHEAD)
    assert not motion.collided
    assert between(before, motion.pose)[0] == pytest.approx(FORWARD_M, abs=1e-3)


def test_slip_into_a_wall_is_stopped_by_it():
    """A turn that slips 2 cm to the left, with a wall 5 mm to the left: it turns, but slips no further."""
    world = World(make_building(room()))
    world.reset(np.array([2.0, 3 - 0.105, 0.0]))
    motion = world.move(np.array([0.0, 0.02, TURN_RAD]))
    assert motion.pose[2] == pytest.approx(TURN_RAD, abs=np.radians(0.1))
    assert motion.pose[1] == pytest.approx(3 - 0.1, abs=1e-3)
    assert motion.collided and motion.penetration_m < 2e-3


def split(boxes: int):
    """`solids` with the upper wall of a room cut into that many boxes."""

    def pieces(building: Building, height_m: float) -> WallSolids:
        whole = solids(building, height_m).boxes
        upper = int(np.argmax(whole[:, 1]))
        x, y, half, thick, yaw = whole[upper]
        parts = np.linspace(x - half, x + half, 2 * boxes + 1)[1::2]
        cut = np.column_stack([parts, *np.full((4, boxes), [[y], [half / boxes], [thick], [yaw]])])
        return WallSolids(np.vstack([np.delete(whole, upper, axis=0), cut]))

    return pieces


def test_seams_between_pieces_do_not_snag(monkeypatch):
    """Sliding 1.5 m along a wall of 1 box or of 240: the same distance within 3 cm, at a steady pace."""
    ends = {}
    for boxes in (1, 240):
        monkeypatch.setattr(world_module, "solids", split(boxes))
        world = World(make_building(room()))
        assert world.model.ngeom > boxes
        world.reset(turned_to(1.0, 3 - 0.101, 12))
        drive = [world.drive(0.4, 0.0, 0.5) for _ in range(8)]
        assert max(motion.penetration_m for motion in drive) < DEEPEST_M
        ends[boxes] = np.array([motion.pose for motion in drive])
    ahead = np.diff(ends[240][1:, 0])
    assert ends[1][-1, 0] - 1.0 > 1.3
    assert ahead.min() > 0.9 * ahead.max()
    np.testing.assert_allclose(ends[240][:, 0], ends[1][:, 0], rtol=0, atol=0.03)


def test_thin_walls_are_not_tunnelled_through():
    """A wall one cell of 1 cm thick, hit at full speed from both sides, straight and aslant."""
    occupancy = np.full((200, 200), FREE, np.uint8)
    occupancy[:, 100] = OCCUPIED
    building = make_building(FloorPlan(occupancy=occupancy, resolution_m=0.01, name="thin"))
    world = World(building)
    for side, yaw_deg in ((-1, 0), (-1, 30), (1, 180), (1, 150)):
        world.reset(turned_to(1.005 + side * 0.3, 0.7, yaw_deg))
        for _ in range(3):
            motion = world.drive(0.5, 0.0, 0.5)
            assert motion.penetration_m < DEEPEST_M
        assert side * (world.pose[0] - 1.005) > 0.1


def test_driving_follows_the_arc():
    """Once at speed, one second at (v, w) is an arc: x = v / w sin w, y = v / w (1 - cos w). Bound 1 mm."""
    world = World(make_building(room(6, 6)))
    world.reset(np.array([3.0, 2.0, 0.0]))
    world.drive(0.3, 0.8, 0.5)
    before = world.pose
    motion = world.drive(0.3, 0.8, 1.0)
    arc = np.array([0.3 / 0.8 * np.sin(0.8), 0.3 / 0.8 * (1 - np.cos(0.8)), 0.8])
    np.testing.assert_allclose(between(before, motion.pose), arc, rtol=0, atol=1e-3)
    assert not motion.collided and motion.physics_steps == 200
    # A move begins with a stop, and counts it.
    stop = world.move(np.zeros(3))
    assert stop.physics_steps > 10
    after = world.drive(0.0, 0.0, 0.5)
    np.testing.assert_allclose(after.pose, stop.pose, rtol=0, atol=1e-4)


@pytest.mark.parametrize("timestep_s", [0.001, 0.002, 0.01])
def test_other_time_steps_work(timestep_s):
    """From 1 to 10 ms: moves end within 0.5 mm and 0.05 degrees, and walls hold."""
    world = World(make_building(room()), config=PhysicsConfig(timestep_s=timestep_s))
    world.reset(turned_to(3.0, 1.5, 0))
    for wanted in (AHEAD, LEFT, -LEFT):
        before = world.pose
        error = between(before, world.move(wanted).pose) - wanted
        assert np.hypot(*error[:2]) < 5e-4 and abs(error[2]) < np.radians(0.05)
    deepest = max(world.move(AHEAD).penetration_m for _ in range(4))
    assert 0 < deepest < DEEPEST_M


def test_real_buildings_hold(shared):
    """Slanted and exact outlines of a real building: reckless moves stay within 5 mm; measured 2.5 mm."""
    from robosim.building.building import BuildingConfig
    from robosim.plans.files import read_plan

    (path,) = shared.glob("maps/gibson/*/Nemacolin.glb_topdownmap.out")
    for tolerance_m in (0.0, 0.05):
        building: Building = make_building(read_plan(path), config=BuildingConfig(tolerance_m=tolerance_m))
        world, rng = World(building), np.random.default_rng(2)
        places = max(building.free.buffer(-0.101).geoms, key=lambda part: part.area)
        for k in range(48):
            if k % 8 == 0:
                world.reset(_draw(places, rng))
            motion = world.move(AHEAD * rng.uniform(0.5, 2) + rng.normal(0, [0, 0.01, 0.3]))
            gap_m = shapely.distance(shapely.Point(motion.pose[:2]), building.free.boundary)
            assert gap_m > 0.1 - DEEPEST_M and motion.penetration_m < DEEPEST_M


def test_bad_requests_are_errors():
    world = World(make_building(room()))
    with pytest.raises(ValueError, match="nearest wall"):
        world.reset(np.array([0.05, 1.0, 0.0]))
    world.reset(np.array([1.0, 1.0, 0.0]))
    with pytest.raises(ValueError, match="displacement"):
        world.move(np.array([np.nan, 0.0, 0.0]))
    with pytest.raises(ValueError, match="duration_s"):
        world.drive(0.1, 0.0, -1.0)
    with pytest.raises(ValueError, match="finite speeds"):
        world.drive(np.inf, 0.0, 1.0)


def test_any_outline_can_be_driven_in():
    """A building whose outline follows no lattice: an octagon. The wall holds where it is slanted."""
    building = make_building(room())
    corners = [(1, 0), (3, 0), (4, 1), (4, 2), (3, 3), (1, 3), (0, 2), (0, 1)]
    octagon = replace(building, free=shapely.MultiPolygon([shapely.Polygon(corners)]))
    world = World(octagon)
    world.reset(turned_to(3.0, 1.0, -45))
    for _ in range(4):
        motion = world.move(AHEAD)
    assert motion.collided
    assert shapely.distance(shapely.Point(motion.pose[:2]), octagon.free.boundary) == pytest.approx(
        0.1, abs=1e-3
    )


def test_bodies_too_heavy_to_turn_for_their_motors_are_reported(caplog):
    """A disk of 1 m in radius on wheels 0.16 m apart turns by 16 degrees instead of 10; the default is fine."""
    for radius_m, expected in ((0.1, 0), (1.0, 1)):
        world = World(make_building(room()), robot=RobotConfig(radius_m=radius_m))
        world.reset(turned_to(2.0, 1.5, 17))
        for _ in range(2):
            world.move(LEFT)
        assert caplog.text.count("degrees off its goal") == expected
