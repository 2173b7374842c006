"""A robot's radio among people: what they weaken, and what stays that of the building."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.radio.link import RadioLink, RadioLinkConfig
from tests.plans import room
from wireless.motion.bodies import people
from wireless.paths import LinkState

POSE = np.array([1.0, 2.0, 0.0])
TARGET = np.array([7.0, 2.0])


@pytest.fixture(scope="module")
def building():
    return make_building(room(8.0, 4.0))


def placed(building, **config) -> RadioLink:
    link = RadioLink(building, RadioLinkConfig(**config))
    link.place(TARGET)
    return link


def snr(link: RadioLink, bodies=None) -> np.ndarray:
    estimates = link.measure(POSE, np.random.default_rng(0), bodies)
    return estimates.snr_db[0, : int(estimates.count[0])]


@pytest.mark.parametrize("model", ["knife-edges", "model-b"])
def test_a_person_in_the_line_of_sight_weakens_it_and_leaves_the_state(building, model):
    """By 8 to 25 dB at 28 GHz; a reflection is the strongest path then, and the state is that of the building."""
    link = placed(building, blockage=model)
    alone = snr(link)
    assert link.state is LinkState.LOS and np.isnan(link.sight_loss_db)
    assert link.bearing == pytest.approx(0.0)
    blocked = snr(link, people(np.array([[4.0, 2.0]])))
    assert 8 < link.sight_loss_db < 25
    assert link.state is LinkState.LOS and abs(link.bearing) > 0.1
    assert 2 < alone[0] - blocked[0] < 25


def test_no_people_and_people_aside_change_no_bit(building):
    link = placed(building)
    alone = snr(link)
    np.testing.assert_array_equal(snr(link, people(np.zeros((0, 2)))), alone)
    np.testing.assert_array_equal(
        snr(placed(building, blockage="none"), people(np.array([[4.0, 2.0]]))), alone
    )
