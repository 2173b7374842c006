"""Paths that round posts and curved walls of a floor plan reflect, instead of the flat walls that stand for them.

Seen from above, a path of unfolded legs s1 and s2 meets a circle of radius a where both are at the same angle theta
from its normal. Across, neighbouring rays spread faster behind it than behind a flat wall, so that it is weaker by
    (s1 + s2) / (s1 + s2 + 2 s1 s2 / (a cos theta)),
geometrical optics, from far away an echo width of pi a cos(theta) times the reflected share of power. Heights change
as along any path. Walls, floor and ceiling may reflect before and after it, and walls be passed.

The legs are traced, by the plan's engine, to places around each arc (`wireless.geometry.arcs`), and count for the part
of the arc around that place; then the path is laid out exactly. What the flat walls of an arc reflect, or their corners
diffract, away from it is left out; paths diffracted around it are not.

Left out: two arcs on a path, the inner side of curved walls, waves that creep around an arc.
Reference: McNamara, Pistorius and Malherbe, Introduction to the Uniform Geometrical Theory of Diffraction, 1990,
section 3.4.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from robosim.support.compiled import compiled
from wireless.em.fields import DIFFRACTION, REFLECTION, TRANSMISSION
from wireless.geometry.arcs import find_arcs
from wireless.geometry.array_types import Point, Points
from wireless.tracing.blocks import Rows
from wireless.tracing.scenes import PlanScene
from wireless.tracing.table import (
    Scratch,
    Setting,
    Table,
    chosen,
    make_scratch,
    make_table,
    merged,
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
    from_rad: Float[np.ndarray, " k"]
    """Direction from the centre to one end."""
    to_rad: Float[np.ndarray, " k"]
    """And to the other, counter-clockwise."""
    wall: Int[np.ndarray, " k"]
    """The wall nearest to its middle."""


class Legs(NamedTuple):
    """Chains from each place to each end of the paths."""

    start: Int[np.ndarray, " q1"]
    """Where those of place i and end j begin, at i * ends + j, and an end."""
    order: Int[np.ndarray, " l"]
    through: Int[np.ndarray, " l"]
    """How many walls are passed; the other interactions are reflections."""
    kind: Int[np.ndarray, "l m"]
    wall: Int[np.ndarray, "l m"]
    """Walls met, from the place on; floor and ceiling after the last."""


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
            out = np.column_stack([np.cos(angle), np.sin(angle)])[1::2]
            place = arc.centre + (arc.radius_m + arc.off_m + OFF_M) * out
            middle, half = walls[arc.walls].mean(axis=1), np.diff(walls[arc.walls], axis=1)[:, 0] / 2
            off = np.linalg.norm(place[:, None] - middle, axis=2) - np.linalg.norm(half, axis=1)
            parts.append(
                (
                    np.tile(arc.centre, (n, 1)),
                    np.full(n, arc.radius_m),
                    angle[:-1:2],
                    angle[2::2],
                    arc.walls[off.argmin(axis=1)],
                )
            )
            places.append(place)
        if parts:
            self._pieces = Pieces(*map(np.concatenate, zip(*parts, strict=True)))
            self._places = np.concatenate(places)
        outline, low, high = scene.outline, scene.extruded.low_m, scene.extruded.high_m
        sides = self._arc[outline.edge_walls]
        self._arc_of_edge = np.where(sides[:, 0] == sides[:, 1], sides[:, 0], -1)
        normal = np.column_stack([-outline.wall_along[:, 1], outline.wall_along[:, 0]])
        level = (normal * outline.wall_point).sum(axis=1)
        upright = np.column_stack([normal, np.zeros(len(level)), level])
        self._planes = np.concatenate([upright, [(0, 0, 1, low), (0, 0, 1, high)]])
        max_reflections = max(scene.setting.max_reflections - 1, 0)
        self._legs = scene.limited(max_reflections=max_reflections, edge_reflections=-1, side_reflections=-1)

    def added(
        self,
        rows: Rows,
        tx: Float[np.ndarray, "n_tx 3"],
        rx: Float[np.ndarray, "n_rx 3"],
        keep: int,
        workers: int | None,
    ) -> Rows:
        """The paths of each link with those over arcs, the strongest of both."""
        if not self.arcs or self.scene.setting.max_reflections < 1:
            return [[(merged([table], keep), first) for table, first in tables] for tables in rows]
        legs = self._traced(np.concatenate([tx, rx]), workers)
        settings = self.scene.setting, self.scene.setting._replace(max_through=0)
        joined: Rows = []
        for i, tables in enumerate(rows):
            joined.append([])
            for table, first in tables:
                receivers = rx[first : first + len(table.n_paths)]
                new = _join(
                    self._planes, settings, self._pieces, legs, (tx[i], i), receivers, len(tx) + first
                )
                joined[-1].append((merged([self._without_arcs(table), new], keep), first))
        return joined

    def _traced(self, ends: Points, workers: int | None) -> Legs:
        """Legs from each place to all ends, without reflections by arcs."""
        height = (self.scene.extruded.low_m + self.scene.extruded.high_m) / 2
        places = np.column_stack([self._places, np.full(len(self._places), height)])
        tables = [table for row in self._legs.tables(places, ends, workers) for table, _ in row]
        order, kind, primitive = (
            np.concatenate([getattr(t, name) for t in tables]) for name in ("order", "kind", "primitive")
        )
        n_paths = np.concatenate([t.n_paths for t in tables])
        flat = ~((kind == REFLECTION) & (self._arc[primitive] >= 0)).any(axis=1)
        of = np.repeat(np.arange(len(n_paths)), n_paths)[flat]
        start = np.searchsorted(of, np.arange(len(n_paths) + 1))
        through = (kind == TRANSMISSION).sum(axis=1)
        return Legs(start, order[flat], through[flat], kind[flat], primitive[flat])

    def _without_arcs(self, table: Table) -> Table:
        """A table without what flat walls of arcs reflect, and their corners diffract, away from the arc."""
        arc = np.full(table.kind.shape, -1)
        flat, bent = table.kind == REFLECTION, table.kind == DIFFRACTION
        arc[flat], arc[bent] = self._arc[table.primitive[flat]], self._arc_of_edge[table.primitive[bent]]
        row, j = np.nonzero(arc >= 0)
        centre = np.array([a.centre for a in self.arcs])[arc[row, j]]
        before, here, after = (table.point[row, j + k, :2] for k in range(3))
        ray, out = (
            step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
            for step in (here - before, after - here)
        )
        away = ((out - ray) * (here - centre)).sum(axis=1) > 0
        return chosen(table, ~np.isin(np.arange(len(table.power)), row[away]))


@compiled
def _images(
    planes: Float[np.ndarray, "n 4"], legs: Legs, leg: int, end: Point, image: Float[np.ndarray, "m1 3"]
) -> None:
    """Images of an end of a path: the last is itself, the first is what the place of a leg sees."""
    m = legs.order[leg]
    image[m] = end
    for j in range(m - 1, -1, -1):
        image[j] = image[j + 1]
        if legs.kind[leg, j] == REFLECTION:
            plane = planes[legs.wall[leg, j]]
            image[j] -= 2 * _height(plane, image[j]) * plane[:3]


@compiled
def _height(plane: Float[np.ndarray, "4"], point: Point) -> float:
    """How far a point is before a plane."""
    return plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3]


@compiled
def _tilt(pieces: Pieces, k: int, angle: float, tx: Point, rx: Point) -> tuple[float, float, float, float]:
    """How far two points are to the left of the normal of a circle, the lesser cosine from it, and distances."""
    ux, uy = np.cos(angle), np.sin(angle)
    px, py = pieces.centre[k, 0] + pieces.radius_m[k] * ux, pieces.centre[k, 1] + pieces.radius_m[k] * uy
    ax, ay, bx, by = tx[0] - px, tx[1] - py, rx[0] - px, rx[1] - py
    a, b = np.hypot(ax, ay), np.hypot(bx, by)
    left = (ux * ay - uy * ax) / a + (ux * by - uy * bx) / b
    return left, min((ax * ux + ay * uy) / a, (bx * ux + by * uy) / b), a, b


@compiled
def _meet(
    planes: Float[np.ndarray, "n 4"],
    setting: Setting,
    legs: Legs,
    leg: int,
    images: Float[np.ndarray, "m1 3"],
    at: tuple[int, int],
    scratch: Scratch,
) -> None:
    """Put the interactions of a leg into a path, from the one at a place on forwards or backwards (1 or -1)."""
    here, step = at
    for j in range(legs.order[leg]):
        before, place = scratch.point[here + 1], here + step
        wall = legs.wall[leg, j]
        a, b = _height(planes[wall], before), _height(planes[wall], images[j])
        scratch.point[place + 1] = before + (a / (a - b) if a != b else 0.0) * (images[j] - before)
        scratch.kind[place], scratch.primitive[place] = legs.kind[leg, j], wall
        scratch.walls[place], scratch.normal[place] = setting.walls[wall], planes[wall, :3]
        here = place


@compiled
def _lay(
    planes: Float[np.ndarray, "n 4"],
    setting: Setting,
    pieces: Pieces,
    k: int,
    legs: Legs,
    leg: tuple[int, int],
    images: Float[np.ndarray, "2 m1 3"],
    scratch: Scratch,
) -> tuple[int, float]:
    """Lay a path over a piece; its number of interactions, -1 for none, and its power over that of a flat wall."""
    tx, rx, low, high = images[0, 0], images[1, 0], pieces.from_rad[k], pieces.to_rad[k]
    if _tilt(pieces, k, low, tx, rx)[0] < 0 or _tilt(pieces, k, high, tx, rx)[0] >= 0:
        return -1, 0.0
    for _ in range(50):
        middle = (low + high) / 2
        if _tilt(pieces, k, middle, tx, rx)[0] >= 0:
            low = middle
        else:
            high = middle
    _, cosine, s, t = _tilt(pieces, k, low, tx, rx)
    z, radius = (tx[2] * t + rx[2] * s) / (s + t), pieces.radius_m[k]
    if cosine <= 0.0 or not setting.low_m <= z <= setting.high_m:
        return -1, 0.0
    before, wall = legs.order[leg[0]], pieces.wall[k]
    m, here, normal = before + 1 + legs.order[leg[1]], scratch.point[before + 1], scratch.normal[before]
    normal[0], normal[1], normal[2] = np.cos(low), np.sin(low), 0.0
    here[:2], here[2] = pieces.centre[k] + radius * normal[:2], z
    scratch.kind[before], scratch.primitive[before] = REFLECTION, wall
    scratch.walls[before] = setting.walls[wall]
    _meet(planes, setting, legs, leg[0], images[0], (before, -1), scratch)
    _meet(planes, setting, legs, leg[1], images[1], (before, 1), scratch)
    scratch.point[0], scratch.point[m + 1] = images[0, before], images[1, m - before - 1]
    return m, (s + t) / (s + t + 2 * s * t / (radius * cosine))


@compiled
def _join(
    planes: Float[np.ndarray, "n 4"],
    settings: tuple[Setting, Setting],
    pieces: Pieces,
    legs: Legs,
    tx: tuple[Point, int],
    rx: Float[np.ndarray, "r 3"],
    first: int,
) -> Table:
    """Paths over arcs from a transmitter, given with its number among ends, to receivers of numbers from `first` on.

    Legs list one face of each passed wall, so that none are left to be paired: the second setting is without pairs.
    """
    setting, unpaired = settings
    table, scratch, row = make_table(setting, len(rx), len(rx)), make_scratch(setting), 0
    images, n = np.empty((2, legs.kind.shape[1] + 1, 3)), (len(legs.start) - 1) // len(pieces.wall)
    for r in range(len(rx)):
        for k in range(len(pieces.wall)):
            a, b = k * n + tx[1], k * n + first + r
            for i in range(legs.start[a], legs.start[a + 1]):
                _images(planes, legs, i, tx[0], images[0])
                for j in range(legs.start[b], legs.start[b + 1]):
                    m, through = legs.order[i] + legs.order[j] + 1, legs.through[i] + legs.through[j]
                    if (
                        m - through > setting.max_reflections
                        or through > setting.max_walls
                        or m > setting.max_interactions
                    ):
                        continue
                    _images(planes, legs, j, rx[r], images[1])
                    m, share = _lay(planes, setting, pieces, k, legs, (i, j), images, scratch)
                    length, power = weigh(unpaired, m, 1.0, scratch) if m > 0 else (-1.0, 0.0)
                    if length < 0:
                        continue
                    scratch.gain[:] *= np.sqrt(share)
                    table = with_room(setting, table, row + 1)
                    write_row(setting, table, row, length, power * share, m, scratch)
                    table.n_paths[r] += 1
                    row += 1
    return table
