"""Sides of patches that can be reached from a point, judged by convex bodies and by exhaustive search."""

import numpy as np
import pytest
import trimesh

from wireless.geometry.reachable_sides import Backs
from wireless.tracing.tracer import Tracer, TracerConfig

RNG = np.random.default_rng(0)
ROOM = trimesh.creation.box(bounds=[(0, 0, 0), (7, 5, 3)])


def shifted(mesh, *where):
    mesh.apply_translation(where)
    return mesh


def sphere(*where):
    return shifted(trimesh.creation.icosphere(subdivisions=2, radius=0.6), *where)


def seen(mesh, point):
    """Space of a mesh, and which sides of its patches are seen from a point."""
    tracer = Tracer(mesh, config=TracerConfig(scene="space", max_transmissions=0))
    space = tracer.scene.space
    return space, Backs(space).seen_from(np.asarray(point, float) - tracer.scene.origin)


def in_front(space, point_of_space):
    return space.panes.plane[:, :3] @ point_of_space - space.panes.plane[:, 3] > 0


def test_of_convex_bodies_the_side_is_seen_that_the_point_is_on_or_none():
    """From outside a sphere its outer sides, from inside its inner ones; of the room always the inner ones."""
    mesh = trimesh.util.concatenate([ROOM.copy(), sphere(3, 2, 1.2)])
    for point in ((6, 4, 2), (3, 2, 1.2)):
        space, side = seen(mesh, point)
        centre = (space.panes.low + space.panes.high) / 2
        middle = np.array([3, 2, 1.2]) - mesh.bounds.mean(axis=0)
        large = np.linalg.norm(space.panes.high - space.panes.low, axis=1) > 2
        outward = np.sign(np.einsum("pi,pi->p", space.panes.plane[:, :3], centre - middle))
        inside = point == (3, 2, 1.2)
        assert large.sum() == 6 and (side != 0).all()
        np.testing.assert_array_equal(side[large], -outward[large])
        np.testing.assert_array_equal(side[~large], -outward[~large] if inside else outward[~large])


def test_open_and_crossing_surfaces_are_seen_from_both_sides():
    """A sphere with a hole; where two halves of one surface cross; one that a point lies on."""
    bowl = sphere(3, 2, 1.2)
    bowl.update_faces(np.arange(len(bowl.faces)) > 0)
    space, side = seen(trimesh.util.concatenate([ROOM.copy(), bowl]), (6, 4, 2))
    assert (side != 0).sum() == 6
    # A star drawn in one stroke, its five sides cross.
    turn = np.arange(5) * 4 * np.pi / 5
    star = np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = (np.column_stack([star, np.full(5, z)]) for z in (0.5, 1.5))
    top = [(0, i, i + 1) for i in range(1, 4)]
    sides = [(i, (i + 1) % 5, 5 + i) for i in range(5)] + [
        (5 + i, (i + 1) % 5, 5 + (i + 1) % 5) for i in range(5)
    ]
    faces = np.array([*top, *(5 + np.array(top)), *sides])
    crossed = trimesh.Trimesh(np.vstack([low, high]) + np.array([3, 2, 0]), faces, process=False)
    space, side = seen(trimesh.util.concatenate([ROOM.copy(), crossed]), (6, 4, 2))
    upright = np.abs(space.panes.plane[:, 2]) < 0.5
    small = np.linalg.norm(space.panes.high - space.panes.low, axis=1) < 2.5
    assert (upright & small).sum() == 5 and (side[upright & small] == 0).all()
    space, side = seen(trimesh.util.concatenate([ROOM.copy(), sphere(3, 2, 1.2)]), (3, 0, 1.2))
    assert (side == 0).sum() == 6


def test_bodies_that_let_paths_through_are_seen_from_both_sides():
    """Only the sphere of metal hides what is in it."""
    mesh = trimesh.util.concatenate([sphere(3, 2, 1.2), sphere(5, 2, 1.2)])
    made_of = {"materials": ("partition", "metal"), "face_material": np.repeat([0, 1], 320)}
    tracer = Tracer(mesh, config=TracerConfig(scene="space", max_transmissions=1), **made_of)
    space = tracer.scene.space
    side = Backs(space).seen_from(np.array([0, 2.0, 1.2]) - tracer.scene.origin)
    through = space.passes[space.patch_facet]
    assert 0 < through.sum() < len(side)
    assert (side[through] == 0).all() and (side[~through] != 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_path_is_lost(seed):
    """Rooms of dented spheres that cross each other and of a bowl: rays find what exhaustive search finds."""
    rng = np.random.default_rng(seed)
    parts = [ROOM.copy()]
    for _ in range(3):
        one = trimesh.creation.icosphere(subdivisions=1, radius=rng.uniform(0.4, 0.8))
        one.vertices *= 1 + 0.35 * np.sin(5 * one.vertices[:, :1]) * np.cos(4 * one.vertices[:, 1:2])
        parts.append(shifted(one, *rng.uniform((1.5, 1.5, 0.9), (5, 3.5, 1.5))))
    parts[-1].update_faces(np.arange(len(parts[-1].faces)) % 20 > 0)
    mesh = trimesh.util.concatenate(parts)
    places = rng.uniform((0.2, 0.2, 2.3), (6.8, 4.8, 2.9), (9, 3))
    found = []
    for search in ("rays", "exhaustive"):
        config = TracerConfig(
            scene="space",
            search=search,
            max_reflections=2,
            max_transmissions=0,
            floor_ceiling=True,
            max_paths=500,
        )
        found.append(Tracer(mesh, config=config).trace(places[:1], places[1:]))
    rays, every = found
    assert len(every.power) > 200
    np.testing.assert_array_equal(rays.link, every.link)
    np.testing.assert_allclose(rays.delay_s, every.delay_s, rtol=1e-12)
