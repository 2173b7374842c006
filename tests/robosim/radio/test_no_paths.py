"""Reasons of missing paths: solids and ground around either end, and none where a scene is in order."""

import numpy as np
import pytest
import trimesh

from robosim.radio.no_paths import explain_missing_paths
from wireless.tracing.mitsuba_scene import MitsubaScene


def scene_of(**shapes):
    """A scene of meshes by their names."""
    mesh = trimesh.util.concatenate(list(shapes.values()))
    names = tuple((name, len(shape.faces), "concrete") for name, shape in shapes.items())
    return MitsubaScene(mesh, ("concrete",), np.zeros(len(mesh.faces), int), names)


def box(low, high, without=()):
    """A box [m], without the triangles whose outward normal is one of those given."""
    mesh = trimesh.creation.box(bounds=(low, high))
    faces = [not any(np.allclose(normal, each) for each in without) for normal in mesh.face_normals]
    mesh.update_faces(np.array(faces))
    return mesh


UP, DOWN = (0, 0, 1), (0, 0, -1)
GROUND = box((-20, -20, -1), (20, 20, 0), (DOWN, (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)))
HOUSE = box((2, -2, 0), (6, 2, 3))
#: Walls and roof apart, which close with the ground only; the lowest surface is that of a well apart.
OPEN_HOUSE = {
    "walls": box((2, -2, -0.5), (6, 2, 3), (UP, DOWN)),
    "roof": box((1, -3, 3), (7, 3, 3.1)),
    "well": box((-19, -19, -3), (-18, -18, -2)),
}
ON_GROUND = scene_of(ground=GROUND, house=HOUSE)
HALL = scene_of(hall=box((-9, -9, 0), (9, 9, 5)), column=HOUSE)
NONE = np.zeros(1, bool)
OUTSIDE, INSIDE, UNDER = (-5.0, 0, 1), (4.0, 0, 1), (-5.0, 0, -1)


@pytest.mark.parametrize(
    ("scene", "tx", "rx", "reason"),
    [
        (ON_GROUND, INSIDE, OUTSIDE, "the transmitter at (4, 0, 1) m lies inside shape house"),
        (ON_GROUND, OUTSIDE, INSIDE, "the receiver lies inside shape house: no path can enter"),
        (scene_of(ground=GROUND, **OPEN_HOUSE), INSIDE, OUTSIDE, "lies inside shapes walls, ground, roof: no path"),
        (scene_of(ground=GROUND, **OPEN_HOUSE), OUTSIDE, INSIDE, "the receiver lies inside shapes walls"),
        (ON_GROUND, UNDER, OUTSIDE, "(-5, 0, -1) m lies below the ground: above it is shape ground"),
        (ON_GROUND, OUTSIDE, UNDER, "the receiver lies below the ground: above is shape ground"),
        # A column in a hall: both ends are enclosed.
        (HALL, INSIDE, OUTSIDE, "the transmitter at (4, 0, 1) m lies inside shape column:"),
        (HALL, OUTSIDE, INSIDE, "the receiver lies inside shape column:"),
        (scene_of(a=HOUSE, b=box((-9, -9, 0), (-1, 9, 5))), INSIDE, OUTSIDE, "at (4, 0, 1) m lies inside shape a:"),
    ],
)  # fmt: skip
def test_explain_missing_paths_names_what_encloses_an_end(scene, tx, rx, reason):
    said = explain_missing_paths(scene, np.array(tx), np.array([rx]), NONE)
    assert reason in said and said.endswith(".") and "\n" not in said


@pytest.mark.parametrize(
    ("scene", "tx", "rx"),
    [
        # In the open, behind a house: diffraction and further reflections may lead there.
        (ON_GROUND, OUTSIDE, (9.0, 0, 1)),
        # In one room, and in one hall around a column.
        (scene_of(room=box((-9, -9, 0), (9, 9, 5))), OUTSIDE, INSIDE),
        (HALL, OUTSIDE, (8.0, 0, 1)),
        # A yard without a roof, on the ground and alone.
        (scene_of(ground=GROUND, yard=box((2, -2, 0), (6, 2, 3), (UP,))), INSIDE, OUTSIDE),
        (scene_of(yard=box((2, -2, 0), (6, 2, 3), (UP, DOWN))), INSIDE, OUTSIDE),
        # Below the floor of a house that the ground is missing of, both ends.
        (scene_of(house=HOUSE), (4.0, 0, -1), (4.0, 1, -2)),
    ],
)
def test_explain_missing_paths_has_no_reason_in_the_same_space(scene, tx, rx):
    assert explain_missing_paths(scene, np.array(tx), np.array([rx]), NONE) == ""


def test_explain_missing_paths_of_many_receivers():
    """The reason counts where half of the receivers or more lack paths, and all of these are on the other side."""
    scene, inside = ON_GROUND, np.array([[4.0, y, 1] for y in (-1, 0, 0.5, 1)])
    outside = inside - [9, 0, 0]
    assert "all 4 receivers lie inside shape house" in explain_missing_paths(
        scene, np.array(OUTSIDE), inside, np.zeros(4, bool)
    )
    both, reached = np.vstack([inside, outside]), np.arange(8) < 4
    said = explain_missing_paths(scene, np.array(INSIDE), both, reached)
    assert "lies inside shape house: only receivers in it have paths" in said
    assert explain_missing_paths(scene, np.array(OUTSIDE), both, ~reached) == ""
    assert explain_missing_paths(scene, np.array(INSIDE), both, np.ones(8, bool)) == ""
    assert explain_missing_paths(scene, np.array(INSIDE), both[:5], np.arange(5) < 4) == ""
