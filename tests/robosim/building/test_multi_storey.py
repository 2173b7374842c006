"""Buildings of several storeys: closed shells around the right volumes, made of what was requested."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from robosim.building.building import BuildingConfig, make_building
from robosim.building.extrusion import KINDS
from robosim.building.mesh_export import export_mesh, export_mitsuba
from robosim.building.multi_storey import StoreysConfig, make_storeys
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.plans.floorplan import MapError
from robosim.plans.furnishings.pieces import make_piece
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from robosim.radio.scene import RadioConfig, RadioScene
from tests.plans import room, turned
from wireless.tracing.stack_scene import StackScene
from wireless.tracing.tracer import Tracer, TracerConfig

STAIRS = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.5), (1.0, 2.5))


def two_storeys(ring=STAIRS, **first):
    return StoreysPlan(
        name="house",
        storeys=(StoreyPlan(plan=room(), openings=(ring,), **first), StoreyPlan(plan=room(), height_m=3.0)),
    )


def test_two_rooms_and_their_stairwell_have_the_volume_of_three_boxes():
    """4 x 3 x 2.6 and 4 x 3 x 3 m3, and 1 x 1.5 x 0.25 m3 between; each edge has two faces, each normal into the free.

    Areas by kind, by hand: two floors and ceilings of 12 m2 less the hole of 1.5 m2 each at the slab; walls of
    14 x 5.6 m2 and the rim of 5 x 0.25 m2.
    """
    storeys = make_storeys(two_storeys(height_m=2.6, slab_m=0.25))
    mesh = storeys.mesh
    assert mesh.is_watertight and mesh.volume == pytest.approx(-(12 * 5.6 + 1.5 * 0.25), rel=1e-12)
    area = [mesh.area_faces[storeys.face_kind == kind].sum() for kind in range(4)]
    np.testing.assert_allclose(area, [14 * 5.6 + 5 * 0.25, 22.5, 22.5, 0.0], rtol=1e-12)
    assert [one.floor_m for one in storeys.storeys] == [0.0, 2.85]
    assert [one.ceiling_m for one in storeys.storeys] == [2.6, 5.85]
    assert storeys.bounds[1, 2] == pytest.approx(5.85)


@pytest.mark.parametrize("seed", range(8))
def test_generated_homes_under_turned_openings_are_closed(seed):
    """Openings that cross walls and furniture of three homes: volume by the polygons' areas, and two faces an edge."""
    rng = np.random.default_rng(seed)
    plans = []
    for number in rng.integers(0, 40, 3):
        plan = generate_plan(int(number), config=GeneratorConfig())
        middle = np.mean(np.reshape(make_building(plan).free.bounds, (2, 2)), axis=0)
        plans.append((plan, middle))
    storeys = []
    for i, (plan, middle) in enumerate(plans):
        shifted = plan.__class__(**{**vars(plan), "origin": (-middle[0], -middle[1], 0.0)})
        hole = shapely.affinity.rotate(shapely.box(-1.1, -0.9, 1.1, 0.9), rng.choice([0, rng.uniform(0, 90)]))
        ring = tuple((float(x), float(y)) for x, y in shapely.get_coordinates(hole)[:-1])
        storeys.append(StoreyPlan(plan=shifted, openings=(ring,) if i < 2 else ()))
    made = make_storeys(StoreysPlan(name="homes", storeys=tuple(storeys)))
    expected = sum(one.building.free.area * 2.5 + one.opening.area * 0.3 for one in made.storeys)
    assert made.mesh.is_watertight and made.mesh.volume == pytest.approx(-expected, rel=1e-9)
    assert isinstance(Tracer(made, config=TracerConfig(max_reflections=1)).scene, StackScene)


def test_slab_is_of_its_own_material_where_asked_for():
    """Underside, top and rim of one slab; the lowest floor and the highest ceiling stay as the building says."""
    storeys = make_storeys(two_storeys(slab_material="wood"))
    height = storeys.mesh.triangles_center[:, 2]
    wood = storeys.face_material == storeys.materials.index("wood")
    assert (
        wood == ((height >= 2.5) & (height <= 2.8) & (np.ptp(storeys.mesh.triangles[:, :, 2], axis=1) < 0.31))
    ).all()
    plain = make_storeys(two_storeys(), config=StoreysConfig(slab_material="metal"))
    rim = (plain.face_kind == KINDS.index("wall")) & (np.abs(plain.mesh.triangles_center[:, 2] - 2.65) < 0.1)
    assert {plain.materials[i] for i in plain.face_material[rim]} == {"metal"}


def test_opening_reaches_as_far_as_both_floors_are_free():
    """Drawn half outside, it ends at the wall, where the storeys' walls and its rim are one face."""
    made = make_storeys(two_storeys(ring=((-1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (-1.0, 2.0))))
    assert made.storeys[0].opening.area == pytest.approx(1.0)
    assert made.mesh.is_watertight


def test_openings_and_settings_that_make_no_building_are_rejected():
    with pytest.raises(MapError, match=r"house: storey 0: openings .*nowhere both free"):
        make_storeys(two_storeys(ring=((9.0, 9.0), (10.0, 9.0), (10.0, 10.0))))
    with pytest.raises(MapError, match="does not cross itself"):
        make_storeys(two_storeys(ring=((1.0, 1.0), (2.0, 2.0), (2.0, 1.0), (1.0, 2.0))))
    with pytest.raises(MapError, match="three points or more"):
        two_storeys(ring=((1.0, 1.0), (2.0, 2.0)))
    with pytest.raises(ValueError, match=r"furniture_height_m is 0\.7"):
        StoreysConfig(building=BuildingConfig(furniture_height_m=0.7))
    with pytest.raises(MapError, match="storey is 2, expected 0, the lowest, to 1"):
        two_storeys().storey(2)


def test_single_storey_is_the_building_of_its_plan():
    """Turned by 30 degrees: the same volume, bounds and areas of kinds as `make_building`."""
    plan = turned(room(), 30)
    alone, one = make_building(plan), make_storeys(StoreysPlan(name="one", storeys=(StoreyPlan(plan=plan),)))
    assert one.mesh.volume == pytest.approx(alone.mesh.volume, rel=1e-12)
    np.testing.assert_allclose(one.bounds, alone.bounds, atol=1e-9)
    for kind in range(4):
        assert one.mesh.area_faces[one.face_kind == kind].sum() == pytest.approx(
            alone.mesh.area_faces[alone.face_kind == kind].sum(), rel=1e-9
        )


def test_other_programs_get_all_storeys(tmp_path):
    """GLB and Mitsuba hold the faces of all storeys."""
    import trimesh

    storeys = make_storeys(two_storeys())
    scene = trimesh.load(export_mesh(storeys, tmp_path / "house.glb"))
    assert scene.area == pytest.approx(storeys.mesh.area, rel=1e-6)
    assert scene.bounds[1, 1] == pytest.approx(5.8)  # y is up in glTF
    export_mitsuba(storeys, tmp_path / "mitsuba")
    assert {one.stem for one in (tmp_path / "mitsuba" / "meshes").iterdir()} == set(
        map(str, storeys.materials)
    )


def test_furnished_storeys_have_their_things_at_their_heights():
    """A table on each floor: its top hides the receiver below it, on both; and the walls stay closed around it."""
    table = make_piece("table", at=(3.0, 1.5))
    plan = two_storeys(height_m=2.6, slab_m=0.25)
    furnished = replace(
        plan,
        storeys=tuple(replace(one, plan=replace(one.plan, furnishings=(table,))) for one in plan.storeys),
    )
    bare, made = make_storeys(plan), make_storeys(furnished)
    placed, top = made.submesh("placed"), table.triangles[:, :, 2].max()
    assert [one.z_m for one in made.furnishings] == [0.0, 2.85]
    assert placed.bounds[:, 2] == pytest.approx([0.0, 2.85 + top])
    assert made.mesh.area == pytest.approx(bare.mesh.area + placed.area)
    assert made.submesh("wall", "floor", "ceiling").is_watertight
    config = RadioConfig(tracer=TracerConfig(max_reflections=0, diffraction=False))
    scene = RadioScene(furnished.storey(1), config)
    assert scene.engine == "space"
    for floor_m in (0.0, 2.85):
        above = scene.places(((3.0, 1.5, floor_m + top + 0.5),), "tx")
        around = ((3.0, 1.5, floor_m + top - 0.2), (0.5, 1.5, floor_m + top + 0.2))
        assert scene.tracer.trace(above, scene.places(around, "rx")).count().tolist() == [[0, 1]]
    with pytest.raises(ValueError, match=r"outside of the free space of house_storey_1 at this height"):
        scene.places(((3.0, 1.5, 2.85 + top - 0.01),), "rx")
