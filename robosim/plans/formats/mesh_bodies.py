"""Places of a mesh that are inside of something that stands in a room, whatever the orientation of its faces.

Many files have faces of any orientation, so places are compared by the closed surfaces that contain them: a place in a
cupboard is inside of all surfaces that contain the room around it, and of the cupboard. Of two rooms that are closed
surfaces of their own neither contains the other. If no surface contains a room, as between solid walls or under the
open sky, only the faces distinguish a body, which they point out of, from another room.
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from robosim.plans.formats.mesh_file import Triangles
from wireless.geometry.closed_surfaces import Sides


def in_bodies(triangles: Triangles, places: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, " k"]:
    """Whether places are in bodies within the surroundings of other places.

    Args:
        triangles: Corners of the mesh's triangles [m].
        places: A place in each room and in each possible body [m].
    """
    within, points_out = _within(triangles, places)
    kinds, kind = np.unique(within, axis=0, return_inverse=True)
    body = np.zeros(len(kinds), bool)
    for k in np.argsort(kinds.sum(axis=1), kind="stable"):
        around = (kinds <= kinds[k]).all(axis=1) & ~body
        # The inside of a hollow body is in its inner surface too.
        around &= (kinds[k].sum() - kinds.sum(axis=1)) % 2 == 1
        if around.any() and not kinds[around].any():
            around &= points_out[kind == k].all()
        body[k] = around.any()
    return body[kind.ravel()]


def _within(
    triangles: Triangles, places: Float[np.ndarray, "k 3"]
) -> tuple[Bool[np.ndarray, "k s"], Bool[np.ndarray, " k"]]:
    """Closed surfaces that places are in, and whether the faces of the smallest of them point out of it."""
    corners = triangles.reshape(-1, 3)
    sides = Sides(trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False))
    faces = np.flatnonzero(sides.closed)
    surface, which = np.unique(sides.surface[faces], return_inverse=True)
    low, high = np.full((len(surface), 3), np.inf), np.full((len(surface), 3), -np.inf)
    np.minimum.at(low, which, triangles[faces].min(axis=1))
    np.maximum.at(high, which, triangles[faces].max(axis=1))
    volume = np.bincount(which, np.linalg.det(triangles[faces] - low[which][:, None]) / 6, len(surface))
    place, body = np.nonzero(((places[:, None] > low) & (places[:, None] < high)).all(axis=2))
    inside, _ = sides.inside(places[place], surface[body])
    within = np.zeros((len(places), len(surface)), bool)
    within[place[inside], body[inside]] = True
    if not len(surface):
        return within, np.zeros(len(places), bool)
    innermost = np.where(within, np.abs(volume), np.inf).argmin(axis=1)
    return within, volume[innermost] > 0
