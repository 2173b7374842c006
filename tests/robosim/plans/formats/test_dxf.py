"""DXF drawings made by ezdxf: units, layers, blocks and curves against exact areas; what is rejected."""

import numpy as np
import pytest

from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from tests.robosim.plans.formats.test_line_drawing import FREE_M2, INNER, OUTER, free_m2, is_free

ezdxf = pytest.importorskip("ezdxf", reason="needs the extra dxf")
xclip = pytest.importorskip("ezdxf.xclip")


class Drawing:
    """A drawing with layers WALL and DOOR."""

    def __init__(self, unit=6, version="R2018"):
        self.document = ezdxf.new(version)
        self.document.units = unit
        self.space = self.document.modelspace()

    def outline(self, points, layer="WALL", scale=1.0, **more):
        corners = [(scale * x, scale * y) for x, y in points]
        self.space.add_lwpolyline(corners, close=True, dxfattribs={"layer": layer, **more})

    def save(self, folder, fmt="asc"):
        self.document.saveas(folder / "house.dxf", fmt=fmt)
        return folder / "house.dxf"


@pytest.mark.parametrize(
    ("unit", "scale"),
    [(1, 1 / 0.0254), (2, 1 / 0.3048), (4, 1000), (5, 100), (6, 1), (10, 1 / 0.9144), (14, 10)],
)
def test_units_of_length(tmp_path, unit, scale):
    drawing = Drawing(unit)
    drawing.outline(OUTER, scale=scale)
    drawing.outline(INNER, scale=scale)
    assert free_m2(read_plan(drawing.save(tmp_path))) == pytest.approx(FREE_M2, abs=0.5)


@pytest.mark.parametrize("fmt", ["asc", "bin"])
def test_coordinates_stay_and_the_unit_can_be_given(tmp_path, fmt):
    drawing = Drawing(0)
    for ring in (OUTER, INNER):
        drawing.outline([(x + 100, y + 50) for x, y in ring], scale=100)
    path = drawing.save(tmp_path, fmt)
    with pytest.raises(
        MapError, match=r"does not say its unit of length \(\$INSUNITS is 0\). Give it: --unit 0.001"
    ):
        read_plan(path)
    plan = read_plan(path, unit_m=0.01)
    assert free_m2(plan) == pytest.approx(FREE_M2)
    assert plan.centres(plan.free).min(axis=0) == pytest.approx([100.225, 50.225])


def test_doors_on_their_layer_are_openings(tmp_path):
    """The leaf and arc of a door, a block, are on DOOR: the door of the house is open."""
    drawing = Drawing()
    drawing.outline(OUTER)
    drawing.outline(INNER)
    door = drawing.document.blocks.new("door")
    door.add_line((0, 0), (0.9, 0))
    door.add_arc((0, 0), 0.9, 0, 90)
    drawing.space.add_blockref("door", (3.05, 2), dxfattribs={"layer": "DOOR"})
    path = drawing.save(tmp_path)
    assert free_m2(read_plan(path)) == pytest.approx(FREE_M2)
    closed = read_plan(path, wall_layers=("wall", "door"))
    assert free_m2(closed) < FREE_M2 - 0.05


def test_blocks_in_blocks_are_turned_mirrored_and_scaled(tmp_path):
    """A post of 1 m x 0.5 m on layer 0, in a block in a block: on the layer of the outer reference, in its place."""
    drawing = Drawing()
    drawing.outline(OUTER)
    post, pair = (drawing.document.blocks.new(name) for name in ("post", "pair"))
    post.add_solid([(0, 0), (1, 0), (0, 0.5), (1, 0.5)])
    pair.add_blockref("post", (0, 0))
    pair.add_blockref("post", (0, 1), dxfattribs={"xscale": 2})
    drawing.space.add_blockref(
        "pair", (4, 1), dxfattribs={"layer": "WALL", "rotation": 90, "xscale": -0.5, "yscale": 1}
    )
    plan = read_plan(drawing.save(tmp_path))
    # (x, y) of the pair goes to (4 - y, 1 - x / 2).
    assert not is_free(plan, 3.75, 0.75) and is_free(plan, 3.75, 1.1) and is_free(plan, 4.1, 0.75)
    assert not is_free(plan, 2.75, 0.25) and is_free(plan, 2.4, 0.25)
    assert free_m2(plan) == pytest.approx(5.95 * 3.95 - 0.5 * 0.5 - 0.5 * (1 - 0.025), abs=0.03)


def test_curves(tmp_path):
    """A round room of two bulges, a circle and a closed spline in it, whose areas follow from their radii."""
    drawing = Drawing()
    drawing.space.add_lwpolyline(
        [(-3, 0, 1), (3, 0, 1)], format="xyb", close=True, dxfattribs={"layer": "WALL"}
    )
    drawing.space.add_circle((1.5, 0), 0.25, dxfattribs={"layer": "WALL"})
    drawing.space.add_ellipse((-1.5, 0), (0.25, 0), 1.0, dxfattribs={"layer": "WALL"})
    plan = read_plan(drawing.save(tmp_path), resolution_m=0.01)
    expected = np.pi * (3 - 0.005) ** 2 - 2 * np.pi * 0.25**2
    assert free_m2(plan) == pytest.approx(expected, rel=2e-3)


def test_hatches_and_wide_polylines(tmp_path):
    """A hatch with a hole of 2 m x 1 m, and a polyline 0.3 m wide."""
    drawing = Drawing()
    drawing.outline(OUTER)
    hatch = drawing.space.add_hatch(dxfattribs={"layer": "WALL"})
    hatch.paths.add_polyline_path([(1, 1), (4, 1), (4, 3), (1, 3)], is_closed=True)
    hatch.paths.add_polyline_path([(1.5, 1.5), (3.5, 1.5), (3.5, 2.5), (1.5, 2.5)], is_closed=True)
    drawing.space.add_lwpolyline([(5, 1), (5, 3)], dxfattribs={"layer": "WALL", "const_width": 0.3})
    plan = read_plan(drawing.save(tmp_path))
    assert is_free(plan, 2.5, 2) and not is_free(plan, 1.2, 2)
    assert not is_free(plan, 5.12, 2) and is_free(plan, 5.18, 2)


@pytest.mark.parametrize("version", ["R2000", "R12"])
def test_polylines_are_as_wide_as_each_vertex_says(version, tmp_path):
    """Codes 40 and 41 of a vertex are the widths of the segment that it begins: 0.3 m, and 0.1 to 0.3 m."""
    drawing = Drawing(version=version)
    drawing.space.add_polyline2d(OUTER, close=True, dxfattribs={"layer": "WALL"})
    if version == "R12":
        add, layer = drawing.space.add_polyline2d, {"layer": "WALL", "default_start_width": 0.9}
    else:
        add, layer = drawing.space.add_lwpolyline, {"layer": "WALL"}
    corners = [(5, 1, 0.3, 0.3), (5, 3, 0.1, 0.3), (2, 3, 0.5, 0.5)]
    add(corners, format="xyse", dxfattribs=layer)
    plan = read_plan(drawing.save(tmp_path), unit_m=1.0)
    assert not is_free(plan, 5.12, 2) and is_free(plan, 5.18, 2)
    assert not is_free(plan, 3.5, 3.08) and is_free(plan, 3.5, 3.13)


def test_what_is_hidden_is_no_wall(tmp_path):
    """Layers that are off or frozen, invisible entities, and paper space."""
    drawing = Drawing()
    drawing.outline(OUTER)
    drawing.outline(INNER)
    for name in ("WALL-OLD", "WALL-NEW"):
        layer = drawing.document.layers.add(name)
        layer.off() if name == "WALL-OLD" else layer.freeze()
        drawing.outline([(1, 1), (1.5, 1), (1.5, 1.5), (1, 1.5)], name)
    drawing.outline([(4, 1), (4.5, 1), (4.5, 1.5), (4, 1.5)], invisible=1)
    drawing.document.layout().add_line((0, 0), (297, 210), dxfattribs={"layer": "WALL"})
    assert free_m2(read_plan(drawing.save(tmp_path))) == pytest.approx(FREE_M2)


def test_read_dxf_leaves_out_invisible_and_frozen_references(tmp_path):
    """Visibility states of dynamic blocks hide references; a frozen layer hides a block whatever its layers are."""
    drawing = Drawing()
    drawing.outline(OUTER)
    drawing.outline(INNER)
    drawing.document.layers.add("OLD").freeze()
    drawing.document.layers.add("OFF").off()
    post = drawing.document.blocks.new("post")
    post.add_solid([(0, 0), (0.5, 0), (0, 0.5), (0.5, 0.5)], dxfattribs={"layer": "WALL"})
    drawing.space.add_blockref("post", (1, 1), dxfattribs={"layer": "WALL", "invisible": 1})
    drawing.space.add_blockref("post", (2, 1), dxfattribs={"layer": "OLD"})
    drawing.space.add_blockref("post", (4, 1), dxfattribs={"layer": "OFF"})
    plan = read_plan(drawing.save(tmp_path))
    assert is_free(plan, 1.25, 1.25) and is_free(plan, 2.25, 1.25) and not is_free(plan, 4.25, 1.25)
    assert free_m2(plan) == pytest.approx(FREE_M2 - 0.25)


@pytest.mark.parametrize(("style", "island", "inner"), [(0, True, False), (1, True, True), (2, False, False)])
def test_read_dxf_reads_styles_of_hatches(tmp_path, style, island, inner):
    """An island in a hatch and a square in it: all outlines count, the outer two, or the outermost alone (code 75)."""
    drawing = Drawing()
    drawing.outline(OUTER)
    hatch = drawing.space.add_hatch(dxfattribs={"layer": "WALL", "hatch_style": style})
    for size, flags in ((1.5, 1), (1.2, 16), (0.4, 0)):
        low, high = 2 - size, 2 + size
        hatch.paths.add_polyline_path([(low, low), (high, low), (high, high), (low, high)], flags=flags)
    plan = read_plan(drawing.save(tmp_path))
    assert not is_free(plan, 0.65, 2.0)
    assert is_free(plan, 1.0, 2.0) == island and is_free(plan, 2.0, 2.0) == inner


def test_read_dxf_reads_wide_polylines_of_old_versions_and_no_meshes(tmp_path):
    """POLYLINE has its width in code 40; polyface meshes are left out, as furniture in space is."""
    drawing = Drawing(version="R12")
    corners = [(0, 0), (6, 0), (6, 4), (0, 4)]
    drawing.space.add_polyline2d(corners, close=True, dxfattribs={"layer": "WALL"})
    wide = {"layer": "WALL", "default_start_width": 0.3, "default_end_width": 0.3}
    drawing.space.add_polyline2d([(5, 1), (5, 3)], dxfattribs=wide)
    drawing.space.add_polyface({"layer": "WALL"}).append_face([(2, 1, 0), (3, 1, 0), (3, 2, 0)])
    plan = read_plan(drawing.save(tmp_path), unit_m=1.0)
    assert not is_free(plan, 5.12, 2) and is_free(plan, 5.18, 2) and is_free(plan, 2.5, 1)


def test_endless_blocks_are_rejected(tmp_path):
    """Blocks of ten of the next, ten deep."""
    drawing = Drawing()
    for deep in range(10):
        block = drawing.document.blocks.new(f"b{deep}")
        for _ in range(10):
            block.add_blockref(f"b{deep + 1}", (0, 0))
    drawing.document.blocks.new("b10").add_line((0, 0), (1, 0))
    drawing.space.add_blockref("b0", (0, 0))
    with pytest.raises(MapError, match="more than 300000 entities"):
        read_plan(drawing.save(tmp_path))


def test_damaged_drawings_are_rejected(tmp_path):
    path = tmp_path / "house.dxf"
    path.write_text("no drawing")
    with pytest.raises(MapError, match="not readable as a DXF drawing"):
        read_plan(path)
    path.write_text("  0\nSECTION\n  2\nHEADER\n  9\n$INSUNITS\n 70\n     6\n  0\nENDSEC\n  0\nEOF\n")
    with pytest.raises(MapError, match="no lines or areas"):
        read_plan(path)


def test_without_the_extra_its_name_is_printed(tmp_path, monkeypatch):
    monkeypatch.setattr("robosim.plans.formats.dxf.is_installed", lambda module: False)
    with pytest.raises(
        ImportError, match=r"A DXF drawing needs ezdxf, which is not installed: pip install .*\[dxf\]"
    ):
        read_plan(Drawing().save(tmp_path))


def test_options_of_other_formats_are_rejected(tmp_path):
    drawing = Drawing()
    drawing.outline(OUTER)
    with pytest.raises(MapError, match=r"floor height is 1\.0, but this is no mesh"):
        read_plan(drawing.save(tmp_path), floor_height_m=1.0)
    with pytest.raises(MapError, match=r"wall layers is .*, but this is no DXF drawing or SVG drawing"):
        read_plan("flat", wall_layers=("A",))


def test_read_dxf_rejects_numbers_that_are_nan(tmp_path):
    drawing = Drawing()
    drawing.outline(OUTER)
    drawing.space.add_circle((3, 3), 0.777, dxfattribs={"layer": "WALL"})
    path = drawing.save(tmp_path)
    path.write_text(path.read_text().replace("0.777", "nan"))
    with pytest.raises(MapError, match=r"house.dxf: radius of a CIRCLE is nan"):
        read_plan(path)


def test_read_dxf_names_blocks_of_other_files_and_missing_ones(tmp_path, caplog):
    drawing = Drawing()
    drawing.outline(OUTER)
    drawing.outline(INNER)
    drawing.document.add_xref_def("stairs.dxf", "STAIRS")
    for name in ("STAIRS", "COLUMNS"):
        drawing.space.add_blockref(name, (1, 1))
    assert free_m2(read_plan(drawing.save(tmp_path))) == pytest.approx(FREE_M2)
    assert "'STAIRS' of 'stairs.dxf'" in caplog.text and "INSERT" in caplog.text


def test_read_dxf_rejects_blocks_that_multiply(tmp_path):
    """Ten references in each of six blocks are a million lines."""
    drawing = Drawing()
    drawing.outline(OUTER)
    drawing.document.blocks.new("B0").add_line((0, 0), (0.01, 0.01), dxfattribs={"layer": "WALL"})
    for level in range(1, 7):
        block = drawing.document.blocks.new(f"B{level}")
        for number in range(10):
            block.add_blockref(f"B{level - 1}", (0.001 * number, 0))
    drawing.space.add_blockref("B6", (1, 1))
    with pytest.raises(MapError, match="more than 300000 entities"):
        read_plan(drawing.save(tmp_path))


def test_read_dxf_reads_copies_at_one_place_once(tmp_path):
    drawing = Drawing()
    drawing.outline(OUTER)
    for _ in range(300):
        drawing.outline(INNER)
    assert free_m2(read_plan(drawing.save(tmp_path))) == pytest.approx(FREE_M2)


def test_read_dxf_leaves_out_the_frame_of_a_fitted_polyline(tmp_path):
    """The top of the frame is at y = 3, of the curve at y = 2."""
    drawing = Drawing()
    drawing.outline(OUTER)
    fitted = drawing.space.add_polyline2d([(1, 1), (2, 3), (3, 1)], dxfattribs={"layer": "WALL", "flags": 4})
    for vertex in fitted.vertices:
        vertex.dxf.flags = 16
    fitted.append_vertices([(1, 1), (1.5, 1.75), (2, 2), (2.5, 1.75), (3, 1)], dxfattribs={"flags": 8})
    plan = read_plan(drawing.save(tmp_path))
    assert is_free(plan, 2.0, 2.9) and not is_free(plan, 2.0, 2.0)


def test_read_dxf_reports_objects_on_layers_of_walls_that_it_cannot_read(tmp_path, caplog):
    """Surfaces, and objects of other programs, which have no attributes for ezdxf; text is no wall."""
    drawing = Drawing()
    drawing.outline(OUTER)
    for layer in ("WALL", "WALL", "FURNITURE"):
        drawing.space.add_3dface([(1, 1), (2, 1), (2, 2)], dxfattribs={"layer": layer})
    drawing.space.add_text("stairs", dxfattribs={"layer": "WALL"})
    file = drawing.save(tmp_path)
    before, entities, after = file.read_text().partition("ENTITIES\n")
    owner = drawing.space.layout_key
    foreign = f"  0\nAEC_WALL\n  5\nFF1\n330\n{owner}\n100\nAcDbEntity\n  8\nWALL\n"
    file.write_text(before + entities + foreign + after)
    read_plan(file)
    assert "2 '3DFACE', 1 'AEC_WALL' on the layers of walls are not read" in caplog.text
    drawing = Drawing()
    drawing.outline(OUTER, layer="DOOR")
    drawing.outline(INNER, layer="TABLE")
    drawing.space.add_3dface([(1, 1), (2, 1), (2, 2)], dxfattribs={"layer": "WALL"})
    with pytest.raises(MapError, match=r"its walls are 1 '3DFACE', which are not read\. Explode them"):
        read_plan(drawing.save(tmp_path))


def test_read_dxf_names_clipped_blocks(tmp_path, caplog):
    """Also one within a block."""
    drawing = Drawing()
    for name, inner in (("a", None), ("b", "a")):
        block = drawing.document.blocks.new(name)
        block.add_lwpolyline(OUTER, close=True, dxfattribs={"layer": "WALL"})
        if inner:
            xclip.XClip(block.add_blockref(inner, (0, 0))).set_block_clipping_path([(0, 0), (1, 1)])
    xclip.XClip(drawing.space.add_blockref("b", (0, 0))).set_block_clipping_path([(0, 0), (1, 1)])
    read_plan(drawing.save(tmp_path))
    assert "the clipping (XCLIP) of 'a'" in caplog.text and "the clipping (XCLIP) of 'b'" in caplog.text
