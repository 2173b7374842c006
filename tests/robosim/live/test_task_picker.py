"""Start and target by a click: the place on the floor, in the building that was clicked into."""

from types import SimpleNamespace

import numpy as np
import pytest

from robosim.building.building import BuildingConfig
from robosim.live.search_panel import FROM_CLICKS, FROM_SEED
from tests.plans import two_rooms

pytest.importorskip("viser", reason="needs viser: pip install -e '.[live]'")


def click(picker, at, eye=(3.0, -2.0, 6.0)):
    """A click from an eye through a point of the floor."""
    way = np.array([*at, 0.0]) - eye
    picker._clicked(SimpleNamespace(ray_origin=tuple(eye), ray_direction=tuple(way / np.linalg.norm(way))))


@pytest.fixture
def searches(explored, quick):
    return explored.search(quick, BuildingConfig())


def test_a_click_sets_what_was_asked_for(searches):
    picker = searches.picker
    picker.ask("target")
    click(picker, (5.0, 2.0))
    assert picker.places["target"] == pytest.approx([5.0, 2.0]) and "start" not in picker.places
    assert searches._task.value == FROM_CLICKS
    start, target = searches._given()
    assert start is None and target == pytest.approx([5.0, 2.0])
    picker.ask("start")
    click(picker, (1.0, 1.0))
    start, _ = searches._given()
    assert start == pytest.approx([1.0, 1.0, np.arctan2(1.0, 4.0)])
    picker.forget()
    assert picker.places == {} and searches._task.value == FROM_SEED


def test_a_click_into_a_wall_means_the_floor_before_it(searches):
    picker = searches.picker
    picker.ask("start")
    click(picker, (3.1, 0.5))
    free = searches._radio.model._free[0]
    from shapely import Point

    assert free.distance(Point(*picker.places["start"])) < 1e-9
    assert np.hypot(*(picker.places["start"] - (3.1, 0.5))) < 0.2


def test_a_click_into_the_second_of_two_buildings_counts_there(searches, monkeypatch):
    """Both searches are in the same building, drawn 8 m apart."""
    shown = [
        SimpleNamespace(middle=np.array([3.1, 1.5]), offset=np.zeros(2)),
        SimpleNamespace(middle=np.array([11.1, 1.5]), offset=np.array([8.0, 0.0])),
    ]
    monkeypatch.setattr(searches.picker, "_sceneries", lambda: shown)
    searches.picker.ask("start")
    click(searches.picker, (9.0, 1.0))
    assert searches.picker.places["start"] == pytest.approx([1.0, 1.0])


def test_a_place_of_another_plan_is_brought_to_the_floor_of_this_one(searches):
    searches.picker.put("start", np.array([5.9, 2.9]))
    from robosim.live.link_model import LinkModel, LinkSettings

    searches._radio.show_plan(LinkModel(two_rooms(0.8), BuildingConfig(), LinkSettings()))
    start, _ = searches._given()
    assert searches._radio.model.nearest_free(start[:2]) == pytest.approx(start[:2])
