"""Facets and edges of a triangle mesh: what rays are mirrored at, and what they bend around.

A facet is all of a plane that has one material: triangles side by side, doubled, or apart from each other
share one image. Edges are found along lines: where triangle sides lie on each other, in whole or in part,
the faces around each piece of line are sorted by angle, faces that the piece merely lies on included. A gap
of more than 180 degrees between them is the outside of a wedge. So neither cracks between vertices nor
T-junctions nor walls that stand on a larger floor make edges that are none.

Left out: triangles that cross each other between their sides.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from wireless.geometry.occlusion import Tree, box_holds, make_tree
from wireless.support.compiled import compiled

#: Triangles thinner than this [m] are dropped: they hide nothing, and their plane is anybody's guess.
SLIVER_M = 1e-9
#: Gaps between faces that exceed 180 degrees by less [rad] are no edge.
FLAT_RAD = 1e-4
#: How far from level floors and ceilings may lean, as 1 less the cosine of the angle.
LEVEL = 1e-6
#: How closely unit vectors agree that are one.
ALIKE = 1e-7
#: A piece of a line: ends, direction, and facet and inward direction of each triangle there.
_Piece = tuple[Float[np.ndarray, "2 3"], Float[np.ndarray, "3"], list[tuple[int, Float[np.ndarray, "3"]]]]


class Surfaces(NamedTuple):
    """Triangles, sorted by facet, and edges."""

    triangle: Float[np.ndarray, "t 3 3"]
    """Corners of triangles [m]."""
    triangle_facet: Int[np.ndarray, " t"]
    """Facet of each triangle."""
    facet_start: Int[np.ndarray, " f1"]
    """Where each facet's triangles begin, and an end."""
    facet_point: Float[np.ndarray, "f 3"]
    """A point of each facet."""
    facet_normal: Float[np.ndarray, "f 3"]
    """Unit normal of each facet, of either side."""
    facet_face: Int[np.ndarray, " f"]
    """One mesh face of each facet."""
    edge: Float[np.ndarray, "e 2 3"]
    """Ends of edges [m]."""
    edge_wedge: Float[np.ndarray, "e 3 3"]
    """Unit vectors along the edge, along the 0-face away from it, and normal to that face into the open."""
    edge_gap_rad: Float[np.ndarray, " e"]
    """Open angle of each edge."""
    edge_facets: Int[np.ndarray, "e 2"]
    """Facets of 0-face and n-face."""


def clusters(
    value: Float[np.ndarray, " n"], gap: float, group: Int[np.ndarray, " n"] | None = None
) -> Int[np.ndarray, " n"]:
    """Number for each run of values, within each group, that has no gap between neighbours."""
    if group is None:
        group = np.zeros(len(value), int)
    order = np.lexsort((value, group))
    new = (np.diff(value[order], prepend=value[order[0]]) > gap) | (np.diff(group[order], prepend=0) != 0)
    number = np.empty(len(value), int)
    number[order] = np.cumsum(new)
    return number - number.min()


def find_surfaces(
    mesh: trimesh.Trimesh, face_material: Int[np.ndarray, " n_faces"], snap_m: float
) -> Surfaces:
    """Facets and edges of any mesh.

    Args:
        mesh: Triangles [m].
        face_material: A number for the material of each face.
        snap_m: Planes and lines closer than this are one.
    """
    triangle = np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)]
    cross = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    size = np.linalg.norm(cross, axis=1)
    longest = np.linalg.norm(triangle - np.roll(triangle, 1, axis=1), axis=2).max(axis=1)
    real = np.flatnonzero(size > SLIVER_M * longest)
    triangle, normal = triangle[real], _one_way(cross[real] / size[real, None])
    group = clusters(np.asarray(face_material)[real].astype(float), 0.5)
    for axis in range(3):
        group = clusters(normal[:, axis], ALIKE, group)
    group = clusters(np.einsum("ij,ij->i", normal, triangle[:, 0]), snap_m, group)
    order = np.argsort(group, kind="stable")
    triangle, normal, facet, face = triangle[order], normal[order], group[order], real[order]
    start = np.searchsorted(facet, np.arange(facet[-1] + 2))
    lines = _pieces_of_lines(triangle, facet, snap_m)
    edge, wedge, gap, facets = _edges(lines, triangle, facet, normal[start[:-1]], snap_m)
    return Surfaces(
        triangle=triangle,
        triangle_facet=facet,
        facet_start=start,
        facet_point=triangle[start[:-1], 0],
        facet_normal=normal[start[:-1]],
        facet_face=face[start[:-1]],
        edge=edge,
        edge_wedge=wedge,
        edge_gap_rad=gap,
        edge_facets=facets,
    )


def floor_and_ceiling(surfaces: Surfaces) -> Bool[np.ndarray, " f"]:
    """Facets that are floor or ceiling: level, at the lowest or the highest place of all.

    A level facet at the top that covers less than half of what the floor does is a lid: of a table, say,
    that stands on a plane.
    """
    z = surfaces.triangle[:, :, 2]
    level = np.abs(surfaces.facet_normal[:, 2]) > 1 - LEVEL
    low, high = (level & np.isclose(surfaces.facet_point[:, 2], end) for end in (z.min(), z.max()))
    a, b = (surfaces.triangle[:, k, :2] - surfaces.triangle[:, 0, :2] for k in (1, 2))
    area = np.bincount(surfaces.triangle_facet, np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2, len(level))
    return low | high if area[high].sum() >= area[low].sum() / 2 else low


def without_rims(surfaces: Surfaces, ground: Bool[np.ndarray, " f"]) -> Surfaces:
    """The same without the edges of some facets, which are taken to go on beyond the walls."""
    kept = ~ground[surfaces.edge_facets].any(axis=1)
    return surfaces._replace(
        edge=surfaces.edge[kept],
        edge_wedge=surfaces.edge_wedge[kept],
        edge_gap_rad=surfaces.edge_gap_rad[kept],
        edge_facets=surfaces.edge_facets[kept],
    )


def _one_way(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The same lines, each by the unit vector whose last non-zero component is positive."""
    sign = np.ones(len(vectors))
    for axis in range(3):
        sign = np.where(np.abs(vectors[:, axis]) > ALIKE, np.sign(vectors[:, axis]), sign)
    return vectors * sign[:, None]


def _pieces_of_lines(
    triangle: Float[np.ndarray, "t 3 3"], facet: Int[np.ndarray, " t"], snap_m: float
) -> list[_Piece]:
    """Pieces of triangle sides: ends, direction, and facet and inward direction of each triangle there."""
    start, stop = triangle.reshape(-1, 3), np.roll(triangle, -1, axis=1).reshape(-1, 3)
    tip = np.roll(triangle, -2, axis=1).reshape(-1, 3)
    length = np.linalg.norm(stop - start, axis=1)
    way = _one_way((stop - start) / length[:, None])
    foot = start - np.einsum("ij,ij->i", start, way)[:, None] * way
    group = np.zeros(len(way), int)
    for axis in range(3):
        group = clusters(way[:, axis], ALIKE, group)
    for axis in range(3):
        group = clusters(foot[:, axis], snap_m, group)
    inward = tip - start
    inward = inward - np.einsum("ij,ij->i", inward, way)[:, None] * way
    inward = inward / np.linalg.norm(inward, axis=1)[:, None]
    pieces = []
    for members in np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1]):
        along, base = way[members[0]], foot[members[0]]
        ends = np.sort(np.column_stack([start[members] @ along, stop[members] @ along]), axis=1)
        cuts = np.sort(ends.ravel())
        cuts = cuts[np.append(True, np.diff(cuts) > snap_m)]
        for low, high in pairwise(cuts):
            here = members[(ends[:, 0] < (low + high) / 2) & (ends[:, 1] > (low + high) / 2)]
            if len(here):
                around = [(int(facet[i // 3]), inward[i]) for i in here]
                pieces.append((base + np.array([[low], [high]]) * along, along, around))
    return pieces


def _edges(
    pieces: list[_Piece],
    triangle: Float[np.ndarray, "t 3 3"],
    facet: Int[np.ndarray, " t"],
    facet_normal: Float[np.ndarray, "f 3"],
    snap_m: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ends, wedge vectors, open angles and facets of all edges; pieces in a row that agree become one."""
    found: list[tuple[np.ndarray, np.ndarray, float, tuple[int, int]]] = []
    middle = np.array([ends.mean(axis=0) for ends, _, _ in pieces]).reshape(-1, 3)
    start, holding = _holding(make_tree(triangle), middle, snap_m)
    for i, (ends, along, faces) in enumerate(pieces):
        around = list(faces)
        for f in np.unique(facet[holding[start[i] : start[i + 1]]]):
            side = np.cross(along, facet_normal[f])
            size = np.linalg.norm(side)
            if size > 1 - 1e-6:  # the piece lies in the facet's plane
                around += [(int(f), side / size), (int(f), -side / size)]
        zero = around[0][1]
        across = np.cross(along, zero)
        angles = np.array([np.arctan2(out @ across, out @ zero) for _, out in around])
        order = np.argsort(angles)
        gaps = np.diff(np.append(angles[order], angles[order[0]] + 2 * np.pi))
        widest = int(np.argmax(gaps))
        if gaps[widest] <= np.pi + FLAT_RAD:
            continue
        first, last = around[order[widest]], around[order[(widest + 1) % len(order)]]
        wedge = np.array([along, first[1], np.cross(along, first[1])])
        if found:
            end, before, gap, facets = found[-1]
            joins = np.linalg.norm(end[1] - ends[0]) < snap_m and facets == (first[0], last[0])
            if joins and abs(gap - gaps[widest]) < ALIKE and np.abs(before - wedge).max() < ALIKE:
                found[-1] = (np.array([end[0], ends[1]]), before, gap, facets)
                continue
        found.append((ends, wedge, float(gaps[widest]), (first[0], last[0])))
    n = len(found)
    return (
        np.array([f[0] for f in found]).reshape(n, 2, 3),
        np.array([f[1] for f in found]).reshape(n, 3, 3),
        np.array([f[2] for f in found]).reshape(n),
        np.array([f[3] for f in found], np.int64).reshape(n, 2),
    )


@compiled
def _holding(
    tree: Tree, points: Float[np.ndarray, "n 3"], near_m: float
) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " h"]]:
    """Triangles that points lie in, off their sides: where those of each point begin, and the triangles."""
    start, found, count = np.zeros(len(points) + 1, np.int64), np.empty(256, np.int64), 0
    stack = np.empty(64, np.int64)
    for n in range(len(points)):
        p = points[n]
        stack[0], depth = 0, 1
        while depth > 0:
            depth -= 1
            box = stack[depth]
            if not box_holds(tree, box, p, near_m):
                continue
            one, other = tree.child[box]
            if one >= 0:
                stack[depth], stack[depth + 1] = one, other
                depth += 2
                continue
            for t in range(-1 - one, -1 - one + other):
                off, least = 0.0, np.inf
                for i in range(3):
                    off += tree.normal[t, i] * (p[i] - tree.triangle[t, 0, i])
                for k in range(3):
                    into = 0.0
                    for i in range(3):
                        into += tree.inward[t, k, i] * (p[i] - tree.triangle[t, k, i])
                    least = min(least, into)
                if abs(off) >= near_m or least <= near_m:
                    continue
                if count == len(found):
                    found = np.concatenate((found, found))
                found[count] = tree.number[t]
                count += 1
        start[n + 1] = count
    return start, found[:count]
