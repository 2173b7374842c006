"""Scenes that are floor plans: vertical walls from one floor to one ceiling, found in any triangle mesh.

Seen from above such a mesh is a set of line segments. Triangles of one wall, doubled walls and pieces side by
side become one segment; a mesh with anything slanted, half as high or with a hole in a wall is not a plan and
is left to the general tracer. Floor and ceiling only count by their height and material: they are taken to
be everywhere, and edges at the top of walls without a ceiling do not diffract.

Walls have two faces and no thickness: the orientation of triangles does not matter.
"""

from dataclasses import dataclass

import numpy as np
import shapely
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from wireless.geometry.facets import clusters, is_wide
from wireless.geometry.tolerance import NEAR_M, exact_m, fit_lines, tolerance_of

#: How far from vertical or level a face may lean, as the sine of the angle.
LEAN = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Extruded:
    """Walls from above."""

    walls: Float[np.ndarray, "n 2 2"]
    """Ends (x, y) [m] of each wall."""
    wall_face: Int[np.ndarray, " n"]
    """A mesh face of each wall."""
    low_m: float
    """Height of the floor."""
    high_m: float
    """Height of the ceiling."""
    floor_face: int
    """A face of the floor, -1 if there is none."""
    ceiling_face: int
    """A face of the ceiling, -1 if there is none."""


def find_extruded(
    mesh: trimesh.Trimesh, face_material: Int[np.ndarray, " n_faces"], snap_m: float
) -> Extruded | None:
    """The floor plan that a mesh was extruded from; None if it was not.

    Args:
        mesh: Any triangles [m], z up.
        face_material: A number for the material of each face: walls of two materials are two walls.
        snap_m: Ends of walls closer than this are one.
    """
    corners = np.asarray(mesh.vertices, float)[np.asarray(mesh.faces)]
    sorted_out = upright_and_level(corners)
    if sorted_out is None:
        return None
    upright, level = sorted_out
    z = corners[upright][:, :, 2]
    low, high = float(z.min()), float(z.max())
    if np.any((np.abs(z - low) > snap_m) & (np.abs(z - high) > snap_m)):
        return None
    floor = level[np.abs(corners[level][:, :, 2] - low).max(axis=1) < snap_m]
    ceiling = level[np.abs(corners[level][:, :, 2] - high).max(axis=1) < snap_m]
    if len(floor) + len(ceiling) < len(level):
        return None
    segments = walls_of(corners[upright], np.asarray(face_material)[upright], low, high, snap_m)
    if segments is None:
        return None
    return Extruded(
        walls=segments[0],
        wall_face=upright[segments[1]],
        low_m=low,
        high_m=high,
        floor_face=int(floor[0]) if len(floor) else -1,
        ceiling_face=int(ceiling[0]) if len(ceiling) else -1,
    )


def upright_and_level(
    corners: Float[np.ndarray, "n 3 3"],
) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " k"]] | None:
    """Which triangles stand upright and which lie level, slivers left out; None if one leans or none stands."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(cross, axis=1)
    real = np.flatnonzero(is_wide(corners, NEAR_M))
    up = np.abs(cross[real, 2]) / size[real]
    upright, level = real[up < LEAN], real[up > 1 - LEAN]
    if len(upright) + len(level) < len(real) or not len(upright):
        return None
    return upright, level


def walls_of(
    triangles: Float[np.ndarray, "m 3 3"],
    material: Int[np.ndarray, " m"],
    low: float,
    high: float,
    snap_m: float,
) -> tuple[Float[np.ndarray, "k 2 2"], Int[np.ndarray, " k"]] | None:
    """Segments of upright triangles, one for all side by side or on each other; None if one has gaps.

    Returns:
        Ends (x, y) of each segment, and one of its triangles.
    """
    origin = triangles[:, :, :2].mean(axis=(0, 1))  # far from zero, offsets would be noise
    xy = triangles[:, :, :2] - origin
    sides = np.roll(xy, -1, axis=1) - xy
    longest = np.argmax(np.linalg.norm(sides, axis=2), axis=1)
    along = sides[np.arange(len(xy)), longest]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    along *= np.where(_is_turned(along), -1, 1)[:, None]
    place = xy[np.arange(len(xy)), longest]
    fitted = _lines(place, sides[np.arange(len(xy)), longest], triangles, snap_m)
    if fitted is not None:
        place, along = fitted
    normal = np.column_stack([-along[:, 1], along[:, 0]])
    group = clusters(np.arctan2(along[:, 1], along[:, 0]), 1e-7)
    group = clusters(np.einsum("ij,ij->i", normal, place), snap_m, group)
    group = clusters(material.astype(float), 0.5, group)
    walls, wall_face = [], []
    for members in np.split(np.argsort(group, kind="stable"), np.cumsum(np.bincount(group))[:-1]):
        reference = members[0]
        s = (xy[members] - place[reference]) @ along[reference]
        spans = _union(s.min(axis=1), s.max(axis=1), snap_m)
        if not _rectangles(s, triangles[members][:, :, 2] - low, high - low, snap_m):
            unrolled = shapely.polygons(np.stack([s, triangles[members][:, :, 2] - low], axis=2))
            solid = shapely.union_all(shapely.set_precision(unrolled, snap_m)).area
            gaps = abs(solid - np.diff(spans, axis=1).sum() * (high - low))
            if gaps > len(s) * snap_m * 4 * (high - low + s.max()):
                return None
        for span in spans:
            walls.append(origin + place[reference] + span[:, None] * along[reference])
            wall_face.append(members[np.argmax(s.min(axis=1) >= span[0] - snap_m)])
    ends, corners = np.array(walls), xy.reshape(-1, 2)
    if fitted is not None:
        ends = origin + corners[cKDTree(corners).query(ends - origin)[1]]
    ends = _joined(ends, tolerance_of(_in_space(corners), snap_m), exact_m(triangles))
    long = (ends[:, 0] != ends[:, 1]).any(axis=1)
    return ends[long], np.array(wall_face)[long]


def _is_turned(along: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
    """Which unit vectors point backwards, or straight to the left."""
    return (along[:, 1] < -1e-9) | ((along[:, 1] < 1e-9) & (along[:, 0] < 0))


def _in_space(points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
    """Points of the plane at height 0."""
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def _lines(
    start: Float[np.ndarray, "n 2"],
    step: Float[np.ndarray, "n 2"],
    triangles: Float[np.ndarray, "n 3 3"],
    snap_m: float,
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]] | None:
    """A point and the direction of the line fitted to each of some segments and those in line with it."""
    # No line is fitted if they are in line exactly.
    ends = _in_space(np.stack([start, start + step], axis=1))
    fits = fit_lines(ends, tolerance_of(ends.reshape(-1, 3), snap_m))
    if fits.off_m.max() <= exact_m(triangles):
        return None
    axis = fits.axis[:, :2] * np.where(_is_turned(fits.axis[:, :2]), -1, 1)[:, None]
    return fits.point[fits.group, :2], axis[fits.group]


def _joined(
    walls: Float[np.ndarray, "n 2 2"], tolerance_m: float, least_m: float
) -> Float[np.ndarray, "n 2 2"]:
    """Walls whose ends are where others end, or on others, if they were within the tolerance of that."""
    # Nothing is moved by less than some least distance.
    places, place = np.unique(walls.reshape(-1, 2), axis=0, return_inverse=True)
    i, j = cKDTree(places).query_pairs(tolerance_m, output_type="ndarray").T
    far = np.linalg.norm(places[i] - places[j], axis=1) > least_m
    links = coo_array((np.ones(far.sum(), bool), (i[far], j[far])), shape=(len(places), len(places)))
    component = connected_components(links, directed=False)[1]
    places = places[np.unique(component, return_index=True)[1]]
    wall = component[place.ravel()].reshape(-1, 2)
    lines = shapely.linestrings(places[wall])
    point, on = shapely.STRtree(lines).query(
        shapely.points(places), predicate="dwithin", distance=tolerance_m
    )
    inner = (wall[on] != point[:, None]).all(axis=1) & (wall[on, 0] != wall[on, 1])
    point, on = point[inner], on[inner]
    start, step = places[wall[on, 0]], np.diff(places[wall[on]], axis=1)[:, 0]
    share = np.einsum("ij,ij->i", places[point] - start, step) / (step**2).sum(axis=1)
    foot = start + share[:, None] * step
    is_off = np.linalg.norm(foot - places[point], axis=1) > least_m
    places[point[is_off]] = foot[is_off]
    return places[wall]


def _rectangles(s: Float[np.ndarray, "n 3"], z: Float[np.ndarray, "n 3"], height: float, snap: float) -> bool:
    """Whether triangles are halves of rectangles from floor to ceiling, two and two: then none leaves a gap."""
    # This holds for almost all walls; others may have no gaps either.
    if len(s) % 2:
        return False
    left, right = s.min(axis=1), s.max(axis=1)
    at_right, at_top = right[:, None] - s < snap, height - z < snap
    at_corner = (at_right ^ (s - left[:, None] < snap)) & (at_top ^ (z < snap))
    if not at_corner.all():
        return False
    # Each half lacks a corner of 1, 2, 4 and 8; the corners that its halves lack are opposite: 1 and 8, or 2 and 4.
    lacks = 15 - (1 << (at_right + 2 * at_top)).sum(axis=1)
    first, other = np.lexsort((right, left)).reshape(-1, 2).T
    same = (np.abs(left[first] - left[other]) < snap) & (np.abs(right[first] - right[other]) < snap)
    halves = np.isin(lacks, (1, 2, 4, 8)).all() and (lacks[first] * lacks[other] == 8).all()
    return bool(same.all() and halves)


def _union(
    start: Float[np.ndarray, " n"], stop: Float[np.ndarray, " n"], gap: float
) -> Float[np.ndarray, "k 2"]:
    """Intervals joined where they touch or overlap."""
    order = np.argsort(start)
    start, reach = start[order], np.maximum.accumulate(stop[order])
    new = np.append(True, start[1:] > reach[:-1] + gap)
    return np.column_stack([start[new], reach[np.append(np.flatnonzero(new)[1:] - 1, len(reach) - 1)]])
