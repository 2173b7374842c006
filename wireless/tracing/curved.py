"""Paths that round posts and curved walls of a floor plan reflect, instead of the flat walls that stand for them.

Seen from above, a path of unfolded legs s1 and s2 meets a circle of radius a where both are at the same angle theta
from its normal. Across, neighbouring rays spread faster behind it than behind a flat wall, so that it is weaker by
    (s1 + s2) / (s1 + s2 + 2 s1 s2 / (a cos theta)),
geometrical optics, from far away an echo width of pi a cos(theta) times the reflected share of power. Heights change
as along any path. Walls, floor and ceiling may reflect before and after it, and walls be passed.

The legs are traced, by the plan's engine, to places around each arc (`wireless.geometry.arcs`), and count for the part
of the arc around that place; then the path is laid out exactly. What the flat walls of an arc reflect, or their corners
diffract, away from it is left out; what bends around it is not.

Left out: two arcs on a path, the inner side of curved walls, waves that creep around an arc.
Reference: McNamara, Pistorius and Malherbe, Introduction to the Uniform Geometrical Theory of Diffraction, 1990,
section 3.4.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim_support.compiled import compiled
from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION
from wireless.geometry.arcs import find_arcs
from wireless.geometry.array_types import Point, Points
from wireless.geometry.layers import Outline
from wireless.tracing.blocks import Rows
from wireless.tracing.scenes import PlanScene
from wireless.tracing.table import (
    Scratch,
    Setting,
    Table,
    make_scratch,
    make_table,
    weigh,
    with_room,
    write_row,
)

#: Places that legs are traced to are no farther apart than this [m, rad], and this far outside of the walls [m].
STEP_M, STEP_RAD, OFF_M = 0.2, np.pi / 8, 1e-3


class Pieces(NamedTuple):
    """Parts of arcs, each with a place that legs are traced to."""

    centre: Float[np.ndarray, "k 2"]
    radius_m: Float[np.ndarray, " k"]
    ends: Float[np.ndarray, "k 2 2"]
    """Unit vectors from the centre to both ends, counter-clockwise."""
    wall: Int[np.ndarray, " k"]
    """The wall nearest to its middle."""


class Legs(NamedTuple):
    """Chains from each place to each end of the paths."""

    start: Int[np.ndarray, " q1"]
    """Where those of place i and end j begin, at i * ends + j, and an end."""
    order: Int[np.ndarray, " l"]
    kind: Int[np.ndarray, "l m"]
    primitive: Int[np.ndarray, "l m"]
    """Walls met, from the place on, see `wireless.tracing.table.Table`."""


class CurvedWalls:
    """Paths over arcs in a floor plan."""

    def __init__(self, scene: PlanScene, snap_m: float):
        self.scene = scene
        walls = scene.extruded.walls - scene.origin[:2]
        self.arcs = find_arcs(walls, snap_m)
        self._arc = np.full(len(scene.setting.walls), -1)
        parts, places = [], []
        for number, arc in enumerate(self.arcs):
            self._arc[arc.walls] = number
            n = int(np.ceil(arc.turn_rad * max(1 / STEP_RAD, arc.radius_m / STEP_M) - 1e-9))
            angle = arc.from_rad + arc.turn_rad * np.linspace(0, 1, 2 * n + 1)
            out = np.column_stack([np.cos(angle), np.sin(angle)])
            place = arc.centre + (arc.radius_m + arc.off_m + OFF_M) * out[1::2]
            middle, half = walls[arc.walls].mean(axis=1), np.diff(walls[arc.walls], axis=1)[:, 0] / 2
            off = np.linalg.norm(place[:, None] - middle, axis=2) - np.linalg.norm(half, axis=1)
            wall = arc.walls[off.argmin(axis=1)]
            ends = np.stack([out[:-1:2], out[2::2]], axis=1)
            parts.append((np.tile(arc.centre, (n, 1)), np.full(n, arc.radius_m), ends, wall))
            places.append(place)
        if parts:
            self._pieces = Pieces(*map(np.concatenate, zip(*parts, strict=True)))
            self._places = np.concatenate(places)
        walls_of_edges = scene.outline.edge_walls
        self._arc_of_edge = np.where(
            self._arc[walls_of_edges[:, 0]] == self._arc[walls_of_edges[:, 1]],
            self._arc[walls_of_edges[:, 0]],
            -1,
        )
        most = max(scene.setting.max_reflections - 1, 0)
        self._legs = scene.limited(max_reflections=most, edge_reflections=-1, side_reflections=-1)

    def added(
        self,
        rows: Rows,
        tx: Float[np.ndarray, "n_tx 3"],
        rx: Float[np.ndarray, "n_rx 3"],
        keep: int,
        workers: int | None,
    ) -> Rows:
        """The paths of each link with those over arcs, the strongest of both."""
        setting = self.scene.setting
        if not self.arcs or setting.max_reflections < 1:
            return rows
        legs, unpaired = self._traced(np.concatenate([tx, rx]), workers), setting._replace(max_through=0)
        found: Rows = []
        for i, tables in enumerate(rows):
            new = _join(self.scene.outline, setting, unpaired, self._pieces, legs, tx, rx, i)
            found.append(
                [
                    (merged(self._without_arcs(t), _part(new, first, len(t.found)), keep), first)
                    for t, first in tables
                ]
            )
        return found

    def _traced(self, ends: Points, workers: int | None) -> Legs:
        """Legs from each place to all ends, without reflections by arcs."""
        height = (self.scene.extruded.low_m + self.scene.extruded.high_m) / 2
        places = np.column_stack([self._places, np.full(len(self._places), height)])
        tables = [table for row in self._legs.tables(places, ends, workers) for table, _ in row]
        order, kind, primitive = (
            np.concatenate([getattr(t, name) for t in tables]) for name in ("order", "kind", "primitive")
        )
        found = np.concatenate([t.found for t in tables])
        flat = ~((kind == REFLECTION) & (self._arc[primitive] >= 0)).any(axis=1)
        of = np.repeat(np.arange(len(found)), found)[flat]
        start = np.searchsorted(of, np.arange(len(found) + 1))
        return Legs(start, order[flat], kind[flat], primitive[flat])

    def _without_arcs(self, table: Table) -> Table:
        """A table without what flat walls of arcs reflect, and their corners diffract, away from the arc."""
        arc = np.full(table.kind.shape, -1)
        flat, bent = table.kind == REFLECTION, table.kind == DIFFRACTION
        arc[flat], arc[bent] = self._arc[table.primitive[flat]], self._arc_of_edge[table.primitive[bent]]
        row, j = np.nonzero(arc >= 0)
        centre = np.array([a.centre for a in self.arcs])[arc[row, j]]
        before, here, after = (table.point[row, j + k, :2] for k in range(3))
        ray, out = (
            step / np.linalg.norm(step, axis=1, keepdims=True) for step in (here - before, after - here)
        )
        away = ((out - ray) * (here - centre)).sum(axis=1) > 0
        return _chosen(table, ~np.isin(np.arange(len(table.power)), row[away]))


def merged(table: Table, new: Table, keep: int) -> Table:
    """The strongest paths of two tables of the same receivers."""
    of = np.concatenate([np.repeat(np.arange(len(t.found)), t.found) for t in (table, new)])
    columns = [np.concatenate(pair) for pair in zip(table[1:], new[1:], strict=True)]
    order = np.lexsort((-columns[0], of))
    of = of[order]
    rank = np.arange(len(of)) - np.searchsorted(of, of)
    order = order[rank < keep]
    return Table(np.minimum(table.found + new.found, keep), *(column[order] for column in columns))


def _chosen(table: Table, some: Bool[np.ndarray, " q"]) -> Table:
    """A table with some of its paths."""
    of = np.repeat(np.arange(len(table.found)), table.found)
    return Table(np.bincount(of[some], minlength=len(table.found)), *(column[some] for column in table[1:]))


def _part(table: Table, first: int, count: int) -> Table:
    """The table of some receivers in a row."""
    start = np.concatenate([[0], np.cumsum(table.found)])
    rows = slice(start[first], start[first + count])
    return Table(table.found[first : first + count], *(column[rows] for column in table[1:]))


@compiled
def _images(
    outline: Outline,
    setting: Setting,
    legs: Legs,
    leg: int,
    end: Point,
    image: Float[np.ndarray, "m1 3"],
) -> None:
    """Images of an end of a path: the last is itself, the first is what the place of a leg sees."""
    m = legs.order[leg]
    image[m] = end
    for j in range(m - 1, -1, -1):
        image[j] = image[j + 1]
        wall = legs.primitive[leg, j]
        if legs.kind[leg, j] != REFLECTION:
            continue
        if wall >= len(outline.wall_along):
            z = setting.low_m if wall == len(outline.wall_along) else setting.high_m
            image[j, 2] = 2 * z - image[j, 2]
            continue
        nx, ny = -outline.wall_along[wall, 1], outline.wall_along[wall, 0]
        off = (image[j, 0] - outline.wall_point[wall, 0]) * nx + (
            image[j, 1] - outline.wall_point[wall, 1]
        ) * ny
        image[j, 0] -= 2 * off * nx
        image[j, 1] -= 2 * off * ny


@compiled
def _tilt(
    ux: float, uy: float, centre: Float[np.ndarray, "2"], radius: float, tx: Point, rx: Point
) -> tuple[float, float]:
    """How much both ends are to the left of a normal of a circle, and the least cosine of both from it."""
    px, py = centre[0] + radius * ux, centre[1] + radius * uy
    ax, ay, bx, by = tx[0] - px, tx[1] - py, rx[0] - px, rx[1] - py
    a, b = np.hypot(ax, ay), np.hypot(bx, by)
    left = (uy * -ax + ux * ay) / a + (uy * -bx + ux * by) / b
    return left, min((ax * ux + ay * uy) / a, (bx * ux + by * uy) / b)


@compiled
def _mirror(pieces: Pieces, k: int, tx: Point, rx: Point, normal: Float[np.ndarray, "2"]) -> float:
    """Set the normal where a piece reflects from one point to another; its cosine from both, 0 if it does not."""
    centre, radius, ends = pieces.centre[k], pieces.radius_m[k], pieces.ends[k]
    fx, fy, tx_, ty_ = ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1]
    if _tilt(fx, fy, centre, radius, tx, rx)[0] < 0 or _tilt(tx_, ty_, centre, radius, tx, rx)[0] >= 0:
        return 0.0
    for _ in range(50):
        mx, my = fx + tx_, fy + ty_
        size = np.hypot(mx, my)
        mx, my = mx / size, my / size
        if _tilt(mx, my, centre, radius, tx, rx)[0] >= 0:
            fx, fy = mx, my
        else:
            tx_, ty_ = mx, my
    normal[0], normal[1] = fx, fy
    return max(_tilt(fx, fy, centre, radius, tx, rx)[1], 0.0)


@compiled
def _meet(
    outline: Outline,
    setting: Setting,
    legs: Legs,
    leg: int,
    j: int,
    before: Point,
    image: Point,
    at: int,
    scratch: Scratch,
) -> None:
    """Put interaction j of a leg, on the line from the point before it to an image, at a place of a path."""
    wall, point = legs.primitive[leg, j], scratch.point[at + 1]
    scratch.kind[at], scratch.primitive[at], scratch.walls[at] = legs.kind[leg, j], wall, setting.walls[wall]
    normal = scratch.normal[at]
    normal[:] = 0.0
    if wall >= len(outline.wall_along):
        normal[2] = 1.0
        a = before[2] - (setting.low_m if wall == len(outline.wall_along) else setting.high_m)
        b = image[2] - before[2] + a
    else:
        normal[0], normal[1] = -outline.wall_along[wall, 1], outline.wall_along[wall, 0]
        x, y = outline.wall_point[wall]
        a = (before[0] - x) * normal[0] + (before[1] - y) * normal[1]
        b = (image[0] - x) * normal[0] + (image[1] - y) * normal[1]
    f = a / (a - b) if a != b else 0.0
    for i in range(3):
        point[i] = before[i] + f * (image[i] - before[i])


@compiled
def _lay(
    outline: Outline,
    setting: Setting,
    pieces: Pieces,
    k: int,
    legs: Legs,
    leg: tuple[int, int],
    images: Float[np.ndarray, "2 m1 3"],
    scratch: Scratch,
) -> tuple[int, float]:
    """Lay a path over a piece; its number of interactions, -1 for none, and its power over that of a flat wall."""
    normal, seen = np.empty(2), (images[0, 0], images[1, 0])
    cosine, radius = _mirror(pieces, k, seen[0], seen[1], normal), pieces.radius_m[k]
    if cosine <= 0.0:
        return -1, 0.0
    before, after = legs.order[leg[0]], legs.order[leg[1]]
    here = scratch.point[before + 1]
    here[:2] = pieces.centre[k] + radius * normal
    s = np.hypot(seen[0][0] - here[0], seen[0][1] - here[1])
    t = np.hypot(seen[1][0] - here[0], seen[1][1] - here[1])
    here[2] = (seen[0][2] * t + seen[1][2] * s) / (s + t)
    if not setting.low_m <= here[2] <= setting.high_m:
        return -1, 0.0
    scratch.kind[before], scratch.primitive[before] = REFLECTION, pieces.wall[k]
    scratch.walls[before] = setting.walls[pieces.wall[k]]
    scratch.normal[before, :2], scratch.normal[before, 2] = normal, 0.0
    for j in range(before):
        at = before - 1 - j
        _meet(outline, setting, legs, leg[0], j, scratch.point[at + 2], images[0, j], at, scratch)
    for j in range(after):
        at = before + 1 + j
        _meet(outline, setting, legs, leg[1], j, scratch.point[at], images[1, j], at, scratch)
    m = before + 1 + after
    scratch.point[0], scratch.point[m + 1] = images[0, before], images[1, after]
    return m, (s + t) / (s + t + 2 * s * t / (radius * cosine))


@compiled
def _is_within(setting: Setting, legs: Legs, leg: tuple[int, int]) -> bool:
    """Whether a path of two legs has no more reflections and passes no more walls than it may."""
    flat, through = 1, 0
    for one in leg:
        for j in range(legs.order[one]):
            flat += legs.kind[one, j] == REFLECTION
            through += legs.kind[one, j] == TRANSMISSION
    return (
        flat <= setting.max_reflections
        and through <= setting.max_walls
        and flat + through <= setting.max_interactions
    )


@compiled
def _join(
    outline: Outline,
    setting: Setting,
    unpaired: Setting,
    pieces: Pieces,
    legs: Legs,
    tx: Float[np.ndarray, "n_tx 3"],
    rx: Float[np.ndarray, "n_rx 3"],
    number: int,
) -> Table:
    """Paths over arcs from one of the transmitters to all receivers, in no order.

    Legs list one face of each passed wall, so that none are left to be paired (`unpaired`).
    """
    table, scratch, row = make_table(setting, len(rx), len(rx)), make_scratch(setting), 0
    images, n = np.empty((2, legs.kind.shape[1] + 1, 3)), len(tx) + len(rx)
    for r in range(len(rx)):
        first = row
        for k in range(len(pieces.wall)):
            a, b = k * n + number, k * n + len(tx) + r
            for i in range(legs.start[a], legs.start[a + 1]):
                _images(outline, setting, legs, i, tx[number], images[0])
                for j in range(legs.start[b], legs.start[b + 1]):
                    if not _is_within(setting, legs, (i, j)):
                        continue
                    _images(outline, setting, legs, j, rx[r], images[1])
                    m, share = _lay(outline, setting, pieces, k, legs, (i, j), images, scratch)
                    if m < 0:
                        continue
                    length, power = weigh(unpaired, m, 1.0, scratch)
                    if length < 0:
                        continue
                    scratch.gain[:] *= np.sqrt(share)
                    table = with_room(setting, table, row + 1)
                    write_row(table, row, length, power * share, m, scratch)
                    row += 1
        table.found[r] = row - first
    return table
