"""Walkers: forces against the potential's numerical gradient, free speed, and what bodies never do."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from robosim.building.building import make_building
from robosim.generator.generate import generate_plan
from robosim.movers.mover import Body, Surroundings
from robosim.movers.walkers import _AHEAD_S, _SIGMA_M, _V0, Walkers, WalkersConfig, _repulsion
from tests.plans import room

FAR = np.array([0.5, 0.5, 0.0])


def begun(count: int, plan=None, robot=FAR, seed: int = 0, **config) -> Walkers:
    walkers = Walkers(count, WalkersConfig(**config))
    building = make_building(plan or room(12.0, 6.0))
    walkers.reset(Surroundings(building, np.array(robot), 0.1), np.random.default_rng(seed))
    return walkers


def walk(walkers: Walkers, robot=FAR, until_s: float = 60.0, every_s: float = 0.05) -> np.ndarray:
    """Poses over time, (times, people, 3)."""
    return np.array([walkers.poses(k * every_s, np.array(robot)) for k in range(1, round(until_s / every_s))])


near = st.floats(-2, 2).filter(lambda value: abs(value) > 0.05)


@settings(deadline=None)
@given(near, near, st.floats(-1.5, 1.5), st.floats(-1.5, 1.5))
def test_repulsion_is_the_gradient_of_the_published_potential(x, y, vx, vy):
    """V0 exp(-b / sigma) with 2 b the sum of distances less the step: central differences, 1e-5 relative."""
    sx, sy = vx * _AHEAD_S, vy * _AHEAD_S

    def potential(x: float, y: float) -> float:
        square = (math.hypot(x, y) + math.hypot(x - sx, y - sy)) ** 2 - math.hypot(sx, sy) ** 2
        return _V0 * math.exp(-0.5 * math.sqrt(max(square, 1e-12)) / _SIGMA_M)

    h = 1e-5
    expected = (
        (potential(x - h, y) - potential(x + h, y)) / (2 * h),
        (potential(x, y - h) - potential(x, y + h)) / (2 * h),
    )
    on_the_step = math.hypot(x, y) + math.hypot(x - sx, y - sy) - math.hypot(sx, sy) < 0.02
    if not on_the_step:  # there b has a kink
        np.testing.assert_allclose(_repulsion(x, y, sx, sy), expected, rtol=1e-4, atol=1e-6)


def test_a_person_alone_walks_at_the_desired_speed():
    """In a wide room: never faster, and in more than half of the time of walking the desired speed within 3 %."""
    walkers = begun(1, room(20.0, 4.0), speed_std_mps=0.0, wait_s=2.0)
    pace = np.hypot(*np.diff(walk(walkers, every_s=0.1)[:, 0, :2], axis=0).T) / 0.1
    walking = pace[pace > 0.5 * pace.max()]
    assert pace.max() < 1.34 + 1e-9
    assert np.mean(np.abs(walking / 1.34 - 1) < 0.03) > 0.5


@pytest.mark.parametrize("seed", range(3))
def test_bodies_enter_neither_walls_nor_each_other_nor_the_robot(seed):
    """Eight people for a minute in a generated home, around a robot that stands there."""
    plan = generate_plan(seed)
    building = make_building(plan)
    walkers = Walkers(8)
    robot = np.array([*building.free.representative_point().coords[0], 0.0])
    walkers.reset(Surroundings(building, robot, 0.1), np.random.default_rng(seed))
    poses = walk(walkers, robot, every_s=0.1)
    places, radius = poses[:, :, :2], Body().radius_m
    depth = shapely.distance(shapely.points(places.reshape(-1, 2)), building.free.boundary)
    assert shapely.contains_xy(building.free, *places.reshape(-1, 2).T).all()
    assert depth.min() > radius - 2 * plan.resolution_m
    apart = np.hypot(*(places[:, :, None] - places[:, None]).transpose(3, 0, 1, 2)) + 9 * np.eye(8)
    assert apart.min() > 2 * radius - 1e-9
    assert np.hypot(*(places - robot[:2]).transpose(2, 0, 1)).min() > radius + 0.1
    # They walk: everybody has moved.
    assert (np.ptp(places, axis=0).max(axis=1) > 1.0).all()


def test_two_people_pass_each_other_in_a_corridor():
    """A corridor of 1.2 m: both get from one end to the other again and again."""
    walkers = begun(2, room(14.0, 1.2), robot=(-50.0, 0.0, 0.0), wait_s=1.0, together=0.0)
    x = walk(walkers, (-50.0, 0.0, 0.0), until_s=180.0, every_s=0.2)[:, :, 0]
    order = np.sign(x[:, 0] - x[:, 1])
    assert (np.diff(order) != 0).sum() >= 3


def test_a_person_steps_around_a_robot_that_stands_in_the_corridor():
    """A corridor of 1.2 m with the robot off its middle: from one end to the other, not nearer than 0.15 m."""
    robot = (7.0, 0.35, 0.0)
    walkers = begun(1, room(14.0, 1.2), robot=robot, wait_s=1.0)
    xy = walk(walkers, robot, until_s=120.0, every_s=0.2)[:, 0, :2]
    assert (np.diff(np.sign(xy[:, 0] - robot[0])) != 0).sum() >= 3
    assert np.hypot(*(xy - robot[:2]).T).min() > Body().radius_m + 0.1 + 0.15 - 1e-9


def test_motions_depend_on_the_seed_only():
    """Poses at the same times are the same, however many are read in between."""
    often, seldom = walk(begun(5, seed=3), every_s=0.02), walk(begun(5, seed=3), every_s=0.1)
    # Poses between steps are rounded differently.
    np.testing.assert_allclose(often[4::5], seldom, atol=1e-9)
    assert not np.allclose(walk(begun(5, seed=4), every_s=0.1), seldom)


def test_too_many_people_are_rejected():
    with pytest.raises(ValueError, match="people is 500, expected at most"):
        begun(500, room(4.0, 3.0))
