"""Scenes that the tracer's tests are held in."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh


def extrude(walls, low=0.0, high=3.0, floor=False, ceiling=False):
    """Mesh of upright rectangles over segments (n, 2, 2), each with vertices of its own."""
    walls = np.asarray(walls, float)
    vertices, faces = [], []
    for (ax, ay), (bx, by) in walls:
        at = len(vertices)
        vertices += [(ax, ay, low), (bx, by, low), (bx, by, high), (ax, ay, high)]
        faces += [(at, at + 1, at + 2), (at, at + 2, at + 3)]
    (x0, y0), (x1, y1) = walls.min(axis=(0, 1)), walls.max(axis=(0, 1))
    for wanted, z in ((floor, low), (ceiling, high)):
        if wanted:
            at = len(vertices)
            vertices += [(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)]
            faces += [(at, at + 1, at + 2), (at, at + 2, at + 3)]
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.fixture(scope="session")
def extruded() -> Callable[..., trimesh.Trimesh]:
    """Makes a mesh of upright walls over segments."""
    return extrude


def loop(*points):
    """Segments of a closed line through points."""
    points = np.array(points, float)
    return np.stack([points, np.roll(points, -1, axis=0)], axis=1)


@pytest.fixture(scope="session")
def ring() -> Callable[..., np.ndarray]:
    """Makes the segments of a closed line through points."""
    return loop
