"""Paths that a rough wall of a floor plan scatters once, in addition to those that the plan's engine finds.

Walls are cut into strips, strips into tiles of at most a given size. A strip counts if the middle of its side is seen
from both ends, which is decided as for any receiver there (`wireless.geometry.visibility`): walls reach from floor to
ceiling, so that it holds for all its tiles. Each tile is one path by its middle, whose power is the integral over the
tile: a fixed rule of so many points that their distance is small against that of either end. Powers are not random.
Phases are those of the path's length, plus one of each tile that is drawn once by `SEED`: they turn as a terminal
moves, and are the same in each run.

Reflections lose what is scattered. Left out: scattering before or after another interaction, by floor and ceiling, and
into what stands behind a wall; edges are as strong as before.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from robosim_support.compiled import compiled
from wireless.em.fields import REFLECTION, SCATTERING
from wireless.em.fresnel import fresnel
from wireless.em.scattering import lobe, lobe_integral
from wireless.geometry.array_types import Point
from wireless.tracing.blocks import Rows
from wireless.tracing.scenes import PlanScene
from wireless.tracing.table import Setting, Table

#: Draws the phases of tiles.
SEED = 1
#: Points of the rule within a tile are no farther apart than this share of the distance of the nearer end, but no more
#: than so many along either side.
FINE, MOST_POINTS = 0.2, 16
#: Sides of walls are looked at from this far [m].
OFF_M = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Tiles:
    """Pieces of the walls' sides, a strip's from the floor up."""

    strip: Int[np.ndarray, " k"]
    """Strip of each tile."""
    middle: Float[np.ndarray, "k 3"]
    """Its middle, around the plan's origin [m]."""
    along: Float[np.ndarray, "k 2"]
    """Unit vector along the wall."""
    normal: Float[np.ndarray, "k 2"]
    """Unit normal into the side's free space."""
    width_m: Float[np.ndarray, " k"]
    height_m: float
    wall: Int[np.ndarray, " k"]
    phase_rad: Float[np.ndarray, " k"]


class Scattering:
    """Scattered paths in a floor plan."""

    def __init__(
        self, scene: PlanScene, share: Float[np.ndarray, " n"], alpha: Int[np.ndarray, " n"], tile_m: float
    ):
        self.scene, self.share, self.alpha = scene, share, alpha
        self.tiles, points = _tiles(scene, share > 0, tile_m)
        self._around = scene.locate(points)
        self._points = np.column_stack([points, np.full(len(points), scene.extruded.low_m)])

    def added(
        self, rows: Rows, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], keep: int
    ) -> Rows:
        """The paths of each link with those scattered, the strongest of both."""
        of_rx = [self._seen(one) for one in rx]
        found: Rows = []
        for one, tables in zip(tx, rows, strict=True):
            from_tx = self._seen(one)
            seen = [from_tx & strips for strips in of_rx]
            found.append(
                [(self._joined(table, first, one, rx, seen, keep), first) for table, first in tables]
            )
        return found

    def powers(self, tx: Point, rx: Point, some: Int[np.ndarray, " m"]) -> Float[np.ndarray, "m 2"]:
        """Power gain over some tiles, vertical and horizontal polarisation."""
        t, setting = self.tiles, self.scene.setting
        near = np.minimum(*(np.linalg.norm(t.middle[some] - end, axis=1) for end in (tx, rx)))
        across = np.clip(np.ceil(t.width_m[some] / (FINE * near)), 1, MOST_POINTS).astype(np.int64)
        up = np.clip(np.ceil(t.height_m / (FINE * near)), 1, MOST_POINTS).astype(np.int64)
        found = np.zeros((len(some), 2))
        for n in np.unique(across):
            for m in np.unique(up[across == n]):
                alike = np.flatnonzero((across == n) & (up == m))
                tile = some[alike]
                u = ((np.arange(n) + 0.5) / n - 0.5)[None, :, None] * t.width_m[tile][:, None, None]
                v = ((np.arange(m) + 0.5) / m - 0.5)[None, None, :] * t.height_m
                point = np.empty((len(tile), n, m, 3))
                point[..., :2] = t.middle[tile, None, None, :2] + u[..., None] * t.along[tile, None, None]
                point[..., 2] = t.middle[tile, None, None, 2] + v
                area = t.width_m[tile] * t.height_m / (n * m)
                gain = self._density(tx, rx, point.reshape(-1, 3), np.repeat(tile, n * m), setting)
                found[alike] = gain.reshape(len(tile), n * m, 2).sum(axis=1) * area[:, None]
        return found

    def _density(
        self,
        tx: Point,
        rx: Point,
        point: Float[np.ndarray, "q 3"],
        tile: Int[np.ndarray, " q"],
        setting: Setting,
    ) -> Float[np.ndarray, "q 2"]:
        """Power gain by area [1/m2] of points on tiles, vertical and horizontal polarisation."""
        t = self.tiles
        normal, wall = t.normal[tile], t.wall[tile]
        before, after = point - tx, rx - point
        r_i, r_s = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
        ray, out = before / r_i[:, None], after / r_s[:, None]
        cos_i = np.clip(-(ray[:, :2] * normal).sum(axis=1), 0.0, 1.0)
        cos_s = np.clip((out[:, :2] * normal).sum(axis=1), 0.0, 1.0)
        mirrored = ray.copy()
        mirrored[:, :2] += 2 * cos_i[:, None] * normal
        cos_psi = np.clip((mirrored * out).sum(axis=1), -1.0, 1.0)
        shape = np.empty(len(point))
        for alpha in np.unique(self.alpha[wall]):
            some = self.alpha[wall] == alpha
            law = None if alpha < 0 else int(alpha)
            shape[some] = lobe(cos_psi[some], cos_s[some], law) / lobe_integral(cos_i[some], law)
        te, tm = _reflected(cos_i, setting.walls, wall, setting.wavenumber)
        # Of a vertical field, theta, the TE part is that along ray x normal.
        level2, sine2 = np.maximum(1 - ray[:, 2] ** 2, 1e-12), 1 - cos_i**2
        sideways = (ray[:, 0] * normal[:, 1] - ray[:, 1] * normal[:, 0]) ** 2
        vertical_te = np.clip(sideways / (level2 * np.maximum(sine2, 1e-12)), 0.0, 1.0)
        friis = (1 / (2 * setting.wavenumber)) ** 2
        common = friis * self.share[wall] ** 2 * shape * cos_i * (cos_s > 0) / (r_i * r_s) ** 2
        vertical = vertical_te * te + (1 - vertical_te) * tm
        horizontal = (1 - vertical_te) * te + vertical_te * tm
        return common[:, None] * np.column_stack([vertical, horizontal])

    def _seen(self, point: Point) -> Bool[np.ndarray, " s"]:
        """Which strips' sides a point sees."""
        if not len(self._points):
            return np.zeros(0, bool)
        return self.scene.seen_targets(point, self._points, self._around)

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
        power, gain = self._weakened(table)
        start = np.concatenate([[0], np.cumsum(table.found)])
        most = table.kind.shape[1]
        blocks, count = [], np.zeros(len(table.found), np.int64)
        for i in range(len(table.found)):
            end = rx[first + i]
            old = slice(start[i], start[i + 1])
            some = np.flatnonzero(seen[first + i][self.tiles.strip])
            new = self._paths(tx, end, some, most)
            parts = [getattr(table, name)[old] for name in Table._fields[1:]]
            parts[0], parts[1] = power[old], gain[old]
            both = [np.concatenate([a, b]) for a, b in zip(parts, new, strict=True)]
            order = np.argsort(-both[0], kind="stable")[:keep]
            count[i] = len(order)
            blocks.append([column[order] for column in both])
        return Table(count, *(np.concatenate(columns) for columns in zip(*blocks, strict=True)))

    def _weakened(self, table: Table) -> tuple[np.ndarray, np.ndarray]:
        """Powers and gains of paths whose reflections lose what is scattered."""
        of_wall = np.ones(len(self.scene.setting.walls))
        of_wall[: len(self.share)] = 1 - self.share**2
        lost = np.where(table.kind == REFLECTION, of_wall[table.primitive], 1.0).prod(axis=1)
        return table.power * lost, table.gain * np.sqrt(lost)[:, None, None]

    def _paths(self, tx: Point, rx: Point, some: Int[np.ndarray, " m"], most: int) -> list[np.ndarray]:
        """Columns of a table after the first: a path by each of some tiles."""
        t, setting = self.tiles, self.scene.setting
        powers = self.powers(tx, rx, some)
        weighted = setting.vertical * powers[:, 0] + setting.horizontal * powers[:, 1]
        some, powers, weighted = some[weighted > 0], powers[weighted > 0], weighted[weighted > 0]
        m = len(some)
        middle = t.middle[some]
        length = np.linalg.norm(middle - tx, axis=1) + np.linalg.norm(rx - middle, axis=1)
        turn = np.exp(1j * (t.phase_rad[some] - setting.wavenumber * length))
        gain = np.zeros((m, 2, 2), complex)
        gain[:, 0, 0], gain[:, 1, 1] = np.sqrt(powers[:, 0]) * turn, -np.sqrt(powers[:, 1]) * turn
        kind, primitive = np.zeros((m, most), np.int64), np.full((m, most), -1, np.int64)
        kind[:, 0], primitive[:, 0] = SCATTERING, t.wall[some]
        point = np.zeros((m, most + 2, 3))
        point[:, 0], point[:, 1], point[:, 2] = tx, middle, rx
        return [weighted, gain, length, np.ones(m, np.int64), kind, primitive, point]


def _tiles(
    scene: PlanScene, rough: Bool[np.ndarray, " n"], tile_m: float
) -> tuple[Tiles, Float[np.ndarray, "s 2"]]:
    """Tiles of all sides of rough walls, and the point that each strip is seen by."""
    extruded, origin = scene.extruded, scene.origin[:2]
    ends = extruded.walls[rough] - origin
    number = np.flatnonzero(rough)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    n = np.maximum(1, np.ceil(length / tile_m - 1e-9)).astype(np.int64)
    of = np.repeat(np.arange(len(ends)), n)
    place = (np.arange(len(of)) - np.repeat(np.cumsum(n) - n, n) + 0.5) / n[of]
    middle = ends[of, 0] + place[:, None] * (ends[of, 1] - ends[of, 0])
    along = (ends[:, 1] - ends[:, 0]) / length[:, None]
    left = np.column_stack([-along[:, 1], along[:, 0]])
    sides = np.repeat([1.0, -1.0], len(of))
    of, middle = np.tile(of, 2), np.tile(middle, (2, 1))
    normal = left[of] * sides[:, None]
    high = extruded.high_m - extruded.low_m
    m = max(1, int(np.ceil(high / tile_m - 1e-9)))
    z = extruded.low_m + (np.arange(m) + 0.5) / m * high
    strip = np.repeat(np.arange(len(of)), m)
    tiles = Tiles(
        strip=strip,
        middle=np.column_stack([middle[strip], np.tile(z, len(of))]),
        along=along[of][strip],
        normal=normal[strip],
        width_m=(length / n)[of][strip],
        height_m=high / m,
        wall=number[of][strip],
        phase_rad=np.random.default_rng(SEED).uniform(0, 2 * np.pi, len(strip)),
    )
    return tiles, middle + OFF_M * normal


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
