"""YAML files of buildings of several storeys: what they say, and what is said of those that make no sense."""

import pytest

from robosim.plans.files import read_plan, write_ros
from robosim.plans.floorplan import MapError
from robosim.plans.storey_plans import is_storeys
from robosim.plans.storeys_file import read_storeys
from tests.plans import room

GOOD = """
storeys:
- plan: ground.yaml
  height: 2.6
  slab: 0.25
  material: wood
  openings:
  - [[1, 1], [2, 1], [2, 2.5]]
- {plan: flat, offset: [0.5, -1]}
"""


def written(folder, text=GOOD):
    write_ros(room(), folder / "ground.yaml")
    (folder / "house.yaml").write_text(text)
    return folder / "house.yaml"


def test_file_says_all_of_its_storeys(tmp_path):
    """Plans next to the file and shipped ones; heights, slabs and openings; an offset moves a plan."""
    file = written(tmp_path)
    house = read_storeys(file)
    ground, first = house.storeys
    assert (house.name, ground.height_m, ground.slab_m, ground.slab_material) == ("house", 2.6, 0.25, "wood")
    assert ground.openings == (((1.0, 1.0), (2.0, 1.0), (2.0, 2.5)),) and first.openings == ()
    x, y, _ = read_plan("flat").origin
    assert first.plan.origin[:2] == (x + 0.5, y - 1) and house.floor_m(1) == pytest.approx(2.85)
    assert is_storeys(file) and not is_storeys(tmp_path / "ground.yaml")
    assert house.storey(1).name == "house_storey_1" and house.storey(0).digest() != house.storey(1).digest()
    assert read_storeys(written(tmp_path, GOOD.replace("2.6", "2.7"))).digest() != house.digest()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("height: 2.6", "height: tall", "storeys\\[0\\].height is 'tall', expected a number"),
        ("height: 2.6", "height: 260", "storey 0: height is 260, expected 0.1 to 100 m"),
        ("slab: 0.25", "slab: 0", "storey 0: slab is 0, expected 0.01 to 10 m"),
        ("slab: 0.25", "slap: 0.25", "a key of storeys\\[0\\] is 'slap'. Did you mean 'slab'"),
        ("material: wood", "material: wod", "storey 0: .*'wod'"),
        ("[1, 1], [2, 1], [2, 2.5]", "[1, 1], [2, 1]", "storey 0: openings has .*three points or more"),
        ("[0.5, -1]", "[0.5]", "storeys\\[1\\].offset is .*expected a list of 2 values"),
        ("plan: flat", "plan: flet", "Did you mean 'flat'"),
        ("plan: flat", "plans: flat", "a key of storeys\\[1\\] is 'plans'. Did you mean 'plan'"),
        ("storeys:", "storeys: 3\nother:", "Known: storeys, name"),
        ("storeys:", "floors:", "a key is 'floors'. Known: storeys, name"),
    ],
)
def test_senseless_values_are_reported_with_file_and_fix(tmp_path, old, new, message):
    with pytest.raises(MapError, match=message) as error:
        read_storeys(written(tmp_path, GOOD.replace(old, new)))
    assert "house.yaml" in str(error.value) or "flet" in str(error.value)


def test_a_single_plan_is_rejected(tmp_path):
    with pytest.raises(MapError, match="several storeys, expected one floor plan"):
        read_plan(written(tmp_path))
