"""True patches: what stands ahead and what can be seen of it, in a room whose answers can be counted."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.datasets.true_patch import MATTERS, OBSTACLE, SEEN, TruePatches
from slam.sensing.egocentric import AHEAD
from tests.plans import two_rooms

CENTRES = AHEAD.centres(np.ones(AHEAD.shape, bool)).reshape(64, 64, 2)


@pytest.fixture(scope="module")
def rooms() -> tuple[TruePatches, object]:
    building = make_building(two_rooms(0.8))
    return TruePatches(building), building.free


def test_obstacles_are_the_cells_that_walls_touch(rooms):
    """Against shapely: a cell is an obstacle if its square is not all within the free polygon."""
    import shapely

    patches, free = rooms
    pose = np.array([1.3, 1.1, 0.4])
    got = patches.at(pose)[OBSTACLE]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    corners = CENTRES[..., None, :] + 0.025 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    squares = shapely.polygons(corners.reshape(-1, 4, 2) @ turn + pose[:2])
    expected = ~shapely.contains(free, squares).reshape(64, 64)
    assert (got != expected).mean() < 0.02
    assert 0.1 < got.mean() < 0.9


def test_seen_is_the_field_of_view_up_to_the_walls(rooms):
    """Free cells are seen if the straight line from the camera to them is free, they are within 3.2 m and 45 degrees.

    Judged by shapely's `covers` on the lines to the centres; cells on the border of the view, whose squares are seen
    in part only, are left out: those within one cell of a cell that differs.
    """
    import cv2
    import shapely

    patches, free = rooms
    pose = np.array([1.3, 1.1, 0.4])
    truth = patches.at(pose)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    ends = CENTRES.reshape(-1, 2) @ np.array([[c, s], [-s, c]]) + pose[:2]
    lines = shapely.linestrings(np.stack([np.broadcast_to(pose[:2], ends.shape), ends], axis=1))
    clear = shapely.covers(free, lines).reshape(64, 64)
    ahead, left = np.moveaxis(CENTRES, -1, 0)
    expected = clear & (np.abs(left) < ahead) & (np.hypot(ahead, left) < 3.2)
    kernel = np.ones((3, 3), np.uint8)
    sure_in = cv2.erode(expected.astype(np.uint8), kernel) > 0
    sure_out = cv2.dilate(expected.astype(np.uint8), kernel) == 0
    assert sure_in.sum() > 500 and sure_out.sum() > 500
    assert truth[SEEN][sure_in].all()
    assert not truth[SEEN][sure_out].any()


def test_walls_seen_are_obstacles_and_matter(rooms):
    """Where rays end there is an obstacle: seen cells have both kinds, and all that is seen matters."""
    truth = rooms[0].at(np.array([1.3, 1.1, 0.4]))
    assert truth[MATTERS][truth[SEEN]].all()
    assert (truth[SEEN] & truth[OBSTACLE]).sum() > 20
    assert (truth[SEEN] & ~truth[OBSTACLE]).sum() > 200


def test_the_patch_turns_with_the_robot(rooms):
    """In a plan that is turned with the robot nothing changes: same patch but for the raster, below 3 % of cells."""
    from dataclasses import replace

    plan = two_rooms(0.8)
    turned = TruePatches(make_building(replace(plan, origin=(2.0, -1.0, 0.7))))
    c, s = np.cos(0.7), np.sin(0.7)
    pose = np.array([1.3, 1.1, 0.4])
    local = pose[:2] - np.array(plan.origin[:2])
    place = np.array([2.0 + c * local[0] - s * local[1], -1.0 + s * local[0] + c * local[1], 1.1])
    assert (turned.at(place) != rooms[0].at(pose)).mean() < 0.03


def test_far_from_the_building_all_is_solid(rooms):
    """Beyond the raster nothing is floor, and nothing matters but the cell the rays end in."""
    truth = rooms[0].at(np.array([500.0, 500.0, 0.0]))
    assert truth[OBSTACLE].all() and truth[MATTERS].sum() <= 2
