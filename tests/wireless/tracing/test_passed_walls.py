"""Walls that paths go through: which are worth trying, judged by the engine in space that tries all."""

from dataclasses import fields

import numpy as np
import pytest

from wireless.em.materials import Layer, Material
from wireless.paths import Interaction, LinkState
from wireless.tracing import scenes
from wireless.tracing.tracer import Tracer, TracerConfig

TX = np.array([[0.83, 1.17, 1.5]])
RX = np.array([[5.31, 0.72, 1.5], [2.64, 3.23, 1.2], [4.42, 3.13, 1.0]])


@pytest.fixture(scope="module")
def two_rooms(extruded, ring):
    """Rooms of 3 x 4 m2 and 2.9 x 4 m2, a wall of 10 cm between."""
    return extruded(
        np.concatenate([ring((0, 0), (3, 0), (3, 4), (0, 4)), ring((3.1, 0), (6, 0), (6, 4), (3.1, 4))])
    )


@pytest.fixture(scope="module")
def with_a_screen(extruded, ring):
    """A room with a thin screen from one wall into the middle: the same space on both sides of it."""
    return extruded(np.concatenate([ring((0, 0), (6, 0), (6, 4), (0, 4)), [[(3, 0), (3, 2.5)]]]))


def traced(mesh, material, **options):
    return Tracer(mesh, materials=(material,), config=TracerConfig(max_paths=500, **options)).trace(TX, RX)


def same(one, other):
    assert len(one) == len(other) > 0
    np.testing.assert_array_equal(one.link, other.link)
    np.testing.assert_allclose(one.power_db, other.power_db, atol=1e-6)
    np.testing.assert_allclose(one.delay_s, other.delay_s, atol=1e-15)


def test_one_face_leads_out_of_a_room_and_not_into_the_next(two_rooms):
    """In the published convention each face is passed: one changes nothing, two let the direct path through."""
    none, one, two = (
        traced(two_rooms, "partition", max_transmissions=n, wall_passage="face") for n in range(3)
    )
    same(one, none)
    assert not one.between(0, 0).order.size and not one.between(0, 2).order.size
    direct = two.between(0, 0).strongest()
    assert direct.order == [2] and (direct.interaction[0, :2] == Interaction.TRANSMISSION).all()
    assert two.link_state()[0, 0] == LinkState.LOS and one.link_state()[0, 0] == LinkState.OUTAGE


@pytest.mark.parametrize("passed", [1, 2])
@pytest.mark.parametrize("name", ["two_rooms", "with_a_screen"])
def test_what_is_left_out_would_lead_nowhere(name, passed, request):
    """Plan and space engine find the same paths, though only one of them looks which walls are worth passing.

    Without edges: in space the walls' upper edges diffract too.
    """
    mesh = request.getfixturevalue(name)
    options = {"max_transmissions": passed, "max_reflections": 2, "diffraction": False}
    same(traced(mesh, "partition", **options), traced(mesh, "partition", scene="space", **options))


def test_a_screen_is_passed_once(with_a_screen):
    """A thin wall with the same space on both sides is one wall."""
    direct = traced(with_a_screen, "partition", max_transmissions=1).between(0, 0).strongest()
    assert direct.interaction[0, 0] == Interaction.TRANSMISSION and direct.order == [1]


def test_half_spaces_let_nothing_through(with_a_screen):
    """The same paths whatever may be passed; and where walls differ, those of layers alone are passed."""
    same(
        traced(with_a_screen, "concrete", max_transmissions=3),
        traced(with_a_screen, "concrete", max_transmissions=0),
    )
    of_face = np.zeros(len(with_a_screen.faces), int)
    of_face[np.isclose(with_a_screen.triangles_center[:, 0], 3.0)] = 1
    pane = Material("pane", (Layer(thickness_m=0.006, material="glass"),))
    for scene in ("plan", "space"):
        config = TracerConfig(scene=scene, max_paths=500, max_transmissions=2, max_reflections=2)
        tracer = Tracer(with_a_screen, materials=("concrete", pane), face_material=of_face, config=config)
        paths = tracer.trace(TX, RX)
        passed = paths.interaction == Interaction.TRANSMISSION
        assert passed.any() and np.allclose(paths.point[..., 0][passed], 3.0)


def test_what_was_traced_before_changes_no_path(two_rooms):
    """One tracer, links in either room and between them in turn: bit-identical to a new tracer for each."""
    config = TracerConfig(max_paths=50)
    stored = Tracer(two_rooms, materials=("partition",), config=config)
    for tx in (TX, RX[1:2]):
        for rx in (RX[:1], RX[1:2], RX[2:], RX[1:2]):
            one = stored.trace(tx, rx)
            other = Tracer(two_rooms, materials=("partition",), config=config).trace(tx, rx)
            assert one.link.tolist() == other.link.tolist()
            np.testing.assert_array_equal(one.gain, other.gain)


@pytest.mark.parametrize("stored, most", [(1, 1000), (32, 1000), (0, 5)])
def test_what_a_transmitter_sees_is_stored_for_the_same_walls_alone(two_rooms, monkeypatch, stored, most):
    """Receivers in its room and in the next by turns, another transmitter between: as if each link were the first.

    To receivers in its own room no path passes the wall, to one in the next room paths do. Transmitters that see too
    much are not stored.
    """
    monkeypatch.setattr(scenes, "MOST_VISITS", most)
    monkeypatch.setattr(scenes, "STORED_SIGHTS", stored)
    config = TracerConfig(max_transmissions=1, wall_passage="face")
    tracer = Tracer(two_rooms, materials=("partition",), config=config)
    for tx in (TX, RX[:1], TX):
        for rx in (RX[1:2], RX[2:], RX[1:2], RX[:1]):
            first = Tracer(two_rooms, materials=("partition",), config=config).trace(tx, rx)
            paths = tracer.trace(tx, rx)
            for field in fields(paths):
                np.testing.assert_array_equal(getattr(paths, field.name), getattr(first, field.name))
    assert len(tracer.scene._sights) == min(stored, 4)
