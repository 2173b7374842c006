"""Points of a path in a floor plan or in storeys, from the parts that it is made of.

Seen from above a path is unfolded into a straight line, along which the height changes evenly; floor and ceiling of a
plan fold the height only. At the rim of a slab the parts before and behind it are unfolded about the rim, which gives
the point of the rim (Keller's law) that both ends must see; each part rises or falls evenly.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float, Int

from robosim.support.compiled import compiled
from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION
from wireless.geometry.array_types import FlatPoint
from wireless.geometry.layers import Outline
from wireless.geometry.plan import NEAR_M
from wireless.tracing.table import Scratch, Setting


class Link(NamedTuple):
    """A transmitter, a receiver, and what each sees."""

    tx: Float[np.ndarray, "3"]
    rx: Float[np.ndarray, "3"]
    image: Float[np.ndarray, "b 2"]
    """Images of the transmitter, see `wireless.geometry.visibility.Visibility`."""
    chain: Int[np.ndarray, "b 5"]
    far_image: Float[np.ndarray, "d 2"]
    """Images of the receiver."""
    far_chain: Int[np.ndarray, "d 5"]


#: Elements of a path, as numbers: view of the transmitter, edge (corners, then rims; -1 for none), view of the
#: receiver, and reflections at floor and ceiling (positive if the ceiling comes first, negative for the floor).
Parts = Int[np.ndarray, "4"]


@compiled
def edge_sight(outline: Outline, edge: int, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Place along an edge, distance from its line and angle from its 0-face of a point; distance -1 if within a wedge.

    The place is 0 along a corner.
    """
    point, wedge = outline.edge_point, outline.edge_wedge
    dx, dy, dz = x - point[edge, 0], y - point[edge, 1], z - point[edge, 2]
    if edge < outline.n_corners:
        ax, ay = wedge[edge, 1, 0], wedge[edge, 1, 1]
        angle = np.arctan2(ax * dy - ay * dx, ax * dx + ay * dy)
        return 0.0, np.hypot(dx, dy), angle if angle >= 0 else angle + 2 * np.pi
    along = dx * wedge[edge, 0, 0] + dy * wedge[edge, 0, 1] + dz * wedge[edge, 0, 2]
    a = dx * wedge[edge, 1, 0] + dy * wedge[edge, 1, 1] + dz * wedge[edge, 1, 2]
    b = dx * wedge[edge, 2, 0] + dy * wedge[edge, 2, 1] + dz * wedge[edge, 2, 2]
    distance, angle = np.hypot(a, b), np.arctan2(b, a) % (2 * np.pi)
    near = NEAR_M / max(distance, NEAR_M)
    if distance < NEAR_M or outline.edge_gap_rad[edge] + near < angle < 2 * np.pi - near:
        return along, -1.0, angle
    return along, distance, angle


@compiled
def _edge_point(outline: Outline, link: Link, parts: Parts) -> tuple[float, float, float]:
    """Where a path meets its edge, a rim by Keller's law; the height of a corner is 0."""
    node, edge, far_node, point = parts[0], parts[1], parts[2], outline.edge_point
    if edge < outline.n_corners:
        return point[edge, 0], point[edge, 1], 0.0
    image, far, wedge = link.image, link.far_image, outline.edge_wedge
    near_s, before, _ = edge_sight(outline, edge, image[node, 0], image[node, 1], link.tx[2])
    far_s, after, _ = edge_sight(outline, edge, far[far_node, 0], far[far_node, 1], link.rx[2])
    s = (near_s * after + far_s * before) / (before + after)
    x, y = point[edge, 0] + s * wedge[edge, 0, 0], point[edge, 1] + s * wedge[edge, 0, 1]
    return x, y, point[edge, 2] + s * wedge[edge, 0, 2]


@compiled
def _mirror_point(outline: Outline, wall: int, image: FlatPoint, tx: float, ty: float) -> tuple[float, float]:
    """Where the line from an image to a target meets the wall it was mirrored at."""
    nx, ny = -outline.wall_along[wall, 1], outline.wall_along[wall, 0]
    px, py = outline.wall_point[wall, 0], outline.wall_point[wall, 1]
    a = (image[0] - px) * nx + (image[1] - py) * ny
    b = (tx - px) * nx + (ty - py) * ny
    f = a / (a - b) if a != b else 1.0
    return image[0] + (tx - image[0]) * f, image[1] + (ty - image[1]) * f


@compiled
def _lay_flat(outline: Outline, link: Link, parts: Parts, x: float, y: float, scratch: Scratch) -> int:
    """Points of a path seen from above, which meets its edge, or ends, at (x, y); its number of interactions."""
    flat, kind, primitive = scratch.flat, scratch.flat_kind, scratch.flat_primitive
    image, chain, node, edge, far_node = link.image, link.chain, parts[0], parts[1], parts[2]
    n = chain[node, 2] + chain[node, 3]
    if edge >= 0:
        flat[n + 1, 0], flat[n + 1, 1] = x, y
        kind[n], primitive[n] = DIFFRACTION, edge
    cx, cy = x, y
    for j in range(n, 0, -1):
        x, y = _mirror_point(outline, chain[node, 0], image[node], x, y)
        flat[j, 0], flat[j, 1] = x, y
        kind[j - 1], primitive[j - 1] = TRANSMISSION if chain[node, 4] else REFLECTION, chain[node, 0]
        node = chain[node, 1]
    if edge >= 0:
        image, chain, n = link.far_image, link.far_chain, n + 1
        x, y = cx, cy
        while chain[far_node, 1] >= 0:
            x, y = _mirror_point(outline, chain[far_node, 0], image[far_node], x, y)
            flat[n + 1, 0], flat[n + 1, 1] = x, y
            kind[n], primitive[n] = TRANSMISSION if chain[far_node, 4] else REFLECTION, chain[far_node, 0]
            far_node = chain[far_node, 1]
            n += 1
    flat[0, 0], flat[0, 1] = link.tx[0], link.tx[1]
    flat[n + 1, 0], flat[n + 1, 1] = link.rx[0], link.rx[1]
    return n


@compiled
def _take_wall(
    wall_along: Float[np.ndarray, "n 2"],
    setting_walls: Complex[np.ndarray, "n l"],
    wall: int,
    normal: Float[np.ndarray, "m 3"],
    walls: Complex[np.ndarray, "m l"],
    m: int,
) -> None:
    """Copy normal and layers of a wall to those of interaction m."""
    normal[m, 0], normal[m, 1], normal[m, 2] = -wall_along[wall, 1], wall_along[wall, 0], 0.0
    for k in range(setting_walls.shape[1]):
        walls[m, k] = setting_walls[wall, k]


@compiled
def _raise_flat(
    outline: Outline, setting: Setting, tx_z: float, rx_z: float, n: int, bounce: int, scratch: Scratch
) -> int:
    """Give heights to the n interactions of a flat path and fold them at floor and ceiling; new number."""
    # Positive `bounce`: the ceiling comes first; negative: the floor.
    flat, point = scratch.flat, scratch.point
    height = setting.high_m - setting.low_m
    z = tx_z - setting.low_m
    end = rx_z - setting.low_m
    if bounce % 2:
        end = height - end
    end += bounce * height
    total = 0.0
    for j in range(n + 1):
        total += np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
    point[0, 0], point[0, 1], point[0, 2] = flat[0, 0], flat[0, 1], tx_z
    m, done, done_m = 0, 0, 0.0
    for j in range(n + 1):
        step = np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
        until = (done_m + step) / total if total > 0 else 1.0
        if j == n:
            until = 1.0
        since = done_m / total if total > 0 else 0.0
        while done < abs(bounce):
            level = (done + 1) * height if bounce > 0 else -done * height
            at = (level - z) / (end - z)
            if at > until:
                break
            fraction = min(max((at - since) / (until - since), 0.0), 1.0) if until > since else 0.0
            up = (done % 2 == 0) == (bounce > 0)
            for i in range(2):
                point[m + 1, i] = flat[j, i] + fraction * (flat[j + 1, i] - flat[j, i])
            point[m + 1, 2] = setting.high_m if up else setting.low_m
            scratch.kind[m], scratch.primitive[m] = REFLECTION, len(setting.walls) - (1 if up else 2)
            scratch.normal[m, 0], scratch.normal[m, 1], scratch.normal[m, 2] = 0.0, 0.0, 1.0
            scratch.walls[m] = setting.walls[scratch.primitive[m]]
            m += 1
            done += 1
        done_m += step
        if j == n:
            break
        level = z + until * (end - z)
        folds = np.floor(level / height) if bounce != 0 else 0.0
        level -= folds * height
        if folds % 2 != 0:
            level = height - level
        point[m + 1, 0], point[m + 1, 1], point[m + 1, 2] = (
            flat[j + 1, 0],
            flat[j + 1, 1],
            setting.low_m + level,
        )
        kind, primitive = scratch.flat_kind[j], scratch.flat_primitive[j]
        scratch.kind[m], scratch.primitive[m] = kind, primitive
        if kind != DIFFRACTION:
            _take_wall(outline.wall_along, setting.walls, primitive, scratch.normal, scratch.walls, m)
        m += 1
    point[m + 1, 0], point[m + 1, 1], point[m + 1, 2] = flat[n + 1, 0], flat[n + 1, 1], rx_z
    return m


@compiled
def _raise_to_rim(
    outline: Outline, setting: Setting, link: Link, edge_at: int, z: float, n: int, scratch: Scratch
) -> None:
    """Give heights to the n interactions of a flat path, the edge at height z among them; each part rises evenly."""
    flat, point = scratch.flat, scratch.point
    for half in range(2):
        first, last = (0, edge_at + 1) if half == 0 else (edge_at + 1, n + 1)
        low, high = (link.tx[2], z) if half == 0 else (z, link.rx[2])
        total, done_m = 0.0, 0.0
        for j in range(first, last):
            total += np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
        point[first, 0], point[first, 1], point[first, 2] = flat[first, 0], flat[first, 1], low
        for j in range(first, last):
            done_m += np.hypot(flat[j + 1, 0] - flat[j, 0], flat[j + 1, 1] - flat[j, 1])
            share = done_m / total if total > 0 else 1.0
            point[j + 1, 0], point[j + 1, 1] = flat[j + 1, 0], flat[j + 1, 1]
            point[j + 1, 2] = low + share * (high - low) if j + 1 < last else high
    for j in range(n):
        kind, primitive = scratch.flat_kind[j], scratch.flat_primitive[j]
        scratch.kind[j], scratch.primitive[j] = kind, primitive
        if kind != DIFFRACTION:
            _take_wall(outline.wall_along, setting.walls, primitive, scratch.normal, scratch.walls, j)


@compiled
def lay_path(outline: Outline, setting: Setting, link: Link, parts: Parts, scratch: Scratch) -> int:
    """Put a path into `scratch`; its number of interactions."""
    x, y, z = link.rx[0], link.rx[1], 0.0
    if parts[1] >= 0:
        x, y, z = _edge_point(outline, link, parts)
    n = _lay_flat(outline, link, parts, x, y, scratch)
    if parts[1] < outline.n_corners:
        return _raise_flat(outline, setting, link.tx[2], link.rx[2], n, parts[3], scratch)
    edge_at = link.chain[parts[0], 2] + link.chain[parts[0], 3]
    _raise_to_rim(outline, setting, link, edge_at, z, n, scratch)
    return n
