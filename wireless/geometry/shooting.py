"""Shooting and bouncing rays: which chains of patches a point may see, and which edges over them.

Rays leave a point in all directions, are mirrored where they meet a patch that reflects, and record what they met:
the patches in a row, and over them the edges of the patch that they met next. Rays that an edge bends leave its
points on Keller's cones and are followed alike. A wall that lets paths through mirrors a ray and lets it on, up to as
many walls as may be passed, which chains do not name. Embree answers a million such rays a second whatever the
number of triangles, in single precision. That is enough, because nothing but names comes of it: images, reflection
points and edge points are computed from these names in double precision, and each leg is looked at in the
double-precision tree. So a chain that rounding made up gives no path, and all that rays can do wrong is to miss a
chain.

Directions are the first n of one sequence that fills the sphere evenly at any length, without a seed: more rays are
the same rays and others, and find the same chains and others. Points of an edge and turns about it are of one
sequence too, of which each edge takes the more the larger it appears.

References: H. Ling, R.-C. Chou and S.-W. Lee, Shooting and bouncing rays, IEEE Trans. Antennas Propag. 37 (1989) 194;
J. B. Keller, Geometrical theory of diffraction, J. Opt. Soc. Am. 52 (1962) 116; M. Roberts, The unreasonable
effectiveness of quasirandom sequences (2018), for the sequences.
"""

from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int

from wireless.geometry.array_types import Point, Points
from wireless.geometry.facets import counted
from wireless.geometry.neighbours import gathered
from wireless.geometry.space import Ground, Space
from wireless.geometry.tolerance import NEAR_M

#: Steps of the sequence: powers of the number whose cube is itself and one (the plane's golden ratio).
_STEPS = 0.7548776662466927, 0.5698402909980532
#: Step along triangles of a patch.
_GOLDEN = 0.6180339887498949
#: How far before a patch a mirrored ray starts, so that in single precision it does not meet that patch again [m].
_LIFT_M = 1e-4
#: Directions that are tried at each point of an edge.
_TURNS = 16
#: An edge that fills this angle [rad] bends as many rays as the transmitter shoots.
EDGE_RAD = 40.0
#: Rays that are shot at once: some 400 bytes each.
_AT_ONCE = 400_000
#: Rays that are aimed at a patch in view, however small, and most of them all for each ray in all directions.
RAYS_AIMED, MOST_AIMED = 64, 4


class Sightings(NamedTuple):
    """Chains of patches over which rays from a point arrive."""

    chains: tuple[Int[np.ndarray, "_ _"], ...]
    """Chains of two patches, of three, and so on, in rising order; without doubles."""
    edge: Int[np.ndarray, " q"]
    """Edges that the point sees over one patch or more."""
    over: Int[np.ndarray, "q m"]
    """The patches that each is seen over, the first from the point first; -1 beyond the last."""


class Bent(NamedTuple):
    """Chains of patches that diffracted rays meet behind edges."""

    sight: Int[np.ndarray, " b"]
    """Which of the edges that were given."""
    chain: Int[np.ndarray, "b m"]
    """Patches in a row, the first from the edge first."""


class _Met(NamedTuple):
    """Patches that rays meet, a row for each patch of each ray."""

    ray: Int[np.ndarray, " m"]
    """Which ray."""
    patch: Int[np.ndarray, " m"]
    """Patch that it meets."""
    at: Float[np.ndarray, "m 3"]
    """Where [m]."""
    normal: Float[np.ndarray, "m 3"]
    """The patch's unit normal."""
    slope: Float[np.ndarray, " m"]
    """Cosine between ray and normal; 0 for what it only grazes, where it ends."""
    left: Int[np.ndarray, " m"]
    """Walls that it may still pass."""


class Shooter:
    """A space made ready to shoot rays in.

    Args:
        space: Surfaces around an origin of their own.
        through: Most walls that a ray passes, on each side of an edge.
    """

    def __init__(self, space: Space, through: int):
        self._space, self._through = space, through
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, space.ground.triangle.astype(np.float32))
        self._patch = np.repeat(np.arange(len(space.patch_facet)), np.diff(space.ground.start))
        self._edge_start, self._edge = edges_of_patches(space)

    def shoot(
        self,
        point: Point,
        rays: int,
        reflections: int,
        edge_reflections: int,
        aims: Int[np.ndarray, " a"],
    ) -> Sightings:
        """Chains that rays from a point find; more rays at the patches `aims` find chains without edges alone."""
        chains = self._chains(point, directions(rays), max(reflections, edge_reflections))
        mirrors = self._space.mirrors[self._space.patch_facet]
        edges = [self._edges(chain) for chain in chains[1 : edge_reflections + 1]]
        over = np.full((sum(len(edge) for edge, _ in edges), max(edge_reflections, 1)), -1, np.int64)
        row = 0
        for _, chain in edges:
            over[row : row + len(chain), : chain.shape[1]] = chain
            row += len(chain)
        if len(aims) and reflections > 1:
            n_rays = int(min(RAYS_AIMED, max(1, MOST_AIMED * rays // len(aims))))
            aimed = self._chains(point, aimed_at(self._space.ground, point, aims, n_rays), reflections - 1)
            for order in range(1, reflections):
                chains[order] = _together([chains[order], aimed[order]], order + 1)
        return Sightings(
            tuple(chain[mirrors[chain[:, -1]]] for chain in chains[1:reflections]),
            np.concatenate([np.empty(0, np.int64), *(edge for edge, _ in edges)]),
            over,
        )

    def _chains(self, point: Point, every: Points, reflections: int) -> list[Int[np.ndarray, "_ _"]]:
        """Chains of patches that rays from a point meet, of one patch, of two, and so on; none twice."""
        met: list[list[np.ndarray]] = [[] for _ in range(reflections + 1)]
        for first in range(0, len(every), _AT_ONCE):
            direction = every[first : first + _AT_ONCE]
            start, owner = np.tile(point, (len(direction), 1)), np.zeros(len(direction), np.int64)
            for order, (_, chain) in enumerate(self._followed(start, direction, owner, reflections)):
                met[order].append(chain)
        return [_together(lots, order + 1) for order, lots in enumerate(met)]

    def bend(
        self,
        source: Float[np.ndarray, "q 3"],
        edge: Int[np.ndarray, " q"],
        seen: Bool[np.ndarray, " q"],
        rays: int,
        reflections: int,
    ) -> tuple[Bent, ...]:
        """Chains of one patch, of two, and so on, that rays find which edges bend; none twice.

        Args:
            source: Where rays to each edge come from, a point or its image [m].
            edge: The edges.
            seen: Whether a source is the point itself, which must see where on the edge a ray is bent.
            rays: Rays that the point shoots in all directions; an edge bends its share.
            reflections: Most patches of a chain.
        """
        if not len(edge) or reflections < 1:
            return ()
        surfaces = self._space.surfaces
        ends, wedge = surfaces.edge[edge], surfaces.edge_wedge[edge]
        away = source - ends[:, 0]
        z = np.einsum("ij,ij->i", away, wedge[:, 0])
        distance = np.linalg.norm(away - z[:, None] * wedge[:, 0], axis=1)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        fills = np.arctan2(length - z, distance) - np.arctan2(-z, distance)
        count = np.where(distance > NEAR_M, np.ceil(rays * fills / EDGE_RAD), 0).astype(np.int64)
        chains: list[list[np.ndarray]] = [[] for _ in range(reflections)]
        batch = np.cumsum(count) // _AT_ONCE
        for which in np.split(np.arange(len(edge)), np.flatnonzero(np.diff(batch)) + 1):
            # Points of edges first: most edges of a full room are hidden.
            points = -(-count[which] // _TURNS)
            sight, k = np.repeat(which, points), counted(points)
            share = np.modf(0.5 + (k + 1) * _STEPS[0])[0]
            at = ends[sight, 0] + (share * length[sight])[:, None] * wedge[sight, 0]
            direction = at - source[sight]
            far = np.linalg.norm(direction, axis=1)
            direction /= np.maximum(far, NEAR_M)[:, None]
            free = far > 4 * _LIFT_M
            direct = np.flatnonzero(free & seen[sight])
            free[direct] = self._free(source[sight[direct]], direction[direct], far[direct] - 2 * _LIFT_M)
            sight, k, at, direction = sight[free], k[free], at[free], direction[free]
            turns = np.minimum(count[sight] - k * _TURNS, _TURNS)
            of = np.repeat(np.arange(len(sight)), turns)
            turn = np.modf((k[of] * _TURNS + counted(turns) + 1) * _STEPS[1])[0]
            sight = sight[of]
            turn *= surfaces.edge_gap_rad[edge[sight]]
            axes, along = wedge[sight], np.einsum("ij,ij->i", direction[of], wedge[sight, 0])
            out = np.cos(turn)[:, None] * axes[:, 1] + np.sin(turn)[:, None] * axes[:, 2]
            direction = along[:, None] * axes[:, 0] + np.sqrt(1 - np.minimum(along**2, 1))[:, None] * out
            at = at[of]
            met = self._followed(at + _LIFT_M * out, direction, sight, reflections - 1)
            for order, (origin, chain) in enumerate(met):
                rows = np.column_stack([origin, chain])[
                    self._space.mirrors[self._space.patch_facet[chain[:, -1]]]
                ]
                chains[order].append(rows)
        joined = [np.concatenate(lots) for lots in chains]
        return tuple(Bent(rows[:, 0], rows[:, 1:]) for rows in joined)

    def _followed(
        self, start: Points, direction: Points, owner: Int[np.ndarray, " n"], reflections: int
    ) -> list[tuple[Int[np.ndarray, " c"], Int[np.ndarray, "c m"]]]:
        """Owners and chains of what rays meet, of one patch, of two, up to one more than they are mirrored."""
        # No row comes twice.
        n_patches = len(self._space.patch_facet)
        chain = np.empty((int(owner.max(initial=-1)) + 1, 0), np.int64)
        node, of_node = owner, np.arange(len(chain))
        result = []
        left = np.full(len(start), self._through)
        for order in range(reflections + 1):
            met = self._met(start, direction, left)
            patch, direction, node, left = met.patch, direction[met.ray], node[met.ray], met.left
            nodes, inverse = np.unique(node * n_patches + patch, return_inverse=True)
            before, new = nodes // n_patches, nodes % n_patches
            of_node, chain = of_node[before], np.column_stack([chain[before], new])
            result.append((of_node, chain))
            if order == reflections:
                break
            good = self._space.mirrors[self._space.patch_facet[patch]] & (met.slope != 0)
            node, direction, left = inverse[good], direction[good], left[good]
            normal, slope = met.normal[good], met.slope[good]
            start = met.at[good] - (_LIFT_M * np.sign(slope))[:, None] * normal
            direction = direction - 2 * slope[:, None] * normal
        return result

    def _met(self, start: Points, direction: Points, left: Int[np.ndarray, " n"]) -> "_Met":
        """Return the patches that rays meet, also behind walls that they pass, each with a number of walls left."""
        hits: list[_Met] = []
        ray = np.arange(len(start))
        while len(ray) or not hits:
            triangle = self._scene.run(start.astype(np.float32), direction[ray].astype(np.float32))
            met = triangle >= 0
            ray, left, patch = ray[met], left[met], self._patch[triangle[met]]
            normal, slope, off = self._planes(patch, start[met], direction[ray])
            slope[np.abs(slope) < 1e-9] = 0
            back = np.divide(off, slope, out=np.zeros_like(off), where=slope != 0)
            at = start[met] - back[:, None] * direction[ray]
            hits.append(_Met(ray, patch, at, normal, slope, left))
            on = self._space.passes[self._space.patch_facet[patch]] & (left > 0) & (slope != 0)
            start = at[on] + (_LIFT_M * np.sign(slope[on]))[:, None] * normal[on]
            ray, left = ray[on], left[on] - 1
        return hits[0] if len(hits) == 1 else _Met(*map(np.concatenate, zip(*hits, strict=True)))

    def _planes(
        self, patch: Int[np.ndarray, " n"], start: Points, direction: Points
    ) -> tuple[Points, Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
        """Unit normals of patches that rays meet, cosines between rays and these, and how far off rays start [m]."""
        facet, surfaces = self._space.patch_facet[patch], self._space.surfaces
        normal = surfaces.facet_normal[facet]
        off = np.einsum("ij,ij->i", start - surfaces.facet_point[facet], normal)
        return normal, np.einsum("ij,ij->i", direction, normal), off

    def _free(self, start: Points, direction: Points, far: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """Whether rays come so far [m], through no more walls than may be passed."""
        free, start, far = np.ones(len(start), bool), start.copy(), far.copy()
        ray = np.arange(len(start))
        for passed in range(self._through + 1):
            begin, along, reach = (a[ray].astype(np.float32) for a in (start, direction, far))
            triangle = self._scene.run(begin, along, dists=reach)
            ray, patch = ray[triangle >= 0], self._patch[triangle[triangle >= 0]]
            _, slope, off = self._planes(patch, start[ray], direction[ray])
            on = self._space.passes[self._space.patch_facet[patch]] & (np.abs(slope) > 1e-9)
            on &= passed < self._through
            free[ray[~on]] = False
            ray, slope, off = ray[on], slope[on], off[on]
            step = -off / slope + _LIFT_M / np.abs(slope)
            start[ray] += step[:, None] * direction[ray]
            far[ray] -= step
            ray = ray[far[ray] > 0]
        return free

    def _edges(self, chain: Int[np.ndarray, "v m"]) -> tuple[Int[np.ndarray, " q"], Int[np.ndarray, "q l"]]:
        """Edges of the last patch of chains, and the patches before it; without doubles."""
        patch, chain = chain[:, -1], chain[:, :-1]
        row, edge = gathered(self._edge_start, self._edge, patch)
        # Rows of one chain follow each other: number them.
        new = np.ones(len(chain), bool)
        new[1:] = (chain[1:] != chain[:-1]).any(axis=1)
        number = np.cumsum(new) - 1
        _, first = np.unique(number[row] * len(self._space.surfaces.edge) + edge, return_index=True)
        return edge[first], chain[row[first]]


def directions(n: int) -> Points:
    """The first n unit vectors of a sequence that fills the sphere evenly at any length."""
    k = np.arange(1, n + 1)
    z = 1 - 2 * np.modf(0.5 + k * _STEPS[0])[0]
    turn = 2 * np.pi * np.modf(k * _STEPS[1])[0]
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def aimed_at(ground: Ground, point: Point, patch: Int[np.ndarray, " p"], rays: int) -> Points:
    """Unit vectors from a point to places spread over the triangles of each patch: the first n of one sequence."""
    k = np.arange(1, rays + 1)
    share, u, v = (np.modf(k * step)[0] for step in (_GOLDEN, *_STEPS))
    triangle = ground.triangle[
        ground.start[patch, None] + (share * np.diff(ground.start)[patch, None]).astype(np.int64)
    ]
    u, v = np.where(u + v > 1, (1 - u, 1 - v), (u, v))[..., None]
    sides = triangle[:, :, 1:] - triangle[:, :, :1]
    away = (triangle[:, :, 0] + u * sides[:, :, 0] + v * sides[:, :, 1] - point).reshape(-1, 3)
    return away / np.maximum(np.linalg.norm(away, axis=1), NEAR_M)[:, None]


def edges_of_patches(space: Space) -> tuple[Int[np.ndarray, " p1"], Int[np.ndarray, " q"]]:
    """Edges at each patch: where those of each begin, and the edges.

    Of the patches of a facet those count whose box meets the edge's.
    """
    surfaces, n_patches = space.surfaces, len(space.patch_facet)
    first = np.searchsorted(space.patch_facet, np.arange(len(surfaces.facet_face) + 1))
    edge = np.repeat(np.arange(len(surfaces.edge)), 2)
    row, patch = gathered(first, np.arange(n_patches), surfaces.edge_facets.ravel())
    low, high = space.panes.low - _LIFT_M, space.panes.high + _LIFT_M
    ends = surfaces.edge[edge[row]]
    near = ((ends.max(axis=1) >= low[patch]) & (ends.min(axis=1) <= high[patch])).all(axis=1)
    pairs = np.unique(patch[near] * max(len(surfaces.edge), 1) + edge[row[near]])
    of, edges = pairs // max(len(surfaces.edge), 1), pairs % max(len(surfaces.edge), 1)
    return np.searchsorted(of, np.arange(n_patches + 1)), edges


def _together(lots: list[Int[np.ndarray, "_ _"]], length: int) -> Int[np.ndarray, "c m"]:
    """Chains of one length from several lots, each sorted and without doubles, as one such."""
    if len(lots) == 1:
        return lots[0]
    return np.unique(np.concatenate([np.empty((0, length), np.int64), *lots]), axis=0)
