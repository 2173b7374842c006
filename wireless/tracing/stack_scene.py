"""Stacked storeys made ready for tracing: which ones are traced as such, and which ones in space."""

import logging
from collections.abc import Callable

import numpy as np
import trimesh
from jaxtyping import Complex, Float, Int

from wireless.geometry.array_types import Points
from wireless.geometry.facets import at_heights, find_surfaces, without_rims
from wireless.geometry.layers import make_layers
from wireless.geometry.plan import Locator
from wireless.geometry.stack import Stack
from wireless.geometry.visibility import Visibility, find_visibility
from wireless.tracing.blocks import Rows
from wireless.tracing.scenes import Around, limits_of, mask_of, trace_plans
from wireless.tracing.table import Setting

logger = logging.getLogger(__name__)


class NoStackError(Exception):
    """Why storeys cannot be traced as such; the message goes on after "because"."""


class StackScene:
    """Storeys over each other, and how links in and between them are traced.

    Raises:
        NoStackError: If rooms are not closed, or paths may reflect at or pass slabs.
    """

    engine = "storeys"
    floor_ceiling = False

    def __init__(
        self,
        stack: Stack,
        mesh: trimesh.Trimesh,
        face_material: Int[np.ndarray, " n"],
        face_wall: Complex[np.ndarray, "n l"],
        setting: Callable[[np.ndarray], Setting],
        *,
        snap_m: float,
        floor_ceiling: bool,
    ):
        if floor_ceiling:
            raise NoStackError("floors and ceilings reflect")
        self.origin = np.append(stack.origin, 0.0)
        local = trimesh.Trimesh(mesh.vertices - self.origin, mesh.faces, process=False)
        surfaces = find_surfaces(local, face_material, snap_m)
        surfaces = without_rims(surfaces, at_heights(surfaces, stack.level_m[[0, -1]], snap_m))
        stacked = make_layers(stack, surfaces, snap_m)
        if stacked is None:
            raise NoStackError("its rooms are not closed")
        self.layers, self.room = stacked.layers, stacked.room
        self._setting = setting(stacked.face)
        thin = bool((face_wall[:, 1].real > 0).any())
        if thin and self._setting.max_through > (1 if stacked.sealed else 0):
            raise NoStackError("paths may pass walls into other rooms")
        self._setting = self._setting._replace(max_through=0)
        self._snap_m = snap_m
        self._places = [self._locator(layer) for layer in range(len(stack.walls))]
        logger.info(f"{len(stack.walls) // 2 + 1} storeys of {len(self.layers.plan.wall_along)} walls")

    def _locator(self, layer: int) -> tuple[Locator, Int[np.ndarray, " t"]] | None:
        """Locator of the triangles of a layer, and the numbers of these triangles."""
        plan, triangles = self.layers.plan, np.flatnonzero(self.layers.tri_layer == layer)
        if not len(triangles):
            return None
        layer_plan = plan._replace(tri_vertex=plan.tri_vertex[triangles], tri_wall=plan.tri_wall[triangles])
        return Locator(layer_plan, 2 * self._snap_m), triangles

    def _around(self, points: Points) -> Around:
        """Where each point's triangles begin, and these; none for a point in no layer, or on a floor or ceiling."""
        level, snap_m = self.layers.level_m, self._snap_m
        layer = np.searchsorted(level, points[:, 2], side="right") - 1
        layer[np.abs(points[:, 2] - level[0]) <= snap_m] = 0
        layer[np.abs(points[:, 2] - level[-1]) <= snap_m] = len(level) - 2
        on = (np.abs(points[:, 2, None] - level[1:-1]) <= snap_m).any(axis=1)
        point, triangle = [np.empty(0, np.int64)], [np.empty(0, np.int64)]
        for number, place in enumerate(self._places):
            inside = np.flatnonzero((layer == number) & ~on)
            if place is not None and len(inside):
                start, triangles = place[0](points[inside, :2])
                point.append(inside[np.repeat(np.arange(len(inside)), np.diff(start))])
                triangle.append(place[1][triangles])
        of, triangles = np.concatenate(point), np.concatenate(triangle)
        order = np.lexsort((triangles, of))
        return np.searchsorted(of[order], np.arange(len(points) + 1)), triangles[order]

    def misplaced(self, points: Points) -> str:
        """Return an error message for points, around the origin, that do not lie in rooms; empty if all do."""
        start, triangle = self._around(points)
        if (np.diff(start) > 0).all() and self.room[triangle].all():
            return ""
        return (
            "positions in slabs or walls, outside, or at the height of a floor or ceiling between storeys, "
            "expected within rooms. Trace them with scene='space'."
        )

    def tables(
        self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], workers: int | None
    ) -> Rows:
        """Paths of each transmitter, to receivers in blocks."""
        layers, setting = self.layers, self._setting
        has_rims = len(layers.outline.edge_gap_rad) > layers.outline.n_corners
        rim = layers.level_m[1:-1] if has_rims else np.empty(0)
        both = np.concatenate([tx[:, 2], rx[:, 2], rim])
        span_m = np.array([[rx[:, 2].min(), rx[:, 2].max()], [both.min(), both.max()]])
        limits = limits_of(setting, 0, span_m)

        def visible(source: np.ndarray, around: np.ndarray, targets: np.ndarray) -> Visibility:
            return find_visibility(layers, around, source, mask_of(targets, len(layers.tri_layer)), limits)

        both_around = self._around(tx), self._around(rx)
        return trace_plans(
            layers, setting, limits, (tx, both_around[0]), (rx, both_around[1]), visible, workers
        )
