"""Meshes as files hold them: turned, moved, subdivided, rounded; and a judge of reflections that shares no code."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation


def box(size, centre, degrees=0.0, axis=(0, 0, 1)):
    """A turned box in 12 triangles."""
    found = trimesh.creation.box(size)
    found.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), axis))
    found.apply_translation(centre)
    return found


def furnished_room(n_boxes=24, n_spheres=3, seed=0):
    """A room of 8 x 6 x 2.7 m with turned boxes that stand apart from each other, and spheres under the ceiling."""
    rng = np.random.default_rng(seed)
    parts, places = [box((8, 6, 2.7), (4, 3, 1.35))], []
    while len(places) < n_boxes:
        place = rng.uniform((0.7, 0.7), (7.3, 5.3))
        if all(np.hypot(*(place - other)) > 0.75 for other in places):
            places.append(place)
            size = np.append(rng.uniform(0.2, 0.7, 2), rng.uniform(0.3, 1.6))
            parts.append(box(size, (*place, size[2] / 2 + 0.01), rng.uniform(0, 180)))
    for _ in range(n_spheres):
        sphere = trimesh.creation.icosphere(subdivisions=1, radius=0.2)
        sphere.apply_translation((*rng.uniform((0.7, 0.7), (7.3, 5.3)), 2.3))
        parts.append(sphere)
    whole = trimesh.util.concatenate(parts)
    return trimesh.Trimesh(whole.vertices, whole.faces, process=False)


def places_above(rng, n, high=2.05):
    """Points above the boxes of that room and below its spheres."""
    return rng.uniform((0.2, 0.2, 1.65), (7.8, 5.8, high), (n, 3))


def subdivided(mesh, times=1):
    """Each triangle in four, `times` times over."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    for _ in range(times):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    return trimesh.Trimesh(vertices, faces, process=False)


def renumbered(mesh, rng):
    """The same with its vertices and faces in another order, and each face's corners too."""
    order, faces = rng.permutation(len(mesh.vertices)), np.asarray(mesh.faces)
    new = np.empty(len(order), int)
    new[order] = np.arange(len(order))
    faces = np.array([np.roll(face, rng.integers(3)) for face in new[faces][rng.permutation(len(faces))]])
    return trimesh.Trimesh(np.asarray(mesh.vertices)[order], faces, process=False)


def in_32_bits(mesh, offset=(0.0, 0.0, 0.0)):
    """Coordinates rounded at an offset, and moved back."""
    rounded = (np.asarray(mesh.vertices) + offset).astype(np.float32).astype(float)
    return trimesh.Trimesh(rounded - offset, mesh.faces, process=False)


class Placed:
    """A rigid motion of meshes and points."""

    def __init__(self, turn=None, shift=(0.0, 0.0, 0.0)):
        self.turn = np.eye(3) if turn is None else Rotation.from_rotvec(turn).as_matrix()
        self.shift = np.asarray(shift, float)

    def points(self, points):
        return np.asarray(points) @ self.turn.T + self.shift

    def mesh(self, mesh):
        return trimesh.Trimesh(self.points(mesh.vertices), mesh.faces, process=False)

    def back(self, routes):
        return np.asarray(routes) @ self.turn


def first_order(triangle, tx, rx, margin=1e-5):
    """Lengths of all paths of one link over one reflection, and whether each keeps a margin [m] from every side.

    The judge: images in each triangle's own plane, and every leg past every triangle by Cramer's rule; numpy alone.
    """
    a, u, v = triangle[:, 0], triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]
    normal = np.cross(u, v)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    h, g = (((p - a) * normal).sum(axis=1) for p in (tx, rx))
    image = tx - 2 * h[:, None] * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        at = image + (h / (h + g))[:, None] * (rx - image)
    depth = depths(triangle, normal, at)
    some = np.flatnonzero((h * g > 0) & (depth >= 0))
    lengths, clear = [], []
    for t in some:
        gap = np.inf
        for p, q in ((tx, at[t]), (at[t], rx)):
            gap = min(gap, past(triangle, normal, p, q, t))
        if gap >= 0:
            lengths.append(np.linalg.norm(image[t] - rx))
            clear.append(gap > margin)
    return np.array(lengths), np.array(clear, bool)


def depths(triangle, normal, point):
    """How deep in each triangle a point of its plane lies, from its nearest side [m]; negative outside."""
    side = np.roll(triangle, -1, axis=1) - triangle
    inward = np.cross(normal[:, None], side)
    inward /= np.linalg.norm(inward, axis=2)[..., None]
    return np.einsum("tki,tki->tk", inward, point[:, None] - triangle).min(axis=1)


def past(triangle, normal, p, q, own):
    """By how much a line passes all triangles but those in the plane of its own [m]; negative if it meets one."""
    h, g = (((e - triangle[:, 0]) * normal).sum(axis=1) for e in (p, q))
    across = (h * g < 0) & (np.abs(h) > 1e-7) & (np.abs(g) > 1e-7)
    level = normal[own] @ triangle[own, 0]
    across &= np.abs(triangle @ normal[own] - level).max(axis=1) > 1e-9
    at = p + (h / np.where(across, h - g, 1))[:, None] * (q - p)
    return -depths(triangle, normal, at)[across].max(initial=-np.inf)
