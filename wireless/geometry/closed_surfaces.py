"""Which side of closed surfaces points are on.

Triangles that share edges are one surface, and closed if each of its edges has an even number of them: also where two
blocks meet in an edge, which has four. A sheet whose faces are doubled, back to back, is not. A segment between two
points meets a closed surface an even number of times if both are on one side of it, otherwise an odd number of times.
So no segment that meets one wall only joins points that are on the same sides of all closed surfaces, as in rooms
between walls that have two sides.

The side of a point is found by counting along one direction that no building has a wall in (parity of the crossings,
M. Shimrat, Algorithm 112, Commun. ACM 5 (1962) 434), for all surfaces at once: each has a number of 64 random bits, and
equal sums of these modulo two mean the same sides, except once in 2^64. Doubled faces count as one wall.
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Int, UInt64
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Point, Points
from wireless.geometry.occlusion import Tree, depth_in, make_tree
from wireless.geometry.tolerance import NEAR_M

#: Direction that parity is counted along; upwards on each axis, so that rays enter boxes at their lowest corner.
_UP = np.array([0.2718281828, 0.5772156649, 0.7700401577])
#: Walls are thicker than twice this, and doubled faces closer [m].
_ASIDE_M = 1e-4


class Sides:
    """Closed surfaces of a mesh.

    Args:
        mesh: Triangles; corners at the same place are one.
        near_m: Points this close to a triangle are on it.
    """

    def __init__(self, mesh: trimesh.Trimesh, near_m: float = NEAR_M):
        surface, closed, once = surfaces_of(mesh)
        self.surface: Int[np.ndarray, " f"] = surface
        """Surface of each face."""
        self.closed: Bool[np.ndarray, " f"] = closed[surface]
        """Whether each face is of a closed surface."""
        bits = np.random.default_rng(0).integers(
            1 << 63, 1 << 64, len(closed), dtype=np.uint64, endpoint=False
        )
        faces = np.flatnonzero(self.closed & once & (trimesh.triangles.area(mesh.triangles) > 0))
        self._tree = make_tree(np.asarray(mesh.triangles)[faces], near_m=near_m)
        self._surface = surface[faces][self._tree.number]
        self._bits = bits[self._surface]
        self._step = _UP / np.linalg.norm(_UP) * 2 * np.linalg.norm(mesh.extents)

    def alike(self, points: Points) -> bool:
        """Whether points are on the same sides of all closed surfaces, and none is on one."""
        sums, on = self._sums(points, np.full(len(points), -1))
        return not on.any() and bool((sums == sums[0]).all())

    def parity(self, points: Points) -> UInt64[np.ndarray, " n"]:
        """Number of closed surfaces that each point is inside of, modulo two."""
        every, ones = np.full(len(points), -1), np.ones(len(self._bits), np.uint64)
        return _sums(self._tree, self._surface, ones, np.ascontiguousarray(points), every, self._step)[0]

    def enclosed(self, points: Points) -> Bool[np.ndarray, " n"]:
        """Whether each point is inside any closed surface."""
        return self._sums(points, np.full(len(points), -1))[0] != 0

    def inside(
        self, points: Points, surface: Int[np.ndarray, " n"]
    ) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """Whether each point is inside a closed surface of its own, and whether it is on that."""
        sums, on = self._sums(points, surface)
        return sums != 0, on

    def _sums(
        self, points: Points, only: Int[np.ndarray, " n"]
    ) -> tuple[UInt64[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        points = np.ascontiguousarray(points, float)
        return _sums(self._tree, self._surface, self._bits, points, only, self._step)


def find_two_faced(mesh: trimesh.Trimesh) -> Bool[np.ndarray, " f"]:
    """Which faces have the inside of closed surfaces on one side only: the two faces of walls, and of solids.

    The others are sheets: of no closed surface, or with another face of one on their back. Walls that are open at the
    top and the bottom of the mesh count as closed there.
    """
    whole = capped(mesh)
    sides = Sides(whole)
    corner = whole.triangles[: len(mesh.faces)]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(normal, axis=1)
    faces = np.flatnonzero(sides.closed[: len(corner)] & (size > 0))
    middle, aside = corner[faces].mean(axis=1), _ASIDE_M * normal[faces] / size[faces, None]
    is_two_faced = np.zeros(len(corner), bool)
    is_two_faced[faces] = sides.parity(middle + aside) != sides.parity(middle - aside)
    return is_two_faced


def capped(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A mesh around its own middle, with a cone over all that is open at its top, and one under its bottom."""
    merged = trimesh.Trimesh(np.asarray(mesh.vertices) - mesh.bounds.mean(axis=0), mesh.faces)
    edges, count = np.unique(merged.edges_sorted, axis=0, return_counts=True)
    open_edges, corners = edges[count % 2 == 1], np.asarray(merged.vertices)
    vertices, faces = [corners], [np.asarray(merged.faces)]
    for number, end in enumerate(merged.bounds[:, 2]):
        rim = open_edges[(np.abs(corners[open_edges, 2] - end) < _ASIDE_M).all(axis=1)]
        faces.append(np.column_stack([rim, np.full(len(rim), len(corners) + number)]))
        vertices.append(np.array([[0.0, 0.0, 2 * end]]))
    return trimesh.Trimesh(np.concatenate(vertices), np.concatenate(faces), process=False)


def surfaces_of(
    mesh: trimesh.Trimesh,
) -> tuple[Int[np.ndarray, " f"], Bool[np.ndarray, " s"], Bool[np.ndarray, " f"]]:
    """The surface of each face, which surfaces are closed, and one each of faces with the same corners."""
    corner = np.sort(trimesh.Trimesh(mesh.vertices, mesh.faces).faces, axis=1).astype(np.int64)
    n = len(corner)
    first, last = corner[:, [0, 1, 0]].ravel(), corner[:, [1, 2, 2]].ravel()
    kinds, edge = np.unique(first * (corner.max(initial=0) + 1) + last, return_inverse=True)
    face = np.repeat(np.arange(n), 3)
    size = n + len(kinds)
    pairs = coo_array((np.ones(3 * n), (face, n + edge)), shape=(size, size))
    parts, component = connected_components(pairs, directed=False)
    # Faces back to back are met in one point, as one wall: they count once.
    once = np.zeros(n, bool)
    once[np.unique(corner, axis=0, return_index=True)[1]] = True
    count = np.bincount(edge.reshape(n, 3)[once].ravel(), minlength=len(kinds))
    closed = np.ones(parts, bool)
    closed[component[n + np.flatnonzero(count % 2)]] = False
    return component[:n].astype(np.int64), closed, once


@compiled
def _sums(
    tree: Tree,
    surface: Int[np.ndarray, " t"],
    bits: UInt64[np.ndarray, " t"],
    points: Points,
    only: Int[np.ndarray, " n"],
    step: Point,
) -> tuple[UInt64[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Sums modulo two of the bits of triangles that steps from points meet; whether a point is on a triangle."""
    # Only triangles of one surface count (`only`), or all where that is -1.
    sums, stack, on = (
        np.zeros(len(points), np.uint64),
        np.empty(64, np.int64),
        np.zeros(len(points), np.bool_),
    )
    low, high, child = tree.low, tree.high, tree.child
    normal, triangle, inward, near_m = tree.normal, tree.triangle, tree.inward, tree.near_m
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        stack[0], depth = 0, 1
        while depth > 0:
            depth -= 1
            box, enter, leave = stack[depth], 0.0, 1.0
            for k in range(3):
                a, b = (low[box, k] - points[i, k]) / step[k], (high[box, k] - points[i, k]) / step[k]
                enter, leave = max(enter, a), min(leave, b)
            if enter > leave:
                continue
            left, other = child[box, 0], child[box, 1]
            if left >= 0:
                stack[depth], stack[depth + 1] = left, other
                depth += 2
                continue
            for t in range(-1 - left, -1 - left + other):
                if only[i] >= 0 and surface[t] != only[i]:
                    continue
                off, rise = 0.0, 0.0
                for k in range(3):
                    off += normal[t, k] * (points[i, k] - triangle[t, 0, k])
                    rise += normal[t, k] * step[k]
                share = -off / rise if abs(off) >= near_m else 0.0
                if not 0 <= share <= 1:
                    continue
                least = depth_in(
                    triangle, inward, t, x + share * step[0], y + share * step[1], z + share * step[2]
                )
                if abs(off) < near_m and least >= -near_m:
                    on[i] = True
                if share > 0 and least >= 0:
                    sums[i] ^= bits[t]
    return sums, on
