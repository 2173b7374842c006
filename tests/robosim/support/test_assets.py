"""Shipped plans: found in a source tree and in an installed package."""

import numpy as np
import pytest

from robosim.plans import files as planfiles
from robosim.plans.files import read_plan, write_ros
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.support import assets


@pytest.fixture
def shipped(tmp_path, monkeypatch):
    """A package folder with two shipped plans and nothing else."""
    monkeypatch.setattr(assets, "__file__", str(tmp_path / "robosim" / "support" / "assets.py"))
    for name in ("flat", "office"):
        plan = FloorPlan(occupancy=np.zeros((2, 3), np.uint8), resolution_m=0.05, name=name)
        write_ros(plan, tmp_path / "assets" / "plans" / f"{name}.yaml")
    return tmp_path


def test_plans_lie_next_to_the_package_in_a_source_tree(shipped):
    assert assets.assets_dir() == shipped / "assets"
    assert list(assets.shipped_plans()) == ["flat", "office"]


def test_plans_lie_inside_an_installed_package(shipped):
    inside = shipped / "robosim" / "assets"
    inside.parent.mkdir()
    (shipped / "assets").rename(inside)
    assert assets.assets_dir() == inside
    assert list(assets.shipped_plans()) == ["flat", "office"]


def test_a_bare_name_reads_a_shipped_plan(shipped, monkeypatch):
    monkeypatch.chdir(shipped)
    assert read_plan("office").name == "office"
    with pytest.raises(MapError, match=r"ofice: no such file.*'office'"):
        read_plan("ofice")
    with pytest.raises(MapError, match="Shipped plans: flat, office"):
        read_plan("castle")


def test_a_file_goes_before_a_shipped_plan(shipped, monkeypatch):
    """A folder of that name in the working folder is said, not passed over."""
    monkeypatch.chdir(shipped)
    (shipped / "office").mkdir()
    with pytest.raises(MapError, match="office: is a folder"):
        read_plan("office")


def test_shipped_plans_can_be_read():
    """Those of this very tree."""
    for name, path in assets.shipped_plans().items():
        assert read_plan(name).name == name
        assert planfiles.find_plans([name]) == [path]
