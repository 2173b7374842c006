"""Constrained triangulation of the plane: every wall is an edge, so that views can be walked.

Points are inserted one by one into a Delaunay triangulation (Lawson's flips); then each wall that is not an
edge yet is made one by flipping the edges that cross it (Sloan). Coordinates are integers of unlimited
size, so that every decision is exact: points on lattices, on lines and on circles need no tolerance.

Left out: anything but straight walls that touch at common points (`wireless.geometry.plan` cuts them so).
Reference: S. W. Sloan, A fast algorithm for generating constrained Delaunay triangulations, Computers &
Structures 47 (1993).
"""

from collections import deque

import numpy as np
from jaxtyping import Int


class Triangulation:
    """Triangles that fill a square around all points."""

    def __init__(self, points: Int[np.ndarray, "n 2"], margin: int):
        self.points = [(int(x), int(y)) for x, y in points]
        low_x, low_y = (min(p[axis] for p in self.points) - margin for axis in (0, 1))
        high_x, high_y = (max(p[axis] for p in self.points) + margin for axis in (0, 1))
        n = len(self.points)
        self.points += [(low_x, low_y), (high_x, low_y), (high_x, high_y), (low_x, high_y)]
        #: Corner c to the left of each edge (a, b), of its triangle a, b, c.
        self.third: dict[tuple[int, int], int] = {}
        self._spoke: dict[int, int] = {}  # of each point, one that it is joined to
        self._add(n, n + 1, n + 2)
        self._add(n, n + 2, n + 3)
        self._last = (n, n + 1)
        for i in _near_to_near(self.points[:n]):
            self._insert(i)

    def constrain(self, a: int, b: int) -> None:
        """Make the segment from point a to point b an edge.

        Raises:
            ValueError: If a third point lies on it, or it crosses a wall.
        """
        crossing = self._crossing(a, b)
        attempts = 20 + len(crossing) ** 2 * 4
        while crossing:
            edge = crossing.popleft()
            c, d = self.third[edge], self.third[edge[1], edge[0]]
            if self._side(c, d, edge[0]) * self._side(c, d, edge[1]) < 0:
                self._flip(*edge)
                if {c, d} != {a, b} and self._cross(a, b, c, d):
                    crossing.append((c, d))
            else:
                crossing.append(edge)
            attempts -= 1
            if attempts < 0:
                raise ValueError(f"The wall from {self.points[a]} to {self.points[b]} crosses another one.")

    def triangles(self) -> Int[np.ndarray, "m 3"]:
        """Point indices of all triangles, counter-clockwise."""
        return np.array([(a, b, c) for (a, b), c in self.third.items() if a < b and a < c], np.int64)

    def _side(self, a: int, b: int, p: int) -> int:
        """Positive where p is left of the line from a to b, 0 on it; exact."""
        (ax, ay), (bx, by), (px, py) = self.points[a], self.points[b], self.points[p]
        return (bx - ax) * (py - ay) - (by - ay) * (px - ax)

    def _cross(self, a: int, b: int, c: int, d: int) -> bool:
        """Whether two segments cross between their ends."""
        return self._side(a, b, c) * self._side(a, b, d) < 0 and self._side(c, d, a) * self._side(c, d, b) < 0

    def _add(self, a: int, b: int, c: int) -> None:
        self.third[a, b], self.third[b, c], self.third[c, a] = c, a, b
        self._spoke[a], self._spoke[b], self._spoke[c] = b, c, a

    def _insert(self, p: int) -> None:
        a, b = self._last
        c = self.third[a, b]
        while True:  # walk towards p
            for u, v in ((a, b), (b, c), (c, a)):
                if self._side(u, v, p) < 0:
                    a, b, c = v, u, self.third[v, u]
                    break
            else:
                break
        for edge in ((a, b), (b, c), (c, a)):
            self._add(*edge, p)
        doubtful = [(a, b), (b, c), (c, a)]
        while doubtful:
            u, v = doubtful.pop()
            across = self.third.get((v, u))
            if across is not None and (self._side(u, v, p) == 0 or self._in_circle(u, v, p, across)):
                self._flip(u, v)
                doubtful += [(u, across), (across, v)]
        self._last = next((u, v) for u, v in ((p, a), (p, b), (p, c)) if (u, v) in self.third)

    def _in_circle(self, a: int, b: int, c: int, d: int) -> bool:
        """Whether d is within the circle through a, b, c (counter-clockwise); exact."""
        dx, dy = self.points[d]
        rows = [(self.points[i][0] - dx, self.points[i][1] - dy) for i in (a, b, c)]
        (ax, ay), (bx, by), (cx, cy) = rows
        aa, bb, cc = (x * x + y * y for x, y in rows)
        return aa * (bx * cy - by * cx) - bb * (ax * cy - ay * cx) + cc * (ax * by - ay * bx) > 0

    def _flip(self, a: int, b: int) -> None:
        c, d = self.third.pop((a, b)), self.third.pop((b, a))
        self._add(c, a, d)
        self._add(d, b, c)

    def _crossing(self, a: int, b: int) -> deque[tuple[int, int]]:
        """Edges between a and b, from near to far; none if a and b are joined."""
        crossed: deque[tuple[int, int]] = deque()
        if (a, b) in self.third:
            return crossed
        # Around a, to the triangle that the segment to b leaves by its far edge.
        first = u = self._spoke[a]
        while not (
            self._side(a, u, b) > 0
            and self._side(a, self.third[a, u], b) < 0
            and self._side(u, self.third[a, u], b) < 0
        ):
            u = self.third[a, u]
            if u == first:
                raise ValueError(f"A point lies on the wall between {self.points[a]} and {self.points[b]}.")
        left, right = self.third[a, u], u
        while True:
            crossed.append((left, right))
            tip = self.third[left, right]
            if tip == b:
                return crossed
            side = self._side(a, b, tip)
            if side == 0:
                raise ValueError(f"A point lies on the wall between {self.points[a]} and {self.points[b]}.")
            left, right = (tip, right) if side > 0 else (left, tip)


def _near_to_near(points: list[tuple[int, int]]) -> list[int]:
    """An order of points in which neighbours follow each other: up and down in stripes."""
    low = min(x for x, _ in points)
    width = max(1, int((max(x for x, _ in points) - low) / max(1, len(points)) ** 0.5))
    stripe = [(x - low) // width for x, _ in points]
    return sorted(range(len(points)), key=lambda i: (stripe[i], points[i][1] * (-1) ** (stripe[i] % 2)))
