"""Routes of a robot along measured places: shortest routes from random ones, from neighbour to neighbour.

Places lie on a square grid. A route goes from a place to one of the eight around it, by the shortest sum of
distances, between two random places that are connected, or, as at the end of a search, to the place nearest to a
goal; every place on it is one measurement.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

#: Neighbours are this many steps of the grid apart at most: also diagonal ones.
_REACH = 1.5


def make_routes(
    position: Float[np.ndarray, "n 2"],
    step_m: float,
    count: int,
    rng: np.random.Generator,
    *,
    goal: Float[np.ndarray, "2"] | None = None,
) -> list[Int[np.ndarray, " _"]]:
    """Routes as rows of `position`.

    Args:
        position: Places [m].
        step_m: Step of their grid [m].
        count: Number of routes.
        rng: Chooses both ends, or the first one; of those that can be reached from the other.
        goal: Routes end at the place nearest to this [m].
    """
    pairs = cKDTree(position).query_pairs(_REACH * step_m, output_type="ndarray")
    length = np.linalg.norm(position[pairs[:, 0]] - position[pairs[:, 1]], axis=1)
    graph = csr_matrix((length, pairs.T), shape=(len(position), len(position)))
    if goal is None:
        start = rng.integers(len(position), size=count)
    else:
        start = np.full(count, np.linalg.norm(position - goal, axis=1).argmin())
    _, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    routes = []
    for first, came_from in zip(start, before, strict=True):
        reached = np.append(np.flatnonzero(came_from >= 0), first)
        route = [int(rng.choice(reached))]
        while route[-1] != first:
            route.append(int(came_from[route[-1]]))
        routes.append(np.array(route if goal is not None else route[::-1]))
    return routes


def step_lengths(
    position: Float[np.ndarray, "n 2"], route: Int[np.ndarray, " places"]
) -> Float[np.ndarray, " places"]:
    """Distance of each place of a route from the one before [m]; 0 for the first."""
    return np.linalg.norm(np.diff(position[route], axis=0, prepend=position[route[:1]]), axis=1)
