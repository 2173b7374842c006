"""Hulls with an outline in a building, against exact intersections of polygons."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from robosim.building.building import Building, make_building
from robosim.building.reach import HEADINGS, reach
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.plans.floorplan import FREE, OCCUPIED
from robosim.robot.calibration import open_floor
from robosim.robot.collision import check_pose, depth_in, hull_at
from robosim.robot.dynamic import World
from robosim.robot.kinematic import KinematicWorld
from robosim.robot.named import JACKAL, TURTLEBOT3_WAFFLE
from robosim.robot.robots import RobotConfig
from robosim.task.tasks import make_task
from slam.hull import Hull
from tests.plans import room, two_rooms
from tests.robosim.robot.test_world import cluttered

KITE = RobotConfig(outline_m=((-0.2, 0.0), (0.0, -0.12), (0.15, 0.0), (0.0, 0.12)), track_m=0.14)
RECTANGLE = RobotConfig(outline_m=((-0.25, -0.1), (0.15, -0.1), (0.15, 0.1), (-0.25, 0.1)))


@pytest.fixture(scope="module")
def hall() -> Building:
    return make_building(cluttered(wall_line="cell_centre"))


@pytest.mark.parametrize("robot", [KITE, RECTANGLE])
def test_reach_is_where_the_polygon_fits_at_some_heading(hall: Building, robot: RobotConfig) -> None:
    places = reach(hall, *robot.hull_m)
    rng = np.random.default_rng(0)
    looser, tighter = shapely.buffer(hall.free, 1e-6), shapely.buffer(hall.free, -1e-6)
    shapely.prepare([looser, tighter])
    cells = np.argwhere(hall.plan.free)
    found = {True: 0, False: 0}
    for row, column in rng.permutation(cells)[:150]:
        x, y = hall.plan.to_map(np.array([column, row]) + 0.5)
        yaws = np.arange(HEADINGS) * 2 * np.pi / HEADINGS
        hulls = [hull_at(robot.hull, np.array([x, y, yaw])) for yaw in yaws]
        fits = shapely.covers(tighter, hulls).any()
        if fits != shapely.covers(looser, hulls).any():
            continue  # it fits exactly
        assert fits == (places.parts[row, column] > 0)
        found[bool(fits)] += 1
    assert min(found.values()) > 10


def test_rooms_are_joined_by_a_door_that_is_wide_enough() -> None:
    """The rectangle is 0.2 m wide, and cells are 0.05 m."""
    assert reach(make_building(two_rooms(0.3)), *RECTANGLE.hull_m).n_parts == 1
    assert reach(make_building(two_rooms(0.1)), *RECTANGLE.hull_m).n_parts == 2


def test_a_corner_too_narrow_to_turn_in_divides_the_floor() -> None:
    """An L of corridors of width w = 0.3 m: of a rectangle of width b = 0.2 m, 2 (w sqrt(2) - b) = 0.45 m pass at most.

    At 45 degrees its long side touches the inner corner as both outer corners touch the outer walls.
    """
    plan = room(2.0, 2.0)
    free = np.zeros(plan.shape, bool)
    free[1:7, 1:-1] = free[1:-1, 1:7] = True
    plan = replace(plan, occupancy=np.where(free, FREE, OCCUPIED).astype(np.uint8))
    long = replace(RECTANGLE, outline_m=((-0.35, -0.1), (0.35, -0.1), (0.35, 0.1), (-0.35, 0.1)))
    assert reach(make_building(plan), *long.hull_m).n_parts == 2
    assert reach(make_building(plan), 0.1).n_parts == 1


@pytest.mark.parametrize("robot", [KITE, RECTANGLE])
def test_the_kinematic_polygon_stops_at_walls(hall: Building, robot: RobotConfig) -> None:
    world = KinematicWorld(hall, robot=robot)
    walls, rng, stopped = hall.free.boundary, np.random.default_rng(1), 0
    world.reset(np.array([*reach(hall, robot.hull.turning_m).widest(), 0.3]))
    for _ in range(400):
        ahead = rng.random() < 0.5
        step = [rng.uniform(-0.3, 0.4), 0.0, 0.0] if ahead else [0.0, 0.0, rng.uniform(-0.6, 0.6)]
        motion = world.move(np.array(step))
        # A hull may be placed a millimetre deep in a wall.
        assert depth_in(walls, robot.hull, motion.pose) <= 1.1e-3
        if motion.collided:
            stopped += 1
            assert shapely.distance(hull_at(robot.hull, motion.pose), walls) < 1e-3
    assert stopped > 30


@pytest.mark.parametrize("robot", [KITE, RECTANGLE])
def test_the_dynamic_polygon_stops_at_walls(hall: Building, robot: RobotConfig) -> None:
    world = World(hall, robot=robot)
    walls, rng, stopped = hall.free.boundary, np.random.default_rng(2), 0
    world.reset(np.array([*reach(hall, robot.hull.turning_m).widest(), 0.3]))
    for _ in range(150):
        motion = world.move(np.array([rng.uniform(-0.3, 0.4), 0.0, rng.uniform(-0.6, 0.6)]))
        assert depth_in(walls, robot.hull, motion.pose) < 4e-3 and motion.penetration_m < 8e-3
        stopped += motion.collided
    assert stopped > 20


def test_commands_of_a_polygon_keep_the_limits_of_its_wheels(monkeypatch: pytest.MonkeyPatch) -> None:
    """The servos are sent no more than 0.4 m/s, and changes of 1 m/s^2; the body may overshoot."""
    robot = replace(JACKAL, max_speed_mps=0.4, max_accel_mps2=1.0)
    world, rims = World(open_floor(), robot=robot), [np.zeros(2)]
    advance = world._advance

    def record(steps: int) -> None:
        rims.append(robot.wheel_radius_m * world.data.ctrl[:2])
        periods.append(steps * world.config.timestep_s)
        advance(steps)

    periods: list[float] = []
    world.reset(np.array([2.0, 2.0, 0.0]))
    monkeypatch.setattr(world, "_advance", record)
    for v_mps, w_radps in ((0.4, 0.0), (9.0, 9.0), (-0.4, 1.0), (0.2, -4.0)):
        world.drive(v_mps, w_radps, 0.5)
    change = np.abs(np.diff(rims, axis=0)).max(axis=1)
    assert 0.39 < np.abs(rims).max() < 0.4 + 1e-9 and (change < 1.0 * np.array(periods) + 1e-9).all()


@pytest.mark.parametrize("world", [KinematicWorld, World])
@pytest.mark.parametrize(("wider_m", "passes"), [(0.04, True), (-0.02, False)])
def test_a_door_passes_what_is_narrower(world: type, wider_m: float, passes: bool) -> None:
    half_m = 0.25 - wider_m / 2  # of a hull in a door of 0.5 m
    robot = RobotConfig(
        outline_m=((-0.3, -half_m), (0.3, -half_m), (0.3, half_m), (-0.3, half_m)), mass_kg=15
    )
    physics = world(make_building(two_rooms(0.5)), robot=robot)
    physics.reset(np.array([2.0, 1.5, 0.0]))
    motion = physics.move(np.array([2.2, 0.0, 0.0]))
    assert motion.collided != passes
    assert motion.pose[0] == (pytest.approx(4.2, abs=1e-3) if passes else pytest.approx(2.7, abs=0.01))


def test_a_rectangle_passes_a_door_4_cm_wider() -> None:
    """The whole system: map, plan and controller, with a lidar whose ranges err by 2 mm near by."""
    robot = replace(JACKAL, lidar="rplidar-a1")
    half_m = 0.22  # of a hull in a door of 0.48 m
    robot = replace(robot, outline_m=((-0.254, -half_m), (0.254, -half_m), (0.254, half_m), (-0.254, half_m)))
    building = make_building(two_rooms(0.48, wall_m=0.1, resolution_m=0.02))
    places = reach(building, *robot.hull_m)
    task = make_task(
        places, np.random.default_rng(0), start=np.array([1.0, 1.0, 2.0]), target=np.array([5.0, 2.2])
    )
    log, _ = run_episode(building, places, task, EpisodeConfig(goal="oracle", max_steps=120).of_robot(robot))
    assert log.arrived and max(motion.penetration_m for motion in log.motions) < 2e-3


def test_a_pose_with_a_corner_in_a_wall_is_an_error() -> None:
    free = make_building(room()).free
    hull = RECTANGLE.hull
    check_pose(free, np.array([0.25, 1.0, 0.0]), hull)
    check_pose(free, np.array([0.1, 1.0, np.pi / 2]), hull)
    with pytest.raises(ValueError, match="part of the hull in a wall"):
        check_pose(free, np.array([0.24, 1.0, 0.0]), hull)
    with pytest.raises(ValueError, match="part of the hull in a wall"):
        check_pose(free, np.array([0.15, 1.0, 0.8]), hull)


def test_outlines_are_convex_and_set_the_radius() -> None:
    dented = RobotConfig(
        outline_m=((-0.2, -0.1), (0.2, -0.1), (0.1, 0.0), (0.2, 0.1), (-0.2, 0.1)), track_m=0.15
    )
    assert len(dented.outline_m) == 4 and dented.hull.radius_m == 0.1
    assert dented.hull == Hull(0.1, dented.outline_m)
    for corners in (((0.1, 0.0), (0.2, 0.1), (0.2, -0.1)), ((-0.1, 0.0), (0.1, 0.0)), ((0.0, np.nan),) * 3):
        with pytest.raises(ValueError, match="around the middle of the axle"):
            RobotConfig(outline_m=corners)
    with pytest.raises(ValueError, match="expected at most the hull's width"):
        replace(TURTLEBOT3_WAFFLE, track_m=0.4)
