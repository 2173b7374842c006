"""IFC models made by ifcopenshell: storeys with open doorways against exact areas; what is rejected."""

import numpy as np
import pytest

from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from tests.robosim.plans.formats.test_line_drawing import FREE_M2, free_m2, is_free

ifcopenshell = pytest.importorskip("ifcopenshell", reason="needs the extra ifc")


def model(version="IFC4"):
    """Two storeys of the house of `test_line_drawing`, in millimetres, with a closed door in the partition."""
    import ifcopenshell.api.aggregate
    import ifcopenshell.api.context
    import ifcopenshell.api.feature
    import ifcopenshell.api.geometry
    import ifcopenshell.api.owner
    import ifcopenshell.api.project
    import ifcopenshell.api.root
    import ifcopenshell.api.unit

    api = ifcopenshell.api
    file = api.project.create_file(version=version)
    if version == "IFC2X3":  # whose entities have an owner
        person, firm = api.owner.add_person(file), api.owner.add_organisation(file)
        api.owner.add_person_and_organisation(file, person=person, organisation=firm)
        api.owner.add_application(file, application_developer=firm)
    project = api.root.create_entity(file, ifc_class="IfcProject")
    api.unit.assign_unit(file)
    whole = api.context.add_context(file, context_type="Model")
    body = api.context.add_context(
        file, context_type="Model", context_identifier="Body", target_view="MODEL_VIEW", parent=whole
    )
    building = api.root.create_entity(file, ifc_class="IfcBuilding")
    api.aggregate.assign_object(file, relating_object=project, products=[building])

    def block(kind, at, size, angle=0.0):
        made = api.root.create_entity(file, ifc_class=kind)
        length, thickness, height = size
        shape = api.geometry.add_wall_representation(
            file, context=body, length=length, height=height, thickness=thickness
        )
        matrix = np.eye(4)
        matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        matrix[:3, 3] = at
        api.geometry.assign_representation(file, product=made, representation=shape)
        api.geometry.edit_object_placement(file, product=made, matrix=matrix)
        return made

    for z in (0.0, 3.0):
        block("IfcSlab", (0, 0, z - 0.3), (6, 4, 0.3))
        for y in (0, 3.8):
            block("IfcWall", (0, y, z), (6, 0.2, 2.7))
        for x in (0.2, 6):
            block("IfcWall", (x, 0.2, z), (3.6, 0.2, 2.7), np.pi / 2)
        partition = block("IfcWall", (3.1, 0.2, z), (3.6, 0.1, 2.7), np.pi / 2)
        opening = block("IfcOpeningElement", (3.3, 2, z), (0.9, 0.5, 2.1), np.pi / 2)
        api.feature.add_feature(file, feature=opening, element=partition)
        api.feature.add_filling(
            file, opening=opening, element=block("IfcDoor", (3.1, 2, z), (0.9, 0.05, 2.1), np.pi / 2)
        )
    return file


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    path = tmp_path_factory.mktemp("ifc") / "house.ifc"
    model().write(str(path))
    return path


@pytest.mark.parametrize("floor_height_m", [0.0, 3.0])
def test_a_storey_with_open_doorways(house, floor_height_m):
    plan = read_plan(house, floor_height_m=floor_height_m)
    assert free_m2(plan) == pytest.approx(FREE_M2)
    assert plan.centres(plan.free).min(axis=0) == pytest.approx([0.225, 0.225])
    assert is_free(plan, 3.05, 2.5) and not is_free(plan, 3.05, 1.0)


def test_a_missing_storey_is_an_error_that_lists_them(house):
    with pytest.raises(MapError, match=r"floors were found at 0.00 m \(24 m2\), 3.00 m \(24 m2\)"):
        read_plan(house, floor_height_m=8.0)


def test_options_that_the_model_knows_are_rejected(house):
    with pytest.raises(MapError, match=r"unit is 0\.1, but this is no mesh or DXF drawing or SVG drawing"):
        read_plan(house, unit_m=0.1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[: len(text) // 2], "it is cut off"),
        (lambda text: "END-ISO-10303-21;", "not readable as an IFC model"),
        (
            lambda text: text.replace("IFCWALL(", "IFCDOOR(").replace("IFCSLAB(", "IFCDOOR("),
            "no walls or floors",
        ),
    ],
)
def test_damaged_models_are_rejected(house, tmp_path, change, message):
    (tmp_path / "house.ifc").write_text(change(house.read_text()))
    with pytest.raises(MapError, match=message):
        read_plan(tmp_path / "house.ifc")


def line_of(text, kind):
    """A line of a model, the first of its kind, and its name."""
    line = next(line for line in text.splitlines(keepends=True) if f"={kind}(" in line)
    return line, line.partition("=")[0]


@pytest.mark.parametrize(
    ("kind", "new", "message"),
    [
        # Without the end of a line all that follows is lost, as the library says nothing.
        ("IFCWALL", lambda line: line.replace(");", ""), r"of its \d+ entities cannot be read"),
        ("IFCWALL", lambda line: line.replace("IFCWALL", "IFCWAL"), r"1 of its \d+ entities cannot be read"),
        ("IFCLOCALPLACEMENT", lambda line: "", r"1 of its entities are missing, such as #\d+"),
        ("IFCEXTRUDEDAREASOLID", lambda line: "", r"1 of its entities are missing, such as #\d+"),
        ("IFCSIUNIT", lambda line: line.replace("(", "(#1,"), "its units of length cannot be read"),
    ],
)
def test_read_ifc_rejects_a_model_of_which_parts_are_lost(house, tmp_path, kind, new, message):
    """Ifcopenshell reads the rest: a wall less, or one at another place, or metres for millimetres."""
    text = house.read_text()
    line, _ = line_of(text, kind)
    (tmp_path / "house.ifc").write_text(text.replace(line, new(line)))
    with pytest.raises(MapError, match=message) as rejected:
        read_plan(tmp_path / "house.ifc")
    assert "Error:" not in str(rejected.value) and "\n" not in str(rejected.value)


def test_read_ifc_reports_products_whose_shape_is_lost(house, tmp_path, caplog):
    """A slab with an extrusion of no height; the floor of the other storey is left."""
    text = house.read_text()
    line, _ = line_of(text, "IFCEXTRUDEDAREASOLID")
    (tmp_path / "house.ifc").write_text(text.replace(line, line.rpartition(",")[0] + ",0.);\n"))
    read_plan(tmp_path / "house.ifc")
    assert "1 of 12 products have a shape that cannot be read, such as #" in caplog.text
    assert "an IfcSlab: they are missing in the plan" in caplog.text


def test_read_ifc_takes_comments_and_lines_with_several_entities(house, tmp_path, caplog):
    """Names in comments and in texts are no references."""
    text = house.read_text()
    (first, _), (wall, name) = line_of(text, "IFCSIUNIT"), line_of(text, "IFCWALL")
    named = f"/* {name} = #9999; */ {wall}".replace("$,$,", "$,'#9998 in a text',", 1)
    (tmp_path / "house.ifc").write_text(text.replace(first, first.rstrip("\n")).replace(wall, named))
    assert free_m2(read_plan(tmp_path / "house.ifc")) == pytest.approx(FREE_M2)
    assert "cannot be read" not in caplog.text


def test_read_ifc_reads_ifc_2x3(tmp_path, caplog):
    model("IFC2X3").write(str(tmp_path / "old.ifc"))
    assert free_m2(read_plan(tmp_path / "old.ifc")) == pytest.approx(FREE_M2)
    assert "cannot be read" not in caplog.text


@pytest.mark.parametrize("kind", ["IfcSpatialZone", "IfcExternalSpatialElement", "IfcVirtualElement"])
def test_read_ifc_leaves_out_zones_and_virtual_elements(house, tmp_path, kind):
    """They bound spaces and are no matter (ISO 16739-1): a zone of the size of the slab is 0.5 m above the floor."""
    file = ifcopenshell.open(str(house))
    slab = file.by_type("IfcSlab")[0]
    placement = file.createIfcAxis2Placement3D(file.createIfcCartesianPoint([0.0, 0.0, 500.0]))
    file.create_entity(
        kind,
        GlobalId=ifcopenshell.guid.new(),
        ObjectPlacement=file.createIfcLocalPlacement(None, placement),
        Representation=file.createIfcProductDefinitionShape(None, None, slab.Representation.Representations),
    )
    file.write(str(tmp_path / "zones.ifc"))
    assert free_m2(read_plan(tmp_path / "zones.ifc")) == pytest.approx(FREE_M2, abs=0.3)


def test_a_crash_of_the_library_is_an_error(house, tmp_path):
    """A placement relative to itself ends ifcopenshell by a stack overflow."""
    lines = house.read_text().splitlines()
    number, line = next((i, one) for i, one in enumerate(lines) if "=IFCLOCALPLACEMENT(" in one)
    own = line.partition("=")[0]
    lines[number] = f"{own}=IFCLOCALPLACEMENT({own},{line.rpartition(',')[2]}"
    (tmp_path / "house.ifc").write_text("\n".join(lines))
    with pytest.raises(MapError, match=r"its reader crashed, signal 11"):
        read_plan(tmp_path / "house.ifc")


def test_without_the_extra_its_name_is_printed(house, monkeypatch):
    monkeypatch.setattr("robosim.plans.formats.ifc.is_installed", lambda module: False)
    with pytest.raises(ImportError, match=r"An IFC model needs ifcopenshell, .*\[ifc\]"):
        read_plan(house)
