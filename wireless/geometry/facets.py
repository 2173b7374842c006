"""Facets and edges of a triangle mesh, for specular reflection and for diffraction.

A facet is all of a plane that has one material: triangles side by side, doubled, or apart from each other share one
image. Planes are found by `wireless.geometry.tolerance`; `wireless.geometry.overlapping_faces` decides what is met
where sheets of several materials lie on each other. Edges are found along lines: where triangle sides lie on each
other, in whole or in part, the faces around each piece of line are sorted by angle, faces that the piece merely lies on
included. A gap of more than 180 degrees between them is the outside of a wedge. So neither cracks between vertices nor
T-junctions nor walls that stand on a larger floor make edges.

Left out: triangles that cross each other between their sides.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.geometry.array_types import Points, Triangles
from wireless.geometry.occlusion import Tree, leaf_around, make_tree
from wireless.geometry.overlapping_faces import without_overlaps
from wireless.geometry.tolerance import NEAR_M, fit_lines, fit_planes, tolerance_of

#: Gaps between faces that exceed 180 degrees by less [rad] are no edge.
FLAT_RAD = 1e-4
#: How far from level floors and ceilings may lean, as 1 less the cosine of the angle.
LEVEL = 1e-6
#: How closely unit vectors agree that are one.
ALIKE = 1e-7
#: Sides that lean off a line by less [rad] are along it: short ones do, whose ends were rounded.
ALONG = 1e-3


class _Pieces(NamedTuple):
    """Pieces of lines that triangle sides lie on, and the sides on each."""

    ends: Float[np.ndarray, "p 2 3"]
    """Ends of each piece [m]."""
    along: Float[np.ndarray, "p 3"]
    """Direction of its line."""
    piece: Int[np.ndarray, " s"]
    """Piece of each side, rising; a side over several pieces is on each of them."""
    facet: Int[np.ndarray, " s"]
    """Facet of the side's triangle."""
    inward: Float[np.ndarray, "s 3"]
    """Direction into that triangle, at right angles to the line."""


class Surfaces(NamedTuple):
    """Triangles, sorted by facet, and edges."""

    triangle: Float[np.ndarray, "t 3 3"]
    """Corners of triangles [m]."""
    triangle_facet: Int[np.ndarray, " t"]
    """Facet of each triangle."""
    facet_start: Int[np.ndarray, " f1"]
    """Where each facet's triangles begin, and an end."""
    facet_point: Float[np.ndarray, "f 3"]
    """A point of the plane fitted to each facet."""
    facet_normal: Float[np.ndarray, "f 3"]
    """Unit normal of each facet, of either side."""
    plane: Float[np.ndarray, "f 4"]
    """Plane of each facet: its normal, and the level along it."""
    facet_off_m: Float[np.ndarray, " f"]
    """How far the corner that deviates most is off each facet's plane [m]."""
    near_m: float
    """Tolerance of contact [m]: rounding, and twice the distance of corners from their planes and lines."""
    tolerance_m: float
    """Corners closer to a plane or line than this are in it [m]."""
    facet_face: Int[np.ndarray, " f"]
    """A mesh face of each facet."""
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
        snap_m: Planes and lines closer than this are one, at least.
    """
    vertex = np.asarray(mesh.vertices, float)
    tolerance_m = tolerance_of(vertex, snap_m)
    triangle = vertex[np.asarray(mesh.faces)]
    fits = fit_planes(triangle, tolerance_m)
    axis = _with_one_sign(fits.axis)
    face = np.flatnonzero(fits.group >= 0)
    plane, material = fits.group[face], np.asarray(face_material)[face]
    triangle, source = without_overlaps(triangle[face], plane, material, axis, tolerance_m)
    face, plane, material = face[source], plane[source], material[source]
    facet = clusters(material.astype(float), 0.5, plane)
    order = np.argsort(facet, kind="stable")
    triangle, face, facet, plane = triangle[order], face[order], facet[order], plane[order]
    start = np.searchsorted(facet, np.arange(facet[-1] + 2))
    plane = plane[start[:-1]]
    normal, point = axis[plane], fits.point[plane]
    planes = np.column_stack([normal, np.einsum("ij,ij->i", normal, point)])
    lines, off_m = _pieces_of_lines(triangle, facet, normal, tolerance_m)
    tree = make_tree(triangle, planes[facet], tolerance_m)
    edge, wedge, gap, facets = _edges(lines, tree, facet, normal, tolerance_m)
    return Surfaces(
        triangle=triangle,
        triangle_facet=facet,
        facet_start=start,
        facet_point=point,
        facet_normal=normal,
        plane=planes,
        facet_off_m=fits.off_m[plane],
        near_m=NEAR_M + 2 * (float(fits.off_m.max()) + off_m),
        tolerance_m=tolerance_m,
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


def at_heights(
    surfaces: Surfaces, height_m: Float[np.ndarray, " k"], snap_m: float
) -> Bool[np.ndarray, " f"]:
    """Facets that are level, at one of some heights."""
    level = np.abs(surfaces.facet_normal[:, 2]) > 1 - LEVEL
    off = np.abs(surfaces.facet_point[:, 2][:, None] - height_m).min(axis=1)
    return level & (off < snap_m)


def is_floor_plan(surfaces: Surfaces, slabs: Bool[np.ndarray, " f"]) -> bool:
    """Whether all facets but floor and ceiling (`slabs`) are upright walls, as far as rounding lets them be."""
    upright = np.abs(surfaces.facet_normal[:, 2]) < np.sqrt(2 * LEVEL)
    return bool(upright.any() and (upright | slabs).all())


def without_rims(surfaces: Surfaces, ground: Bool[np.ndarray, " f"]) -> Surfaces:
    """Return surfaces without the edges of ground facets, which are taken to go on beyond the walls."""
    inner = ~ground[surfaces.edge_facets].any(axis=1)
    return surfaces._replace(
        edge=surfaces.edge[inner],
        edge_wedge=surfaces.edge_wedge[inner],
        edge_gap_rad=surfaces.edge_gap_rad[inner],
        edge_facets=surfaces.edge_facets[inner],
    )


def is_wide(triangle: Triangles, least_m: float) -> Bool[np.ndarray, " t"]:
    """Which triangles are no slivers: wider than some least width [m]."""
    cross = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    longest = np.linalg.norm(triangle - np.roll(triangle, 1, axis=1), axis=2).max(axis=1)
    return np.linalg.norm(cross, axis=1) > least_m * longest


def _with_one_sign(vectors: Points) -> Points:
    """Return the directions of lines, each by the unit vector whose last non-zero component is positive."""
    sign = np.ones(len(vectors))
    for axis in range(3):
        sign = np.where(np.abs(vectors[:, axis]) > ALIKE, np.sign(vectors[:, axis]), sign)
    return vectors * sign[:, None]


def _pieces_of_lines(
    triangle: Triangles,
    facet: Int[np.ndarray, " t"],
    facet_normal: Float[np.ndarray, "f 3"],
    tolerance_m: float,
) -> tuple[_Pieces, float]:
    """Pieces of triangle sides, from end to end along each line; and how far sides are off their lines [m]."""
    # Slivers have no inside to speak of: the sides of their neighbours are on the same lines.
    wide = is_wide(triangle, tolerance_m)
    triangle, facet = triangle[wide], facet[wide]
    start, stop = triangle.reshape(-1, 3), np.roll(triangle, -1, axis=1).reshape(-1, 3)
    tip = np.roll(triangle, -2, axis=1).reshape(-1, 3)
    both = np.hstack([start, stop]), np.hstack([stop, start])
    sides, line = np.unique(
        np.where(np.any(start < stop, axis=1)[:, None], *both), axis=0, return_inverse=True
    )
    fits = fit_lines(sides.reshape(-1, 2, 3), tolerance_m)
    line, along, base = fits.group[line.ravel()], _with_one_sign(fits.axis), fits.point
    inward = np.cross(along[line], facet_normal[np.repeat(facet, 3)])
    inward *= (np.sign(np.einsum("ij,ij->i", tip - start, inward)) / np.linalg.norm(inward, axis=1))[:, None]
    ends = np.stack([np.einsum("ij,ij->i", p - base[line], along[line]) for p in (start, stop)], axis=1)
    ends.sort(axis=1)
    # Cuts along each line, where a side ends; each end is at one, and each side goes from one to another.
    place, of = ends.ravel(), np.repeat(line, 2)
    order = np.lexsort((place, of))
    new = np.append(True, (np.diff(of[order]) > 0) | (np.diff(place[order]) > tolerance_m))
    cut = np.empty(len(place), np.int64)
    cut[order] = np.cumsum(new) - 1
    at, on = place[order][new], of[order][new]
    first, last = cut.reshape(-1, 2).T
    side = np.repeat(np.arange(len(line)), last - first)
    piece = np.repeat(first, last - first) + counted(last - first)
    order = np.argsort(piece, kind="stable")
    side, piece = side[order], piece[order]
    used, number = np.unique(piece, return_inverse=True)
    pieces = _Pieces(
        ends=base[on[used]][:, None]
        + np.stack([at[used], at[used + 1]], axis=1)[..., None] * along[on[used]][:, None],
        along=along[on[used]],
        piece=number,
        facet=facet[side // 3],
        inward=inward[side],
    )
    return pieces, float(fits.off_m.max())


def counted(count: Int[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
    """From 0 up to each count, one after the other."""
    return np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)


def _edges(
    pieces: _Pieces,
    tree: Tree,
    facet: Int[np.ndarray, " t"],
    facet_normal: Float[np.ndarray, "f 3"],
    tolerance_m: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ends, wedge vectors, open angles and facets of all edges; pieces in a row that agree become one."""
    n = len(pieces.ends)
    start, holding = _holding(tree, pieces.ends.mean(axis=1), pieces.along, tolerance_m)
    held = np.unique(np.column_stack([np.repeat(np.arange(n), np.diff(start)), facet[holding]]), axis=0)
    side = np.cross(pieces.along[held[:, 0]], facet_normal[held[:, 1]])
    size = np.linalg.norm(side, axis=1)
    flat = size > 1 - 1e-6  # the piece lies in the facet's plane
    held, side = held[flat], side[flat] / size[flat, None]
    piece = np.concatenate([pieces.piece, held[:, 0], held[:, 0]])
    face = np.concatenate([pieces.facet, held[:, 1], held[:, 1]])
    out = np.concatenate([pieces.inward, side, -side])
    order = np.argsort(piece, kind="stable")
    piece, face, out = piece[order], face[order], out[order]
    first = np.searchsorted(piece, np.arange(n))
    zero = out[first][piece]
    across = np.cross(pieces.along[piece], zero)
    angle = np.arctan2(np.einsum("ij,ij->i", out, across), np.einsum("ij,ij->i", out, zero))
    order = np.lexsort((angle, piece))
    face, out, angle = face[order], out[order], angle[order]
    # The face after each, counter-clockwise; after the last of a piece comes its first, a turn later.
    after = np.arange(1, len(piece) + 1)
    last = np.append(first[1:], len(piece)) - 1
    after[last] = first
    gap = angle[after] - angle
    gap[last] += 2 * np.pi
    widest = np.lexsort((np.arange(len(gap)), -gap, piece))[first]
    widest = widest[gap[widest] > np.pi + FLAT_RAD]
    of = piece[widest]
    facets, gap = np.column_stack([face[widest], face[after[widest]]]), gap[widest]
    ends, along, out = pieces.ends[of], pieces.along[of], out[widest]
    wedge = np.stack([along, out, np.cross(along, out)], axis=1)
    joins = np.linalg.norm(ends[:-1, 1] - ends[1:, 0], axis=1) < tolerance_m
    joins &= (facets[:-1] == facets[1:]).all(axis=1) & (np.abs(np.diff(gap)) < ALIKE)
    joins &= np.abs(np.diff(wedge, axis=0)).max(axis=(1, 2), initial=0) < ALIKE
    begin = np.flatnonzero(np.append(True, ~joins)[: len(ends)])
    end = np.append(begin[1:], len(ends))[: len(begin)] - 1
    ends = np.stack([ends[begin, 0], ends[end, 1]], axis=1)
    return ends, wedge[begin], gap[begin], facets[begin].astype(np.int64)


@compiled
def _holding(
    tree: Tree, points: Points, along: Points, near_m: float
) -> tuple[Int[np.ndarray, " n1"], Int[np.ndarray, " h"]]:
    """Triangles that points lie in, off sides along their lines: where those of each begin, and the triangles."""
    start, triangles, count = np.zeros(len(points) + 1, np.int64), np.empty(256, np.int64), 0
    stack = np.empty(64, np.int64)
    for n in range(len(points)):
        p, stack[0] = points[n], 0
        first, last, depth = leaf_around(tree, p, near_m, stack, 1)
        while depth >= 0:
            for t in range(first, last):
                off, least = -tree.level[t], np.inf
                for i in range(3):
                    off += tree.normal[t, i] * p[i]
                for k in range(3):
                    into, across = near_m, 0.0
                    for i in range(3):
                        into += tree.inward[t, k, i] * (p[i] - tree.triangle[t, k, i])
                        across += tree.inward[t, k, i] * along[n, i]
                    if abs(across) < ALONG:
                        into -= 2 * near_m
                    least = min(least, into)
                if abs(off) >= near_m or least <= 0:
                    continue
                if count == len(triangles):
                    triangles = np.concatenate((triangles, triangles))
                triangles[count] = tree.number[t]
                count += 1
            first, last, depth = leaf_around(tree, p, near_m, stack, depth)
        start[n + 1] = count
    return start, triangles[:count]
