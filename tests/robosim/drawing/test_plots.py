"""Plots of plans and episodes: legend and scale bar."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.drawing import plots
from robosim.drawing.plots import explain, plan_axes, plot_episode, plot_plan, wall_keys
from robosim.episode_log import EpisodeLog
from robosim.task.tasks import Task
from slam.grid import GridFrame, MapEstimate
from tests.plans import two_rooms


@pytest.fixture
def drawn(monkeypatch):
    """Figures as they would be written."""
    figures = []
    monkeypatch.setattr(plots, "save_figure", lambda figure, path: figures.append(figure))
    yield figures
    for figure in figures:
        plt.close(figure)


def _named(figure) -> list[str]:
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def _log(seeks: bool) -> EpisodeLog:
    log = EpisodeLog(Task(np.array([1.0, 0.6, 0.0]), np.array([5.0, 2.0]), 4.0), seeks_target=seeks)
    log.add_pose(None, log.task.start, log.task.start, 0.25)
    return log


@pytest.mark.parametrize("seeks", [True, False])
def test_the_legend_names_walls_map_and_trajectories(drawn, tmp_path, seeks):
    building = make_building(two_rooms(0.8))
    frame = GridFrame(origin_xy=(0.0, 0.0), shape=(60, 120))
    nothing = np.zeros(frame.shape, bool)
    estimate = MapEstimate(
        frame=frame,
        obstacle_probability=np.full(frame.shape, 0.5, np.float32),
        explored=nothing,
        blocked=nothing,
        pose=np.zeros(3),
    )
    plot_episode(tmp_path / "map.png", building, _log(seeks), estimate)
    expected = [
        "true walls",
        "floor seen",
        "obstacle seen",
        "not seen",
        "true trajectory",
        "estimated trajectory",
        "start",
    ]
    assert _named(drawn[0]) == expected + ["target"] * seeks
    title = drawn[0].axes[0].get_title()
    assert "25 % seen" in title and ("shortest" in title) == seeks


def test_parts_of_the_floor_are_labelled_by_their_areas(drawn, tmp_path):
    """Two rooms without a door wide enough: two parts, each of the cells in its colour, the larger first."""
    plan = two_rooms(0.1)
    places = reach(make_building(plan), 0.1)
    plot_plan(tmp_path / "reach.png", make_building(plan), places)
    cells = np.sort(np.bincount(places.parts.ravel())[1:])[::-1] * plan.resolution_m**2
    assert places.n_parts == 2
    assert _named(drawn[0])[1:3] == [f"part {k + 1}: {area:.1f} m2" for k, area in enumerate(cells)]


def test_the_floor_that_can_be_reached_is_filled(drawn, tmp_path):
    """Each cell of each part in the part's colour, on a plan turned by 30 degrees too; other cells stay open."""
    plan = replace(two_rooms(0.1), origin=(1.0, -2.0, np.radians(30)))
    building = make_building(plan)
    places = reach(building, 0.1)
    plot_plan(tmp_path / "reach.png", building, places)
    (mesh,) = (one for one in drawn[0].axes[0].collections if isinstance(one, QuadMesh))
    shown = np.ma.filled(mesh.get_array().reshape(plan.shape), -1)
    larger = 1 + np.argmax(np.bincount(places.parts.ravel())[1:])
    assert np.array_equal(shown, np.where(places.parts == 0, -1, places.parts != larger))
    corner = mesh.get_coordinates()
    middle = (corner[:-1, :-1] + corner[1:, 1:]) / 2
    assert np.allclose(middle[places.parts > 0], plan.centres(places.parts > 0))


@pytest.mark.parametrize("width_m", [3.0, 17.0, 90.0])
def test_a_scale_bar_is_as_long_as_it_says(width_m):
    """Its ends, in the axes' own metres."""
    figure, axes = plt.subplots(layout="constrained")
    axes.set(xlim=(-2.0, width_m - 2.0), ylim=(5.0, 9.0))
    explain(axes, wall_keys(furnished=True))
    bar = axes.lines[0].get_xdata()
    (label,) = (text.get_text() for text in axes.texts if text.get_text().endswith(" m"))
    assert np.ptp(bar) == pytest.approx(float(label[:-2]))
    assert np.all(axes.lines[0].get_ydata() < 5.0), "below the plan"
    plt.close(figure)


def test_the_axes_show_all_of_a_plan():
    figure, axes = plan_axes(make_building(two_rooms(0.8)))
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    assert west < 0 < 6 < east and south < 0 < 3 < north
    plt.close(figure)
