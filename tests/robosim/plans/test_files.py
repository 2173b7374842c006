"""The one door to all formats: which reader, which options, which words where something is wrong."""

import json
import os

import numpy as np
import pytest
import trimesh

from robosim.plans.files import find_plans, read_plan, write_png, write_ros
from robosim.plans.floorplan import FloorPlan, MapError

FREE_EDGE = np.array([[0, 0, 1], [2, 0, 1]], np.uint8)


@pytest.fixture
def folder(tmp_path):
    """One small plan in every format, and files that are none."""
    plan = FloorPlan(occupancy=FREE_EDGE, resolution_m=0.05, name="map")
    write_ros(plan, tmp_path / "map.yaml")
    write_ros(plan, tmp_path / "sub" / "other.yml", image="png")
    write_png(plan, tmp_path / "picture.PNG")
    np.save(tmp_path / "array.npy", FREE_EDGE)
    (tmp_path / "Grid.glb_topdownmap.out").write_text("0,1,1\n0,2,0\n")
    (tmp_path / "house.json").write_text(json.dumps({"verts": [[0, 0], [1, 0], [1, 1], [0, 1]]}))
    box = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 2.5]])
    box.faces = box.faces[:, ::-1]
    box.export(tmp_path / "room.PLY", file_type="ply")
    (tmp_path / "result.json").write_text('{"arrived": true}')
    (tmp_path / "settings.yaml").write_text("speed: 1")
    (tmp_path / "notes.txt").write_text("nothing")
    return tmp_path


@pytest.mark.parametrize(
    ("name", "shape", "options"),
    [
        ("map.yaml", (2, 3), {}),
        ("sub/other.yml", (2, 3), {}),
        ("map.pgm", (2, 3), {"resolution_m": 0.05}),
        ("picture.PNG", (2, 3), {"resolution_m": 0.05}),
        ("array.npy", (2, 3), {"resolution_m": 0.05}),
        ("Grid.glb_topdownmap.out", (2, 3), {}),
        ("house.json", (22, 22), {}),
        ("room.PLY", (62, 82), {"floor_height_m": 0.0, "slice_m": (0.3, 1.0), "up": "z"}),
    ],
)
def test_the_ending_chooses_the_reader(folder, name, shape, options):
    """Capitals do not matter; all give cells of 0.05 m."""
    for path in (folder / name, str(folder / name)):
        plan = read_plan(path, **options)
        assert plan.shape == shape
        assert plan.resolution_m == 0.05


@pytest.mark.parametrize(
    "name", ["Grid.glb_topdownmap.out", "house.json", "room.PLY", "picture.PNG", "array.npy"]
)
def test_the_resolution_can_be_given(folder, name):
    assert read_plan(folder / name, resolution_m=0.1).resolution_m == 0.1


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("map.yaml", {"resolution_m": 0.1}, ["itself"]),
        ("map.pgm", {"resolution_m": 0.0}, ["0 m", "positive"]),
        ("map.pgm", {"resolution_m": float("nan")}, ["nan m", "positive"]),
        ("map.yaml", {"floor_height_m": 0.0}, ["floor height is 0.0", "no mesh"]),
        ("map.yaml", {"slice_m": (0.1, 1.0)}, ["slice is (0.1, 1.0)", "no mesh"]),
        ("map.yaml", {"up": "z"}, ["up axis is z", "no mesh"]),
        ("sub", {}, ["is a folder", "other.yml"]),
        ("notes.txt", {}, [".txt", "unknown", ".yaml", ".glb"]),
        ("missing.yaml", {}, ["no such file"]),
        ("mapp.yaml", {}, ["no such file", "map.yaml"]),
        ("hosue.json", {}, ["no such file", "house.json"]),
        ("settings.yaml", {}, ["'image' is missing", "image: settings.pgm"]),
        ("result.json", {}, ["verts"]),
        ("a\0b", {}, ["cannot be opened"]),
        ("x" * 5000, {}, ["cannot be opened"]),
    ],
)
def test_what_cannot_be_read_is_said(folder, name, options, words):
    """One line that names the file, the value and the fix."""
    with pytest.raises(MapError) as error:
        read_plan(folder / name, **options)
    for word in words:
        assert word in str(error.value)
    assert "\n" not in str(error.value)
    if len(name) < 100 and name.isprintable():
        assert str(folder / name) in str(error.value)


def test_unreadable_files_and_devices_are_said(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    for name in ("pipe.yaml", "loop.yaml"):
        with pytest.raises(MapError, match=name):
            read_plan(tmp_path / name)


def test_files_of_absurd_size_are_not_read(tmp_path):
    """Three gigabytes of nothing (a sparse file) must not be loaded to find out."""
    with open(tmp_path / "huge.out", "wb") as file:
        file.truncate(3_000_000_000)
    with pytest.raises(MapError, match=r"huge\.out: 3000000000 bytes"):
        read_plan(tmp_path / "huge.out")


def test_plans_are_found_in_folders(folder):
    """Maps, grids and houses, below too; images, arrays, meshes and other YAML or JSON are passed over."""
    found = find_plans([folder])
    names = ["Grid.glb_topdownmap.out", "house.json", "map.yaml", "sub/other.yml"]
    assert [str(path.relative_to(folder)) for path in found] == names
    assert find_plans([folder / "room.PLY", str(folder / "sub")]) == [folder / "room.PLY", found[-1]]
    for path in found:
        read_plan(path)


def test_folders_without_plans_and_missing_files_are_said(folder):
    (folder / "empty").mkdir()
    with pytest.raises(MapError, match=r"empty: no floor plan"):
        find_plans([folder / "empty"])
    with pytest.raises(MapError, match=r"mop\.yaml: no such file.*map\.yaml"):
        find_plans([folder / "mop.yaml"])


def test_reading_does_not_change_the_files(folder):
    """Arrays are mapped into memory to be checked; the plan must have a copy of its own."""
    plan = read_plan(folder / "array.npy", resolution_m=1.0)
    plan.occupancy[:] = 0
    np.testing.assert_array_equal(np.load(folder / "array.npy"), FREE_EDGE)
