"""The lidar against closed forms, what is made of its scans, and a robot that has nothing else."""

import json

import numpy as np
import pytest

from robosim.building.building import BuildingConfig, make_building
from robosim.cli import main
from robosim.lidar import RPLIDAR_A1, Lidar, LidarConfig, lds_01, rangers_4, rplidar_a1, ust_10lx, vl53l5cx
from robosim.parts import LIDAR
from robosim.task.coverage import Coverage
from slam.actions import Action
from slam.grid import GridFrame
from slam.mapping.classical import ClassicalMapper
from slam.mapping.occupancy import OccupancyGrid
from slam.poses import between, compose
from slam.sensing.laser import LaserScan
from tests.plans import room
from tests.slam import beams


@pytest.fixture(scope="module")
def building():
    """A room of 8 m by 6 m, its corner at the origin."""
    return make_building(room(8.0, 6.0), config=BuildingConfig(tolerance_m=0.0))


def walls_of(building) -> list[tuple[float, ...]]:
    return [tuple(wall.ravel()) for wall in building.walls_2d]


@pytest.mark.parametrize("make", [rplidar_a1, lds_01, ust_10lx])
@pytest.mark.parametrize("pose", [(2.0, 1.5, 0.0), (5.3, 4.4, 2.1), (7.0, 0.8, -1.0)])
def test_ranges_are_those_of_the_closed_form(building, make, pose):
    """All beams at once, in single precision."""
    pose = np.array(pose)
    lidar = make([building.mesh], LidarConfig(level=0.0))
    assert isinstance(lidar, Lidar)
    scan = lidar.scan(pose, np.random.default_rng(0))
    exact = beams.ranges(walls_of(building), pose, bearing=scan.bearing_rad)
    exact = np.where((exact <= scan.max_range_m) & (exact >= lidar.model.min_range_m), exact, np.inf)
    np.testing.assert_allclose(scan.range_m, exact, atol=2e-5)


@pytest.mark.parametrize("make", [rangers_4, vl53l5cx])
@pytest.mark.parametrize("pose", [(5.5, 4.0, 0.4), (7.0, 3.8, -0.3)])
def test_a_cone_returns_the_nearest_surface_in_it(building, make, pose):
    """Within the width of a cone, to the error of nine rays: the nearest of 200 on convex walls, 3 cm at most."""
    pose, lidar = np.array(pose), make([building.mesh], LidarConfig(level=0.0))
    half = np.radians(lidar.model.cone_deg) / 2
    within = lidar.model.bearing_rad[:, None] + np.linspace(-half, half, 200)
    exact = beams.ranges(walls_of(building), pose, bearing=within.ravel()).reshape(within.shape).min(axis=1)
    found = lidar.scan(pose, np.random.default_rng(0)).range_m
    seen = exact < 3.9
    assert seen.any()
    assert (found[seen] >= exact[seen] - 1e-4).all()
    np.testing.assert_allclose(found[seen], exact[seen], atol=0.03)


def test_it_errs_as_its_maker_says(building):
    """Spread and part of the beams that are missing, over many scans, within three standard errors."""
    pose = np.array([4.0, 3.0, 0.3])
    lidar, rng = rplidar_a1([building.mesh], LidarConfig()), np.random.default_rng(1)
    true = lidar.true_scan(pose).range_m
    scans = np.array([lidar.scan(pose, rng).range_m for _ in range(300)])
    there = np.isfinite(scans)
    expected = RPLIDAR_A1.missing
    assert abs(1 - there.mean() - expected) < 3 * np.sqrt(expected / scans.size)
    error = (scans - true) / RPLIDAR_A1.sigma_at(true)
    assert abs(error[there].mean()) < 3 / np.sqrt(there.sum())
    assert abs(error[there].std() - 1) < 3 / np.sqrt(2 * there.sum())


def test_what_grazes_a_wall_does_not_come_back():
    """Beams along a long corridor, as far as it reaches."""
    corridor = make_building(room(30.0, 1.0))
    pose = np.array([0.5, 0.5, 0.0])
    scan = lds_01([corridor.mesh], LidarConfig()).true_scan(pose)
    ahead = np.argmin(np.abs(scan.bearing_rad))
    assert not scan.hit[ahead]
    far = rplidar_a1([corridor.mesh], LidarConfig(level=1e-6)).scan(pose, np.random.default_rng(0))
    slant = np.abs(np.abs(np.degrees(far.bearing_rad)) - 90)
    assert not far.hit[(slant > 86) & (np.abs(far.bearing_rad) < 1)].any()
    assert far.hit[slant < 80].all()


def fan(ranges, **options) -> LaserScan:
    bearing = np.linspace(-np.pi, np.pi, len(ranges), endpoint=False)
    return LaserScan(
        bearing_rad=bearing,
        range_m=np.array(ranges, float),
        **{"max_range_m": 9.0, "height_m": 0.2, **options},
    )


def test_one_missing_beam_says_nothing_and_five_are_clear_as_far_as_neighbours():
    ranges = np.full(360, 3.0)
    ranges[10] = np.inf
    ranges[100:107] = np.inf
    ranges[107] = 2.0
    ranges[-4:] = ranges[:4] = np.inf  # behind the robot, across the seam
    clear = fan(ranges).clear_m
    assert clear[10] == 0
    assert (clear[102:105] == 2.0).all()
    assert (clear[[100, 106]] == 0).all()
    assert (clear[200:350] == 3.0).all()
    assert (clear[[0, -1]] == 3.0).all()
    assert (fan(np.full(360, np.inf)).clear_m == 9.0).all()


def test_what_a_grazed_wall_hides_stays_unknown():
    """Close along a wall of a corridor, where beams graze it: nothing behind it is entered as free."""
    corridor = make_building(room(12.0, 2.0))
    lidar, rng = rplidar_a1([corridor.mesh], LidarConfig()), np.random.default_rng(5)
    frame = GridFrame(origin_xy=(-3.0, -5.0), resolution_m=0.05, shape=(240, 400))
    grid = OccupancyGrid(frame)
    for x in np.arange(0.5, 11.5, 0.25):
        pose = np.array([x, 0.15, 0.02])
        grid.integrate_laser(lidar.scan(pose, rng), pose)
    y = frame.origin_xy[1] + (np.arange(240) + 0.5) * 0.05
    assert (grid.log_odds[(y > 0.2) & (y < 1.8)] < 0).sum() > 7500
    assert not (grid.log_odds[(y < -0.1) | (y > 2.1)] < 0).any()


def test_beams_are_found_by_bearing():
    scan = fan(np.ones(360))
    assert scan.all_around
    np.testing.assert_array_equal(scan.nearest(scan.bearing_rad), np.arange(360))
    np.testing.assert_array_equal(scan.nearest(scan.bearing_rad + 0.49 * scan.step_rad), np.arange(360))
    half = LaserScan(bearing_rad=np.linspace(-1, 1, 21), range_m=np.ones(21), max_range_m=9.0, height_m=0.2)
    assert not half.all_around
    np.testing.assert_array_equal(half.nearest(np.array([-1.04, 0.0, 1.04, 1.06, 3.0])), [0, 10, 20, -1, -1])


def test_what_lies_lower_than_its_beams_stays(building):
    """A step that the camera has seen, and that the beams pass over."""
    frame = GridFrame(origin_xy=(-3.0, -3.0), resolution_m=0.05, shape=(120, 120))
    grid = OccupancyGrid(frame)
    iy, ix = frame.index(np.array([[1.0, 0.0], [1.0, 1.0]]))
    grid.log_odds[iy, ix] = 2.0
    grid.top_m[iy, ix] = [0.12, 0.5]
    for _ in range(10):
        grid.integrate_laser(fan(np.full(360, 2.5)), np.zeros(3))
    assert grid.log_odds[iy[0], ix[0]] == 2.0
    assert grid.log_odds[iy[1], ix[1]] < 0


def test_a_map_and_poses_from_beams_alone(building):
    """On a round through the room from noisy odometry: within 2 cm, walls where they stand, floor free."""
    lidar, rng = rplidar_a1([building.mesh], LidarConfig()), np.random.default_rng(2)
    pose = np.array([1.0, 1.0, 0.0])
    mapper, blind = ClassicalMapper(), np.zeros((16, 16), np.float32)
    mapper.reset(pose)
    estimate = mapper.update(blind, laser=lidar.scan(pose, rng))
    for length, turns in ((20, 9), (12, 9), (20, 9), (10, 0)):
        for action in [Action.FORWARD] * length + [Action.LEFT] * turns:
            motion = np.array([0.25, 0, 0]) if action == Action.FORWARD else np.array([0, 0, np.radians(10)])
            pose = compose(pose, motion)
            measured = motion + rng.normal(0, [0.01, 0.01, 0.01])
            estimate = mapper.update(blind, action, measured, laser=lidar.scan(pose, rng))
    off = between(pose, estimate.pose)
    assert np.hypot(*off[:2]) < 0.02
    assert abs(off[2]) < np.radians(0.4)
    inside = estimate.frame.index(np.array([(4.0, 3.0), (1.0, 5.0), (7.0, 1.0)]))
    assert (estimate.obstacle_probability[inside] < 0.1).all()
    walls = estimate.frame.index(np.array([(0.0, 3.0), (4.0, 0.0), (8.0, 3.0), (4.0, 6.0)]))
    near = np.array(
        [
            estimate.obstacle_probability[iy - 1 : iy + 2, ix - 1 : ix + 2].max()
            for iy, ix in zip(*walls, strict=True)
        ]
    )
    assert (near > 0.9).all()


def test_it_sees_all_around(building):
    """From the middle of a room of 6 m: all cells within 3.2 m, of which a camera sees those ahead."""
    plan = building.plan
    region = np.ones(plan.occupancy.shape, bool)
    pose = np.array([4.0, 3.0, 0.0])
    scan = rplidar_a1([building.mesh], LidarConfig()).true_scan(pose)
    coverage = Coverage(plan, region, np.radians(90))
    coverage.update(pose, None, scan)
    # A circle less the two segments beyond the walls.
    half = np.arccos(3.0 / 3.2)
    expected = 3.2**2 * (np.pi - 2 * half + np.sin(2 * half))
    assert coverage.area_m2 == pytest.approx(expected, rel=0.02)
    none = Coverage(plan, region, np.radians(90))
    none.update(pose, None)
    assert none.fraction == 0


def test_a_robot_without_a_camera_explores(tmp_path):
    """A home, by a lidar alone."""
    main(
        "episode flat --goal explore --explorer gain --camera none --lidar rplidar-a1 --mapper classical --physics "
        f"kinematic --noise.level 1 --max-steps 240 --seed 1 --no-video --out {tmp_path}".split()
    )
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["coverage"] > 0.6
    assert result["config"]["simulator"]["robot"]["lidar"] == "rplidar-a1"
    poses, estimates = (np.loadtxt(tmp_path / name)[:, 1:3] for name in ("trajectory.tum", "estimate.tum"))
    assert np.hypot(*(poses - estimates).T).max() < 0.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--camera none", "camera and lidar are 'none'"),
        ("--camera none --lidar lds-01", "mapper is 'neural', which learned from pictures"),
        (
            "--camera none --lidar lds-01 --mapper classical --goal visual",
            "goal is 'visual', which looks through the camera",
        ),
        ("--lidar lds-1", "Did you mean 'lds-01'?"),
        ("--lidar lds-01 --laser.height-m 0", "height_m is 0"),
    ],
)
def test_what_cannot_be_is_rejected(options, message, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(f"episode flat {options} --out {tmp_path}/out".split())
    assert stop.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_every_name_is_one(building):
    for name in LIDAR.names:
        if name != "none":
            assert isinstance(LIDAR.make(name, [building.mesh], LidarConfig()), Lidar)
