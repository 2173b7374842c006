"""Driving on and on: all numbers stay finite, and what is held stops growing when there is nothing new to see."""

import json

import numpy as np
from rich.console import Console

from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from tests.benchmarks.endurance import PARTS, run
from tests.benchmarks.slam_plan import SlamSettings


def _room() -> FloorPlan:
    occupancy = np.full((70, 90), OCCUPIED, np.uint8)
    occupancy[5:-5, 5:-5] = FREE
    occupancy[30:36, 40:44] = OCCUPIED
    return FloorPlan(occupancy=occupancy, resolution_m=0.05, origin=(0.0, 0.0, 0.0), name="room")


def test_nothing_runs_away(tmp_path):
    """400 decisions in a room of 4 m x 3 m with noise: every number finite, the pose never off by 0.2 m.

    The map has its size after the first tenth. What the navigator holds grows by what each scan needs to be entered
    again when a loop closes: at most 40 kB a decision.
    """
    run(_room(), SlamSettings(steps=400), out=tmp_path, console=Console(quiet=True))
    parts = json.loads((tmp_path / "endurance.json").read_text())["parts"]
    assert [part["decisions"] for part in parts] == [40 * (k + 1) for k in range(PARTS)]
    assert sum(part["not_finite"] for part in parts) == 0
    assert max(part["pose_error_most_m"] for part in parts) < 0.2
    assert len({part["cells"] for part in parts}) == 1
    held = [part["held_bytes"] for part in parts]
    assert max(np.diff(held)) < 40 * 40_000
