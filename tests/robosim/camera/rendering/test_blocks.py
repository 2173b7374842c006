"""Blocks of large scenes: pictures as without them, of fewer parts."""

import numpy as np
import pytest
import trimesh

from robosim.building.building import make_building
from robosim.camera.cameras import make_camera
from robosim.camera.model import RGBD, CameraConfig, camera_pose
from robosim.camera.rendering import visibility
from robosim.camera.rendering.blocks import BLOCK_M, Blocks
from robosim.camera.rendering.shading import shaded_mesh
from robosim.plans.floorplan import FloorPlan

VIEWS = ((5.0, 5.0, 0.7), (20.0, 25.0, 0.3), (92.0, 30.0, 3.0), (70.0, 10.0, 1.8))


def tiles(n: int) -> np.ndarray:
    """Triangles of n x n square metres of floor at z = 0, from the origin."""
    y, x = np.divmod(np.arange(n * n), n)
    corner = np.stack([x, y, np.zeros_like(x)], axis=1)[:, None].astype(np.float32)
    square = corner + np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    return square[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def hall() -> trimesh.Trimesh:
    """A lit hall of 100 m x 60 m with a post in its middle."""
    occupancy = np.zeros((302, 502), np.uint8)
    occupancy[[0, -1]] = occupancy[:, [0, -1]] = occupancy[148:152, 248:252] = 1
    return shaded_mesh(make_building(FloorPlan(occupancy=occupancy, resolution_m=0.2, name="hall")))


def pictures(mesh: trimesh.Trimesh, config: CameraConfig, views: list[np.ndarray]) -> tuple[list[RGBD], int]:
    """Pictures of a mesh, and the count of triangles drawn for them."""
    with make_camera([mesh], config) as camera:
        parts = [camera._visibility.parts(*camera._scenery.to_local(view)) for view in views]
        n_triangles = sum(int(camera._pass._counts[numbers].sum()) // 3 for numbers in parts)
        return [camera.render(view) for view in views], n_triangles


def test_blocks_cover_their_tiles_exactly():
    """A block of 8 x 8 tiles of a metre is 32 triangles of its area, between its edges and its middle."""
    triangles = tiles(16)
    blocks = Blocks.of(triangles, np.full(triangles.shape, 100, np.uint8), 12.0)
    assert blocks.counts.tolist() == [32] * 4
    assert (blocks.far_m == -np.inf).all()  # of one colour
    sizes = trimesh.triangles.area(blocks.fans).reshape(4, 32)
    assert sizes.sum(axis=1) == pytest.approx(BLOCK_M**2)
    corners = {tuple(corner) for corner in triangles.reshape(-1, 3)}
    assert {tuple(corner) for corner in blocks.fans[:, :2].reshape(-1, 3)} <= corners


def test_blocks_have_the_mean_colour_of_their_tiles():
    """Tones of 90 and 110 in turns are 100 from afar; a block with a shadow has no piece."""
    triangles = tiles(8)
    tones = np.where(np.arange(len(triangles)) // 2 % 2, 90, 110).astype(np.uint8)
    colours = np.broadcast_to(tones[:, None, None], triangles.shape).copy()
    blocks = Blocks.of(triangles, colours, 12.0)
    assert (blocks.colours == 100).all()
    assert blocks.far_m.tolist() == [12.0]
    colours[0] = 50
    assert Blocks.of(triangles, colours, 12.0).far_m.tolist() == [np.inf]


def test_blocks_around_a_hole_are_drawn_as_tiles():
    """Without four tiles in its middle a block has no fan that covers it; without a corner tile it has one."""
    triangles = tiles(8)
    middle = np.abs(triangles.mean(axis=1)[:, :2] - 4).max(axis=1) < 1
    grey = np.full(triangles.shape, 100, np.uint8)
    assert Blocks.of(triangles[~middle], grey[~middle], 12.0).counts.tolist() == [0]
    assert Blocks.of(triangles[2:], grey[2:], 12.0).counts.tolist() == [32]


def test_pictures_of_large_scenes_are_those_of_their_tiles(monkeypatch):
    """Depth to 1e-4, colours within 12 m exactly, beyond within the grain, from less than half of the triangles.

    Judge: the same camera without blocks.
    """
    mesh, config = hall(), CameraConfig()
    views = [camera_pose(np.array(view), config) for view in VIEWS]
    monkeypatch.setattr(visibility, "MANY_PARTS", np.inf)
    expected, tiled = pictures(mesh, config, views)
    monkeypatch.setattr(visibility, "MANY_PARTS", 100)
    frames, drawn = pictures(mesh, config, views)
    assert drawn < 0.5 * tiled
    changed = 0
    for frame, truth in zip(frames, expected, strict=True):
        assert frame.depth == pytest.approx(truth.depth, rel=1e-4)
        difference = np.abs(frame.rgb.astype(int) - truth.rgb).max(axis=2)
        assert not difference[truth.depth < 12].any()
        assert difference.max() <= 32
        changed += (difference > 0).sum()
    assert 0 < changed < 0.05 * sum(frame.depth.size for frame in frames)
