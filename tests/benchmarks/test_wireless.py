"""The radio benchmark runs on a tiny plan, and its numbers show what it claims. No wall-clock bounds."""

import io
import json

import numpy as np
import pytest
import shapely
from rich.console import Console

from robosim.building.building import make_building
from robosim.plans.floorplan import FloorPlan
from tests.benchmarks import sight, space, wireless


@pytest.fixture(scope="module")
def plan() -> FloorPlan:
    """Two rooms with a passage, and a column."""
    occupancy = np.zeros((30, 44), np.uint8)
    occupancy[:22, 20:22] = 1
    occupancy[12:15, 8:12] = 1
    return FloorPlan(occupancy=occupancy, resolution_m=0.1, name="rooms")


def test_settings_are_compared_with_the_fullest(plan, tmp_path):
    """The fullest setting agrees with itself entirely, and paths that are left out cost agreement.

    Without edges or reflections only line of sight is left; each reflection more adds links, edges add more. An
    outline on the 0.1 m grid is the same at 0.02 m and with straight walls, where all errors are those at 0. Rates
    are positive, and views answer as many pairs as there are.
    """
    rooms = [space.Room(1, 0, 0), space.Room(1, 1, 1)]
    tables = wireless.run([plan], out=tmp_path, receivers=60, segments=400, workers=2, rooms=rooms)
    report = json.loads((tmp_path / "wireless.json").read_text())
    of = {(row["tolerance_m"], row["order"], row["edges"]): row for row in report["pooled"]}
    assert len(of) == 75
    full = of[0, 4, 1]
    assert (full["same_state"], full["same_aoa"], full["power_db"]) == (1, 1, 0)
    agreement = [of[0, order, -1]["same_state"] for order in wireless.ORDERS]
    assert agreement == sorted(agreement) and agreement[0] < agreement[-1] < 1
    assert of[0, 0, -1]["same_aoa"] < of[0, 0, 0]["same_aoa"] <= of[0, 0, 1]["same_aoa"]
    for order, edges in ((0, -1), (2, 0), (4, 1)):
        for key in ("same_state", "same_aoa", "power_db"):
            assert of[0.02, order, edges][key] == of[None, order, edges][key] == of[0, order, edges][key]
    for row in report["speed"]:
        assert min(row["links_per_s"], row["links_per_s_1"], row["live_s"], row["prepare_s"]) > 0
        assert row["live_s"] <= row["live_95_s"] and row["receivers"] > 500
    assert 0.1 < report["peak_memory_gb"] < 4
    assert [row["facets"] for row in report["space"]["speed"]] == [12, 92]
    assert min(row[key] for row in report["space"]["speed"] for key in row if key != "false") > 0
    assert [(row["recall"], row["false"]) for row in report["space"]["speed"]] == [(1, 0), (1, 0)]
    for name in ("wireless", "space"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    console = Console(record=True, width=150, file=io.StringIO())
    console.print(tables)
    assert "Who sees whom" in console.export_text()


def test_more_rays_find_more_of_all_paths_and_no_false_one():
    """Recall rises with the number of rays, to all paths where all patches are tried; few rays miss some."""
    report = space.compare([], space.Room(3, 1, 1), receivers=1, links=6)
    recall = [row["recall"] for row in report["recall"]]
    assert recall == sorted(recall) and recall[0] < 0.99 and recall[-1] == 1
    assert not any(row["false"] for row in report["recall"])


def test_double_precision_is_never_wrong_about_sight(plan):
    """Of 2000 segments the box tree gets none wrong, here and 10 km away; Embree, as it is, hides wall from wall.

    Embree is not named wrong for nothing: it is given the very same segments, and moving their ends by 0.1 mm
    mends nearly all of them here, but not far away, where single precision resolves 1 mm.
    """
    building = make_building(plan)
    ours, plain, moved = sight.compare(building, count=2000, seed=3)
    assert ours["wrong_here"] == ours["wrong_far"] == 0
    assert plain["wrong_here"] > 20 > moved["wrong_here"]
    assert moved["wrong_far"] > 20
    assert sight.rate_of_views(building, receivers=5, seed=0) > 0


def test_the_judge_of_sight_knows_hidden_seen_and_too_close(plan):
    """A sheet from (1, 0) to (1, 1): past its end by 1 mm is seen, short of it hidden, 0.1 um away unsure.

    The start lies on a wall of its own, which does not hide. GEOS agrees on the sure ones.
    """
    walls = np.array([[(1, 0), (1, 1)], [(0, -1), (0, 3)]], float)
    height = np.array([1.001, 0.999, 1 + 1e-7, 1 - 1e-7, 2.0])
    start = np.column_stack([np.zeros(5), height, np.ones(5)])
    stop = np.column_stack([np.full(5, 2.0), height, np.ones(5)])
    assert sight.judge(walls, sight.Segments(start, stop)).tolist() == [0, 1, -1, -1, 0]
    lines = shapely.linestrings(np.stack([start[:, :2], stop[:, :2]], axis=1))
    assert shapely.crosses(lines, shapely.linestrings(walls[0])).tolist() == [False, True, False, True, False]
