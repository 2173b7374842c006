"""Paths that a rough wall scatters once, in addition to those that an engine finds, in floor plans and in space.

In plans walls are cut into strips, strips into tiles of at most a given size. A strip counts if the middle of its side
is seen from both ends, which is decided as for any receiver there (`wireless.geometry.visibility`): walls reach from
floor to ceiling, so that it holds for all its tiles. In space tiles are parts of triangles, each seen by its middle.
Each tile is one path by its middle, whose power is the integral over the tile: a fixed rule of so many points that
their distance is small against that of either end. Powers are not random. Phases are those of the path's length, plus
one of each tile that is drawn once by `SEED`: they turn as a terminal moves, and are the same in each run.

Reflections lose what is scattered. Left out: scattering before or after another interaction, by floor and ceiling of
plans, by floors that do not reflect, and into what stands behind a wall; edges are as strong as before.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim.support.compiled import compiled
from wireless.em.fields import REFLECTION, SCATTERING
from wireless.em.fresnel import fresnel
from wireless.em.scattering import lobe, lobe_integral
from wireless.geometry.array_types import Point, Points
from wireless.geometry.occlusion import Tree, is_hidden
from wireless.tracing.blocks import Rows
from wireless.tracing.scenes import PlanScene, SpaceScene
from wireless.tracing.table import Setting, Table, merged

#: Draws the phases of tiles.
SEED = 1
#: Points of the rule within a tile are no farther apart than this share of the distance of the nearer end, but no more
#: than so many along either side.
FINE, MOST_POINTS = 0.2, 16
#: Sides of walls are looked at from this far [m].
OFF_M = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Tiles:
    """Pieces of the walls' sides: rectangles, or triangles."""

    corner: Float[np.ndarray, "k 3"]
    """A corner of each, around the scene's origin [m]."""
    side: Float[np.ndarray, "k 2 3"]
    """The two sides from that corner."""
    normal: Float[np.ndarray, "k 3"]
    """Unit normal into the side's free space."""
    wall: Int[np.ndarray, " k"]
    corners: int
    """4 or 3."""

    @property
    def middle(self) -> Float[np.ndarray, "k 3"]:
        """Middles of the tiles."""
        return self.corner + self.side.sum(axis=1) / (2 if self.corners == 4 else 3)

    def points(self, tiles: Int[np.ndarray, " m"], n: int, m: int) -> Float[np.ndarray, "m q 3"]:
        """Points of even areas on some tiles: n along one side and m along the other, or n^2 on triangles."""
        if self.corners == 4:
            share = np.stack(np.meshgrid((np.arange(n) + 0.5) / n, (np.arange(m) + 0.5) / m), axis=-1)
        else:
            begin, sign = _parts(n)
            share = (begin + sign[:, None] / 3) / n
        return self.corner[tiles, None] + share.reshape(-1, 2) @ self.side[tiles]


def _parts(n: int) -> tuple[Int[np.ndarray, "n2 2"], Int[np.ndarray, " n2"]]:
    """Parts of a triangle with sides cut into n: corners, in parts of both sides, and the signs of their own sides."""
    i, j = np.meshgrid(np.arange(n), np.arange(n))
    up, down = i + j < n, i + j < n - 1
    begin = np.concatenate([np.column_stack([i[up], j[up]]), np.column_stack([i[down], j[down]]) + 1])
    return begin, np.where(np.arange(n * n) < up.sum(), 1, -1)


class Scattering:
    """Scattered paths in a scene."""

    def __init__(
        self,
        setting: Setting,
        tiles: Tiles,
        seen: Callable[[Point], Bool[np.ndarray, " k"]],
        share: Float[np.ndarray, " n"],
        alpha: Int[np.ndarray, " n"],
    ):
        """Walls scatter a share S by a lobe of exponent alpha (-1: Lambert's law); a point sees some of the tiles."""
        self.setting, self.tiles, self._seen, self.share, self.alpha = setting, tiles, seen, share, alpha
        self._middle = tiles.middle
        self._length_m = np.linalg.norm(tiles.side, axis=2)
        self._area_m2 = np.linalg.norm(np.cross(tiles.side[:, 0], tiles.side[:, 1]), axis=1)
        if tiles.corners == 3:
            self._length_m, self._area_m2 = (
                self._length_m.max(axis=1, keepdims=True).repeat(2, axis=1),
                self._area_m2 / 2,
            )
        self._phase_rad = np.random.default_rng(SEED).uniform(0, 2 * np.pi, len(tiles.wall))

    def added(
        self, rows: Rows, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], keep: int
    ) -> Rows:
        """The paths of each link with those scattered, the strongest of both."""
        of_rx = [self._seen(end) for end in rx]
        joined: Rows = []
        for end, tables in zip(tx, rows, strict=True):
            from_tx = self._seen(end)
            seen = [from_tx & strips for strips in of_rx]
            joined.append(
                [(self._joined(table, first, end, rx, seen, keep), first) for table, first in tables]
            )
        return joined

    def powers(self, tx: Point, rx: Point, tiles: Int[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
        """Power gain over some tiles, vertical and horizontal polarisation."""
        near = np.minimum(*(np.linalg.norm(self._middle[tiles] - end, axis=1) for end in (tx, rx)))
        fine = np.ceil(self._length_m[tiles] / (FINE * near[:, None]))
        number = np.clip(fine, 1, MOST_POINTS).astype(np.int64)
        power = np.zeros((len(tiles), 2))
        for n, m in np.unique(number, axis=0).tolist():
            alike = np.flatnonzero((number == (n, m)).all(axis=1))
            point = self.tiles.points(tiles[alike], n, m)
            tile = np.repeat(tiles[alike], point.shape[1])
            gain = self._density(tx, rx, point.reshape(-1, 3), tile).reshape(*point.shape[:2], 2)
            power[alike] = gain.mean(axis=1) * self._area_m2[tiles[alike], None]
        return power

    def _density(
        self,
        tx: Point,
        rx: Point,
        point: Float[np.ndarray, "q 3"],
        tile: Int[np.ndarray, " q"],
    ) -> Float[np.ndarray, "q 2"]:
        """Power gain by area [1/m2] of points on tiles, vertical and horizontal polarisation."""
        setting, normal, wall = self.setting, self.tiles.normal[tile], self.tiles.wall[tile]
        before, after = point - tx, rx - point
        r_i, r_s = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        ray, out = before / r_i[:, None], after / r_s[:, None]
        cos_i = np.clip(-(ray * normal).sum(axis=1), 0.0, 1.0)
        cos_s = np.clip((out * normal).sum(axis=1), 0.0, 1.0)
        mirrored = ray + 2 * cos_i[:, None] * normal
        cos_psi = np.clip((mirrored * out).sum(axis=1), -1.0, 1.0)
        shape = np.empty(len(point))
        for alpha in np.unique(self.alpha[wall]):
            mask = self.alpha[wall] == alpha
            law = None if alpha < 0 else int(alpha)
            shape[mask] = lobe(cos_psi[mask], cos_s[mask], law) / lobe_integral(cos_i[mask], law)
        te, tm = _reflected(cos_i, setting.walls, wall, setting.wavenumber)
        # The TE component of a vertical field, theta, is that along ray x normal.
        level2, sine2 = np.maximum(1 - ray[:, 2] ** 2, 1e-12), 1 - cos_i**2
        sideways = (ray[:, 0] * normal[:, 1] - ray[:, 1] * normal[:, 0]) ** 2
        vertical_te = np.clip(sideways / (level2 * np.maximum(sine2, 1e-12)), 0.0, 1.0)
        friis = (1 / (2 * setting.wavenumber)) ** 2
        common = friis * self.share[wall] ** 2 * shape * cos_i * (cos_s > 0) / (r_i * r_s) ** 2
        vertical = vertical_te * te + (1 - vertical_te) * tm
        horizontal = (1 - vertical_te) * te + vertical_te * tm
        return common[:, None] * np.column_stack([vertical, horizontal])

    def _joined(
        self,
        table: Table,
        first: int,
        tx: Point,
        rx: Float[np.ndarray, "n_rx 3"],
        seen: list[Bool[np.ndarray, " s"]],
        keep: int,
    ) -> Table:
        """A table with scattered paths among the others, whose reflections are weaker."""
        of_wall = np.ones(len(self.setting.walls))
        of_wall[: len(self.share)] = 1 - self.share**2
        reflects = table.kind == REFLECTION
        lost = np.where(reflects, of_wall[np.where(reflects, table.primitive, 0)], 1.0).prod(axis=1)
        table = table._replace(power=table.power * lost, gain=table.gain * np.sqrt(lost)[:, None, None])
        numbers = range(first, first + len(table.n_paths))
        new = [self._paths(tx, rx[i], np.flatnonzero(seen[i]), table.kind.shape[1]) for i in numbers]
        n_paths = np.array([len(columns[0]) for columns in new])
        return merged([table, Table(n_paths, *map(np.concatenate, zip(*new, strict=True)))], keep)

    def _paths(self, tx: Point, rx: Point, tiles: Int[np.ndarray, " m"], max_order: int) -> list[np.ndarray]:
        """Columns of a table after the first: a path by each of some tiles."""
        setting = self.setting
        powers = self.powers(tx, rx, tiles)
        weighted = setting.vertical * powers[:, 0] + setting.horizontal * powers[:, 1]
        tiles, powers, weighted = tiles[weighted > 0], powers[weighted > 0], weighted[weighted > 0]
        m = len(tiles)
        middle = self._middle[tiles]
        length = np.linalg.norm(middle - tx, axis=1) + np.linalg.norm(rx - middle, axis=1)
        turn = np.exp(1j * (self._phase_rad[tiles] - setting.wavenumber * length))
        gain = np.zeros((m, 2, 2), complex)
        gain[:, 0, 0], gain[:, 1, 1] = np.sqrt(powers[:, 0]) * turn, -np.sqrt(powers[:, 1]) * turn
        kind, primitive = np.zeros((m, max_order), np.int64), np.full((m, max_order), -1, np.int64)
        kind[:, 0], primitive[:, 0] = SCATTERING, self.tiles.wall[tiles]
        point = np.zeros((m, max_order + 2, 3))
        point[:, 0], point[:, 1], point[:, 2] = tx, middle, rx
        return [weighted, gain, length, np.ones(m, np.int64), kind, primitive, point]


def scattering_in_plan(
    scene: PlanScene, share: Float[np.ndarray, " n"], alpha: Int[np.ndarray, " n"], tile_m: float
) -> Scattering:
    """Scattering by both sides of the walls of a plan."""
    extruded, number = scene.extruded, np.flatnonzero(share > 0)
    ends = extruded.walls[number] - scene.origin[:2]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    n = np.maximum(1, np.ceil(length / tile_m - 1e-9)).astype(np.int64)
    of = np.repeat(np.arange(len(ends)), n)
    step = ((ends[:, 1] - ends[:, 0]) / n[:, None])[of]
    begin = ends[of, 0] + (np.arange(len(of)) - np.repeat(np.cumsum(n) - n, n))[:, None] * step
    normal = np.column_stack([-step[:, 1], step[:, 0]]) * (n / length)[of, None]
    of, step, begin = np.tile(of, 2), np.tile(step, (2, 1)), np.tile(begin, (2, 1))
    normal = np.concatenate([normal, -normal])
    points = begin + step / 2 + OFF_M * normal
    around = scene.locate(points)
    targets = np.column_stack([points, np.full(len(points), extruded.low_m)])
    high = extruded.high_m - extruded.low_m
    m = max(1, int(np.ceil(high / tile_m - 1e-9)))
    strip = np.repeat(np.arange(len(of)), m)
    z = np.tile(extruded.low_m + np.arange(m) / m * high, len(of))
    up = np.zeros((len(strip), 3))
    up[:, 2] = high / m
    level = np.zeros(len(strip))
    tiles = Tiles(
        corner=np.column_stack([begin[strip], z]),
        side=np.stack([np.column_stack([step[strip], level]), up], axis=1),
        normal=np.column_stack([normal[strip], level]),
        wall=number[of][strip],
        corners=4,
    )

    def seen(point: Point) -> Bool[np.ndarray, " k"]:
        return scene.seen_targets(point, targets, around)[strip] if len(strip) else np.zeros(0, bool)

    return Scattering(scene.setting, tiles, seen, share, alpha)


def scattering_in_space(
    scene: SpaceScene, share: Float[np.ndarray, " n"], alpha: Int[np.ndarray, " n"], tile_m: float
) -> Scattering:
    """Scattering by both sides of the facets that reflect."""
    surfaces = scene.space.surfaces
    share = np.where(scene.space.mirrors, share, 0.0)
    rough = np.flatnonzero(share[surfaces.triangle_facet] > 0)
    corner, facet = surfaces.triangle[rough], surfaces.triangle_facet[rough]
    longest = np.linalg.norm(np.roll(corner, 1, axis=1) - corner, axis=2).max(axis=1, initial=0)
    n = np.maximum(1, np.ceil(longest / tile_m - 1e-9)).astype(np.int64)
    begin, side, wall = [np.empty((0, 3))], [np.empty((0, 2, 3))], [facet[:0]]
    for number in np.unique(n).tolist():
        triangles, (steps, sign) = np.flatnonzero(n == number), _parts(number)
        sides = (corner[triangles, 1:] - corner[triangles, :1]) / number
        begin.append((corner[triangles, :1] + steps @ sides).reshape(-1, 3))
        side.append((sign[:, None, None] * sides[:, None]).reshape(-1, 2, 3))
        wall.append(np.repeat(facet[triangles], len(steps)))
    corner, sides, facet = (np.concatenate(2 * parts) for parts in (begin, side, wall))
    normal = surfaces.facet_normal[facet]
    normal[len(normal) // 2 :] *= -1
    tiles = Tiles(corner=corner, side=sides, normal=normal, wall=facet, corners=3)
    middle = tiles.middle

    def seen(point: Point) -> Bool[np.ndarray, " k"]:
        return _seen_from(scene.space.tree, point, middle, tiles.normal)

    return Scattering(scene.setting, tiles, seen, share, alpha)


@compiled
def _seen_from(
    tree: Tree, point: Point, middle: Points, normal: Float[np.ndarray, "n 3"]
) -> Bool[np.ndarray, " n"]:
    """Which tiles show a point the side that their normal leads to, with nothing between."""
    seen = np.zeros(len(middle), np.bool_)
    for i in range(len(middle)):
        before = 0.0
        for k in range(3):
            before += (point[k] - middle[i, k]) * normal[i, k]
        seen[i] = before > tree.near_m and not is_hidden(tree, point, middle[i])
    return seen


@compiled
def _reflected(
    cos_i: Float[np.ndarray, " q"], walls: np.ndarray, wall: Int[np.ndarray, " q"], wavenumber: float
) -> tuple[Float[np.ndarray, " q"], Float[np.ndarray, " q"]]:
    """Share of the power that smooth walls reflect, TE and TM."""
    te, tm = np.empty(len(cos_i)), np.empty(len(cos_i))
    for j in range(len(cos_i)):
        ratios = fresnel(cos_i[j], walls[wall[j]], wavenumber)
        te[j], tm[j] = abs(ratios[0]) ** 2, abs(ratios[1]) ** 2
    return te, tm
