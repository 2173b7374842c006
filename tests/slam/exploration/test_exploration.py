"""Goals are frontiers, exploration sees all that the hull can reach, and then it ends.

Nothing here depends on how short a frontier may be and still count: those required are at least 0.5 m long.
"""

import itertools
import math

import numpy as np
import pytest
from scipy import ndimage

from slam.control.controller import Controller
from slam.exploration.explorer import ExplorerConfig, FrontierExplorer
from slam.exploration.frontiers import Frontier, find_frontiers, lines_across, unseen_area
from slam.grid import GridFrame, MapEstimate
from slam.planning.cost_map import CostConfig, cut_box, known_box, travel_time_from_robot
from slam.planning.planner import Planner
from slam.robot import Robot
from tests.slam.floors import floor
from tests.slam.gridworld import CELL, GridWorld, cells_of, hall

WORLDS = {
    "room": (hall((4, 3)), (2.0, 1.5, 0.0)),
    "two rooms": (hall((6, 4), [(2.9, 0, 3.0, 1.5), (2.9, 2.1, 3.0, 4)]), (1.0, 1.0, 0.3)),
    "T of corridors": (hall((6, 4), [(0, 1, 2.5, 4), (3.5, 1, 6, 4)]), (3.0, 3.0, -1.57)),
    "niche": (hall((5, 3), [(0, 0, 2.25, 1.2), (2.75, 0, 5, 1.2)]), (2.5, 0.3, -1.57)),
}


def _explore(world: GridWorld, decisions: int, hidden=None, rating="gain"):
    """Goals and poses until the explorer is done; cells that are hidden never show, whatever is looked at."""
    planner, controller, explorer = (
        Planner(),
        Controller(),
        FrontierExplorer(config=ExplorerConfig(rating=rating)),
    )
    goals, poses = [], []
    for _ in range(decisions):
        if hidden is not None:
            world.explored[hidden], world.probability[hidden] = False, 0.5
        goal = explorer.goal(world.estimate())
        if goal is None:
            return np.array(goals), np.array(poses), True
        goals.append(goal)
        poses.append(world.pose.copy())
        world.act(controller.act(world.pose.copy(), planner.plan(world.estimate(), goal, look=True)))
    return np.array(goals), np.array(poses), False


def _frontier_cells(estimate: MapEstimate) -> np.ndarray:
    """Brute force: seen free cells with an unseen one that is no obstacle among their eight neighbours."""
    ny, nx = estimate.frame.shape
    found = np.zeros((ny, nx), bool)
    for iy, ix in np.argwhere(estimate.explored & estimate.known_free):
        for jy, jx in itertools.product(range(max(iy - 1, 0), iy + 2), range(max(ix - 1, 0), ix + 2)):
            if jy < ny and jx < nx and not estimate.explored[jy, jx] and not estimate.obstacle[jy, jx]:
                found[iy, ix] = True
    return found


def _drawn(seed: int) -> MapEstimate:
    """A hall with random furniture, known in random blobs around the robot, which stands on seen floor."""
    rng = np.random.default_rng(seed)
    solid = hall((5, 4))
    for x, y in rng.uniform([0.2, 0.2], [4.6, 3.6], (6, 2)):
        solid[cells_of((x, y, x + 0.3, y + 0.2))] = True
    blobs = ndimage.gaussian_filter(rng.normal(size=solid.shape), 8)
    # Walls and floor are known somewhat farther than they count as seen, as with a real camera.
    explored, known = blobs > -0.01, blobs > -0.02
    here = np.s_[36:45, 46:55]
    solid[here], explored[here], known[here] = False, True, True
    return MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL, shape=solid.shape),
        obstacle_probability=np.where(known, np.where(solid, 0.95, 0.05), 0.5).astype(np.float32),
        explored=explored,
        blocked=np.zeros(solid.shape, bool),
        pose=np.array([2.5, 2.0, 0.4]),
    )


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("rating", ["gain", "cheapest", "nearest", "tour"])
def test_a_goal_is_where_seen_floor_meets_what_is_unseen(seed, rating):
    """On drawn maps, the centre of a cell of the brute-force set; half a cell or a neighbour off is not."""
    estimate = _drawn(seed)
    frontiers = _frontier_cells(estimate)
    assert frontiers.sum() > 20
    goal = FrontierExplorer(config=ExplorerConfig(rating=rating)).goal(estimate)
    assert goal is not None
    iy, ix = estimate.frame.index(goal)
    assert frontiers[iy, ix]
    np.testing.assert_allclose(goal, [(ix + 0.5) * CELL, (iy + 0.5) * CELL], atol=1e-9)


def test_the_nearest_frontier_may_lie_behind_and_the_cheapest_does_not():
    """Patches 1.2 m behind and 2.2 m ahead: behind is nearer by 1 m, 4 decisions, but 18 turns of 10 degrees away."""
    world = GridWorld(hall((8, 3)), (4.0, 1.5, 0.0)).know_all()
    for box in ((2.2, 1.2, 2.8, 1.8), (6.2, 1.2, 6.8, 1.8)):
        world.explored[cells_of(box)], world.probability[cells_of(box)] = False, 0.5
    nearest = FrontierExplorer(config=ExplorerConfig(rating="nearest")).goal(world.estimate())
    cheapest = FrontierExplorer(config=ExplorerConfig(rating="cheapest")).goal(world.estimate())
    assert nearest[0] < 3.0
    assert cheapest[0] > 6.0


@pytest.mark.parametrize("walls_seen", [True, False])
def test_a_map_without_frontiers_needs_one_look_around_and_no_more(walls_seen):
    """Fully known: once around on the spot, 36 turns of 10 degrees and the decision for it, then exploration has ended.

    Also with walls that are known, but from too far to count as seen: nothing is to be found in them.
    """
    world = GridWorld(*WORLDS["room"]).know_all()
    world.explored[world.solid] = walls_seen
    assert not _frontier_cells(world.estimate()).any()
    explorer = FrontierExplorer()
    goals = [explorer.goal(world.estimate()) for _ in range(50)]
    assert all((goal == world.pose[:2]).all() for goal in goals[:37])
    assert goals[37:] == [None] * 13


def test_the_nearest_frontier_is_the_nearer_one_and_gain_prefers_the_larger():
    """A closed hall, known but for a patch 0.6 m wide near by and a whole end of 2 m farther off."""
    world = GridWorld(hall((7, 3)), (3.0, 1.5, math.pi)).know_all()
    for box in ((2.0, 1.2, 2.2, 1.8), (5.0, 0.1, 6.9, 2.9)):
        world.explored[cells_of(box)], world.probability[cells_of(box)] = False, 0.5
    nearest = FrontierExplorer(config=ExplorerConfig(rating="nearest")).goal(world.estimate())
    gain = FrontierExplorer(config=ExplorerConfig(rating="gain")).goal(world.estimate())
    assert nearest[0] < 2.5
    assert gain[0] > 4.5


def test_a_tour_collects_a_pocket_at_hand_and_gain_leaves_it_for_the_larger_end():
    """A patch of 0.6 m 1.2 m behind the robot, and an end of 3 m at 3 m: coming back for the patch would take 6 m."""
    world = GridWorld(hall((10, 3)), (3.0, 1.5, math.pi)).know_all()
    for box in ((1.2, 1.2, 1.8, 1.8), (7.0, 0.1, 9.9, 2.9)):
        world.explored[cells_of(box)], world.probability[cells_of(box)] = False, 0.5
    goals = {
        rating: FrontierExplorer(config=ExplorerConfig(rating=rating)).goal(world.estimate())
        for rating in ("tour", "gain")
    }
    assert goals["tour"][0] < 2.5
    assert goals["gain"][0] > 6.5


def test_without_a_weight_turns_do_not_count():
    """Patches 1.2 m behind and 2.2 m ahead: the one behind is cheapest for a robot that drives in any direction."""
    world = GridWorld(hall((8, 3)), (4.0, 1.5, 0.0)).know_all()
    for box in ((2.2, 1.2, 2.8, 1.8), (6.2, 1.2, 6.8, 1.8)):
        world.explored[cells_of(box)], world.probability[cells_of(box)] = False, 0.5
    config = ExplorerConfig(rating="cheapest", turn_weight=0.0)
    assert FrontierExplorer(config=config).goal(world.estimate())[0] < 3.0


def test_what_is_seen_from_the_edge_of_an_open_half_plane_is_half_a_disc():
    """Pi r^2 / 2 = 16.1 m^2 at 3.2 m; half of it with a wall over one side, at most length x depth.

    Within 8 and 15 %: 60 rays, sampled every other cell and short of the rim, miss 6 %, and one runs along the wall.
    """
    shape = (200, 200)
    explored = np.zeros(shape, bool)
    explored[:, :100] = True
    probability = np.where(explored, 0.05, 0.5).astype(np.float32)
    frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL, shape=shape)
    spot = np.array([4.975, 5.025])

    def area(probability, length_m=100.0):
        estimate = MapEstimate(
            frame=frame,
            obstacle_probability=probability,
            explored=explored,
            blocked=np.zeros(shape, bool),
            pose=np.array([4.0, 5.0, 0.0]),
        )
        box = cut_box(estimate, np.zeros(2), np.full(2, 10.0))
        frontier = Frontier(goal_xy=spot, near_xy=spot, cost_m=1.0, length_m=length_m)
        return unseen_area(box, frontier, 3.2, 1.5)

    half_disc = math.pi * 3.2**2 / 2
    assert area(probability) == pytest.approx(half_disc, rel=0.08)
    walled = probability.copy()
    walled[98:100, 100:] = 0.95
    assert area(walled) == pytest.approx(half_disc / 2, rel=0.15)
    assert area(probability, length_m=2.0) == pytest.approx(3.0)


def test_the_end_of_a_corridor_has_a_longer_line_across_than_a_door_in_its_side():
    """A corridor of 10 m by 2 m, seen up to 9 m, with a door of 1 m in its middle: 9 m, and not the length of a side.

    Through the door, the longest line that stays in the unseen room for 0.8 m leaves the corridor at the other side,
    at 2 m over the sine of its angle. A frontier that no line crosses has none.
    """
    world = GridWorld(hall((10, 6), [(0, 2, 4.5, 2.1), (5.5, 2, 10, 2.1)]), (1.0, 1.0, 0.0)).know_all()
    for hidden in ((9, 0, 10, 2), (0, 2.1, 10, 6)):
        world.explored[cells_of(hidden)], world.probability[cells_of(hidden)] = False, 0.5
    box = cut_box(world.estimate(), np.zeros(2), np.array([10.0, 6.0]))

    def line_m(x, y):
        spot = np.array([x, y])
        there = Frontier(goal_xy=spot, near_xy=spot, cost_m=1.0, length_m=1.0)
        return lines_across(box, there.goal_xy[None], 40.0).item()

    assert line_m(8.95, 1.0) == pytest.approx(9.0, abs=0.3)
    assert 2.0 <= line_m(5.0, 2.05) < 4.5
    assert line_m(2.0, 1.0) == 0.0


@pytest.mark.parametrize("rating", ["gain", "tour"])
@pytest.mark.parametrize("name", WORLDS)
def test_exploration_sees_all_that_the_hull_can_reach_and_ends(name, rating):
    """All reachable cells (by SciPy's distances and components of the true world) seen; done within 300 decisions."""
    world = GridWorld(*WORLDS[name])
    reachable = world.reachable()
    _, _, done = _explore(world, 300, rating=rating)
    assert done
    assert reachable.sum() > 500
    assert world.explored[reachable].all()
    # Paths may reach 2 cm into walls (`CostConfig.overlap_m`): one of them touches a door post twice.
    assert world.bumps == (2 if (name, rating) == ("two rooms", "gain") else 0)


def test_a_frontier_that_shows_nothing_new_is_given_up():
    """A patch that never shows: done all the same, all else seen, and no goal held for more than 60 decisions."""
    solid = hall((3.2, 2.8))
    hidden = np.zeros_like(solid)
    hidden[cells_of((1.6, 1.2, 2.1, 1.7))] = True
    hidden &= ~solid
    world = GridWorld(solid, (0.8, 0.8, 0.0))
    reachable = world.reachable() & ~hidden
    goals, _, done = _explore(world, 700, hidden)
    assert done
    assert world.explored[reachable].mean() > 0.99
    held = [len(list(group)) for _, group in itertools.groupby(map(tuple, goals))]
    assert max(held) <= 60


def test_between_two_equal_ends_of_a_corridor_it_makes_up_its_mind():
    """Started in the middle of 12 m, looking across: each end is visited once, and the path turns round at most twice.

    A robot that dithers between the two never gets to either.
    """
    world = GridWorld(hall((12, 1.2)), (6.0, 0.6, math.pi / 2))
    reachable = world.reachable()
    _, poses, done = _explore(world, 220)
    assert done
    assert world.explored[reachable].all()
    step = np.diff(poses[:, 0])
    step = step[np.abs(step) > 0.02]
    assert (np.diff(np.sign(step)) != 0).sum() <= 2
    assert np.abs(step).sum() < 18, "out to one end and back to the other"


@pytest.mark.parametrize(("size_m", "choices"), [((20, 20), 6), ((60, 40), 3)])
def test_a_goal_is_chosen_every_fourth_decision_and_on_a_large_map_every_eighth(size_m, choices, monkeypatch):
    """In 24 decisions with a goal that remains valid."""
    solid = hall(size_m)
    explored = np.zeros_like(solid)
    explored[100:200, 100:200] = True
    estimate = MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=CELL, shape=solid.shape),
        obstacle_probability=np.where(explored, 0.05, 0.5).astype(np.float32),
        explored=explored,
        blocked=np.zeros_like(solid),
        pose=np.array([7.5, 7.5, 0.0]),
    )
    explorer, made = FrontierExplorer(), []
    choose = explorer._choose
    monkeypatch.setattr(explorer, "_choose", lambda estimate: made.append(1) or choose(estimate))
    for _ in range(24):
        assert explorer.goal(estimate) is not None
    assert len(made) == choices


def test_exploration_repeats_itself():
    """Goals and poses bit for bit."""
    first, second = (_explore(GridWorld(*WORLDS["two rooms"]), 30) for _ in range(2))
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


@pytest.mark.parametrize("values", [{"candidates": 0}, {"every": 0}, {"patience": 0}, {"tour": 13}])
def test_impossible_settings_are_rejected(values):
    """By name."""
    with pytest.raises(ValueError, match=next(iter(values))):
        ExplorerConfig(**values)


@pytest.mark.parametrize("radius_m", [0.03, 0.1])
def test_frontiers_of_small_robots_are_where_the_floor_ends(radius_m):
    """A floor of 6 m whose east is unseen from x = 1.5 m on: one frontier there, 3.5 m from the robot.

    Fields of robots smaller than the cells of the map allow are on the map's own cells, others on larger ones.
    """
    estimate = floor((-2.0, 0.0, 0.0))
    east = np.s_[:, round(4.5 / CELL) :]
    estimate.explored[east], estimate.obstacle_probability[east] = False, 0.5
    low, high = known_box(estimate)
    box = cut_box(estimate, low - 0.1, high + 0.1)
    hull = Robot(radius_m=radius_m, track_m=0.06).hull
    times = travel_time_from_robot(box, CostConfig(), hull, through_unknown=False)
    (frontier,) = find_frontiers(box, times, min_cells=3, piece_m=9.0, given_up=np.zeros((0, 2)))
    assert frontier.near_xy == pytest.approx([1.5, 0.0], abs=0.15)
    assert frontier.cost_m == pytest.approx(3.5, abs=0.15)
