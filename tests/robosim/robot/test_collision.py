"""Walls as convex solids: they cover the solid side of every wall line, and no free space.

Judged by GEOS: the union of the pieces is compared with the free area they were made from.
"""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from robosim.building.extrusion import wall_segments
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.robot.collision import check_pose, free_quarters, wall_solids
from slam.hull import Hull
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
    """Ragged outlines on the lattice, turned and far away. Measured: 0 m2 and 0 m of flaws.

    Would catch a wall left open, a rectangle poking into a room, and a slope off its line.
    """
    overlap, bare, n = flaws(noisy_plan(seed, wall_line=wall_line, origin=origin))
    assert overlap == 0 and bare == 0
    assert n > 50


@pytest.mark.parametrize("wall_line", ["cell_edge", "cell_centre"])
@pytest.mark.parametrize("tolerance_m", [None, 0.03, 0.08, 0.2])
@pytest.mark.parametrize("seed", range(2))
def test_pieces_cover_slanted_walls_and_nothing_else(wall_line, tolerance_m, seed):
    """Simplified outlines have walls in any direction, thin spikes and corners of a few degrees."""
    overlap, bare, _ = flaws(noisy_plan(seed, wall_line=wall_line, origin=(1.0, 2.0, 0.7)), tolerance_m)
    assert overlap == 0 and bare == 0


def test_sharp_spikes_become_prisms():
    """A solid spike of 6 degrees has no room for a rectangle 1 cm thick over a whole side."""
    outer = [(0, 0), (4, 0), (4, 3), (0, 3)]
    spike = [(1, 1), (1, 1.1), (2, 1.05)]
    free = shapely.MultiPolygon([shapely.Polygon(outer, [spike])])
    solids = wall_solids(free, room())
    assert len(solids.prisms) >= 1
    assert all(shapely.Polygon(p).exterior.is_ccw and len(p) == 3 for p in solids.prisms)
    union = shapely.union_all(solids.polygons())
    assert union.intersection(free).area < 1e-9
    assert free.boundary.difference(union.buffer(EXACT_M)).length == 0


def test_a_room_is_four_boxes():
    """Greedy growth makes one piece of each straight wall, whatever the number of cells."""
    assert len(wall_solids(free_polygons(room()), room())) == 4


def test_a_slope_is_one_box():
    """A wall at 45 degrees through 40 cell centres is one turned rectangle on exactly that line.

    Five straight walls (the slope cuts one corner off) and one slope are 4 + 1 + 1 pieces at most.
    """
    occupancy = np.full((60, 60), FREE, np.uint8)
    iy, ix = np.indices(occupancy.shape)
    occupancy[ix + iy > 80] = OCCUPIED
    plan = FloorPlan(occupancy=occupancy, resolution_m=0.05, wall_line="cell_centre")
    solids = wall_solids(free_polygons(plan), plan)
    turned = solids.boxes[~np.isclose(np.sin(2 * solids.boxes[:, 4]), 0)]
    assert len(turned) == 1 and len(solids) <= 6
    x, y, half_length, half_width, yaw = turned[0]
    assert half_length == pytest.approx(38 / 2 * 0.05 * np.sqrt(2))  # from cell (59, 21) to cell (21, 59)
    # Its near face lies on x + y = 80 cells + 2 half cells.
    assert (x + y) / np.sqrt(2) - half_width == pytest.approx(81 * 0.05 / np.sqrt(2), abs=1e-12)
    assert yaw == pytest.approx(-np.pi / 4)


def test_quarters_agree_with_shapely():
    """Crossing parity against GEOS' point in polygon, at the centroid of each quarter square."""
    plan = noisy_plan(5, wall_line="cell_centre")
    free = free_polygons(plan)
    walls = np.round(plan.to_cells(wall_segments(free)) - 0.5).astype(int)
    quarters = free_quarters(walls, plan.shape)
    offsets = np.array([[0.75, 0.5], [0.5, 0.75], [0.25, 0.5], [0.5, 0.25]])
    iy, ix = np.indices(plan.shape)
    for quarter, offset in enumerate(offsets):
        points = plan.to_map(np.stack([ix, iy], axis=-1) + offset + 0.5)
        assert (
            (quarters >> quarter & 1 == 1) == shapely.contains_xy(free, points[..., 0], points[..., 1])
        ).all()


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
    """Walls through cell centres: 646 and 1394 boxes at tolerance 0, all on the lattice, no prism."""
    (path,) = shared.glob(f"maps/gibson/*/{building}.glb_topdownmap.out")
    overlap, bare, _ = flaws(read_plan(path), tolerance_m)
    assert overlap == 0 and bare == 0


def test_fewer_pieces_than_walls_on_cell_edges(shared):
    """Each step of a staircase is two walls but one rectangle: measured 1239 boxes for 4084 walls."""
    (path,) = shared.glob("maps/gibson/*/Nemacolin.glb_topdownmap.out")
    plan = replace(read_plan(path), wall_line="cell_edge")
    free = free_polygons(plan, 0)
    assert len(wall_solids(free, plan)) < 0.4 * len(wall_segments(free))


def test_a_pose_in_a_wall_is_an_error():
    free = free_polygons(room())
    check_pose(free, np.array([0.1, 1.0, 0.0]), Hull(0.1))
    check_pose(free, np.array([0.0992, 1.0, 0.0]), Hull(0.1))  # within the tolerance of offset polygons
    with pytest.raises(ValueError, match=r"0\.097 m from the nearest wall"):
        check_pose(free, np.array([0.097, 1.0, 0.0]), Hull(0.1))
    with pytest.raises(ValueError, match="not in free space"):
        check_pose(free, np.array([-1.0, 1.0, 0.0]), Hull(0.1))
    with pytest.raises(ValueError, match="finite"):
        check_pose(free, np.array([1.0, np.nan, 0.0]), Hull(0.1))
