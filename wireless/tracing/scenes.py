"""Scenes made ready for tracing: floor plans, and any triangles in space; which engine traces what of them.

Each has the place that its coordinates count from (`origin`), and `tables` of the paths of each transmitter.
"""

import logging
from collections.abc import Callable, Iterator
from copy import copy
from functools import cache
from typing import Any, Literal

import numpy as np
import trimesh
from jaxtyping import Bool, Complex, Float, Int

from wireless.geometry.array_types import Point, Points
from wireless.geometry.boxes import make_boxes
from wireless.geometry.closed_surfaces import Sides
from wireless.geometry.extruded import Extruded
from wireless.geometry.facets import at_heights, floor_and_ceiling, is_floor_plan, without_rims
from wireless.geometry.layers import Layers, one_storey
from wireless.geometry.plan import Locator, make_plan, regions
from wireless.geometry.prepared_surfaces import prepare_surfaces
from wireless.geometry.space import make_space
from wireless.geometry.view_steps import Limits
from wireless.geometry.visibility import Visibility, find_visibility, views_onto
from wireless.tracing.blocks import Rows, trace_blocks
from wireless.tracing.candidates import Candidates
from wireless.tracing.plan_engine import trace_links, views_of
from wireless.tracing.scene_size import report_size
from wireless.tracing.space_engine import trace_space
from wireless.tracing.table import Setting, Table

logger = logging.getLogger(__name__)

#: From so many facets on, chains of them are found by rays: below, what a transmitter's own search takes is more than
#: its first links take by exhaustive search.
MANY_FACETS = 150
#: Visibility of transmitters is stored for their next links: of so many, and no more than this [bytes]; not if their
#: views pass triangles more often than that.
STORED_SIGHTS, STORED_BYTES, MOST_VISITS = 32, 32_000_000, 500_000
#: Where each point's triangles begin (and an end), and these triangles.
Around = tuple[Int[np.ndarray, " _"], Int[np.ndarray, " _"]]


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
        self.floor_ceiling = floor_ceiling
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
        self._layers = one_storey(self.plan, extruded.low_m, extruded.high_m)
        self.outline = self._layers.outline
        self._region = regions(plan)
        #: Visibility of the last transmitters: links of the same transmitter and region follow each other.
        self._around: dict[bytes, Around] = {}
        self._passed: dict[int, tuple[Layers, Setting]] = {}
        self._sights: dict[tuple[bytes, int], Visibility] = {}
        logger.info(f"Floor plan of {len(extruded.walls)} walls and {len(plan.corner_vertex)} corners")

    def tables(
        self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], workers: int | None
    ) -> Rows:
        """Paths of each transmitter, to receivers in blocks."""
        around_tx, around_rx = self._located(tx[:, :2]), self.locate(rx[:, :2])
        region = self._only_region(np.concatenate([around_tx[1], around_rx[1]]))
        layers, setting = self._passable(region)
        limits = limits_of(setting, MOST_VISITS)

        def visible(source: np.ndarray, around: np.ndarray, targets: np.ndarray) -> Visibility:
            """Return the visibility from a transmitter in a region that paths must not leave; stored for next links."""
            key = source[:2].tobytes(), region
            visibility = self._sights.get(key)
            if visibility is None:
                visibility = find_visibility(
                    layers, around, source, mask_of(targets, len(self._region)), limits
                )
                if visibility.whole:  # otherwise it sees too much to store
                    stored = {**self._sights, key: visibility}
                    while len(stored) > STORED_SIGHTS or (
                        len(stored) > 1 and sum(map(_bytes, stored.values())) > STORED_BYTES
                    ):
                        del stored[next(iter(stored))]
                    self._sights = stored
            return visibility

        return trace_plans(layers, setting, limits, (tx, around_tx), (rx, around_rx), visible, workers)

    def misplaced(self, points: Points) -> str:
        """Return an error message for points, around the origin, not between floor and ceiling; empty if all are."""
        z, low, high = points[:, 2], self.extruded.low_m, self.extruded.high_m
        if np.all((z >= low) & (z <= high)):
            return ""
        return (
            f"heights from {z.min()} to {z.max()} m, expected {low} to {high} m, between floor and ceiling. "
            "Trace other points with scene='space'."
        )

    def seen_targets(self, point: Point, targets: Points, around: Around) -> Bool[np.ndarray, " n"]:
        """Which targets a point sees directly, of whom the triangles around each are given."""
        start, triangle = self.locate(point[None, :2])
        limits = limits_of(self.setting, 0)._replace(target_order=0, edge_order=-1, max_through=0)
        has_target = mask_of(around[1], len(self._region))
        seen = find_visibility(self._layers, triangle[: start[1]], point, has_target, limits)
        return np.diff(views_onto(seen, targets, *around)[0]) > 0

    def limited(self, **limits: Any) -> "PlanScene":
        """Return the scene with fields of its setting changed."""
        scene = copy(self)
        scene.setting = self.setting._replace(**limits)
        scene._around, scene._passed, scene._sights = {}, {}, {}
        return scene

    def _only_region(self, around: Int[np.ndarray, " s"]) -> int:
        """The region that some triangles lie in, if paths must not leave it; -1 otherwise."""
        # A path that passes only one wall, from a region to itself, must find that region on both sides of the wall: a
        # wall between rooms is passed by its two sides.
        if self.setting.max_through == 1 and len(regions := np.unique(self._region[around])) == 1:
            return int(regions[0])
        return -1

    def _passable(self, region: int) -> tuple[Layers, Setting]:
        """Plan and setting in which paths pass only walls that may lead on, where they must not leave a region."""
        if region not in self._passed:
            tri_open = self.plan.tri_open
            if region >= 0:
                tri_open = (
                    tri_open
                    & (self._region[:, None] == region)
                    & (self._region[self.plan.tri_next] == region)
                )
            layers = self._layers._replace(plan=self.plan._replace(tri_open=tri_open))
            setting = self.setting if tri_open.any() else self.setting._replace(max_through=0)
            self._passed = {region: (layers, setting)}
        return self._passed[region]

    def _located(self, points: Float[np.ndarray, "n 2"]) -> Around:
        """`locate`, whose last result is stored."""
        key = points.tobytes()
        around = self._around.get(key)
        if around is None:
            around = self.locate(points)
            self._around = {key: around}
        return around


class SpaceScene:
    """Scene of arbitrary triangles, and how links among them are traced.

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
        floor_ceiling: bool | None,
        search: Literal["auto", "exhaustive", "rays"],
        rays: int,
        level_m: Float[np.ndarray, " k"] | None = None,
    ):
        report_size(len(mesh.faces))
        self.origin = np.round(mesh.bounds.mean(axis=0), 3)
        local = trimesh.Trimesh(mesh.vertices - self.origin, mesh.faces, process=False)
        surfaces, patches = prepare_surfaces(local, face_material, snap_m)
        ground = slabs = floor_and_ceiling(surfaces)
        if level_m is not None:
            level_m = level_m - self.origin[2]
            ground, slabs = (at_heights(surfaces, z, snap_m) for z in (level_m[[0, -1]], level_m))
        surfaces = without_rims(surfaces, ground)
        self.floor_ceiling = not is_floor_plan(surfaces, slabs) if floor_ceiling is None else floor_ceiling
        mirrors = ~slabs | self.floor_ceiling
        self.setting = setting(surfaces.facet_face)
        passes = self.setting.walls[:, 1].real > 0
        self.space = make_space(surfaces, mirrors, passes, patches)
        if not passes.any():
            self.setting = self.setting._replace(max_through=0)
        self._sides = None
        if self.setting.max_through == 1:
            sides = Sides(local)
            self._sides = sides if sides.closed[face_wall[:, 1].real > 0].all() else None
        logger.info(f"{len(mirrors)} facets and {len(surfaces.edge)} edges in space")
        self._by_rays = search == "rays" or (search == "auto" and len(mirrors) >= MANY_FACETS)
        self._candidates = cache(
            lambda through: Candidates(self.space, self.setting._replace(max_through=through), rays)
        )

    def tables(
        self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], workers: int | None
    ) -> Rows:
        """Paths of each transmitter, to receivers in blocks."""
        leads_on = self._sides is None or not self._sides.alike(np.concatenate([tx, rx]))
        setting = self.setting if leads_on else self.setting._replace(max_through=0)

        def trace(txs: slice, rxs: slice) -> Iterator[Table]:
            receivers = rx[rxs]
            boxes = make_boxes(receivers, receivers)
            for source in tx[txs]:
                yield trace_space(self.space, setting, source, receivers, boxes)

        if not self._by_rays:
            return trace_blocks(len(tx), len(rx), trace, workers)
        candidates = self._candidates(setting.max_through)
        return trace_blocks(len(tx), len(rx), lambda txs, rxs: candidates.trace(tx[txs], rx[rxs]), workers)

    def misplaced(self, points: Points) -> str:
        """Nothing: points may lie anywhere."""
        return ""


def limits_of(setting: Setting, most_visits: int, span_m: np.ndarray | None = None) -> Limits:
    """How far transmitters are followed, see `Limits`."""
    orders = setting.max_reflections, setting.side_reflections, setting.max_through
    return Limits(*orders, most_visits, np.zeros((2, 2)) if span_m is None else span_m)


def trace_plans(
    layers: Layers,
    setting: Setting,
    limits: Limits,
    tx: tuple[Float[np.ndarray, "n_tx 3"], Around],
    rx: tuple[Float[np.ndarray, "n_rx 3"], Around],
    visible: Callable[[np.ndarray, np.ndarray, np.ndarray], Visibility],
    workers: int | None,
) -> Rows:
    """Paths of each transmitter, to receivers in blocks."""

    def trace(txs: slice, rxs: slice) -> Iterator[Table]:
        receivers, (start, triangle) = rx[0][rxs], part_of(*rx[1], rxs)
        views = views_of(layers, receivers, start, triangle, limits._replace(target_order=-1))
        tx_start, tx_triangle = part_of(*tx[1], txs)
        for i, source in enumerate(tx[0][txs]):
            seen = visible(source, tx_triangle[tx_start[i] : tx_start[i + 1]], triangle)
            yield trace_links(layers, setting, source, seen, receivers, start, triangle, views)

    return trace_blocks(len(tx[0]), len(rx[0]), trace, workers)


def _bytes(seen: Visibility) -> int:
    return seen.sector.nbytes + seen.visit.nbytes  # the rest is small


def mask_of(places: Int[np.ndarray, " s"], n: int) -> Bool[np.ndarray, " n"]:
    """True at some of n places."""
    flags = np.zeros(n, bool)
    flags[places] = True
    return flags


def part_of(
    start: Int[np.ndarray, " r1"], triangle: Int[np.ndarray, " s"], rows: slice
) -> tuple[Int[np.ndarray, " p1"], Int[np.ndarray, " q"]]:
    """The triangles of some points in a row, counted from their own first."""
    first, last = start[rows.start], start[rows.stop]
    return start[rows.start : rows.stop + 1] - first, triangle[first:last]
