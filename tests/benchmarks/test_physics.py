"""The physics benchmark runs, and its numbers show what it claims. No wall-clock bounds."""

import json

from robosim.building.building import make_building
from tests.benchmarks import physics
from tests.plans import room


def test_the_benchmark_compares_engines(tmp_path):
    """Every engine gets the same walks. The kinematic twin is exact; MuJoCo errs by at most 0.3 mm at 5 ms.

    Walls hold in all of them, judged by the outline, and finer steps cost more of them.
    """
    table = physics.run([make_building(room(2.5, 2.0))], out=tmp_path, legs=2)
    rows = {row["engine"]: row for row in json.loads((tmp_path / "physics.json").read_text())["rows"]}
    assert table.row_count == len(rows) == len(physics.TIMESTEPS_S) + 2
    assert (tmp_path / "physics.png").stat().st_size > 10_000
    assert rows["kinematic"]["error_m"] < 1e-12
    assert 0 < rows["MuJoCo 5 ms"]["error_m"] < 3e-4
    assert rows["MuJoCo 1 ms"]["steps_per_move"] > 3 * rows["MuJoCo 5 ms"]["steps_per_move"]
    for row in rows.values():
        assert row["moves_per_s"] > 0 and row["moves"] == 2 * physics.LEG
        assert row["moves_in_the_open"] > 5
        assert max(row["penetration_by_outline_m"], row["penetration_by_contacts_m"]) < 5e-3
