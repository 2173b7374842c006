"""Why terminals in a scene have no paths: they are inside of a solid, or below the ground.

A terminal is enclosed if rays to all sides meet a surface, so that openings of less than a thousandth of all directions
count as closed. Enclosed terminals are compared by the closed surfaces around them (see
`wireless.geometry.closed_surfaces`).
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.ray_casting import make_ray_scene
from wireless.geometry.closed_surfaces import Sides, capped
from wireless.geometry.shooting import directions
from wireless.tracing.mitsuba_scene import MitsubaScene

#: Rays of a terminal besides those up and down, receivers that are looked at, and shapes that are named.
_RAYS, _MOST_RECEIVERS, _MOST_NAMES = 2000, 32, 3


def explain_missing_paths(
    scene: MitsubaScene,
    tx: Float[np.ndarray, "3"],
    rx: Float[np.ndarray, "n 3"],
    reached: Bool[np.ndarray, " n"],
) -> str:
    """Return why half of the receivers [m] or more, those not `reached`, have no path from a transmitter [m].

    The text is a line; empty where geometry does not show the reason: terminals on one side of all surfaces may need
    more reflections than are traced.
    """
    missed = rx[~reached]
    if not len(missed) or 2 * len(missed) < len(rx):
        return ""
    sample = missed[np.linspace(0, len(missed) - 1, min(len(missed), _MOST_RECEIVERS)).astype(int)]
    points = np.vstack([tx, sample])
    hit, (inside, surface) = _first_faces(scene, points), _surfaces_around(scene, points)
    is_enclosed: Bool[np.ndarray, " n"] = np.all(hit >= 0, axis=1)
    is_below = (hit[:, -2] >= 0) & (hit[:, -1] < 0)
    around_tx, around_rx = inside[0] & ~inside[1:].any(axis=0), inside[1:] & ~inside[0]
    sender = f"the transmitter at ({', '.join(f'{value:g}' for value in tx)}) m"
    receivers = "the receiver lies" if len(rx) == 1 else f"all {len(rx)} receivers lie"
    if is_enclosed[0] and (around_tx.any() or not is_enclosed[1:].any()):
        shapes = _names(scene, hit[:1], np.isin(surface, np.flatnonzero(around_tx)))
        limit = "only receivers in it have paths" if reached.any() else "no path can leave it"
        return f"{sender} lies inside {shapes}: {limit}. Move it into free space."
    if reached.any():
        return ""
    if is_enclosed[1:].all() and (not is_enclosed[0] or around_rx.any(axis=1).all()):
        shapes = _names(scene, hit[1:], np.isin(surface, np.flatnonzero(around_rx.any(axis=0))))
        return f"{receivers} inside {shapes}: no path can enter. Move receivers into free space."
    if is_below[0] and (hit[1:, -1] >= 0).all():
        return f"{sender} lies below the ground: above it is {_names(scene, hit[:1, -2])}, below it nothing."
    if is_below[1:].all() and hit[0, -1] >= 0:
        return f"{receivers} below the ground: above is {_names(scene, hit[1:, -2])}, below nothing."
    return ""


def _first_faces(scene: MitsubaScene, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n r"]:
    """Face that each ray from points meets first, -1 for none; the last two rays point up and down."""
    centre = scene.mesh.bounds.mean(axis=0)
    ray = np.vstack([directions(_RAYS), [[0, 0, 1], [0, 0, -1]]]).astype(np.float32)
    start = np.repeat((points - centre).astype(np.float32), len(ray), axis=0)
    hit = make_ray_scene(scene.mesh.triangles - centre).run(start, np.tile(ray, (len(points), 1)))
    return np.asarray(hit, np.int64).reshape(len(points), -1)


def _surfaces_around(
    scene: MitsubaScene, points: Float[np.ndarray, "n 3"]
) -> tuple[Bool[np.ndarray, "n s"], Int[np.ndarray, " f"]]:
    """Whether points are inside of each surface, open ones together as the first, and the surface of each face."""
    sides = Sides(capped(scene.mesh))
    closed, number = np.unique(np.where(sides.closed, sides.surface, -1), return_inverse=True)
    at = np.repeat(points - scene.mesh.bounds.mean(axis=0), len(closed), axis=0)
    inside, _ = sides.inside(at, np.tile(closed, len(points)))
    return inside.reshape(len(points), -1) & (closed >= 0), number[: len(scene.mesh.faces)]


def _names(
    scene: MitsubaScene, hit: Int[np.ndarray, "..."], around: Bool[np.ndarray, " f"] | None = None
) -> str:
    """Names of the shapes whose faces are around a terminal, or, where none is known to be, that its rays meet."""
    faces = hit[hit >= 0].ravel() if around is None or not around.any() else np.flatnonzero(around)
    shape = np.repeat(np.arange(len(scene.shapes)), [n for _, n, _ in scene.shapes])[faces]
    count = np.bincount(shape, minlength=len(scene.shapes))
    names = [scene.shapes[i][0] for i in np.argsort(-count, kind="stable") if count[i]]
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return f"shape{'s' if len(names) > 1 else ''} {', '.join(names[:_MOST_NAMES])}{more}"
