"""Mitsuba scenes: those that a building is exported to, transforms and shapes by hand, damaged ones."""

from dataclasses import replace

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.mesh_export import export_mitsuba
from robosim.support.reading import FileError
from tests.plans import two_rooms
from wireless import Tracer, TracerConfig
from wireless.em.materials import Layer, Material
from wireless.tracing.mitsuba_scene import is_mitsuba, read_mitsuba
from wireless.tracing.tracer import _report_half_space

SHAPE = """<scene version="2.1.0"><default name="t" value="0.2"/>
<bsdf type="itu-radio-material" id="m"><string name="type" value="concrete"/><float name="thickness" value="$t"/></bsdf>
<shape type="{kind}" id="one">{transform}<ref id="{material}" name="bsdf"/></shape></scene>"""


PLY_SHAPE = '<shape type="ply" id="p"><string name="filename" value="{}"/><ref id="m" name="bsdf"/></shape>'


def write_square(path, scale=1.0, faces=2):
    """Two squares at different heights as an ASCII PLY file."""
    corners = [
        f"{x} {y} {z}".replace("1", str(scale)) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
    ]
    lines = ["4 0 1 2 3", "4 4 5 6 7"][:faces]
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
    header += f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    path.write_text(header + "\n".join([*corners, *lines]) + "\n")
    return path


def scene_of(tmp_path, kind="cube", transform="", material="m"):
    path = tmp_path / "scene.xml"
    path.write_text(SHAPE.format(kind=kind, transform=transform, material=material))
    return path


def test_an_exported_building_has_the_same_paths(tmp_path):
    building = make_building(two_rooms(0.8))
    path = export_mitsuba(building, tmp_path)
    own = {f"mat-{material}": material for material in building.materials}
    config = TracerConfig(max_reflections=2, floor_ceiling=True, max_paths=300)
    tx, rx = np.array([[1.0, 1.0, 1.5]]), np.array([[2.0, 2.0, 1.2], [5.0, 2.0, 1.0], [4.0, 0.6, 1.5]])
    expected = Tracer(building, config=config).trace(tx, rx)
    found = Tracer.from_mitsuba(path, materials=own, config=config).trace(tx, rx)
    assert len(found) == len(expected)
    for name in ("delay_s", "power"):
        a, b = (np.sort(getattr(paths, name)) for paths in (found, expected))
        assert a == pytest.approx(b, rel=1e-4)


def test_tracer_of_a_scene_reflects_at_the_ground_with_a_configuration_too(tmp_path):
    path = scene_of(tmp_path, "rectangle", '<transform name="to_world"><scale value="10"/></transform>')
    ends = np.array([[0.0, 0, 2]]), np.array([[3.0, 0, 2]])
    config = TracerConfig(max_reflections=3)
    tracer = Tracer.from_mitsuba(path, config=config)
    assert len(tracer.trace(*ends)) == len(Tracer(read_mitsuba(path), config=config).trace(*ends)) == 2
    assert tracer.config.floor_ceiling is True
    silent = Tracer.from_mitsuba(path, config=replace(config, floor_ceiling=False))
    assert len(silent.trace(*ends)) == 1


def test_materials_are_slabs_with_defaults_of_the_scene(tmp_path):
    scene = read_mitsuba(scene_of(tmp_path))
    assert scene.materials == (Material("m", (Layer(thickness_m=0.2, material="concrete"),)),)
    assert (scene.face_material == 0).all()


def test_materials_of_older_scenes_are_known_by_their_names(tmp_path):
    scene = read_mitsuba(scene_of(tmp_path, material="mat-itu_ceiling-board"))
    assert scene.materials[0].layers == (Layer(thickness_m=0.1, material="ceiling_board"),)


def test_given_materials_replace_those_of_the_scene(tmp_path):
    path = scene_of(tmp_path, material="paint")
    assert read_mitsuba(path, {"paint": "wood"}).materials == ("wood",)


@pytest.mark.parametrize(
    ("transform", "low", "high"),
    [
        ("", (-1, -1, -1), (1, 1, 1)),
        (
            '<transform name="to_world"><scale value="2"/><translate x="1" z="3"/></transform>',
            (-1, -2, 1),
            (3, 2, 5),
        ),
        (
            '<transform name="to_world"><scale x="3"/><rotate z="1" angle="90"/></transform>',
            (-1, -3, -1),
            (1, 3, 1),
        ),
        (
            '<transform name="to_world"><matrix value="1 0 0 5  0 1 0 0  0 0 2 0  0 0 0 1"/></transform>',
            (4, -1, -2),
            (6, 1, 2),
        ),
    ],
)
def test_shapes_are_placed_by_their_transforms(tmp_path, transform, low, high):
    bounds = read_mitsuba(scene_of(tmp_path, transform=transform)).mesh.bounds
    assert bounds == pytest.approx(np.array([low, high]))


def test_a_rectangle_reflects_like_the_mirror_image(tmp_path):
    path = scene_of(tmp_path, "rectangle", '<transform name="to_world"><scale value="10"/></transform>')
    paths = Tracer.from_mitsuba(path).trace(np.array([[0.0, 0, 2]]), np.array([[3.0, 0, 2]]))
    assert np.sort(paths.delay_s) * 299792458 == pytest.approx([3.0, 5.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda text: text.replace("<scene", "<screen").replace("</scene", "</screen"),
            "begins with <screen>",
        ),
        (lambda text: text[:60], "not readable as a Mitsuba scene"),
        (lambda text: text.replace('type="cube"', 'type="sphere"'), "shape one is of type 'sphere'"),
        (lambda text: text.replace("concrete", "cheese"), "material 'm' is 'cheese'"),
        (lambda text: text.replace('<ref id="m" name="bsdf"/>', ""), "shape one has no material"),
        (lambda text: text.replace('type="cube"', 'type="ply"'), "is a folder"),
        (lambda text: "<scene/>", "there is no shape"),
        (lambda text: text.replace("<shape", '<include filename="scene.xml"/><shape', 1), "includes itself"),
        (
            lambda text: text.replace("<shape", '<include filename="no.xml"/><shape', 1),
            "no.xml: no such file",
        ),
        (lambda text: text.replace("<shape", '<bsdf type="diffuse" id="m"/><shape', 1), "two materials 'm'"),
        (lambda text: text.replace('name="thickness"', 'name="depth"'), "material 'm' has 'depth'"),
        (  # as in Mitsuba 3, where a property may be set once
            lambda text: text.replace("</bsdf>", '<float name="thickness" value="0.3"/></bsdf>', 1),
            "bsdf 'm' has 'thickness' twice",
        ),
        (lambda text: text.replace('value="$t"', 'value="nan"'), "thickness_m is nan"),
        (lambda text: text.replace("concrete", "cheese"), "--scene-material m=concrete"),
        (lambda text: text.replace('type="itu-radio-material"', 'type="diffuse"'), "material 'm' is 'm'"),
        (
            lambda text: text.replace("<shape", PLY_SHAPE.format("all.ply") + "<shape", 1),
            "long, expected under",
        ),
        *(
            (lambda text, name=name: text.replace("<shape", PLY_SHAPE.format(name) + "<shape", 1), reason)
            for name, reason in {
                "cut.ply": "shape p: .*cut.ply: .*announces 10 vertices and faces, but has 9 lines",
                "none.ply": "none.ply: .*it has no faces",
                "nan.ply": "nan.ply: .*a vertex is not finite",
                "points.obj": "points.obj: not readable",
            }.items()
        ),
    ],
)
def test_damaged_scenes_are_rejected(tmp_path, change, message):
    path = scene_of(tmp_path)
    path.write_text(change(path.read_text()))
    write_square(tmp_path / "all.ply", scale=1e7)
    write_square(tmp_path / "nan.ply", scale="nan")
    write_square(tmp_path / "none.ply", faces=0)
    whole = write_square(tmp_path / "cut.ply").read_text()
    (tmp_path / "cut.ply").write_text(whole[: whole.rindex("4 4 5")])
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(FileError, match=message) as error:
        read_mitsuba(path)
    assert "\n" not in str(error.value) and "scene.xml" in str(error.value)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("canyon", b"<?xml version='1.0'?><!-- a comment --><scene version='3.0.0'>", True),
        ("drawing.svg", b"<svg xmlns='http://www.w3.org/2000/svg'/>", False),
        ("picture.png", b"\x89PNG\r\n", False),
        ("empty.xml", b"", True),
        ("empty", b"", False),
    ],
)
def test_content_decides_what_is_a_scene(tmp_path, name, content, expected):
    (tmp_path / name).write_bytes(content)
    assert is_mitsuba(tmp_path / name) == expected


RADIO = """<bsdf type="{}" id="mat-wood"><float name="relative_permittivity" value="12"/>
<float name="conductivity" value="0.5"/><float name="thickness" value="0.05"/></bsdf>"""
PLATE = """<shape type="rectangle" id="plate"><transform name="to_world"><scale value="50"/></transform>{}</shape>"""
REF = '<ref id="mat-wood" name="bsdf"/>'


@pytest.mark.parametrize("kind", ["radio-material", "itu-radio-material"])
@pytest.mark.parametrize("place", ["scene", "shape", "unnamed", "twosided", "included"])
def test_read_mitsuba_takes_what_the_scene_states_of_a_material(tmp_path, kind, place):
    """A slab of 12 and 0.5 S/m, 5 cm thick, under the name of wood: the reflection has its Fresnel coefficient.

    3.5 GHz, from (-3, 0, 4) to (3, 0, 4) over the plate, 10 m: free space of -63.33 dB and the slab, vertical
    polarisation.
    """
    bsdf = RADIO.format(kind)
    content = {
        "scene": bsdf + PLATE.format(REF),
        "shape": PLATE.format(bsdf),
        "unnamed": PLATE.format(bsdf.replace(' id="mat-wood"', "")),
        "twosided": bsdf.replace(' id="mat-wood"', "").join(
            ['<bsdf type="twosided" id="mat-wood">', "</bsdf>"]
        )
        + PLATE.format(REF),
        "included": '<include filename="part/materials.xml"/>' + PLATE.format(REF),
    }[place]
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "materials.xml").write_text(f"<scene version='3.0.0'>{bsdf}</scene>")
    path = tmp_path / "scene.xml"
    path.write_text(f"<scene version='3.0.0'>{content}</scene>")
    (material,) = read_mitsuba(path).materials
    assert material.layers == (Layer(thickness_m=0.05, relative_permittivity=12.0, conductivity_spm=0.5),)
    paths = Tracer.from_mitsuba(path, frequency_hz=3.5e9).trace([[-3.0, 0, 4]], [[3.0, 0, 4]])
    assert 10 * np.log10(paths.power[1]) == pytest.approx(-70.12, abs=0.02)


def binary_ply(path, face, *, number="f4", index="i4", order="<", comment="", more=(), cut=0):
    """Five corners and faces as a binary PLY file; `more` are properties of vertices other than x, y, z."""
    names = {"f4": "float", "f8": "double", "i4": "int", "u4": "uint"}
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 0), (0, 0, 3)], float)
    header = (
        f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\n{comment}element vertex 5\n"
    )
    header += "".join(f"property {names[number]} {name}\n" for name in (*"xyz", *more))
    header += f"element face {len(face)}\nproperty list uchar {names[index]} vertex_indices\nend_header\n"
    content = header.encode() + np.pad(corners, ((0, 0), (0, len(more)))).astype(order + number).tobytes()
    for corner in face:
        content += bytes([len(corner)]) + np.array(corner).astype(order + index).tobytes()
    path.write_bytes(content[: len(content) - cut])
    return corners


@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"number": "f8", "index": "u4"},
        {"comment": "comment by hand\ncomment element vertex 7\n"},
        {"order": ">"},
        {"more": ("nx", "ny", "nz")},
        {"more": ("s", "t")},
        {"face": [(0, 1, 2, 3), (0, 1, 4, 4)]},
    ],
)
def test_read_mitsuba_reads_binary_ply_of_each_layout(tmp_path, layout):
    layout = {"face": [(0, 1, 2), (0, 4, 3)], **layout}
    corners = binary_ply(tmp_path / "mesh.ply", **layout)
    path = scene_of(tmp_path)
    path.write_text(path.read_text().replace("<shape", PLY_SHAPE.format("mesh.ply") + "<shape", 1))
    scene = read_mitsuba(path)
    fans = [corner[:1] + corner[k : k + 2] for corner in layout["face"] for k in range(1, len(corner) - 1)]
    assert scene.shapes[0] == ("p", len(fans), "m")
    triangles = {tuple(map(tuple, np.sort(corners[list(fan)], axis=0))) for fan in fans}
    assert {
        tuple(map(tuple, np.sort(each, axis=0))) for each in scene.mesh.triangles[: len(fans)]
    } == triangles


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ({"face": [(0, 1, 5)]}, "a face has vertex 5, expected 0 to 4"),
        ({"face": [(0, 1, -1)]}, "a face has vertex -1, expected 0 to 4"),
        ({"face": [(0, 1, -1)], "order": ">"}, "a face has vertex -1, expected 0 to 4"),
        ({"face": [(0, 1, 5)], "more": ("nx", "ny", "nz")}, "a face has vertex 5, expected 0 to 4"),
        ({"face": [(0, 1, 2)], "cut": 1}, "not readable as a mesh"),
        ({"face": []}, "it has no faces"),
        ({"face": [(0, 1, 1)]}, "shape p has an area of 0 m2"),
    ],
)
def test_read_mitsuba_rejects_damaged_binary_ply(tmp_path, layout, message):
    binary_ply(tmp_path / "mesh.ply", **layout)
    path = scene_of(tmp_path)
    path.write_text(path.read_text().replace("</scene", PLY_SHAPE.format("mesh.ply") + "</scene", 1))
    with pytest.raises(FileError, match=message):
        read_mitsuba(path)


def test_read_mitsuba_follows_includes_with_shapes(tmp_path):
    (tmp_path / "part").mkdir()
    write_square(tmp_path / "part" / "wall.ply")
    wall = PLY_SHAPE.format("wall.ply")
    (tmp_path / "part" / "walls.xml").write_text(f"<scene version='3.0.0'>{wall}</scene>")
    path = scene_of(tmp_path)
    path.write_text(path.read_text().replace("<shape", '<include filename="part/walls.xml"/><shape', 1))
    assert [shape[:2] for shape in read_mitsuba(path).shapes] == [("p", 4), ("one", 12)]


def test_read_mitsuba_says_what_it_assumes_of_materials(tmp_path, caplog):
    path = scene_of(tmp_path, material="mat-wood")
    text = path.read_text().replace("<shape", '<bsdf type="diffuse" id="mat-wood"/><shape', 1)
    path.write_text(text)
    assert read_mitsuba(path).materials == (Material("mat-wood", (Layer(thickness_m=0.1, material="wood"),)),)
    assert "material mat-wood is no radio material" in caplog.text
    rough = '<float name="scattering_coefficient" value="0.3"/><float name="thickness"'
    path.write_text(text.replace('<float name="thickness"', rough).replace('ref id="mat-wood"', 'ref id="m"'))
    assert read_mitsuba(path).materials[0].scattering == 0.3
    assert "material m scatters (S = 0.3) only if the tracer does" in caplog.text


def test_read_mitsuba_rejects_given_materials_of_other_names(tmp_path):
    with pytest.raises(FileError, match="no material 'paint' in it, expected one of m"):
        read_mitsuba(scene_of(tmp_path), {"paint": "wood"})


def test_tracer_warns_of_walls_without_thickness(caplog):
    """Glass by name is a half-space, which lets nothing through: said below 10 GHz, where paths pass walls."""
    mesh = make_building(two_rooms(0.8)).mesh
    for frequency_hz, config, material, is_said in (
        (3.5e9, TracerConfig(), "glass", True),
        (3.5e9, TracerConfig(wall_thickness_m=0.1), "marble", False),
        (3.5e9, TracerConfig(max_transmissions=0), "marble", False),
        (28e9, TracerConfig(), "marble", False),
        (3.5e9, TracerConfig(), "glazing", False),
    ):
        _report_half_space.cache_clear()
        caplog.clear()
        Tracer(mesh, materials=(material,), frequency_hz=frequency_hz, config=config)
        assert (f"Walls of {material} have no thickness" in caplog.text) == is_said
        assert ("--wall-thickness" in caplog.text) == is_said


def test_read_mitsuba_takes_the_first_default_of_a_parameter(tmp_path):
    """As Mitsuba 3.9 does: those of an included file count if the scene sets none; names count inside of texts."""
    path = scene_of(tmp_path, transform='<transform name="to_world"><scale value="$s"/></transform>')
    (tmp_path / "part").mkdir()
    write_square(tmp_path / "part" / "wall.ply")
    (tmp_path / "more.xml").write_text(
        f"<scene version='3.0.0'><default name='s' value='9'/>{PLY_SHAPE.format('$at/wall.ply')}</scene>"
    )
    head = (
        '<default name="s" value="2"/><default name="at" value="part"/><include filename="more.xml"/><shape'
    )
    path.write_text(path.read_text().replace("<shape", head, 1))
    scene = read_mitsuba(path)
    assert [shape[:2] for shape in scene.shapes] == [("p", 4), ("one", 12)]
    assert scene.mesh.bounds == pytest.approx(np.array([[-2.0, -2, -2], [2, 2, 2]]))


VERTICES = "v 0 0 0\nv 1 0 0\nv 1 2 0\n"
OBJ_SHAPE = PLY_SHAPE.replace("ply", "obj")


@pytest.mark.parametrize(
    ("text", "triangles"),
    [
        (f"{VERTICES}f 1 2 3\n", 1),
        (f"{VERTICES}f -3 -2 -1\nv 0 2 0\nv 0 0 3\nv 1 0 3\n", 1),
        (f"{VERTICES}f -3/-1 -2//5 -1/1/1 # the first\n", 1),
        (f"o a\r\n{VERTICES}v 0 2 0 1 0 0\r\nusemtl b\r\nf\t1 2 \\\r\n3 4\r\nl 1 2\r\n", 2),
    ],
)
def test_read_mitsuba_counts_vertices_of_obj_from_either_end(tmp_path, text, triangles):
    """The first triangle is that of the first three vertices, as the format has it, also if others follow the face."""
    (tmp_path / "mesh.obj").write_text(text)
    path = scene_of(tmp_path)
    path.write_text(path.read_text().replace("<shape", OBJ_SHAPE.format("mesh.obj") + "<shape", 1))
    scene = read_mitsuba(path)
    assert scene.shapes[0] == ("p", triangles, "m")
    assert scene.mesh.triangles[0] == pytest.approx(np.array([(0.0, 0, 0), (1, 0, 0), (1, 2, 0)]))


@pytest.mark.parametrize("face", ["0 1 2", "1 2 4", "-4 1 2"])
def test_read_mitsuba_rejects_obj_faces_of_missing_vertices(tmp_path, face):
    (tmp_path / "mesh.obj").write_text(f"{VERTICES}f {face}\n")
    path = scene_of(tmp_path)
    path.write_text(path.read_text().replace("<shape", OBJ_SHAPE.format("mesh.obj") + "<shape", 1))
    with pytest.raises(FileError, match=r"mesh.obj: .*a face has vertex (-1|3), expected 0 to 2"):
        read_mitsuba(path)


def test_read_mitsuba_takes_thickness_and_type_of_materials_by_name(tmp_path):
    """As `process_xml` of Sionna RT 2.2 does for mat-itu_NAME of any plugin."""
    path = scene_of(tmp_path, material="mat-itu_outer")
    stated = '<string name="type" value="brick"/><float name="thickness" value="0.3"/>'
    bsdf = f'<bsdf type="diffuse" id="mat-itu_outer">{stated}<rgb name="reflectance" value="1"/></bsdf>'
    path.write_text(path.read_text().replace("<shape", f"{bsdf}<shape", 1))
    scene = read_mitsuba(path)
    assert scene.materials[0].layers == (Layer(thickness_m=0.3, material="brick"),)
    assert scene.notes == ()


@pytest.mark.parametrize(
    ("more", "scattering"),
    [
        ("", None),
        ('<float name="scattering_coefficient" value="0"/>', 0.0),
        (
            '<float name="scattering_coefficient" value="0.2"/><string name="scattering_pattern" value="directive"/>'
            '<integer name="alpha_r" value="4"/>',
            0.2,
        ),
    ],
)
def test_read_mitsuba_takes_the_scattering_that_a_material_states(tmp_path, more, scattering):
    """A stated 0 is smooth with any configuration of the tracer; parameters of patterns are left out."""
    path = scene_of(tmp_path)
    path.write_text(path.read_text().replace("</bsdf>", f"{more}</bsdf>"))
    assert read_mitsuba(path).materials[0].scattering == scattering
