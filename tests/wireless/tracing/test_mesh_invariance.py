"""Paths do not depend on how a mesh is cut, turned, moved, rounded or numbered."""

import io

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from wireless.tracing.tracer import Tracer, TracerConfig

C = 299792458.0
CUTS = ("plain", "subdivided", "cut anywhere", "doubled")


def room(size, cut, rng):
    """A closed room around zero, its walls cut into triangles somehow; corners are not shared."""
    mesh = trimesh.creation.box(size)
    triangles = mesh.triangles
    if cut == "subdivided":
        triangles = mesh.subdivide().subdivide().triangles
    if cut == "cut anywhere":  # at places inside, and at sides where neighbours are not: T-junctions
        pieces = []
        for a, b, c in triangles:
            share = rng.dirichlet([1, 1, 1])
            inside, on = share @ (a, b, c), a + rng.uniform(0.01, 0.99) * (b - a)
            pieces += [[(a, b, inside), (b, c, inside), (c, a, inside)], [(a, on, c), (on, b, c)]][
                rng.integers(2)
            ]
        triangles = np.array(pieces)
    if cut == "doubled":
        triangles = np.concatenate([triangles, triangles[:, ::-1]])
    return triangles[rng.permutation(len(triangles))]


def images(size, tx, rx):
    """Lengths of the direct path and of all first-order reflections in a closed room, by mirrored transmitters."""
    lengths = [np.linalg.norm(tx - rx)]
    for axis in range(3):
        for side in (-1, 1):
            image = tx.copy()
            image[axis] = side * size[axis] - tx[axis]
            lengths.append(np.linalg.norm(image - rx))
    return np.sort(lengths)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    cut=st.sampled_from(CUTS),
    shifted=st.sampled_from(["not", "80 m", "to UTM and back"]),
    bits=st.sampled_from([32, 64]),
)
def test_each_first_order_path_of_a_room_is_found_once(seed, cut, shifted, bits):
    """Rooms of random size and attitude; all 16 links of each have 7 paths, of the lengths of images, within 0.1 mm."""
    rng = np.random.default_rng(seed)
    size = rng.uniform([3, 3, 2.4], [12, 9, 4])
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
    turn[:3, 3] = rng.uniform(-80, 80, 3) if shifted == "80 m" else 0.0
    corners = trimesh.transform_points(room(size, cut, rng).reshape(-1, 3), turn)
    if shifted == "to UTM and back":
        offset = np.array([453210.5, 5412345.25, 310.0])
        corners = (corners + offset) - offset
    if bits == 32:
        corners = corners.astype(np.float32).astype(float)
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    tx, rx = (rng.uniform(-0.45, 0.45, (4, 3)) * size for _ in range(2))
    config = TracerConfig(
        scene="space", max_reflections=1, diffraction=False, max_transmissions=0, floor_ceiling=True
    )
    paths = Tracer(mesh, config=config).trace(
        trimesh.transform_points(tx, turn), trimesh.transform_points(rx, turn), workers=1
    )
    assert (paths.count() == 7).all()
    for i in range(4):
        for j in range(4):
            found = np.sort(paths.delay_s[(paths.tx == i) & (paths.rx == j)]) * C
            np.testing.assert_allclose(found, images(size, tx[i], rx[j]), atol=1e-4)


def furnished():
    """A room of 8 x 6 x 3 m3 with 12 turned boxes and two spheres in it: 460 triangles."""
    rng = np.random.default_rng(5)
    parts = [trimesh.creation.box((8, 6, 3))]
    for place in rng.uniform([-3.4, -2.4, -1.2], [3.4, 2.4, 1.2], (12, 3)):
        parts.append(trimesh.creation.box(rng.uniform(0.1, 0.5, 3)))
        parts[-1].apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        parts[-1].apply_translation(place)
    for place in ([-2.0, 1.0, 0.3], [1.5, -1.2, -0.4]):
        parts.append(trimesh.creation.icosphere(subdivisions=1, radius=0.3))
        parts[-1].apply_translation(place)
    return trimesh.util.concatenate(parts)


@pytest.fixture(scope="module")
def links():
    """A transmitter and 30 receivers in the room, off all that stands in it."""
    rng = np.random.default_rng(6)
    points = rng.uniform([-3.8, -2.8, -1.4], [3.8, 2.8, 1.4], (400, 3))
    mesh = furnished()
    inside = np.zeros(len(points), bool)
    for part in mesh.split()[1:]:
        inside |= np.linalg.norm(points - part.bounds.mean(axis=0), axis=1) < 0.5
    points = points[~inside]
    return points[:1], points[1:31]


@pytest.mark.parametrize("search", ["exhaustive", "rays"])
def test_a_furnished_room_has_the_same_paths_as_an_stl_file(links, search):
    """Subdivided, turned by 37 degrees and saved in 32 bits: the same paths up to second order, within 0.1 mm."""
    config = TracerConfig(
        scene="space",
        search=search,
        max_reflections=2,
        diffraction=False,
        max_transmissions=0,
        floor_ceiling=True,
        max_paths=200,
    )
    turn = trimesh.transformations.rotation_matrix(np.radians(37), [0.3, 0.5, 0.8])
    plain, tilted = furnished(), furnished().subdivide()
    tilted.apply_transform(turn)
    file = io.BytesIO(tilted.export(file_type="stl"))
    saved = trimesh.load_mesh(file, file_type="stl")
    whole = Tracer(plain, config=config).trace(*links, workers=1)
    again = Tracer(saved, config=config).trace(
        *(trimesh.transform_points(points, turn) for points in links), workers=1
    )
    np.testing.assert_array_equal(whole.count(), again.count())
    for j in range(whole.count().shape[1]):
        one, other = (np.sort(paths.delay_s[paths.rx == j]) for paths in (whole, again))
        np.testing.assert_allclose(one * C, other * C, atol=1e-4)
