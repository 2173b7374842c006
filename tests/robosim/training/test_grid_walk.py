"""A robot that explores on a grid: it sees what a camera would see, and goes where a robot can."""

import numpy as np
import pytest
import shapely
from scipy import ndimage

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.generator.generate import generate_plan
from robosim.training.grid_walk import GridAgent, GridWorld
from slam.exploration.explorer import ExplorerConfig, FrontierExplorer
from tests.plans import room, two_rooms

HFOV = np.pi / 2


def world_in(plan, seed=0):
    building = make_building(plan)
    return building, GridWorld(building, reach(building, 0.1), np.random.default_rng(seed), HFOV)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_sees_what_lies_in_the_line_of_sight(seed):
    """Against Shapely: cells whose centre is in view are seen, but for 1 %, and others are not, but for 1 %."""
    plan = generate_plan(seed)
    building, world = world_in(plan, seed)
    x, y, yaw = world.pose
    centres = plan.centres(plan.free)
    offset = centres - (x, y)
    ahead, left = offset @ (np.cos(yaw), np.sin(yaw)), offset @ (-np.sin(yaw), np.cos(yaw))
    near = (np.hypot(*offset.T) <= 3.2) & (np.abs(left) <= ahead)
    lines = shapely.linestrings([[(x, y), tuple(c)] for c in centres[near]])
    expected = np.zeros(plan.shape, bool)
    shown = np.argwhere(plan.free)[near][shapely.covers(building.free, lines)]
    expected[shown[:, 0], shown[:, 1]] = True
    seen = world._explored[1:-1, 1:-1] & plan.free
    assert expected.sum() > 50
    assert (expected & ~seen).sum() <= 0.01 * expected.sum()
    beyond = seen & ~ndimage.binary_dilation(expected, np.ones((3, 3)))
    assert beyond.sum() <= 0.01 * expected.sum()


def test_all_of_an_empty_room_is_seen():
    _, world = world_in(room(4.0, 3.0))
    agent = GridAgent(FrontierExplorer(config=ExplorerConfig(rating="gain")))
    for _ in range(200):
        pose = agent.act(world.estimate())
        if pose is None:
            break
        world.step(pose)
    else:
        pytest.fail("not explored after 200 decisions")
    assert world.coverage > 0.995


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_hull_stays_clear_of_walls(seed):
    """In two rooms with a door of 0.6 m the centre stays a radius away, but for a cell; seen floor never shrinks."""
    building, world = world_in(two_rooms(0.6), seed)
    agent = GridAgent(FrontierExplorer(config=ExplorerConfig(rating="nearest")))
    before = world.coverage
    while (pose := agent.act(world.estimate())) is not None:
        world.step(pose)
        assert building.free.boundary.distance(shapely.Point(world.pose[:2])) >= 0.05 - 1e-9
        assert world.coverage >= before
        before = world.coverage
    assert before > 0.98
