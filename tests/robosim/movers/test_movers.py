"""Movers in pictures, scans and contacts, against other engines and closed forms."""

import numpy as np
import pytest
import trimesh

from robosim.building.building import make_building
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.lidar import LidarConfig, rplidar_a1
from robosim.movers.mover import Body
from robosim.movers.movers import Movers, MoversConfig, make_movers
from robosim.movers.person import person_triangles
from robosim.robot.dynamic import World
from robosim.robot.kinematic import KinematicWorld
from tests.plans import room


class Scripted:
    """Bodies that move along straight lines."""

    def __init__(self, starts, velocities=None, body: Body | None = None) -> None:
        self.starts = np.array(starts, float)
        self.velocities = np.zeros_like(self.starts) if velocities is None else np.array(velocities, float)
        self.bodies = (body or Body(),) * len(self.starts)

    def reset(self, surroundings, rng) -> None:
        pass

    def poses(self, time_s, robot):
        return self.starts + time_s * self.velocities


BUILDING = make_building(room(8.0, 4.0))
START = np.array([1.0, 2.0, 0.0])


def movers(*args, **options) -> Movers:
    made = Movers([Scripted(*args, **options)], BUILDING, 0.1)
    made.reset(START, np.random.default_rng(0))
    return made


def surfaces_of(some: Movers) -> trimesh.Trimesh:
    triangles, colours = some.surfaces()
    mesh = trimesh.Trimesh(
        triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), process=False
    )
    mesh.visual.vertex_colors = np.column_stack([colours, np.full(len(colours), 255)]).repeat(3, axis=0)
    return mesh


@pytest.mark.parametrize("backend", ["pyrender", "embree", "plan"])
def test_pictures_are_those_of_a_scene_with_the_bodies_in_it(backend):
    """Every camera: depth and colour as ray casting has them in one mesh, but for one pixel in 300 at outlines."""
    some, config = movers([[3.0, 2.2, 2.0], [4.5, 1.2, 0.3]]), CameraConfig(width=96, height=96)
    pose = camera_pose(START, config)
    with make_camera([BUILDING.mesh], config, backend=backend) as camera:
        drawn = some.draw(camera.render(pose), pose, config)
    with make_camera([BUILDING.mesh, surfaces_of(some)], config, backend="embree") as camera:
        expected = camera.render(pose)
    with make_camera([BUILDING.mesh], config, backend="embree") as camera:
        bodies = expected.depth < camera.render(pose).depth - 0.01
    assert bodies.sum() > 200
    off = np.abs(drawn.depth - expected.depth) > 1e-3
    assert off.mean() < 1 / 300
    wrong = np.abs(drawn.rgb.astype(int) - expected.rgb).max(axis=2) > 1
    assert (wrong & bodies & ~off).mean() < 1 / 300


def test_scans_are_those_of_a_scene_with_the_bodies_in_it():
    some = movers([[3.0, 2.2, 2.0], [1.5, 1.2, 0.3]])
    config = LidarConfig(level=0.0)
    found = rplidar_a1([BUILDING.mesh], config).true_scan(START, some.surfaces()[0])
    expected = rplidar_a1([BUILDING.mesh, surfaces_of(some)], config).true_scan(START)
    np.testing.assert_allclose(found.range_m, expected.range_m, atol=1e-5)
    alone = rplidar_a1([BUILDING.mesh], config).true_scan(START)
    assert (found.range_m < alone.range_m - 0.1).sum() > 5


def test_a_person_has_the_height_given_and_few_triangles():
    """At most 500, standing or walking; feet on the floor when standing."""
    for phase, speed in ((0.0, 0.0), (1.0, 1.3), (4.0, 1.6)):
        triangles = person_triangles(1.8, phase, speed)
        assert len(triangles) <= 500
        assert triangles[..., 2].max() == pytest.approx(1.8)
    assert person_triangles(1.8, 0.0, 0.0)[..., 2].min() == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("physics", [World, KinematicWorld])
def test_a_person_in_the_path_stops_the_robot(physics):
    """With the hull at the body, to 2 mm of the contact of two circles; the robot has caused it."""
    some = movers([[1.4, 2.05, 0.0]])
    world = physics(BUILDING, movers=some)
    world.reset(START)
    motion = world.move(np.array([0.25, 0.0, 0.0]))
    reach = np.sqrt((0.1 + Body().radius_m) ** 2 - 0.05**2)
    assert motion.collided
    assert np.hypot(*(motion.pose[:2] - [1.4, 2.05])) == pytest.approx(0.1 + Body().radius_m, abs=0.002)
    assert motion.pose[0] == pytest.approx(1.4 - reach, abs=0.03)
    assert [contact.by_robot for contact in some.contacts] == [True]


@pytest.mark.parametrize("physics", [World, KinematicWorld])
def test_a_person_who_walks_into_the_robot_has_caused_it(physics):
    """The robot waits; also where it retreats more slowly than the person comes."""
    some = movers([[2.0, 2.0, 0.0]], [[-1.0, 0.0, 0.0]])
    world = physics(BUILDING, movers=some)
    world.reset(START)
    world.drive(0.0, 0.0, 1.0)
    assert some.time_s == pytest.approx(1.0)
    assert [contact.by_robot for contact in some.contacts] == [False]


@pytest.mark.parametrize("physics", [World, KinematicWorld])
def test_time_passes_as_long_as_a_motion_takes(physics):
    some = movers([[6.0, 2.0, 0.0]])
    world = physics(BUILDING, movers=some)
    world.reset(START)
    total = sum(world.move(np.array(step)).duration_s for step in ([0.25, 0, 0], [0, 0, 0.2], [0.0, 0, 0]))
    assert some.time_s == pytest.approx(total)


@pytest.mark.parametrize("physics", [World, KinematicWorld])
def test_bodies_far_off_change_no_motion(physics):
    """Bit by bit in the dynamic world; the kinematic one moves in pieces, to 1e-12 m."""
    alone, among = physics(BUILDING), physics(BUILDING, movers=movers([[7.0, 3.0, 0.0]]))
    for world in (alone, among):
        world.reset(START)
    for step in ([0.25, 0.0, 0.0], [0.0, 0.01, 0.3], [0.25, 0.0, 0.0]):
        ours, theirs = (world.move(np.array(step)).pose for world in (among, alone))
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=0 if physics is World else 1e-12)


def test_a_body_that_is_not_there_is_nowhere():
    some = movers([[np.nan, np.nan, np.nan], [3.0, 2.0, 0.0]])
    some.advance(0.1, START)
    assert len(some.present) == 1 and some.share_free(START[:2], np.array([5.0, 0.0])) < 1
    assert np.isfinite(some.velocity).all() and len(some.surfaces()[0]) == len(person_triangles(1.7, 0, 0))


def test_nothing_moves_by_default():
    assert make_movers(MoversConfig(), BUILDING, 0.1) is None and not MoversConfig().any
