"""A drawn wall is passed once, and weakens by the decibels of its own layers."""

import itertools

import numpy as np
import pytest
import trimesh

from wireless.em.materials import wall_row
from wireless.paths import Interaction, LinkCategory, LinkState
from wireless.tracing.tracer import Tracer, TracerConfig

C = 299792458.0


def slab_loss_db(material, frequency_hz):
    """Loss at normal incidence by transfer matrices of all boundaries and layers [dB]."""
    row = wall_row(material, frequency_hz)
    index = [1.0, *np.sqrt(row[0::2]), 1.0]
    thickness = [0.0, *row[1::2].real, 0.0]
    matrix = np.eye(2, dtype=complex)
    for i in range(len(index) - 1):
        r = (index[i] - index[i + 1]) / (index[i] + index[i + 1])
        matrix = matrix @ np.array([[1, r], [r, 1]]) * (index[i] + index[i + 1]) / (2 * index[i])
        phase = 1j * 2 * np.pi * frequency_hz / C * index[i + 1] * thickness[i + 1]
        matrix = matrix @ np.diag([np.exp(phase), np.exp(-phase)])
    return 20 * np.log10(abs(matrix[0, 0]))


@pytest.fixture
def apart(extruded, ring):
    """Makes two rooms with a wall of some thickness between them, at x = 3 m."""

    def make(thickness_m):
        far = 3 + thickness_m
        rooms = ring((0, 0), (3, 0), (3, 4), (0, 4)), ring((far, 0), (9, 0), (9, 4), (far, 4))
        return extruded(np.concatenate(rooms))

    return make


def with_partition(thickness_m):
    """A closed room of 9 x 4 x 3 m3 with a solid wall from side to side in it, as closed meshes."""
    room = trimesh.creation.box((9, 4, 3))
    room.apply_translation((4.5, 2, 1.5))
    wall = trimesh.creation.box((thickness_m, 3.9, 2.9))
    wall.apply_translation((3 + thickness_m / 2, 2, 1.5))
    return trimesh.util.concatenate([room, wall])


def excess_db(paths):
    """Loss of the direct path beyond free space [dB]; NaN if there is none."""
    length = np.linalg.norm(paths.tx_position[0] - paths.rx_position[0])
    direct = np.flatnonzero((paths.interaction == Interaction.TRANSMISSION).sum(axis=1) == paths.order)
    if len(direct) != 1:
        return np.nan
    free = (C / paths.frequency_hz / (4 * np.pi * length)) ** 2
    return 10 * np.log10(free / paths.power[direct[0]])


@pytest.mark.parametrize("thickness_m", [0.02, 0.15, 0.6])
@pytest.mark.parametrize(
    "material, frequency_ghz, right_db",
    [("glazing", 5.0, 10.25), ("concrete_wall", 5.2, 25.4), ("partition", 28.0, 4.3), ("door", 2.4, None)],
)
def test_one_wall_is_one_passage(apart, material, frequency_ghz, right_db, thickness_m):
    """Its own decibels, however thick it is drawn, traced as a plan and in space, as rooms and as a solid between.

    Both faces weakened before: 20.5, 50.8 and 8.6 dB. Against transfer matrices: within 1e-6 dB.
    """
    expected = slab_loss_db(material, frequency_ghz * 1e9)
    assert right_db is None or expected == pytest.approx(right_db, abs=0.06)
    for mesh, scene in [
        (apart(thickness_m), "plan"),
        (apart(thickness_m), "space"),
        (with_partition(thickness_m), "space"),
    ]:
        config = TracerConfig(scene=scene, max_reflections=0, diffraction=False, max_transmissions=1)
        tracer = Tracer(mesh, materials=(material,), frequency_hz=frequency_ghz * 1e9, config=config)
        paths = tracer.trace(np.array([[1.0, 2.0, 1.2]]), np.array([[7.0, 2.0, 1.2]]))
        assert excess_db(paths) == pytest.approx(expected, abs=1e-6)
        assert paths.order.tolist() == [1]
        assert (paths.interaction == Interaction.TRANSMISSION).sum() == 1


def test_walls_are_counted_as_walls(apart, extruded, ring):
    """Three rooms in a row: the second wall needs a second transmission, and both weaken alike."""
    rooms = [ring((x, 0), (x + 2.8, 0), (x + 2.8, 4), (x, 4)) for x in (0, 3, 6)]
    mesh = extruded(np.concatenate(rooms))
    tx, rx = np.array([[1.0, 2.0, 1.2]]), np.array([[4.5, 2.0, 1.2], [7.5, 2.0, 1.2]])
    for scene in ("plan", "space"):
        found = []
        for most in range(4):
            config = TracerConfig(scene=scene, max_reflections=0, diffraction=False, max_transmissions=most)
            paths = Tracer(mesh, materials=("partition",), config=config).trace(tx, rx)
            found.append(paths.count()[0].tolist())
        assert found == [[0, 0], [1, 0], [1, 1], [1, 1]]
        assert paths.order.tolist() == [1, 2]


def test_faces_far_apart_are_two_walls(extruded, ring):
    """Between houses 3 m apart there are two walls, also if what lies between is modelled as neither."""
    houses = ring((0, 0), (3, 0), (3, 4), (0, 4)), ring((6, 0), (9, 0), (9, 4), (6, 4))
    mesh = extruded(np.concatenate(houses))
    expected = slab_loss_db("partition", 28e9)
    for most, right in ((1, np.nan), (2, 2 * expected)):
        config = TracerConfig(max_reflections=0, diffraction=False, max_transmissions=most)
        paths = Tracer(mesh, materials=("partition",), config=config).trace(
            np.array([[1.0, 2.0, 1.2]]), np.array([[8.0, 2.0, 1.2]])
        )
        assert excess_db(paths) == pytest.approx(right, abs=1e-6, nan_ok=True)


def test_a_single_sheet_is_a_wall(extruded, ring):
    """A sheet in a room, and a room of single sheets with one end outside of it, weaken by all of their decibels."""
    screen = extruded(np.concatenate([ring((0, 0), (9, 0), (9, 4), (0, 4)), [[(3, 0), (3, 4)]]]))
    alone = extruded(ring((0, 0), (3, 0), (3, 4), (0, 4)))
    expected = slab_loss_db("glazing", 5e9)
    for mesh, scene in itertools.product((screen, alone), ("plan", "space")):
        config = TracerConfig(scene=scene, max_reflections=0, diffraction=False, max_transmissions=1)
        tracer = Tracer(mesh, materials=("glazing",), frequency_hz=5e9, config=config)
        paths = tracer.trace(np.array([[1.0, 2.0, 1.2]]), np.array([[5.0, 2.0, 1.2]]))
        assert excess_db(paths) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("scene", ["plan", "space"])
def test_both_directions_are_alike_and_no_power_is_gained(scene, extruded, ring):
    """Reciprocity across corners, slanted walls and walls of two materials; nothing is stronger than in free space.

    Within 1e-9 of the power, over all paths of 30 links.
    """
    rooms = ring((0, 0), (3, 0), (3, 4), (0, 4)), ring((3.2, 0), (9, 0), (9, 4), (3.6, 4))
    block = ring((5, 1), (5, 2), (6, 2.4), (6, 1))
    mesh = extruded(np.concatenate([*rooms, block]))
    of_face = (mesh.triangles_center[:, 0] > 3.1).astype(int)
    rng = np.random.default_rng(3)
    tx = np.column_stack([rng.uniform(0.2, 2.8, 5), rng.uniform(0.2, 3.8, 5), np.full(5, 1.2)])
    rx = np.column_stack([rng.uniform(6.2, 8.8, 6), rng.uniform(0.2, 3.8, 6), np.full(6, 1.5)])
    config = TracerConfig(
        scene=scene, max_reflections=1, diffraction=False, max_transmissions=3, max_paths=500
    )
    tracer = Tracer(
        mesh, materials=("glazing", "partition"), face_material=of_face, frequency_hz=6e9, config=config
    )
    there, back = tracer.trace(tx, rx), tracer.trace(rx, tx)
    assert there.count().min() > 0
    np.testing.assert_array_equal(there.count(), back.count().T)
    for i, j in itertools.product(range(5), range(6)):
        one = np.sort(there.power[(there.tx == i) & (there.rx == j)])
        other = np.sort(back.power[(back.tx == j) & (back.rx == i)])
        np.testing.assert_allclose(one, other, rtol=1e-9)
    free = (C / 6e9 / (4 * np.pi * there.delay_s * C)) ** 2
    assert (there.power <= free * (1 + 1e-12)).all()


def test_below_10_ghz_walls_are_passed_by_default(apart, caplog):
    """Reported once; from 10 GHz on walls are passed only if configured."""
    link = np.array([[1.0, 2.0, 1.2]]), np.array([[7.0, 2.0, 1.2]])

    def paths(frequency_hz, **options):
        tracer = Tracer(
            apart(0.15), materials=("partition",), frequency_hz=frequency_hz, config=TracerConfig(**options)
        )
        return len(tracer.trace(*link))

    with caplog.at_level("WARNING"):
        assert paths(5.31e9) > 0 and paths(5.31e9) > 0
    assert [m for m in caplog.messages if "5.31 GHz" in m] == [
        "At 5.31 GHz paths pass up to 2 walls. Set max_transmissions to change that (robosim trace "
        "--max-transmissions, robosim episode --radio.tracer.max-transmissions)."
    ]
    assert paths(28e9) == 0
    assert paths(5.31e9, max_transmissions=0) == 0
    assert paths(28e9, max_transmissions=1) > 0


def test_line_of_sight_through_a_wall_is_said_to_be_obstructed(apart):
    """In tables and pictures; the link state stays the published one."""
    config = TracerConfig(max_transmissions=1)
    paths = Tracer(apart(0.15), materials=("partition",), config=config).trace(
        np.array([[1.0, 2.0, 1.2]]), np.array([[7.0, 2.0, 1.2], [2.0, 3.0, 1.2]])
    )
    assert paths.link_category().tolist() == [[LinkCategory.OBSTRUCTED_LOS, LinkCategory.LOS]]
    assert paths.link_state().tolist() == [[LinkState.LOS, LinkState.LOS]]
