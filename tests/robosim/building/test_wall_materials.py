"""Walls of materials of their own: by the colours of a plan, with layers from files; against what was drawn."""

import logging

import numpy as np
import pytest
from PIL import Image

from robosim.building.building import BuildingConfig, make_building
from robosim.building.wall_materials import read_material
from robosim.plans.files import read_plan, write_ros
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan, MapError
from robosim.support.reading import FileError
from tests.benchmarks.trial_floors import turned
from wireless.em.materials import Layer, Material
from wireless.paths import LinkCategory
from wireless.tracing.tracer import Tracer, TracerConfig

BLUE, GREEN = (0, 0, 255), (0, 128, 0)
OWN = "layers:\n- {material: glass, thickness_m: 0.01}\n"


def room_with_window(folder, colours="'#0000ff': glazing, '#008000': own.yaml"):
    """A room of 60 x 40 cells of 0.1 m, its wall to the east of glass from row 10 to 30, to the north of own layers."""
    pixels = np.full((44, 64, 3), 0, np.uint8)
    pixels[2:-2, 2:-2] = 254
    pixels[13:33, -2:] = BLUE  # bright enough to be unknown by its grey
    pixels[:2] = GREEN
    Image.fromarray(pixels).save(folder / "room.png")
    (folder / "own.yaml").write_text(OWN)
    (folder / "room.yaml").write_text(
        "image: room.png\nresolution: 0.1\norigin: [1.0, 2.0, 0.3]\nnegate: 0\noccupied_thresh: 0.65\n"
        f"free_thresh: 0.196\nmaterials: {{{colours}}}\n"
    )
    return folder / "room.yaml"


def length_of(building, name):
    return building.of_material(name).area / building.height_m


@pytest.mark.parametrize("tolerance_m", [None, 0.0, 0.1])
def test_walls_take_the_material_of_the_cells_behind(tmp_path, tolerance_m):
    """Glass 2 m of the wall to the east, own layers all 6 m to the north, the rest as the building says; to 1e-9 m."""
    building = make_building(
        read_plan(room_with_window(tmp_path)), config=BuildingConfig(tolerance_m=tolerance_m)
    )
    assert length_of(building, "glazing") == pytest.approx(2.0, abs=1e-9)
    assert length_of(building, "own") == pytest.approx(6.0, abs=1e-9)
    assert length_of(building, "partition") == pytest.approx(12.0, abs=1e-9)
    assert Material("own", (Layer(thickness_m=0.01, material="glass"),)) in building.materials
    window = building.of_material("glazing")
    cells = building.plan.to_cells(window.vertices[:, :2])
    assert (
        np.allclose(cells[:, 0], 62)
        and np.isclose(cells[:, 1].min(), 11)
        and np.isclose(cells[:, 1].max(), 31)
    )
    assert building.mesh.is_watertight and building.mesh.volume == pytest.approx(-60.0)


@pytest.mark.parametrize("degrees", [10, 30, 45, 77])
def test_slanted_walls_keep_their_materials(tmp_path, degrees):
    """Turned against the grid: each length within three cells of what it was."""
    plan = turned(read_plan(room_with_window(tmp_path)), degrees)
    building = make_building(plan)
    assert length_of(building, "glazing") == pytest.approx(2.0, abs=0.3)
    assert length_of(building, "own") == pytest.approx(6.0, abs=0.3)


def test_radio_meets_the_wall_that_is_there(tmp_path):
    """The reflection off the window is a window's: as in a room whose walls are all of glass, to 1e-9 dB."""
    plan = read_plan(room_with_window(tmp_path))
    places = plan.to_map(np.array([[40.0, 18.0], [42.0, 24.0]]))
    tx, rx = (np.append(place, 1.5)[None] for place in places)
    config = TracerConfig(max_reflections=1, diffraction=False)

    def off_the_east(building):
        paths = Tracer(building, config=config).trace(tx, rx)
        hit = plan.to_cells(paths.point[:, 0, :2])[:, 0]
        return paths.select((paths.order == 1) & (np.abs(hit - 62) < 1e-6)).power_db

    own = off_the_east(make_building(plan))
    glass = off_the_east(make_building(plan, config=BuildingConfig(wall_material="glazing")))
    boards = off_the_east(make_building(plan, config=BuildingConfig(wall_material="drywall")))
    assert len(own) == 1 and own == pytest.approx(glass, abs=1e-9)
    # Without the plan's own materials the wall behind is drawn as the building says.
    assert boards == pytest.approx(own, abs=1e-9)


def test_written_and_read_again_it_is_the_same(tmp_path):
    """Occupancy, materials and their names; in another folder, where the file of layers is not."""
    plan = read_plan(room_with_window(tmp_path))
    (tmp_path / "b").mkdir()
    write_ros(plan, tmp_path / "b" / "room.yaml")
    back = read_plan(tmp_path / "b" / "room.yaml")
    assert np.array_equal(back.occupancy, plan.occupancy) and np.array_equal(back.material, plan.material)
    assert make_building(back).materials == make_building(plan).materials
    assert back.digest() != FloorPlan(occupancy=plan.occupancy, resolution_m=0.1, origin=plan.origin).digest()


@pytest.mark.parametrize(
    ("colours", "words"),
    [
        ("'#00f': glazing", "'#00f' is no colour"),
        ("'#0000ff': [glazing]", r"#0000ff: it is \['glazing'\], expected a name"),
        ("'#0000ff': glasing", "Did you mean 'glazing'"),
        ("'#0000ff': none.yaml", "there is no such file"),
    ],
)
def test_materials_that_are_none_are_rejected(tmp_path, colours, words):
    """By the name of the map, with what is expected."""
    with pytest.raises(MapError, match=words) as rejected:
        read_plan(room_with_window(tmp_path, colours))
    assert "room.yaml" in str(rejected.value)


def test_grey_pictures_and_missing_colours_are_reported(tmp_path, caplog):
    """Colours of a grey picture are a mistake; a colour that is nowhere is reported."""
    path = room_with_window(tmp_path, "'#ff00ff': door")
    with caplog.at_level(logging.WARNING):
        read_plan(path)
    assert "#ff00ff, which no pixel" in caplog.text
    Image.open(tmp_path / "room.png").convert("L").save(tmp_path / "room.png")
    with pytest.raises(MapError, match=r"room.png is grey"):
        read_plan(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("layers: 3", "layers is 3, expected a list"),
        ("layers: []", "layers of 'wall' are 0"),
        ("layers: [{material: glas, thickness_m: 0.01}]", "Did you mean 'glass'"),
        ("layers: [{material: glass}]", "thickness_m"),
        ("layers: [{material: glass, thickness_m: thin}]", "wall.yaml"),
        ("thickness: 3", "a key is 'thickness'. Known: name, layers"),
        ("name: thick", "'layers' is missing"),
        ("layers: []\ncolour: red", "a key is 'colour'. Known: name, layers"),
        (OWN + "scattering: rough", "scattering is 'rough', expected a number"),
        (OWN + "scattering: 1.5", "scattering of 'wall' is 1.5, expected 0 to 1"),
        (OWN + "lobe: 2.5", "lobe is 2.5, expected a whole number"),
    ],
)
def test_layers_that_are_none_are_rejected(tmp_path, text, words):
    """One line that names the file and what would be right."""
    (tmp_path / "wall.yaml").write_text(text)
    with pytest.raises(FileError, match=words) as rejected:
        read_material(tmp_path / "wall.yaml")
    assert "wall.yaml" in str(rejected.value)


def test_a_file_of_layers_is_a_wall_material(tmp_path):
    """For all walls of a building, by the path of the file."""
    (tmp_path / "wall.yaml").write_text("name: pane\n" + OWN)
    plan = FloorPlan(occupancy=np.full((5, 5), FREE, np.uint8), resolution_m=1.0)
    building = make_building(plan, config=BuildingConfig(wall_material=str(tmp_path / "wall.yaml")))
    assert "pane" in map(str, building.materials)


def test_a_file_of_layers_says_how_rough_they_are(tmp_path):
    """Coefficient and lobe get into the wall; without them there are none."""
    path = tmp_path / "wall.yaml"
    path.write_text(OWN + "scattering: 0.3\nlobe: 6\n")
    assert (read_material(path).scattering, read_material(path).lobe) == (0.3, 6)
    path.write_text(OWN)
    assert (read_material(path).scattering, read_material(path).lobe) == (None, None)


def test_materials_of_free_cells_are_rejected():
    """They would be of no wall."""
    cells = np.full((4, 4), FREE, np.uint8)
    cells[0] = OCCUPIED
    with pytest.raises(MapError, match="not occupied"):
        FloorPlan(occupancy=cells, resolution_m=1.0, material=np.ones((4, 4), np.uint8), materials=("glass",))
    with pytest.raises(MapError, match="there are 0 materials"):
        FloorPlan(occupancy=cells, resolution_m=1.0, material=(cells == OCCUPIED).astype(np.uint8))


@pytest.mark.parametrize("cells", [1, 3, 6])
def test_a_drawn_window_weakens_once(cells):
    """A room divided by glazing at 5 GHz, with all defaults: 10.25 dB beyond free space, whatever its thickness."""
    occupancy = np.ones((60, 120), np.uint8)
    occupancy[2:-2, 2:-2] = 0
    glass = np.zeros_like(occupancy)
    glass[2:-2, 60 : 60 + cells] = 1
    plan = FloorPlan(
        occupancy=np.maximum(occupancy, glass), resolution_m=0.1, material=glass, materials=("glazing",)
    )
    paths = Tracer(make_building(plan), frequency_hz=5e9).trace(
        np.array([[2.0, 3.0, 1.5]]), np.array([[10.0, 3.0, 1.5]])
    )
    direct = paths.select(paths.order == 1).strongest()
    free_db = 20 * np.log10(299792458.0 / 5e9 / (4 * np.pi * 8))
    assert free_db - direct.power_db == pytest.approx(10.25, abs=0.01)
    assert paths.link_category().tolist() == [[LinkCategory.OBSTRUCTED_LOS]]
