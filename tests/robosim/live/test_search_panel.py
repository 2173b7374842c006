"""Start and target by clicks on the floor."""

from types import SimpleNamespace

import numpy as np
import pytest
from shapely import Point

from robosim.live.link_model import LinkModel
from robosim.live.search_panel import FROM_CLICKS, FROM_SEED
from robosim.radio.scene import RadioConfig
from tests.plans import two_rooms

pytest.importorskip("viser", reason="needs viser: pip install -e '.[live]'")


def click(searches, place, eye=(3.0, -2.0, 6.0)):
    """A click from an eye through a point of the floor."""
    direction = np.array([*place, 0.0]) - eye
    searches._click(
        SimpleNamespace(ray_origin=tuple(eye), ray_direction=tuple(direction / np.linalg.norm(direction)))
    )


@pytest.fixture
def searches(explored, quick):
    return explored.search(quick)


def test_a_click_sets_start_or_target(searches):
    searches.await_click("target")
    click(searches, (5.0, 2.0))
    assert searches.places["target"] == pytest.approx([5.0, 2.0]) and "start" not in searches.places
    assert searches._task.value == FROM_CLICKS
    start, target = searches._ends()
    assert start is None and target == pytest.approx([5.0, 2.0])
    searches.await_click("start")
    click(searches, (1.0, 1.0))
    start, _ = searches._ends()
    assert start == pytest.approx([1.0, 1.0, np.arctan2(1.0, 4.0)])
    searches.clear_places()
    assert searches.places == {} and searches._task.value == FROM_SEED


def test_a_click_on_a_wall_sets_the_nearest_floor(searches):
    searches.await_click("start")
    click(searches, (3.1, 0.5))
    model = searches._radio.model
    free = model.building.free_at(model.config.height_m).buffer(-model.clearance_m)
    assert free.distance(Point(*searches.places["start"])) < 1e-9
    assert np.hypot(*(searches.places["start"] - (3.1, 0.5))) < 0.2


def test_a_click_on_the_second_of_two_buildings_is_relative_to_it(searches, monkeypatch):
    """Both searches are in the same building, drawn 8 m apart."""
    shown = [
        SimpleNamespace(middle=np.array([3.1, 1.5]), offset=np.zeros(2)),
        SimpleNamespace(middle=np.array([11.1, 1.5]), offset=np.array([8.0, 0.0])),
    ]
    monkeypatch.setattr(type(searches.player), "buildings", shown)
    searches.await_click("start")
    click(searches, (9.0, 1.0))
    assert searches.places["start"] == pytest.approx([1.0, 1.0])


def test_a_place_on_another_plan_is_moved_to_free_floor(searches):
    searches.set_place("start", np.array([5.9, 2.9]))
    searches._radio.show_plan(LinkModel(two_rooms(0.8), RadioConfig()))
    start, _ = searches._ends()
    assert searches._radio.model.nearest_free(start[:2]) == pytest.approx(start[:2])
