"""Normals of what a coarse laser sees far away, and searching where little is known, among walls in closed form."""

import math

import numpy as np
import pytest

from slam.graph.judging import Judge
from slam.graph.submaps import View
from slam.matching.levels import SurfaceLevels, matches, most_paired
from slam.matching.scan_matching import Match, MatchConfig, points_of_beams
from slam.poses import to_map, wrap
from tests.slam.beams import RANGE_M, ranges, rectangle, seen

BEARING = np.radians(np.arange(-90, 90.1, 1.0))
MATCHING = MatchConfig(max_range_m=12.0, sigma_m=0.02, outlier_m=0.06, iterations=12)
#: A room of 8 m x 5 m with a niche, so that it looks the same from one pose only.
ROOM = [*rectangle(-4, -2.5, 4, 2.5), *rectangle(1, 1.5, 2, 2.5)]


@pytest.mark.parametrize("far_m", [12.0, 20.0, 28.0])
def test_a_far_wall_has_normals(far_m: float) -> None:
    """Beams of 1 degree lie 0.5 m apart on it at 28 m, farther than the steps of a surface."""
    reach = far_m / np.cos(BEARING)
    reach[np.abs(BEARING) > math.radians(40)] = np.inf
    scan = points_of_beams(BEARING, reach, 40.0, 0.05, 0.02)
    assert len(scan.points) > 60
    np.testing.assert_allclose(scan.normals, np.tile([-1.0, 0.0], (len(scan.points), 1)), atol=1e-6)
    assert scan.sigma_m is not None
    slant = np.hypot(*scan.points.T)
    grazed = np.abs(scan.points[:, 1]) / slant * slant * 0.0017
    np.testing.assert_allclose(scan.sigma_m, np.hypot(0.02, grazed), rtol=1e-9)


def test_far_posts_have_none() -> None:
    """Ranges that jump from beam to beam are of many things: no normal, but points to search by."""
    rng = np.random.default_rng(0)
    reach = rng.uniform(18, 24, len(BEARING))
    scan = points_of_beams(BEARING, reach, 40.0, 0.05, 0.02)
    assert scan.loose is not None
    assert len(scan.points) < 0.15 * len(BEARING) < 0.8 * len(BEARING) < len(scan.loose)
    both = scan.with_more(scan).at(np.array([1.0, 2.0, 0.5]))
    assert len(both.every()) == 2 * len(BEARING)


def test_a_judge_prefers_where_nothing_is_contradicted() -> None:
    """Of the true pose and one shifted by 1 m through a wall's niche, both on surfaces, the true one."""
    true = np.array([0.3, -0.2, 0.1])
    views = [seen(ranges(ROOM, pose))[1] for pose in (np.zeros(3), true)]
    judge = Judge(
        view=views[1], recent=[(np.zeros(3), views[0])], predicted=true, covariance=np.diag([1.0, 1.0, 0.1])
    )

    def match(pose: np.ndarray) -> Match:
        return Match(pose=pose, information=np.eye(3), paired=np.ones(10, bool))

    assert judge(match(true)) > judge(match(true + np.array([1.0, 0.0, 0.0]))) + 0.3
    nothing = View(bearing_rad=BEARING, range_m=np.full(len(BEARING), -RANGE_M))
    blind = Judge(view=nothing, recent=judge.recent, predicted=true, covariance=judge.covariance)
    assert blind(match(true)) == 0


def test_a_pose_of_which_nothing_is_known_is_searched_in_bounded_memory() -> None:
    """With 100 m of uncertainty only the middle is searched: 1 m and 60 degrees off is found."""
    levels = SurfaceLevels(0.05)
    scan, _ = seen(ranges(ROOM, np.zeros(3)))
    levels.enter(np.zeros(3), scan)
    true = np.array([0.4, 0.3, 0.2])
    other, _ = seen(ranges(ROOM, true))
    predicted = true + np.array([1.0, -0.5, math.radians(60)])
    found = matches(levels, other, predicted, np.diag([100.0, 100.0, 3.0]) ** 2, MATCHING, most_paired)
    best = max(found, key=most_paired)
    assert np.hypot(*(best.pose - true)[:2]) < 0.03
    assert abs(wrap(float(best.pose[2] - true[2]))) < math.radians(0.5)
    assert len(to_map(best.pose, other.points)) == len(best.paired)
