"""Circular arcs that runs of short walls stand for: round posts and curved walls, of a drawing or of a raster.

Walls that meet end to end form chains. A part of a chain is an arc if a circle fits it: ends and middles of its walls
are near the circle, there are four walls at least, each turns by 60 degrees at most, and all together by 60 degrees at
least. The circle is that of least squares of x^2 + y^2 - 2 c.(x, y) - d over the length of the walls (Kasa, IEEE Trans.
Instrum. Meas. 25, 1976). Of parts that overlap, those that turn more go first.
"""

from collections import defaultdict
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

#: How far walls may be from the circle: share of its radius, but no more than this [m], a cell of a raster.
OFF, OFF_M = 0.2, 0.05
#: Least turn of an arc and most of a wall [rad], largest radius [m], and fewest and most walls.
TURN_RAD, LARGEST_M, FEWEST, MOST = np.pi / 3, 20.0, 4, 64


class Arc(NamedTuple):
    """Part of a circle, seen from outside."""

    centre: Float[np.ndarray, "2"]
    """Its centre [m]."""
    radius_m: float
    from_rad: float
    """Direction from the centre to one end."""
    turn_rad: float
    """Angle counter-clockwise to the other end."""
    walls: Int[np.ndarray, " k"]
    """The walls that stand for it, from one end to the other."""
    off_m: float
    """How far they are from it at most."""


def find_arcs(walls: Float[np.ndarray, "n 2 2"], snap_m: float) -> list[Arc]:
    """Arcs among walls, whose ends are one if closer than about `snap_m`."""
    candidates = [arc for chain, point in _chains(walls, snap_m) for arc in _arcs(chain, point)]
    used: set[int] = set()
    arcs = []
    for arc in sorted(candidates, key=lambda candidate: -candidate.turn_rad):
        if used.isdisjoint(arc.walls.tolist()):
            used.update(arc.walls.tolist())
            arcs.append(arc)
    return arcs


def _chains(
    walls: Float[np.ndarray, "n 2 2"], snap_m: float
) -> list[tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k1 2"]]]:
    """Walls that meet end to end where no other does, and their ends; a ring is walked twice."""
    node = np.unique(np.round(walls.reshape(-1, 2) / snap_m), axis=0, return_inverse=True)[1].reshape(-1, 2)
    at: defaultdict[int, list[int]] = defaultdict(list)
    for wall, ends in enumerate(node.tolist()):
        for end in ends:
            at[end].append(wall)
    left = dict.fromkeys(range(len(walls)))
    # Chains first, from where they begin; the rest are rings.
    begins = [wall for wall, ends in enumerate(node.tolist()) if any(len(at[end]) != 2 for end in ends)]
    chains = []
    for first in (*begins, *range(len(walls))):
        if first not in left:
            continue
        side = int(len(at[int(node[first, 0])]) == 2)  # begin at the end where the chain ends
        wall, chain, point, ahead = first, [], [walls[first, side]], int(node[first, 1 - side])
        while wall in left:
            del left[wall]
            chain.append(wall)
            point.append(walls[wall, int(node[wall, 1] == ahead)])
            if len(at[ahead]) != 2:
                break
            wall = sum(at[ahead]) - wall
            ahead = int(node[wall].sum() - ahead)
        if wall == first and len(chain) > 1:
            chain, point = 2 * chain, point + point[1:]
        chains.append((np.array(chain), np.array(point)))
    return chains


def _arcs(chain: Int[np.ndarray, " k"], point: Float[np.ndarray, "k1 2"]) -> list[Arc]:
    """The longest arc that begins at each wall of a chain."""
    point = point - (origin := point.mean(axis=0))
    middle = (point[1:] + point[:-1]) / 2
    length = np.linalg.norm(np.diff(point, axis=0), axis=1)
    # Integrals along walls by Simpson's rule, summed up from the first on.
    a = np.stack([point[:-1], middle, point[1:]])
    weight = np.array([1, 4, 1])[:, None] / 6 * length
    row = np.concatenate([2 * a, np.ones((3, len(chain), 1))], axis=2)
    square = (a**2).sum(axis=2)
    normal = np.einsum("qk,qki,qkj->kij", weight, row, row)
    right = np.einsum("qk,qki,qk->ki", weight, row, square)
    arcs = []
    for i in range(len(chain)):
        left, target = (np.cumsum(sums[i : i + MOST], axis=0)[FEWEST - 1 :] for sums in (normal, right))
        bent = np.linalg.cond(left) < 1e12
        ends = np.flatnonzero(bent) + i + FEWEST
        if not len(ends):
            continue
        x = np.linalg.solve(left[bent], target[bent][..., None])[..., 0]
        radius = np.sqrt(np.maximum(x[:, 2] + (x[:, :2] ** 2).sum(axis=1), 0))
        for n in range(len(ends) - 1, -1, -1):
            end, centre, r = int(ends[n]), x[n, :2], float(radius[n])
            if len(set(chain[i:end].tolist())) < end - i or not 0 < r < LARGEST_M:
                continue
            points = np.concatenate([point[i : end + 1], middle[i:end]]) - centre
            off = float(np.abs(np.linalg.norm(points, axis=1) - r).max())
            if off > min(OFF * r, OFF_M) or length[i:end].max() > 2 * np.sin(TURN_RAD / 2) * (r + off):
                continue
            angle = np.unwrap(np.arctan2(*(point[i : end + 1] - centre).T[::-1]))
            turn = float(angle[-1] - angle[0])
            if abs(turn) < TURN_RAD - 1e-9:
                continue
            first = float(angle[0] if turn > 0 else angle[-1])
            arcs.append(Arc(centre + origin, r, first, min(abs(turn), 2 * np.pi), chain[i:end], off))
            break
    return arcs
