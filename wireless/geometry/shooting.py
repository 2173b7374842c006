"""Shooting and bouncing rays: which chains of patches a point may see, and which edges over them.

Rays leave a point in all directions, are mirrored where they meet a patch that reflects, and note what they met:
the patches in a row, and over them the edges of the patch that they met next. Embree answers a million such rays
a second whatever the number of triangles, in single precision. That is enough, because nothing but names comes of
it: images, reflection points and edge points are computed from these names in double precision, and each leg is
looked at in the double-precision tree. So a chain that rounding made up gives no path, and all that rays can
do wrong is to miss a chain.

Directions are the first n of one sequence that fills the sphere evenly at any length, without a seed: more rays are
the same rays and others, and find the same chains and others.

Reference: H. Ling, R.-C. Chou and S.-W. Lee, Shooting and bouncing rays, IEEE Trans. Antennas Propag. 37 (1989) 194;
M. Roberts, The unreasonable effectiveness of quasirandom sequences (2018), for the sequence.
"""

from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float, Int

from wireless.geometry.images import Space

#: Steps of the sequence: powers of the number whose cube is itself and one (the plane's golden ratio).
_STEPS = 0.7548776662466927, 0.5698402909980532
#: How far before a patch a mirrored ray starts, lest single precision let it meet that patch again [m].
_LIFT_M = 1e-4


class Sightings(NamedTuple):
    """What points see over chains of patches."""

    chains: tuple[Int[np.ndarray, "_ _"], ...]
    """Chains of two patches, of three, and so on, in rising order, of the first point; without doubles."""
    start: Int[np.ndarray, " s1"]
    """Where each point's edges begin, and an end."""
    edge: Int[np.ndarray, " q"]
    """Edges that points see over one patch or more, rising for each point."""
    over: Int[np.ndarray, "q m"]
    """The patches that each is seen over, the first from the point first; -1 beyond the last."""


class Shooter:
    """A space made ready to shoot rays in.

    Args:
        space: Surfaces around an origin of their own.
    """

    def __init__(self, space: Space):
        self._space = space
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, space.triangle.astype(np.float32))
        self._patch = np.repeat(np.arange(len(space.patch_facet)), np.diff(space.start))
        self._edge_start, self._edge = edges_of_patches(space)

    def shoot(
        self, points: Float[np.ndarray, "s 3"], rays: int, reflections: int, edge_reflections: int
    ) -> Sightings:
        """Chains that rays from each point find, in a row that does not depend on how many points there are.

        Args:
            points: Where rays start, around the space's origin [m].
            rays: Rays from each.
            reflections: Most patches of a chain.
            edge_reflections: Most patches that edges are looked for over.
        """
        most = max(reflections, edge_reflections)
        n_patches = len(self._space.patch_facet)
        way = np.tile(directions(rays), (len(points), 1))
        start = np.repeat(points, rays, axis=0)
        node = np.repeat(np.arange(len(points)), rays)
        # What each node is: its point, and its chain.
        owner, chain = np.arange(len(points)), np.empty((len(points), 0), np.int64)
        chains: list[np.ndarray] = []
        seen: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        for order in range(most + 1):
            triangle = self._scene.run(start.astype(np.float32), way.astype(np.float32))
            met = triangle >= 0
            patch = self._patch[triangle[met]]
            start, way, node = start[met], way[met], node[met]
            nodes, inverse = np.unique(node * n_patches + patch, return_inverse=True)
            of, new = nodes // n_patches, nodes % n_patches
            if 0 < order <= edge_reflections:
                seen.append(self._edges(owner[of], chain[of], new))
            if order == most:
                break
            facet = self._space.patch_facet[patch]
            normal = self._space.surfaces.facet_normal[facet]
            slope = np.einsum("ij,ij->i", way, normal)
            off = np.einsum("ij,ij->i", start - self._space.surfaces.facet_point[facet], normal)
            good = self._space.mirrors[facet] & (np.abs(slope) > 1e-9)
            node, way, start = inverse[good], way[good], start[good]
            normal, slope, off = normal[good], slope[good], off[good]
            start = start - (off / slope)[:, None] * way - (_LIFT_M * np.sign(slope))[:, None] * normal
            way = way - 2 * slope[:, None] * normal
            owner, chain = owner[of], np.column_stack([chain[of], new])
            if 0 < order < reflections:
                mine = (owner == 0) & self._space.mirrors[self._space.patch_facet[new]]
                chains.append(chain[mine])
        return self._gathered(len(points), chains, seen, edge_reflections)

    def _edges(
        self, owner: Int[np.ndarray, " v"], chain: Int[np.ndarray, "v m"], patch: Int[np.ndarray, " v"]
    ) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, " q"], Int[np.ndarray, "q m"]]:
        """Edges of what was met over chains: point, edge and chain of each, without doubles."""
        count = self._edge_start[patch + 1] - self._edge_start[patch]
        row = np.repeat(np.arange(len(patch)), count)
        at = np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
        edge = self._edge[self._edge_start[patch[row]] + at]
        # Rows of one chain follow each other: number them.
        new = np.ones(len(chain), bool)
        new[1:] = (owner[1:] != owner[:-1]) | (chain[1:] != chain[:-1]).any(axis=1)
        number = np.cumsum(new) - 1
        _, kept = np.unique(number[row] * len(self._space.surfaces.edge) + edge, return_index=True)
        return owner[row[kept]], edge[kept], chain[row[kept]]

    def _gathered(
        self,
        n_points: int,
        chains: list[np.ndarray],
        seen: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
        edge_reflections: int,
    ) -> Sightings:
        """Edges of all orders in one table, by point and edge."""
        most = max(edge_reflections, 1)
        owner = np.concatenate([s[0] for s in seen]) if seen else np.empty(0, np.int64)
        edge = np.concatenate([s[1] for s in seen]) if seen else np.empty(0, np.int64)
        over = np.full((len(edge), most), -1, np.int64)
        row = 0
        for _, _, chain in seen:
            over[row : row + len(chain), : chain.shape[1]] = chain
            row += len(chain)
        order = np.lexsort((edge, owner))
        owner, edge, over = owner[order], edge[order], over[order]
        start = np.searchsorted(owner, np.arange(n_points + 1))
        return Sightings(tuple(chains), start, edge, over)


def directions(n: int) -> Float[np.ndarray, "n 3"]:
    """The first n unit vectors of a sequence that fills the sphere evenly at any length."""
    k = np.arange(1, n + 1)
    z = 1 - 2 * np.modf(0.5 + k * _STEPS[0])[0]
    turn = 2 * np.pi * np.modf(k * _STEPS[1])[0]
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def edges_of_patches(space: Space) -> tuple[Int[np.ndarray, " p1"], Int[np.ndarray, " q"]]:
    """Edges at each patch: where those of each begin, and the edges.

    Of the patches of a facet those count whose box meets the edge's.
    """
    surfaces, n_patches = space.surfaces, len(space.patch_facet)
    first = np.searchsorted(space.patch_facet, np.arange(len(surfaces.facet_face) + 1))
    facet = surfaces.edge_facets.ravel()
    edge = np.repeat(np.arange(len(surfaces.edge)), 2)
    count = first[facet + 1] - first[facet]
    row = np.repeat(np.arange(len(facet)), count)
    patch = first[facet[row]] + np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    used = (np.arange(space.window.shape[1]) < space.corners[:, None])[..., None]
    low = np.where(used, space.window, np.inf).min(axis=1) - _LIFT_M
    high = np.where(used, space.window, -np.inf).max(axis=1) + _LIFT_M
    ends = surfaces.edge[edge[row]]
    near = ((ends.max(axis=1) >= low[patch]) & (ends.min(axis=1) <= high[patch])).all(axis=1)
    pairs = np.unique(patch[near] * max(len(surfaces.edge), 1) + edge[row[near]])
    of, edges = pairs // max(len(surfaces.edge), 1), pairs % max(len(surfaces.edge), 1)
    return np.searchsorted(of, np.arange(n_patches + 1)), edges
