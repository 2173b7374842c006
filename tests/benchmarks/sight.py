"""Whether two points see each other: double precision against Embree, rates and wrong answers.

Segments are those a tracer asks about: from corners, and from points of walls (legs of reflections), to
receivers, at any heights. The judge is brute force in double precision, on candidates that GEOS finds within
`NEAR_M` of a segment: where a wall is crossed, or missed, by a clear margin the answer is certain; segments
that pass an end of a wall closer than that are left out. So whatever is counted as wrong is wrong.

Embree works in single precision, and is given the start and end of each segment as they are, or moved by
0.1 mm into the segment, which is the usual cure for walls that hide what lies on them. All is asked again
10 km from the origin.

Left out: other ray engines; robust mode, which embreex does not offer.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import TypeVar

import numpy as np
import shapely
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int8

from robosim.building.building import Building
from wireless.geometry.layers import one_storey
from wireless.geometry.occlusion import hidden_each, make_tree
from wireless.geometry.plan import Locator, make_plan
from wireless.geometry.view_steps import Limits
from wireless.tracing.plan_engine import views_of

#: What comes closer to hiding or not hiding than this is not judged [m].
NEAR_M = 1e-6
#: Where scenes are asked about again [m].
FAR_M = 10_000.0
#: How far Embree's segments are shortened at both ends [m].
SHIFT_M = 1e-4
#: Snapping distance of the plan whose views are timed [m].
_SNAP_M = 1e-6


Answer = TypeVar("Answer")


@dataclass(frozen=True, eq=False)
class Segments:
    """What is asked about."""

    start: Float[np.ndarray, "n 3"]
    """Corners and points of walls [m]."""
    stop: Float[np.ndarray, "n 3"]
    """Receivers [m]."""


def draw_segments(building: Building, count: int, rng: np.random.Generator) -> Segments:
    """Segments that leave walls into free space: half from corners, half from anywhere on a wall.

    Args:
        building: Where they are.
        count: About how many.
        rng: Draws walls, heights and receivers.
    """
    walls, height = building.walls_2d, building.height_m
    wall, share = rng.integers(len(walls), size=2 * count), rng.uniform(size=(2 * count, 1))
    share[::2] = 0.0
    start = walls[wall, 0] + share * (walls[wall, 1] - walls[wall, 0])
    low, high = np.array(building.free.bounds).reshape(2, 2)
    spots = rng.uniform(low, high, (4 * count, 2))
    spots = spots[shapely.contains_xy(building.free.buffer(-0.01), spots)]
    stop = spots[rng.integers(len(spots), size=2 * count)]
    z = rng.uniform(0.1 * height, 0.9 * height, (2 * count, 2))
    way = stop - start
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    into_the_open = shapely.contains_xy(building.free, start + 10 * NEAR_M * way)
    chosen = np.flatnonzero(into_the_open)[:count]
    return Segments(np.column_stack([start, z[:, 0]])[chosen], np.column_stack([stop, z[:, 1]])[chosen])


def judge(walls: Float[np.ndarray, "w 2 2"], segments: Segments) -> Int8[np.ndarray, " n"]:
    """1 for certainly hidden, 0 for certainly seen, -1 for too close to say."""
    p, q = segments.start[:, :2], segments.stop[:, :2]
    tree = shapely.STRtree(shapely.linestrings(walls))
    lines = shapely.linestrings(np.stack([p, q], axis=1))
    i, w = tree.query(lines, predicate="dwithin", distance=2 * NEAR_M)
    own = shapely.distance(shapely.points(p[i]), tree.geometries[w]) < NEAR_M
    i, w = i[~own], w[~own]  # it starts there and leaves into free space
    a, b = walls[w, 0], walls[w, 1]
    sides = [_off(a, b, p[i]), _off(a, b, q[i]), _off(p[i], q[i], a), _off(p[i], q[i], b)]
    clear = np.min(np.abs(sides), axis=0) > NEAR_M
    crossed = (sides[0] * sides[1] < 0) & (sides[2] * sides[3] < 0) & clear
    missed = (sides[0] * sides[1] > 0) | (sides[2] * sides[3] > 0)
    answer = np.zeros(len(p), np.int8)
    answer[i[~(missed & clear)]] = -1
    answer[i[crossed]] = 1
    return answer


def _off(
    a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"], p: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """Distance of points from lines, positive on the left."""
    way, to = b - a, p - a
    return (way[:, 0] * to[:, 1] - way[:, 1] * to[:, 0]) / np.linalg.norm(way, axis=1)


def compare(building: Building, *, count: int, seed: int) -> list[dict[str, object]]:
    """Ask all engines about the same segments: a row for each engine, with its rate and wrong answers.

    Args:
        building: Whose walls hide; furniture must reach the ceiling.
        count: About how many segments.
        seed: Of the drawn segments.
    """
    segments = draw_segments(building, count, np.random.default_rng(seed))
    truth = judge(building.walls_2d, segments)
    sure = truth >= 0
    triangle = np.asarray(building.submesh("wall", "furniture").triangles, float)
    rows: list[dict[str, object]] = []
    for name, prepare in _ENGINES.items():
        row: dict[str, object] = {"engine": name, "segments": int(sure.sum()), "unsure": int((~sure).sum())}
        for where, shift in (("here", 0.0), ("far", FAR_M)):
            move = np.array([shift, shift, 0.0])
            ask = prepare(triangle + move, segments.start + move, segments.stop + move)
            seconds, hidden = min((_timed(ask) for _ in range(3)), key=lambda pair: pair[0])
            row[f"wrong_{where}"] = int((hidden[sure] != (truth[sure] == 1)).sum())
            row[f"segments_per_s_{where}"] = len(truth) / seconds
        rows.append(row)
    return rows


def _timed(ask: Callable[[], Answer]) -> tuple[float, Answer]:
    begin = perf_counter()
    answer = ask()
    return perf_counter() - begin, answer


def _double(triangle: np.ndarray, p: np.ndarray, q: np.ndarray) -> Callable[[], Bool[np.ndarray, " n"]]:
    """Our box tree."""
    tree = make_tree(triangle)
    hidden_each(tree, p[:1], q[:1])  # compiles
    return lambda: hidden_each(tree, p, q)


def _embree(
    triangle: np.ndarray, p: np.ndarray, q: np.ndarray, shift_m: float = 0.0
) -> Callable[[], Bool[np.ndarray, " n"]]:
    """Embree's query for any hit, segments converted beforehand."""
    scene = EmbreeScene()
    TriangleMesh(scene, triangle.astype(np.float32))  # enters itself into the scene
    way = q - p
    length = np.linalg.norm(way, axis=1)
    way /= length[:, None]
    origin, along = (p + shift_m * way).astype(np.float32), way.astype(np.float32)
    reach = (length - 2 * shift_m).astype(np.float32)

    def ask() -> Bool[np.ndarray, " n"]:
        return np.asarray(scene.run(origin, along, reach, query="OCCLUDED")) != -1

    return ask


def _embree_shifted(triangle: np.ndarray, p: np.ndarray, q: np.ndarray) -> Callable[[], np.ndarray]:
    return _embree(triangle, p, q, SHIFT_M)


_ENGINES: dict[str, Callable[[np.ndarray, np.ndarray, np.ndarray], Callable[[], np.ndarray]]] = {
    "box tree, float64": _double,
    "Embree, as it is": _embree,
    "Embree, ends moved 0.1 mm": _embree_shifted,
}


def rate_of_views(building: Building, *, receivers: int, seed: int) -> float:
    """Pairs of corner and receiver that views through the triangulated plan decide, per second, one thread.

    Args:
        building: Where.
        receivers: How many, drawn from free space.
        seed: Of the receivers.
    """
    plan = make_plan(building.walls_2d, _SNAP_M)
    low, high = np.array(building.free.bounds).reshape(2, 2)
    spots = np.random.default_rng(seed).uniform(low, high, (8 * receivers, 2))
    spots = spots[shapely.contains_xy(building.free, spots)][:receivers] - plan.origin
    around = Locator(plan, 2 * _SNAP_M)(spots)
    points, layers = np.column_stack([spots, np.ones(len(spots))]), one_storey(plan, 0.0, building.height_m)
    limits = Limits(target_order=-1, edge_order=0, max_through=0, most_visits=0, span_m=np.zeros((2, 2)))
    views_of(layers, points, *around, limits)
    seconds = min(_timed(lambda: views_of(layers, points, *around, limits))[0] for _ in range(3))
    return len(spots) * len(plan.corner_vertex) / seconds
