"""Scenes made ready for tracing: floor plans, and any triangles in space; which engine traces what of them.

Each has the place that its coordinates count from (`origin`), and `tables` of the paths of each transmitter.
"""

import logging
from collections.abc import Callable, Iterator
from functools import cache
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Bool, Complex, Float, Int

from wireless.geometry.beams import Sight, sight_of
from wireless.geometry.boxes import make_boxes
from wireless.geometry.closed import Sides
from wireless.geometry.extruded import Extruded
from wireless.geometry.facets import at_heights, find_surfaces, floor_and_ceiling, without_rims
from wireless.geometry.images import make_space
from wireless.geometry.plan import Locator, Plan, make_plan, regions
from wireless.tracing.blocks import Rows, trace_blocks
from wireless.tracing.candidates import Candidates
from wireless.tracing.plan_engine import trace_links, views_of
from wireless.tracing.space_engine import trace_space
from wireless.tracing.table import Setting, Table

logger = logging.getLogger(__name__)

#: From so many facets on, chains of them are found by rays: below, what a transmitter's own search takes is more than
#: its first links take by exhaustive search.
MANY_FACETS = 150
#: What transmitters see is kept for their next links: of so many, and no more than this [bytes]. Whose views pass
#: triangles more often than that sees too much to keep.
KEPT_SIGHTS, KEPT_BYTES, MOST_VISITS = 32, 32_000_000, 500_000


class PlanScene:
    """A floor plan, and how its links are traced."""

    engine = "plan"

    def __init__(
        self,
        extruded: Extruded,
        setting: Callable[[np.ndarray], Setting],
        *,
        snap_m: float,
        floor_ceiling: bool,
    ):
        plan = make_plan(extruded.walls, snap_m)
        self.extruded = extruded
        self.origin = np.append(plan.origin, 0.0)
        self.locate = Locator(plan, 2 * snap_m)
        faces = np.append(extruded.wall_face, [extruded.floor_face, extruded.ceiling_face])
        self.setting = setting(faces)._replace(
            low_m=extruded.low_m,
            high_m=extruded.high_m,
            has_floor=floor_ceiling and extruded.floor_face >= 0,
            has_ceiling=floor_ceiling and extruded.ceiling_face >= 0,
        )
        thin = self.setting.walls[:, 1].real > 0
        self.plan = plan._replace(tri_open=plan.tri_open & (plan.tri_wall >= 0) & thin[plan.tri_wall])
        self._region = regions(plan)
        #: What was found last: a transmitter is asked for again and again, and so is a region.
        self._around: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
        self._passed: dict[int, tuple[Plan, Setting]] = {}
        self._sights: dict[tuple[bytes, int], Sight] = {}
        logger.info("Floor plan of %d walls and %d corners", len(extruded.walls), len(plan.corner_vertex))

    def tables(
        self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], workers: int | None
    ) -> Rows:
        """Paths of each transmitter, to receivers in blocks."""
        low, high = self.extruded.low_m, self.extruded.high_m
        for name, points in (("tx", tx), ("rx", rx)):
            z = points[:, 2]
            if not self.holds(points):
                raise ValueError(
                    f"{name} has heights from {z.min()} to {z.max()} m, expected {low} to {high} m, between "
                    "floor and ceiling. Trace other points with scene='space'."
                )
        around_tx, around_rx = self._located(tx[:, :2]), self.locate(rx[:, :2])
        region = self._only_region(np.concatenate([around_tx[1], around_rx[1]]))
        plan, setting = self._passable(region)
        order, through = setting.side_reflections, setting.max_through

        def trace(txs: slice, rxs: slice) -> Iterator[Table]:
            some, (start, triangle) = rx[rxs], part_of(*around_rx, rxs)
            views = views_of(plan, some[:, :2].copy(), start, triangle, order, through)
            tx_start, tx_triangle = part_of(*around_tx, txs)
            for i, one in enumerate(tx[txs]):
                around = tx_triangle[tx_start[i] : tx_start[i + 1]]
                sight = self._sight(one[:2].copy(), around, plan, setting, region, triangle)
                yield trace_links(plan, setting, one, sight, some, start, triangle, views)

        return trace_blocks(len(tx), len(rx), trace, workers)

    def holds(self, points: Float[np.ndarray, "n 3"]) -> bool:
        """Whether points lie between floor and ceiling."""
        z = points[:, 2]
        return bool(np.all((z >= self.extruded.low_m) & (z <= self.extruded.high_m)))

    def _only_region(self, around: Int[np.ndarray, " s"]) -> int:
        """The region that some triangles lie in, if paths must not leave it; -1 otherwise.

        Whoever passes one wall only, from a region to itself, must find that region on both sides of the wall: a
        wall between rooms is passed by its two sides.
        """
        if self.setting.max_through == 1 and len(found := np.unique(self._region[around])) == 1:
            return int(found[0])
        return -1

    def _passable(self, region: int) -> tuple[Plan, Setting]:
        """Plan and setting in which paths pass only walls that may lead on, where they must not leave a region."""
        if region < 0:
            return self._where_open(self.plan.tri_open)
        known = self._passed.get(region)
        if known is None:
            both = (self._region[:, None] == region) & (self._region[self.plan.tri_next] == region)
            known = self._where_open(self.plan.tri_open & both)
            self._passed = {region: known}
        return known

    def _sight(
        self,
        tx: Float[np.ndarray, "2"],
        around: Int[np.ndarray, " s"],
        plan: Plan,
        setting: Setting,
        region: int,
        asked: Int[np.ndarray, " q"],
    ) -> Sight:
        """What a transmitter sees, where paths must not leave a region; kept, as it is asked for again and again.

        Of one that sees too much it is what it sees of the triangles asked for.
        """
        key = tx.tobytes(), region
        found = self._sights.get(key)
        if found is None:
            orders = setting.max_reflections, setting.side_reflections, setting.max_through
            wanted = marked(asked, len(plan.tri_vertex))
            found = sight_of(plan, around, tx, wanted, MOST_VISITS, *orders)
            if not found.whole:
                return found
            kept = {**self._sights, key: found}
            while len(kept) > KEPT_SIGHTS or (len(kept) > 1 and sum(map(_bytes, kept.values())) > KEPT_BYTES):
                del kept[next(iter(kept))]
            self._sights = kept
        return found

    def _where_open(self, tri_open: Bool[np.ndarray, "t 3"]) -> tuple[Plan, Setting]:
        """Plan and setting in which paths pass only some walls, if any."""
        plan = self.plan._replace(tri_open=tri_open)
        return plan, self.setting if tri_open.any() else self.setting._replace(max_through=0)

    def _located(self, points: Float[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray]:
        """`locate`, which keeps what it found last."""
        key = points.tobytes()
        found = self._around.get(key)
        if found is None:
            found = self.locate(points)
            self._around = {key: found}
        return found


class SpaceScene:
    """Any triangles, and how links among them are traced.

    Heights of floors and ceilings (`level_m`) are those of storeys, if it has some.
    """

    engine = "space"

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        face_material: Int[np.ndarray, " n"],
        face_wall: Complex[np.ndarray, "n l"],
        setting: Callable[[np.ndarray], Setting],
        *,
        snap_m: float,
        floor_ceiling: bool,
        search: Literal["auto", "exhaustive", "rays"],
        rays: int,
        level_m: Float[np.ndarray, " k"] | None = None,
    ):
        self.origin = np.round(mesh.bounds.mean(axis=0), 3)
        moved = trimesh.Trimesh(mesh.vertices - self.origin, mesh.faces, process=False)
        surfaces = find_surfaces(moved, face_material, snap_m)
        ground = slabs = floor_and_ceiling(surfaces)
        if level_m is not None:
            level_m = level_m - self.origin[2]
            ground, slabs = (at_heights(surfaces, z, snap_m) for z in (level_m[[0, -1]], level_m))
        surfaces = without_rims(surfaces, ground)
        mirrors = ~slabs | floor_ceiling
        self._setting = setting(surfaces.facet_face)
        passes = self._setting.walls[:, 1].real > 0
        self.space = make_space(surfaces, mirrors, passes)
        if not passes.any():
            self._setting = self._setting._replace(max_through=0)
        self._sides = None
        if self._setting.max_through == 1:
            sides = Sides(moved)
            self._sides = sides if sides.closed[face_wall[:, 1].real > 0].all() else None
        logger.info("%d facets and %d edges in space", len(mirrors), len(surfaces.edge))
        self._by_rays = search == "rays" or (search == "auto" and len(mirrors) >= MANY_FACETS)
        self._candidates = cache(
            lambda through: Candidates(self.space, self._setting._replace(max_through=through), rays)
        )

    def tables(
        self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], workers: int | None
    ) -> Rows:
        """Paths of each transmitter, to receivers in blocks."""
        setting = self._passing(np.concatenate([tx, rx]))

        def trace(txs: slice, rxs: slice) -> Iterator[Table]:
            some = rx[rxs]
            boxes = make_boxes(some, some)
            for one in tx[txs]:
                yield trace_space(self.space, setting, one, some, boxes)

        if not self._by_rays:
            return trace_blocks(len(tx), len(rx), trace, workers)
        candidates = self._candidates(setting.max_through)
        return trace_blocks(len(tx), len(rx), lambda txs, rxs: candidates.trace(tx[txs], rx[rxs]), workers)

    def _passing(self, points: Float[np.ndarray, "n 3"]) -> Setting:
        """The setting for some points: who passes a closed surface once does not come out on the side it began on."""
        leads_on = self._sides is None or not self._sides.alike(points)
        return self._setting if leads_on else self._setting._replace(max_through=0)


def _bytes(sight: Sight) -> int:
    return sight.sector.nbytes + sight.visit.nbytes  # the rest is small


def marked(some: Int[np.ndarray, " s"], n: int) -> Bool[np.ndarray, " n"]:
    """True at some of n places."""
    flags = np.zeros(n, bool)
    flags[some] = True
    return flags


def by_triangle(
    start: Int[np.ndarray, " r1"], triangle: Int[np.ndarray, " s"], n_triangles: int
) -> tuple[Int[np.ndarray, " t1"], Int[np.ndarray, " s"]]:
    """Points of each triangle, from the triangles of each point."""
    point = np.repeat(np.arange(len(start) - 1), np.diff(start))
    order = np.argsort(triangle, kind="stable")
    return np.searchsorted(triangle[order], np.arange(n_triangles + 1)), point[order]


def part_of(
    start: Int[np.ndarray, " r1"], triangle: Int[np.ndarray, " s"], some: slice
) -> tuple[Int[np.ndarray, " p1"], Int[np.ndarray, " q"]]:
    """The triangles of some points in a row, counted from their own first."""
    first, last = start[some.start], start[some.stop]
    return start[some.start : some.stop + 1] - first, triangle[first:last]
