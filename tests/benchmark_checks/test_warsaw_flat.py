"""The benchmark in a real flat: its measure of walls, and that the correction of scans makes the map."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from robosim.logs.log_mapping import map_log
from robosim.logs.trajectory_scores import ends_of_beams
from slam.poses import compose, to_map
from tests.benchmarks.warsaw_flat import CONFIG, _place, read_reference, read_run, wall_errors


def test_walls_that_are_off_by_a_known_distance():
    """One wall 4 cm inside, furniture 0.5 m inside and 1 cm of noise: 4 cm and 0, to 3 mm."""
    rng = np.random.default_rng(0)
    along = rng.uniform(0, 6, 40_000)
    lines = [np.column_stack([along, np.full(40_000, y)]) for y in (0.04, 0.5, 4.0)]
    points = np.concatenate(lines) + rng.normal(0, 0.01, (120_000, 2))
    near = wall_errors(points, np.array([[0.0, 0.0], [6.0, 0.0]]))
    np.testing.assert_allclose(near, np.full(12, 0.04), atol=0.003)
    far = wall_errors(points, np.array([[6.0, 4.0], [0.0, 4.0]]))
    np.testing.assert_allclose(far, np.zeros(12), atol=0.003)


@pytest.mark.parametrize(("run", "median_cm"), [("calib3", 8.0), ("calib4", 8.0)])
def test_a_real_flat_comes_out_only_with_corrected_scans(shared, run, median_cm):
    """Half of the walls to 8 cm, and all published poses to 0.5 m; as measured, the map comes apart by metres."""
    folder = shared / "data" / "warsaw-flat-ble"
    floor = shapely.Polygon(np.loadtxt(folder / "layout.csv", delimiter=",", skiprows=1))
    log = read_run(folder, run)
    reference = read_reference(folder / "calibration_df.csv", log.times)
    worst = []
    for each in (log, replace(log, beam_s=None)):
        mapped = map_log(each, CONFIG)
        place = _place(mapped, reference, floor)
        poses = np.array([compose(place, pose) for pose in mapped.poses])
        worst.append(np.nanpercentile(np.hypot(*(poses - reference)[:, :2].T), 95))
        if each is log:
            ends = to_map(place, ends_of_beams(mapped.log, mapped.poses))
            walls = wall_errors(ends, np.array(floor.exterior.coords))
            assert 100 * np.median(np.abs(walls)) < median_cm
    assert worst[0] < 0.5 < 1.0 < worst[1]
