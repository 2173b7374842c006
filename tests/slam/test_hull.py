"""Hulls with an outline, against exact intersections of polygons."""

import numpy as np
import pytest
import shapely
from jaxtyping import Bool, Float

from slam.grid import GridFrame
from slam.hull import Hull
from slam.planning.clearance import LIMIT_M, Clearance

RECTANGLE = Hull(0.2, ((-0.35, -0.2), (0.15, -0.2), (0.15, 0.2), (-0.35, 0.2)))
KITE = Hull(0.25, ((-0.4, 0.0), (0.0, -0.25), (0.2, 0.0), (0.0, 0.25)))


def _obstacles(seed: int) -> tuple[Clearance, Float[np.ndarray, "n 2"]]:
    """Random obstacle cells with surfaces somewhere inside, and the surfaces."""
    rng = np.random.default_rng(seed)
    frame = GridFrame(origin_xy=(-2.0, -1.5), resolution_m=0.05, shape=(60, 80))
    obstacle: Bool[np.ndarray, "ny nx"] = rng.random(frame.shape) < 0.01
    offset = rng.uniform(-0.02, 0.02, (*frame.shape, 2)).astype(np.float32)
    return Clearance(frame, obstacle, offset), frame.centres(obstacle) + offset[obstacle]


@pytest.mark.parametrize("hull", [RECTANGLE, KITE])
def test_space_is_the_distance_of_the_polygon(hull: Hull) -> None:
    clearance, surfaces = _obstacles(1)
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.uniform(-2.5, 2.5, 400), rng.uniform(-2, 2, 400), rng.uniform(-4, 4, 400)])
    space = clearance.space(hull, poses[:, :2], poses[:, 2])
    points = shapely.points(surfaces)
    for pose, found in zip(poses, space, strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        polygon = shapely.Polygon(hull.corners @ [[c, s], [-s, c]] + pose[:2])
        inside = shapely.contains_properly(polygon, points)
        if inside.any():
            assert found == pytest.approx(-shapely.distance(points[inside], polygon.exterior).max(), abs=1e-6)
        else:
            assert found == pytest.approx(min(shapely.distance(points, polygon).min(), LIMIT_M), abs=1e-6)


def test_a_disk_needs_no_heading() -> None:
    clearance, _ = _obstacles(3)
    points = np.random.default_rng(4).uniform(-1, 1, (20, 2))
    assert (clearance.space(Hull(0.1), points, 1.0) == clearance.at(points) - 0.1).all()


def test_circles_of_a_hull() -> None:
    assert RECTANGLE.turning_m == pytest.approx(np.hypot(0.35, 0.2)) and RECTANGLE.inner_m == pytest.approx(
        0.15
    )
    assert (RECTANGLE.ahead_m, RECTANGLE.behind_m) == (0.15, 0.35)
    assert Hull(0.1).turning_m == Hull(0.1).inner_m == Hull(0.1).ahead_m == Hull(0.1).behind_m == 0.1


@pytest.mark.parametrize("hull", [RECTANGLE, KITE])
def test_a_run_ends_where_the_polygon_meets_something(hull: Hull) -> None:
    clearance, surfaces = _obstacles(5)
    points = shapely.points(surfaces)
    rng = np.random.default_rng(6)
    for _ in range(50):
        x, y, yaw = rng.uniform(-1.5, 1.5), rng.uniform(-1, 1), rng.uniform(-3, 3)
        (run_m,) = clearance.free_run_m(np.array([x, y]), np.array([yaw]), hull)
        c, s = np.cos(yaw), np.sin(yaw)

        def swept(length_m: float) -> shapely.Geometry:
            ends = [hull.corners, hull.corners + np.array([length_m, 0.0])]
            turned = np.vstack(ends) @ [[c, s], [-s, c]] + [x, y]  # noqa: B023
            return shapely.MultiPoint(turned).convex_hull

        if not shapely.intersects(swept(0.0), points).any():
            assert not shapely.intersects(swept(run_m).buffer(-0.01), points).any()
            # The next step of 5 cm meets something.
            assert run_m > 1.49 or shapely.intersects(swept(run_m + 0.05).buffer(0.01), points).any()
