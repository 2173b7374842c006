"""Walls as convex solids: they cover the solid side of every wall line, and no free space.

Judged by GEOS: the union of the pieces is compared with the free area they were made from.
"""

import numpy as np
import pytest
import shapely

from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.collision import check_pose, wall_segments, wall_solids
from tests.outlines import free_polygons
from tests.plans import room

# Far less than physics can feel; GEOS' buffers are off by more than 1e-9 at 10 km from the origin.
EXACT_M = 1e-7


def noisy_plan(seed: int, **kwargs) -> FloorPlan:
    """Free space with ragged walls, islands, passages one cell wide and cells that touch by a corner."""
    rng = np.random.default_rng(seed)
    coarse = rng.random((9, 11)) < 0.3
    occupied = np.kron(coarse, np.ones((5, 5), bool)) ^ (rng.random((45, 55)) < 0.04)
    occupancy = np.where(occupied, OCCUPIED, FREE).astype(np.uint8)
    return FloorPlan(occupancy=occupancy, **{"resolution_m": 0.05, "name": "noisy", **kwargs})


def flaws(plan: FloorPlan, tolerance_m: float | None = 0.0) -> tuple[float, float, int]:
    """Free area inside of the pieces [m2], length of wall that no piece is on [m], number of pieces."""
    free = free_polygons(plan, tolerance_m)
    solids = wall_solids(free, plan)
    union = shapely.union_all(solids.polygons())
    bare = free.boundary.difference(union.buffer(EXACT_M))
    return union.buffer(-EXACT_M).intersection(free).area, bare.length, len(solids)


@pytest.mark.parametrize("wall_line", ["cell_edge", "cell_centre"])
@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (3.0, -7.0, 0.3), (1e4, -1e4, 2.0)])
@pytest.mark.parametrize("seed", range(2))
def test_pieces_cover_all_walls_and_nothing_else(wall_line, origin, seed):
    """Ragged outlines, turned and far away. Measured: 1e-10 m2 and 0 m of flaws.

    Would catch a wall left open, a rectangle poking into a room, and a slope off its line.
    """
    overlap, bare, n = flaws(noisy_plan(seed, wall_line=wall_line, origin=origin))
    assert overlap < 1e-9 and bare == 0
    assert n > 50


@pytest.mark.parametrize("wall_line", ["cell_edge", "cell_centre"])
@pytest.mark.parametrize("tolerance_m", [None, 0.03, 0.08, 0.2])
@pytest.mark.parametrize("seed", range(2))
def test_pieces_cover_slanted_walls_and_nothing_else(wall_line, tolerance_m, seed):
    """Simplified outlines have walls in any direction, thin spikes and corners of a few degrees."""
    overlap, bare, _ = flaws(noisy_plan(seed, wall_line=wall_line, origin=(1.0, 2.0, 0.7)), tolerance_m)
    assert overlap == 0 and bare == 0


def test_a_room_is_four_boxes():
    """One piece for each straight wall, whatever the number of cells."""
    assert len(wall_solids(free_polygons(room()), room())) == 4


def test_segments_have_free_space_on_their_left():
    free = free_polygons(noisy_plan(1))
    segments = wall_segments(free)
    assert np.hypot(*(segments[:, 1] - segments[:, 0]).T).sum() == pytest.approx(free.length)
    along = segments[:, 1] - segments[:, 0]
    left = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    inside = segments.mean(axis=1) + 1e-3 * left
    assert shapely.contains_xy(free, inside).all()


@pytest.mark.parametrize("building", ["Hominy", "Nemacolin"])
@pytest.mark.parametrize("tolerance_m", [0.0, 0.05])
def test_pieces_of_real_buildings_are_exact(shared, building, tolerance_m):
    """Walls through cell centres."""
    (path,) = shared.glob(f"maps/gibson/*/{building}.glb_topdownmap.out")
    overlap, bare, _ = flaws(read_plan(path), tolerance_m)
    assert overlap == 0 and bare == 0


def test_a_pose_in_a_wall_is_an_error():
    free = free_polygons(room())
    check_pose(free, np.array([0.1, 1.0, 0.0]), 0.1)
    check_pose(free, np.array([0.0992, 1.0, 0.0]), 0.1)  # within the tolerance of offset polygons
    with pytest.raises(ValueError, match=r"0\.097 m from the nearest wall"):
        check_pose(free, np.array([0.097, 1.0, 0.0]), 0.1)
    with pytest.raises(ValueError, match="not in free space"):
        check_pose(free, np.array([-1.0, 1.0, 0.0]), 0.1)
    with pytest.raises(ValueError, match="finite"):
        check_pose(free, np.array([1.0, np.nan, 0.0]), 0.1)
