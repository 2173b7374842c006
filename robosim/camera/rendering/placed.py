"""Surfaces of placed meshes as patches to be coloured: small triangles that share no corners.

Long sides are halved until none is longer than a limit, in both triangles that meet there, so that no crack opens
between them. Sheets, which cameras may see from either side, come twice, once with each front.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from robosim.building.extrusion import PLACED
from robosim.camera.rendering.tessellation import Patches
from robosim.plans.furnishings.furnishing import Furnishing

#: Meshes of more triangles are not cut.
_ENOUGH = 20_000


def placed_patches(
    furnishings: Sequence[Furnishing], *, step_m: float
) -> tuple[Patches, Float[np.ndarray, "n 3"]]:
    """Patches of placed meshes, and the colour of each of their corners.

    Args:
        furnishings: What is placed, at least one.
        step_m: Longest side of a patch [m], but for meshes of many triangles.
    """
    triangles, colours = [], []
    for one in furnishings:
        bodies = one.bodies
        fronts = bodies.vertices[bodies.faces]
        backs = fronts[~bodies.oriented[bodies.body]][:, ::-1]
        both = np.concatenate([fronts, backs])
        cut = both if len(both) > _ENOUGH else _cut(both, step_m)
        triangles.append(cut)
        colours.append(np.tile(np.array(one.colour, float), (3 * len(cut), 1)))
    corners = np.concatenate(triangles)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    inward = corners.mean(axis=1, keepdims=True) - corners
    inward /= np.maximum(np.linalg.norm(inward, axis=2, keepdims=True), 1e-300)
    n = corners.shape[0] * 3
    patches = Patches(
        vertices=corners.reshape(-1, 3),
        normals=np.repeat(normal, 3, axis=0),
        inward=inward.reshape(-1, 3),
        kind=np.full(n, PLACED, np.uint8),
        cell=np.zeros((n, 2), int),
        row=np.zeros(n, int),
        source=np.zeros(n, int),
        faces=np.arange(n).reshape(-1, 3),
    )
    return patches, np.concatenate(colours)


def _cut(triangles: Float[np.ndarray, "n 3 3"], step_m: float) -> Float[np.ndarray, "m 3 3"]:
    """Triangles without sides longer than a step."""
    done = []
    while len(triangles):
        long = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2) > step_m
        count = long.sum(axis=1)
        done.append(triangles[count == 0])
        parts = []
        for n_long in (1, 2, 3):
            some, which = triangles[count == n_long], long[count == n_long]
            # Turned so that long sides come first: a to b, and b to c.
            first = {
                1: np.argmax(which, axis=1),
                2: np.argmin(which, axis=1) + 1,
                3: np.zeros(len(some), int),
            }
            order = (first[n_long][:, None] + np.arange(3)) % 3
            a, b, c = np.take_along_axis(some, order[:, :, None], axis=1).transpose(1, 0, 2)
            ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
            pieces = {
                1: [(a, ab, c), (ab, b, c)],
                2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
                3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
            }
            parts += [np.stack(piece, axis=1) for piece in pieces[n_long]]
        triangles = np.concatenate(parts)
    return np.concatenate(done)
