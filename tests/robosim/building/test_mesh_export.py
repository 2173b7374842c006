"""Buildings in files: what is read back is what was built, by readers we did not write."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from robosim.building.building import KINDS, BuildingConfig, make_building
from robosim.building.extrusion import PLACED
from robosim.building.mesh_export import KIND_COLOURS, export_mesh, export_mitsuba, itu_slab
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from tests.wireless.em.plane_waves import reflection, slab
from wireless.em.materials import Layer, Material, permittivity

FLOAT32_M = 1e-5
"""Half a step of 32-bit coordinates below 100 m, and more."""


@pytest.fixture(scope="module")
def building():
    """Rooms with low furniture, away from the origin and turned."""
    free = np.ones((40, 60), bool)
    free[10:14, 20:25] = False
    free[:25, 40] = False
    plan = FloorPlan(
        occupancy=np.where(free, FREE, OCCUPIED).astype(np.uint8), resolution_m=0.1, origin=(7.0, -3.0, 0.4)
    )
    return make_building(plan, config=BuildingConfig(furniture_height_m=0.7))


def triangles(mesh):
    """Corners of all triangles, each from its lowest corner on in its own sense, in a fixed order."""
    corners = np.round(mesh.triangles / FLOAT32_M).astype(np.int64)
    first = np.lexsort(corners.transpose(2, 0, 1)[::-1], axis=-1)[:, 0]
    turned = corners[np.arange(len(corners))[:, None], (first[:, None] + np.arange(3)) % 3].reshape(-1, 9)
    return turned[np.lexsort(turned.T[::-1])]


def assert_same_triangles(got, want):
    """Equal numbers of triangles, corners within a step of the rounding, all in the same sense."""
    assert len(got.faces) == len(want.faces)
    assert np.abs(triangles(got) - triangles(want)).max() <= 1


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".PLY"])
def test_mesh_files_hold_the_same_triangles(building, tmp_path, suffix):
    """Read by trimesh, z up: every triangle, with its normal to the same side."""
    path = export_mesh(building, tmp_path / f"building{suffix}")
    assert_same_triangles(trimesh.load(path, force="mesh", process=False), building.mesh)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]  # no temporary file is left


def test_glb_is_y_up(building, tmp_path):
    """The glTF standard: floor at y = 0, ceiling at y = 2.5; turned back by 90 degrees it is the building."""
    scene = trimesh.load(export_mesh(building, tmp_path / "building.glb"))
    assert scene.bounds[:, 1] == pytest.approx([0.0, 2.5])
    mesh = scene.to_geometry()
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    assert_same_triangles(mesh, building.mesh)


def test_glb_has_an_object_of_its_colour_for_each_kind(building, tmp_path):
    """Names and colours as of the kinds, areas as built."""
    scene = trimesh.load(export_mesh(building, tmp_path / "building.glb"))
    assert set(scene.geometry) == set(KINDS[:PLACED])
    for number, kind in enumerate(KINDS[:PLACED]):
        part = scene.geometry[kind]
        assert part.area == pytest.approx(building.submesh(kind).area, rel=1e-5)
        assert (part.visual.vertex_colors == KIND_COLOURS[number]).all()


def test_ply_has_coloured_faces_and_stays_watertight(building, tmp_path):
    """Faces in order, each in the colour of its kind, on the vertices that walls and floor share."""
    mesh = trimesh.load(export_mesh(building, tmp_path / "building.ply"), process=False)
    assert mesh.is_watertight
    assert np.array_equal(mesh.visual.face_colors, KIND_COLOURS[building.face_kind])


def test_export_leaves_the_building_as_it_was(building, tmp_path):
    """Turning y up and colouring work on copies."""
    before = building.mesh.vertices.copy()
    for suffix in (".glb", ".ply"):
        export_mesh(building, tmp_path / f"building{suffix}")
    assert np.array_equal(building.mesh.vertices, before)


def test_unknown_format_is_rejected(building, tmp_path):
    """The message names the formats and the nearest one."""
    with pytest.raises(ValueError, match=r"expected a name that ends in \.glb.*Did you mean \.glb"):
        export_mesh(building, tmp_path / "building.glbb")
    assert not list(tmp_path.iterdir())


def test_broken_export_leaves_the_old_file(building, tmp_path, monkeypatch):
    """An error halfway keeps what was there, and no temporary file."""
    path = export_mesh(building, tmp_path / "building.ply")
    before = path.read_bytes()

    def half(self, file_obj, **_):
        file_obj.write_bytes(b"ply")
        raise OSError("disk full")

    monkeypatch.setattr(trimesh.Trimesh, "export", half)
    with pytest.raises(OSError, match="disk full"):
        export_mesh(building, path)
    assert path.read_bytes() == before and len(list(tmp_path.iterdir())) == 1


def test_mitsuba_scene_refers_to_its_meshes_and_materials(building, tmp_path):
    """What Sionna RT and DiffeRT read: BSDFs `mat-itu_NAME` with a type, shapes with a file and a material."""
    xml = export_mitsuba(building, tmp_path / "scene")
    assert xml == tmp_path / "scene" / "scene.xml"
    root = ET.parse(xml).getroot()
    types = {bsdf.get("id"): bsdf.find("string").get("value") for bsdf in root.findall("bsdf")}
    assert types == {
        "mat-partition": "plasterboard",
        "mat-concrete": "concrete",
        "mat-ceiling_board": "ceiling_board",
    }
    assert {bsdf.get("type") for bsdf in root.findall("bsdf")} == {"itu-radio-material"}
    thickness = [bsdf.find("float[@name='thickness']").get("value") for bsdf in root.findall("bsdf")]
    assert sorted(thickness) == ["0.007", "1", "1"]
    parts = {}
    for shape in root.findall("shape"):
        (file,) = shape.findall("string")
        assert shape.get("type") == "ply" and file.get("name") == "filename"
        mesh = trimesh.load(xml.parent / file.get("value"), process=False)
        parts[types[shape.find("ref").get("id")]] = mesh
    assert_same_triangles(parts["plasterboard"], building.of_material("partition"))
    assert_same_triangles(trimesh.util.concatenate(list(parts.values())), building.mesh)


def test_mitsuba_scene_goes_by_the_name_it_is_given(building, tmp_path):
    """A path that ends in .xml is the scene; its meshes lie next to it."""
    assert export_mitsuba(building, tmp_path / "office.xml") == tmp_path / "office.xml"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["meshes", "office.xml"]


def test_materials_of_one_itu_type_have_their_own_slabs(tmp_path):
    """Drywall and plasterboard: two shapes, two BSDFs of one type, each with its own id, as Mitsuba asks."""
    plan = FloorPlan(occupancy=np.zeros((5, 5), np.uint8), resolution_m=1.0)
    config = BuildingConfig(wall_material="drywall", ceiling_material="plasterboard")
    root = ET.parse(export_mitsuba(make_building(plan, config=config), tmp_path)).getroot()
    assert sorted(b.get("id") for b in root.findall("bsdf")) == [
        "mat-concrete",
        "mat-drywall",
        "mat-plasterboard",
    ]
    assert {s.get("id") for s in root.findall("shape")} == {
        "mesh-drywall_surfaces",
        "mesh-plasterboard_surfaces",
        "mesh-concrete_surfaces",
    }


def test_broken_mitsuba_export_leaves_no_scene(building, tmp_path, monkeypatch):
    """The XML comes last and an old one goes first: no scene ever has missing or mixed meshes."""
    export_mitsuba(building, tmp_path)

    def fail(self, file_obj, **_):
        raise OSError("disk full")

    monkeypatch.setattr(trimesh.Trimesh, "export", fail)
    with pytest.raises(OSError, match="disk full"):
        export_mitsuba(building, tmp_path)
    assert not (tmp_path / "scene.xml").exists()


@pytest.mark.parametrize(
    ("material", "itu_type", "thickness_m", "most_db"),
    [
        ("concrete", "concrete", 1.0, 1e-3),
        ("ceiling_board", "ceiling_board", 1.0, 1e-3),
        ("door", "wood", 0.04, 1e-9),
        ("concrete_wall", "concrete", 0.2, 1e-9),
        ("drywall", "plasterboard", 1.0, 1.5),
    ],
)
def test_slabs_of_itu_materials_reflect_as_our_walls(material, itu_type, thickness_m, most_db):
    """Half-spaces and single layers to 0.001 dB; drywall as far as its newer fit differs. Judge: closed forms."""
    found = itu_slab(material, 28e9)
    assert found[:2] == (itu_type, thickness_m)
    assert found.off_db < most_db
    eps, cos_i = permittivity(itu_type, 28e9), np.cos(np.radians([0.0, 30.0, 60.0]))
    through = slab(cos_i, eps, thickness_m, 28e9)[:2]
    if thickness_m == 1.0:
        np.testing.assert_allclose(np.abs(through), np.abs(reflection(cos_i, eps)), atol=1e-3)


def test_layers_that_no_slab_can_stand_for():
    """Two boards with air between reflect like no slab, by a known difference; own permittivities are rejected."""
    assert 3 < itu_slab("partition", 28e9).off_db < 5
    own = Material("own", (Layer(thickness_m=0.1, relative_permittivity=3.0),))
    with pytest.raises(ValueError, match="'own' has a permittivity of its own"):
        itu_slab(own, 28e9)
