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

SHAPE = """<scene version="2.1.0"><default name="t" value="0.2"/>
<bsdf type="itu-radio-material" id="m"><string name="type" value="concrete"/><float name="thickness" value="$t"/></bsdf>
<shape type="{kind}" id="one">{transform}<ref id="{material}" name="bsdf"/></shape></scene>"""


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
    ],
)
def test_damaged_scenes_are_rejected(tmp_path, change, message):
    path = scene_of(tmp_path)
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=message):
        read_mitsuba(path)


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
