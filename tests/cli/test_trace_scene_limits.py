"""`robosim trace` over scenes in which nothing arrives, or that are too large: what it says."""

import numpy as np
import pytest

from robosim.cli import main
from robosim.support.tum import write_tum

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
