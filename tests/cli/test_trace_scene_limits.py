"""`robosim trace` over scenes in which nothing arrives, or that are too large: what it says."""

import numpy as np
import pytest
import trimesh

from robosim.cli import main
from robosim.support.reading import FileError
from robosim.support.tum import write_tum
from wireless.tracing import mitsuba_scene, scene_size, scenes
from wireless.tracing.mitsuba_scene import read_mitsuba
from wireless.tracing.tracer import Tracer

HOUSE = """<scene version="2.1.0">
<bsdf type="itu-radio-material" id="m"><string name="type" value="metal"/></bsdf>
<shape type="rectangle" id="ground"><transform name="to_world"><scale value="5"/></transform><ref id="m"/></shape>
<shape type="cube" id="house"><transform name="to_world"><translate x="2" z="1"/></transform><ref id="m"/></shape>
</scene>"""


@pytest.fixture
def scene_file(tmp_path):
    """A closed house on level ground."""
    (tmp_path / "house.xml").write_text(HOUSE)
    return tmp_path / "house.xml"


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (
            "--tx 2,0,1 --rx -3,0,1 --rx -3,1,1",
            "house: the transmitter at (2, 0, 1) m lies inside shape house",
        ),
        ("--tx -3,0,1 --rx 2,0,1 --rx 2.5,0,1", "house: all 2 receivers lie inside shape house"),
        (
            "--tx -3,0,-1 --rx -3,1,1",
            "the transmitter at (-3, 0, -1) m lies below the ground: above it is shape ground",
        ),
        ("--tx -3,0,1 --rx -3,1,-1", "the receiver lies below the ground: above is shape ground"),
        ("--tx 2,0,1 --grid 1", "lies inside shape house: only receivers in it have paths"),
    ],
)
def test_trace_says_why_nothing_arrives(words, reason, scene_file, tmp_path, caplog):
    main(
        [
            "trace",
            str(scene_file),
            *words.split(),
            "--json",
            "--no-plots",
            "--workers",
            "1",
            "--out",
            f"{tmp_path}/o",
        ]
    )
    assert [
        reason in record.getMessage()
        for record in caplog.records
        if "lies" in record.getMessage() or "lie " in record.getMessage()
    ] == [True]


def test_trace_along_says_why_nothing_arrives(scene_file, tmp_path, caplog):
    poses = np.column_stack([np.linspace(1.5, 2.5, 3), np.zeros(3), np.zeros(3)])
    write_tum(tmp_path / "drive.tum", np.arange(3.0), poses)
    words = f"--tx -3,0,1 --along {tmp_path}/drive.tum --rate 1 --height 1 --out {tmp_path}/o"
    main(["trace", str(scene_file), *words.split()])
    assert "all 3 receivers lie inside shape house: no path can enter" in caplog.text


@pytest.mark.parametrize(
    "words", ["--tx -3,0,1 --rx 4,0,1", "--tx 2,0,1 --rx 2.5,0,1", "--tx -3,0,1 --grid 1"]
)
def test_trace_has_nothing_to_say_of_scenes_in_order(words, scene_file, tmp_path, caplog):
    """Around the house, within it as in a room, and on a grid of which some cells are in it."""
    main(["trace", str(scene_file), *words.split(), "--no-plots", "--workers", "1", "--out", f"{tmp_path}/o"])
    assert "shape house" not in caplog.text and "below the ground" not in caplog.text


LARGE = """<scene version="2.1.0"><bsdf type="itu-radio-material" id="m"><string name="type" value="metal"/></bsdf>
<shape type="cube" id="house"><ref id="m"/></shape>
<shape type="{kind}" id="terrain"><string name="filename" value="terrain.{kind}"/><ref id="m"/></shape></scene>"""


def terrain(folder, kind, n=20):
    """A scene with a cube and a level terrain of 2 n^2 triangles."""
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(n + 1.0), np.arange(n + 1.0)))
    corner = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = (
        part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1])
    )
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    trimesh.Trimesh(np.column_stack([x, y, 0 * x - 2]), faces, process=False).export(
        folder / f"terrain.{kind}"
    )
    (folder / "city.xml").write_text(LARGE.format(kind=kind))
    return folder / "city.xml"


@pytest.mark.parametrize("kind", ["ply", "obj"])
def test_trace_rejects_a_large_scene_before_it_is_prepared(kind, tmp_path, monkeypatch, fails):
    """812 triangles where 500 are too many, unless that is confirmed."""
    file = terrain(tmp_path, kind)
    monkeypatch.setattr(scene_size, "MOST_TRIANGLES", 500)
    with monkeypatch.context() as patch:
        patch.setattr(mitsuba_scene, "check_mesh", None)
        for words in (["--tx", "9,9,3", "--rx", "5,5,1"], ["--inspect"]):
            said = fails("trace", file, *words, "--out", tmp_path / "o")
            assert f"{file}: it has 812 triangles, whose preparation takes up to 0.0 GB and 0 s" in said
            assert "confirm it by --allow-large (allow_large=True)" in said
        with pytest.raises(FileError, match="it has 812 triangles"):
            Tracer.from_mitsuba(file)
    main(f"trace {file} --tx 9,9,3 --rx 5,5,1 --allow-large --max-reflections 1 --out {tmp_path}/o".split())
    assert len(Tracer.from_mitsuba(file, allow_large=True).mesh.faces) == 812


def test_read_mitsuba_counts_two_triangles_of_a_rectangle(tmp_path, monkeypatch):
    """14 triangles of a rectangle and a cube."""
    (tmp_path / "house.xml").write_text(HOUSE)
    monkeypatch.setattr(scene_size, "MOST_TRIANGLES", 14)
    assert len(read_mitsuba(tmp_path / "house.xml").mesh.faces) == 14


def test_read_mitsuba_counts_triangles_of_squares(tmp_path, monkeypatch):
    """400 squares of a file are 800 triangles."""
    file = terrain(tmp_path, "obj", n=1)
    squares = "".join(f"v {k} 0 0\nv {k + 1} 0 0\nv {k + 1} 1 0\nv {k} 1 0\n" for k in range(400))
    squares += "".join(f"f {k} {k + 1} {k + 2} {k + 3}\n" for k in range(1, 1600, 4))
    (tmp_path / "terrain.obj").write_text(squares)
    monkeypatch.setattr(scene_size, "MOST_TRIANGLES", 500)
    with pytest.raises(FileError, match="it has 812 triangles"):
        read_mitsuba(file)


def test_check_size_depends_on_the_memory_of_the_machine(monkeypatch):
    """Half of 4 GB are 476,000 triangles of 4,200 bytes; half of 64 GB are more than 2,000,000."""
    size = {"SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(scene_size.os, "sysconf", lambda name: size[name])
    for memory, most in ((4e9, 476_190), (64e9, 2_000_000)):
        size["SC_PHYS_PAGES"] = int(memory / 4096)
        scene_size.check_size(most - 10)
        with pytest.raises(FileError, match="expected at most 2000000 triangles and half of the memory"):
            scene_size.check_size(most + 10)


def test_tracer_reports_memory_and_time_before_it_prepares_many_triangles(tmp_path, monkeypatch, caplog):
    file = terrain(tmp_path, "ply")
    Tracer.from_mitsuba(file)
    assert "Preparing" not in caplog.text
    monkeypatch.setattr(scene_size, "_REPORTED", 500)
    monkeypatch.setattr(scenes, "prepare_surfaces", None)  # the preparation
    with pytest.raises(TypeError):
        Tracer.from_mitsuba(file)
    assert "Preparing 812 triangles for tracing takes up to 0.0 GB and 0 s per process." in caplog.text
