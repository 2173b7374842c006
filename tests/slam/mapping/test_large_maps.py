"""Large maps: probabilities computed where they are read equal those of arrays, and take no memory."""

import pickle
import subprocess
import sys

import cv2
import numpy as np
import pytest

from slam.actions import FORWARD_M, TURN_RAD, Action
from slam.exploration.explorer import FrontierExplorer
from slam.grid import ComputedGrid, GridFrame, MapEstimate
from slam.mapping import neural, occupancy
from slam.mapping.classical import ClassicalMapper, MapperConfig
from slam.mapping.moving import MovingConfig
from slam.mapping.neural import NeuralMapper
from slam.mapping.occupancy import probability_of
from slam.planning.cost_map import known_box
from slam.planning.planner import Planner
from slam.poses import compose
from slam.sensing.egocentric import belief_ahead
from slam.sensing.laser import LaserScan
from tests.slam.mapping.test_neural_mapping import saying
from tests.slam.rooms import Room

#: A probability that differs from cell to cell, 0.5 in the first row.
LOG_ODDS = np.arange(12, dtype=np.float32).reshape(4, 3) // 3 * np.float32([1.2, -0.4, 4.0])


def test_computed_grid_is_read_like_an_array():
    """Windows, masks, comparisons, methods and functions of numpy give what they give for the array."""
    grid, array = ComputedGrid(probability_of, LOG_ODDS), probability_of(LOG_ODDS)
    mask = LOG_ODDS > 0
    assert (grid.shape, grid.size, grid.ndim, grid.dtype, len(grid)) == ((4, 3), 12, 2, np.float32, 4)
    for read in (
        np.asarray, np.mean, lambda g: g[1:3, 1], lambda g: g[mask], lambda g: g[2, 1], lambda g: g != 0.5,
        lambda g: 1 - g, lambda g: g.copy(), lambda g: g.max(axis=0), lambda g: np.where(g > 0.5, g, 0.0),
        lambda g: np.stack([row for row in g]), lambda g: cv2.blur(np.asarray(g), (3, 3)),
    ):  # fmt: skip
        assert np.array_equal(read(grid), read(array))
    assert np.array_equal(pickle.loads(pickle.dumps(grid)), array)
    with pytest.raises(TypeError):
        grid[0, 0] = 1.0


def _estimates(made) -> list[MapEstimate]:
    """Estimates along a turn and two steps in a room, with a camera and a laser."""
    bearings = np.linspace(-np.pi, np.pi, 180, endpoint=False)
    pose, room, estimates = np.array([-1.0, -0.5, 0.0]), Room(), []
    made.reset(pose)
    for action in (None, *6 * [Action.LEFT], *2 * [Action.FORWARD]):
        turn = {Action.LEFT: [0, 0, TURN_RAD], Action.FORWARD: [FORWARD_M, 0, 0]}.get(action, [0, 0, 0])
        pose = compose(pose, np.array(turn, float))
        laser = LaserScan(bearing_rad=bearings, range_m=np.full(180, 3.0), max_range_m=8.0, height_m=0.2)
        estimates.append(made.update(room.depth(pose), action, np.array(turn, float), laser))
    return estimates


@pytest.mark.parametrize("kind", ["classical", "neural"])
def test_mapper_estimates_the_same_map_whatever_its_size(kind, monkeypatch):
    """All cells, the patch ahead, goals and paths are the same with computed probabilities as with arrays."""
    config = MapperConfig(moving=MovingConfig(tracks=True))

    def decisions():
        made = (
            NeuralMapper(saying(1.0, 0.5), config=config)
            if kind == "neural"
            else ClassicalMapper(config=config)
        )
        estimates = _estimates(made)
        for estimate in estimates:
            explorer, planner = FrontierExplorer(), Planner()
            goal = explorer.goal(estimate)
            path = planner.plan(estimate, np.array([1.0, 0.5])).path
            yield belief_ahead(estimate), belief_ahead(estimate, anticipated=True), goal, path, estimate.pose
        for layer in ("obstacle_probability", "anticipated_probability", "explored", "blocked", "obstacle"):
            yield (getattr(estimates[-1], layer, None),)

    expected = [[None if v is None else np.array(v) for v in values] for values in decisions()]
    for module in (occupancy, neural):
        monkeypatch.setattr(module, "LARGE_CELLS", 0)
    computed = list(decisions())
    assert isinstance(computed[-5][0], ComputedGrid)
    for got, right in zip(computed, expected, strict=True):
        for value, expected_value in zip(got, right, strict=True):
            if expected_value is None:
                assert value is None
            else:
                np.testing.assert_allclose(np.asarray(value), expected_value, rtol=0, atol=1e-4)


@pytest.mark.parametrize("cells", [[], [(0, 0)], [(199, 149)], [(70, 3), (130, 140)], [(64, 64), (63, 127)]])
def test_known_box_spans_the_known_cells_and_the_robot(cells):
    """Beyond strips of 64 rows and columns as well, at the borders, and with nothing known."""
    probability = np.full((200, 150), 0.5, np.float32)
    for iy, ix in cells:
        probability[iy, ix] = 0.4
    nothing = np.zeros(probability.shape, bool)
    estimate = MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=1.0, shape=probability.shape),
        obstacle_probability=probability,
        explored=nothing,
        blocked=nothing,
        pose=np.array([75.0, 100.0, 0.0]),
    )
    corners = np.array([(ix + k, iy + k) for iy, ix in cells for k in (0, 1)] + [(75, 100)])
    low, high = known_box(estimate)
    assert np.array_equal(low, corners.min(axis=0)) and np.array_equal(high, corners.max(axis=0))


_DIAGONAL = """
import resource
import numpy as np
from slam.mapping.classical import ClassicalMapper
from slam.sensing.laser import LaserScan

bearings = np.linspace(-np.pi, np.pi, 90, endpoint=False)
laser = LaserScan(bearing_rad=bearings, range_m=np.full(90, 2.0), max_range_m=20.0, height_m=0.2)
mapper = ClassicalMapper()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for along_m in range(0, 400, 2):
    pose = np.array([along_m, along_m, 0.0])
    mapper._make_room(*mapper.occupancy.laser_box(laser, pose))
    mapper.occupancy.integrate_laser(laser, pose)
    points = laser.dense(20.0)
    mapper.surfaces.add(points + pose[:2], -points / 2, np.ones(len(points)))
    estimate = mapper.estimate()
cells = estimate.frame.shape[0] * estimate.frame.shape[1]
print(cells, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="ru_maxrss is in kB on Linux only")
def test_mapper_takes_memory_where_it_has_seen():
    """A diagonal of 400 m x 400 m takes less than 3 bytes per cell of its rectangle; a probability alone took 4."""
    run = subprocess.run([sys.executable, "-c", _DIAGONAL], capture_output=True, text=True, check=True)
    cells, taken = map(int, run.stdout.split()[-2:])
    assert cells > 64e6 and taken < 3 * cells
