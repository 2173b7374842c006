"""What plans, buildings and logs look like when printed and drawn."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from robosim.building.building import make_building
from robosim.episode_log import EpisodeLog
from robosim.robot.motion import Motion
from robosim.task.tasks import Task
from tests.plans import two_rooms


@pytest.fixture
def plan():
    """Two rooms with a door, turned and moved, under a name that looks like markup."""
    return replace(two_rooms(0.8), origin=(3.0, -2.0, 0.5), name="<b>$x$")


def test_plans_and_buildings_say_in_a_line_what_they_are(plan):
    """Name, size and area; no array is printed."""
    rows, columns = plan.shape
    area = f"{plan.free.sum() * plan.resolution_m**2:.1f} m2"
    assert (
        repr(plan)
        == f"<FloorPlan '<b>$x$': {columns} x {rows} cells of {plan.resolution_m:g} m, {area} free>"
    )
    building = make_building(plan)
    assert repr(building) == (
        f"<Building '<b>$x$': {area} of free floor, {len(building.mesh.faces)} faces of partition, concrete, "
        "ceiling_board>"
    )


def test_plan_and_walls_are_drawn_in_one_place(plan):
    """Walls of the building lie within a cell of free cells in the picture of the plan; both are in `map`."""
    axes = plan.plot()
    (image,) = axes.images
    axes.figure.canvas.draw()
    building = make_building(plan)
    ends = building.walls_2d.reshape(-1, 2)
    to_cells = (image.get_transform() - axes.transData).inverted()
    np.testing.assert_allclose(to_cells.transform(ends), plan.to_cells(ends), atol=1e-6)
    shade = image.get_array()
    assert set(np.unique(shade[plan.free])) == {255} and 255 not in shade[~plan.free]
    assert building.plot(axes) is axes
    assert len(axes.collections[0].get_segments()) == len(building.walls_2d)
    assert axes.title.get_text() == "<b>$x$" and not axes.title.get_parse_math()
    plt.close(axes.figure)
    alone = building.plot()
    (x0, x1), (y0, y1) = alone.get_xlim(), alone.get_ylim()
    assert x0 < ends[:, 0].min() and x1 > ends[:, 0].max() and y0 < ends[:, 1].min() and y1 > ends[:, 1].max()
    plt.close(alone.figure)


def test_a_log_draws_both_trajectories_and_the_target():
    """True and estimated trajectory, start and target at their places; a log with nothing in it too."""
    log = EpisodeLog(Task(np.zeros(3), np.array([2.0, 1.0]), 2.0))
    assert repr(log) == "<EpisodeLog: running after 0 steps>"
    plt.close(log.plot().figure)
    log.add_pose(None, np.array([0.0, 0, 0]), np.array([0.1, 0, 0]), 0.1)
    log.motions.append(Motion(np.array([1.0, 0, 0]), collided=False, duration_s=1.0))
    log.add_pose(None, np.array([1.0, 0, 0]), np.array([1.1, 0, 0]), 0.2)
    axes = log.plot()
    drawn = {line.get_label(): line.get_xydata().tolist() for line in axes.lines}
    assert drawn == {
        "true trajectory": [[0, 0], [1, 0]],
        "estimated trajectory": [[0.1, 0], [1.1, 0]],
        "start": [[0, 0]],
        "target": [[2, 1]],
    }
    assert repr(log) == "<EpisodeLog: running after 1 step>"
    plt.close(axes.figure)
