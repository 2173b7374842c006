"""Generated homes with furniture of true height: the same rooms, pieces that stand free, passages for a hull."""

import numpy as np
import pytest
import shapely

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.model import CameraConfig
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.robot.robots import LOCOBOT, RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task

TALL = GeneratorConfig(heights=True, furniture=1.2)


def outline(one) -> shapely.Geometry:
    return shapely.convex_hull(shapely.multipoints(one.bodies.vertices[:, :2]))


@pytest.mark.parametrize("style", ["home", "office"])
@pytest.mark.parametrize("seed", range(4))
def test_pieces_stand_free_on_the_floor_of_their_home(seed, style):
    """None reaches into a wall as it is built, nor into another piece; all below the ceiling, on the floor."""
    config = GeneratorConfig(heights=True, furniture=1.2, style=style)
    plan = generate_plan(seed, config=config)
    building = make_building(plan)
    outlines = [outline(one) for one in plan.furnishings]
    assert len(outlines) >= 3
    assert shapely.covers(building.free, outlines).all()
    tree = shapely.STRtree(outlines)
    one, other = tree.query(outlines, predicate="intersects")
    assert (one == other).all()
    for piece in plan.furnishings:
        low, high = piece.bodies.vertices[:, 2].min(), piece.bodies.vertices[:, 2].max()
        assert low == 0 and 0.2 <= high <= 2.3


@pytest.mark.parametrize("seed", range(4))
def test_a_hull_still_gets_through_all_rooms(seed):
    """The largest part of the furnished home has nearly all places of a LoCoBot: measured 98.9 % or more."""
    plan = generate_plan(seed, config=TALL)
    places = reach(make_building(plan), *LOCOBOT.hull_m)
    assert (places.parts == 1).sum() > 0.97 * (places.parts > 0).sum()


def test_homes_with_heights_are_the_same_homes():
    """Walls are those of an unfurnished home but for stubs and columns, and seeds give what they gave, bit for bit."""
    for seed in range(3):
        empty = generate_plan(seed, config=GeneratorConfig(furniture=0.0))
        cells = generate_plan(seed)
        tall = generate_plan(seed, config=GeneratorConfig(heights=True))
        again = generate_plan(seed, config=GeneratorConfig(heights=True))
        assert tall.digest() == again.digest()
        assert not cells.furnishings and not empty.furnishings
        assert empty.shape == cells.shape == tall.shape
        assert not (tall.free & ~empty.free).any()
        assert tall.free.sum() > 0.9 * empty.free.sum()


def test_navigable_areas_have_no_heights():
    with pytest.raises(ValueError, match="heights is True and navigable too"):
        GeneratorConfig(heights=True, navigable=True)


@pytest.mark.parametrize("physics", ["kinematic", "dynamic"])
@pytest.mark.parametrize(("goal", "mast_m"), [("oracle", 1.25), ("shortest", 0.3)])
def test_an_episode_among_furniture_arrives_and_penetrates_nothing(physics, goal, mast_m):
    """A tall robot and one that drives under tables: no hull nearer to anything lower than it than its radius."""
    building = make_building(generate_plan(1, config=GeneratorConfig(heights=True, area_m2=45)))
    robot = RobotConfig(mast_m=mast_m, camera=CameraConfig(height_m=mast_m))
    simulator = SimulatorConfig(physics=physics, robot=robot)
    places = reach(building, *robot.hull_m)
    task = make_task(places, np.random.default_rng([1, 0]))
    log, _ = run_episode(
        building, places, task, EpisodeConfig(goal=goal, seed=1, max_steps=200, simulator=simulator)
    )
    assert log.ended == "arrived"
    gap = shapely.distance(
        shapely.points(np.array(log.poses)[:, :2]), building.floor(robot.height_m).boundary
    )
    assert gap.min() > robot.hull.radius_m - (1e-9 if physics == "kinematic" else 1e-3)
    assert log.result()["deepest_penetration_m"] < 1e-3
    assert building.floor(robot.height_m).area < building.free.area - 1
