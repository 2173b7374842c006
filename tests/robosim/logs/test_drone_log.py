"""Logs of a drone with four rangers: rows of made flights with known walls."""

import numpy as np

from robosim.logs.log_mapping import LogConfig, make_log_plan, map_log
from robosim.plans.floorplan import OCCUPIED
from slam.poses import between
from tests.benchmarks.drone_logs import drone_log
from tests.slam.beams import along, ranges, rectangle

ROOM = rectangle(-1, -1, 3, 2)


def made_flight():
    """Rows of a flight round a room of 4 x 3 m, at 10 Hz and 0.3 m/s."""
    route = np.array(along([(0, 0), (2, 0), (2, 1), (0, 1), (0, 0)], step_m=0.03))
    towards = np.radians([-90.0, 0.0, 90.0, 180.0])
    reach = np.array([ranges(ROOM, pose, bearing=towards) for pose in route])
    seconds, n = 0.1 * np.arange(len(route)), len(route)
    places = np.column_stack([seconds, route[:, :2], np.full(n, 0.5)])
    half = 0.5 * route[:, 2]
    turned = np.column_stack([np.zeros(n), np.zeros(n), np.sin(half), np.cos(half)])
    return route, places, np.column_stack([seconds, reach, np.full(n, 1.9), turned])


def test_rows_become_scans_of_four_beams():
    """Displacements and ranges are those of every fifth row: right, front, left and back."""
    route, places, measured = made_flight()
    log = drone_log("flight", places, measured)
    np.testing.assert_allclose(
        between(log.odometry()[0], log.odometry()[-1]),
        between(route[0], route[5 * (len(log.times) - 1)]),
        atol=1e-9,
    )
    np.testing.assert_allclose(log.range_m[0], [1.0, 3.0, 2.0, 1.0], atol=1e-6)


def test_the_map_of_four_beams_shows_the_room():
    """Occupied cells lie within a cell of the walls; the beam to the back is one like the others."""
    route, places, measured = made_flight()
    log = drone_log("flight", places, measured)
    found = map_log(log, LogConfig(range_m=3.5))
    plan = make_log_plan(log, found.poses, 0.05, 3.5)
    cells = np.argwhere(plan.occupancy == OCCUPIED)[:, ::-1] * 0.05 + np.array(plan.origin[:2]) + 0.025
    x, y = (cells + route[0, :2]).T
    off = np.minimum(np.minimum(np.abs(x + 1), np.abs(x - 3)), np.minimum(np.abs(y + 1), np.abs(y - 2)))
    assert len(cells) > 100
    assert np.percentile(off, 90) < 0.08
