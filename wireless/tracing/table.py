"""Tables of the strongest paths of links, and the arrays in which one path is worked out and weighed.

Floor plans and spaces find paths differently, but weigh and list them alike.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from robosim.support.compiled import compiled
from wireless.em.fields import TRANSMISSION, Path, Wedge, path_gain

#: Relative step of the wavenumber in which the group delay of walls is taken.
_STEP = 1e-6
#: Two faces farther apart are two walls, with a shaft or the open air between them [m].
THICKEST_WALL_M = 1.0 + 1e-6


class Setting(NamedTuple):
    """Physics of paths, and how many are listed."""

    walls: Complex[np.ndarray, "n l"]
    """Layers of each wall, then of floor and ceiling, see `wireless.em.fresnel.fresnel`."""
    half: Bool[np.ndarray, " n"]
    """Which of these are one of the two faces of a wall."""
    low_m: float
    """Height of the floor."""
    high_m: float
    """Height of the ceiling."""
    has_floor: bool
    """Whether the floor reflects."""
    has_ceiling: bool
    """Whether the ceiling reflects."""
    wavenumber: float
    """2 pi over the wavelength [1/m]."""
    max_reflections: int
    """Most reflections on a path without diffraction."""
    edge_reflections: int
    """Most reflections on a path with diffraction; -1 for no diffraction."""
    side_reflections: int
    """Most of them before the edge, and after it; at most edge_reflections."""
    max_walls: int
    """Most walls that a path passes."""
    max_through: int
    """Most faces of walls that a path passes."""
    max_interactions: int
    """Most interactions of a path, of all kinds, a passed wall counted once."""
    max_met: int
    """Largest number with each face of passed walls counted."""
    vertical: float
    """Weight of the power from theta to theta."""
    horizontal: float
    """Weight of the power from phi to phi."""
    crossed: float
    """Weight of the power from either to the other."""
    keep: int
    """Most paths of a link."""
    bisector: bool
    """At which angle the faces of an edge reflect, see `TracerConfig.diffraction_law`."""


class Table(NamedTuple):
    """Paths of links, one row per path: receiver by receiver, strongest first; rows beyond the last path are unused."""

    n_paths: Int[np.ndarray, " r"]
    """Paths of each receiver."""
    power: Float[np.ndarray, " q"]
    """Power gain by the setting's weights."""
    gain: Complex[np.ndarray, "q 2 2"]
    """See `wireless.em.fields.path_gain`."""
    length_m: Float[np.ndarray, " q"]
    """Unfolded length, and the group delay of passed walls as a length."""
    order: Int[np.ndarray, " q"]
    """Number of interactions."""
    kind: Int[np.ndarray, "q m"]
    """Kind of each interaction, 0 beyond the last."""
    primitive: Int[np.ndarray, "q m"]
    """Wall (floor and ceiling after the last) or corner; -1 beyond the last."""
    point: Float[np.ndarray, "q m2 3"]
    """Transmitter, interactions, receiver, around the plan's origin [m]; zeros beyond."""


class Scratch(NamedTuple):
    """Arrays to work in."""

    flat: Float[np.ndarray, "m2 2"]
    flat_kind: Int[np.ndarray, " m"]
    flat_primitive: Int[np.ndarray, " m"]
    point: Float[np.ndarray, "m2 3"]
    kind: Int[np.ndarray, " m"]
    primitive: Int[np.ndarray, " m"]
    normal: Float[np.ndarray, "m 3"]
    walls: Complex[np.ndarray, "m l"]
    share: Float[np.ndarray, " m"]
    listed: Bool[np.ndarray, " m"]
    wedge: Float[np.ndarray, "3 3"]
    wedge_n: Float[np.ndarray, " 1"]
    wedge_walls: Complex[np.ndarray, "2 l"]
    gain: Complex[np.ndarray, "2 2"]
    work: Float[np.ndarray, "8 3"]
    field: Complex[np.ndarray, "2 3"]


@compiled
def most_interactions(setting: Setting) -> int:
    """How many interactions a path can have, each face of passed walls counted."""
    return max(setting.max_reflections, setting.edge_reflections + 1, 1) + setting.max_through


@compiled
def make_table(setting: Setting, n_rx: int, rows: int) -> Table:
    """Table of so many receivers with room for so many paths, and none in it."""
    n_max = most_interactions(setting) - setting.max_through + setting.max_walls
    return Table(
        np.zeros(n_rx, np.int64),
        np.zeros(rows),
        np.zeros((rows, 2, 2), np.complex128),
        np.zeros(rows),
        np.zeros(rows, np.int64),
        np.zeros((rows, n_max), np.int64),
        np.full((rows, n_max), -1, np.int64),
        np.zeros((rows, n_max + 2, 3)),
    )


@compiled
def with_room(setting: Setting, table: Table, rows: int) -> Table:
    """Return the table, or a copy with at least so many rows: memory follows the paths that exist."""
    if rows <= len(table.power):
        return table
    larger, used = make_table(setting, len(table.n_paths), max(rows, 2 * len(table.power))), len(table.power)
    larger.n_paths[:] = table.n_paths
    larger.power[:used], larger.gain[:used], larger.length_m[:used] = table.power, table.gain, table.length_m
    larger.order[:used], larger.kind[:used] = table.order, table.kind
    larger.primitive[:used], larger.point[:used] = table.primitive, table.point
    return larger


@compiled
def make_scratch(setting: Setting) -> Scratch:
    """Arrays to work out one path in."""
    n_max = most_interactions(setting)
    return Scratch(
        np.zeros((n_max + 2, 2)),
        np.zeros(n_max, np.int64),
        np.zeros(n_max, np.int64),
        np.zeros((n_max + 2, 3)),
        np.zeros(n_max, np.int64),
        np.zeros(n_max, np.int64),
        np.zeros((n_max, 3)),
        np.zeros((n_max, setting.walls.shape[1]), np.complex128),
        np.ones(n_max),
        np.ones(n_max, np.bool_),
        np.zeros((3, 3)),
        np.ones(1),
        np.zeros((2, setting.walls.shape[1]), np.complex128),
        np.zeros((2, 2), np.complex128),
        np.zeros((8, 3)),
        np.zeros((2, 3), np.complex128),
    )


@compiled
def write_row(
    setting: Setting, table: Table, row: int, length_m: float, power: float, m: int, scratch: Scratch
) -> None:
    """Put the path of m interactions in `scratch`, just weighed, into a table; of a passed wall its first face."""
    table.length_m[row], table.power[row] = length_m + _wall_delay_m(setting, m, scratch), power
    # Number by number: for rows numba would compile a message for shapes that differ, too.
    for p in range(2):
        for q in range(2):
            table.gain[row, p, q] = scratch.gain[p, q]
    order = 0
    for j in range(m):
        if scratch.listed[j]:
            table.kind[row, order], table.primitive[row, order] = scratch.kind[j], scratch.primitive[j]
            order += 1
            for i in range(3):
                table.point[row, order, i] = scratch.point[j + 1, i]
    table.order[row] = order
    for i in range(3):
        table.point[row, 0, i], table.point[row, order + 1, i] = scratch.point[0, i], scratch.point[m + 1, i]


@compiled
def _wall_delay_m(setting: Setting, m: int, scratch: Scratch) -> float:
    """Group delay of passed walls on the path in `scratch`, just weighed, as a length beyond the unfolded one."""
    passes = False
    for j in range(m):
        passes = passes or scratch.kind[j] == TRANSMISSION
    if not passes:
        return 0.0
    walls, gain, length = scratch.walls.copy(), np.zeros((2, 2), np.complex128), np.inf
    path = Path(scratch.point, scratch.kind, scratch.normal, walls, scratch.share)
    wedge = Wedge(scratch.wedge, scratch.wedge_n[0], scratch.wedge_walls, setting.bisector)
    weight = np.array([[setting.vertical, setting.crossed], [setting.crossed, setting.horizontal]])
    for step in (-_STEP, _STEP):
        # A wall so much thicker has the phases of one met at a wavenumber so much larger.
        for j in range(m):
            if scratch.kind[j] == TRANSMISSION:
                for k in range(1, walls.shape[1], 2):
                    walls[j, k] = scratch.walls[j, k] * (1 + step)
        path_gain(path, m, wedge, setting.wavenumber, gain, scratch.work, scratch.field)
        turn = 0j
        for p in range(2):
            for q in range(2):
                turn += weight[p, q] * gain[p, q] * np.conj(scratch.gain[p, q])
        later = -np.angle(turn) / (step * setting.wavenumber)
        if abs(later) < abs(length):  # a root of `share_walls` may jump within one of the steps
            length = later
    return length


@compiled
def share_walls(setting: Setting, m: int, scratch: Scratch) -> bool:
    """Pair the faces of passed walls along the path in `scratch`; whether it is within the limits.

    A wall with two faces is passed once: each face takes the square root of its transmission ratios, so that the
    wall counts once, from both directions alike, also across a corner or between two materials. Faces farther apart
    than `THICKEST_WALL_M` are a wall each. Where the ends of a path are on different sides of the faces that it
    meets, one of an odd number of faces has no opposite: all share the ratios of half as many walls, rounded up.
    Within a wall nothing is reflected or diffracted, as its ratios contain that.
    """
    faces, first, within = 0, -1, False
    for j in range(m):
        scratch.share[j], scratch.listed[j] = 1.0, True
        if scratch.kind[j] != TRANSMISSION:
            within = within or faces % 2 == 1
        elif setting.half[scratch.primitive[j]]:
            faces += 1
            if faces % 2 == 1:
                first = j
            elif _thickness_m(scratch, first, j) <= THICKEST_WALL_M:
                scratch.share[first], scratch.share[j], scratch.listed[j] = 0.5, 0.5, False
    if faces % 2 == 1:
        number = 0
        for j in range(m):
            if scratch.kind[j] == TRANSMISSION and setting.half[scratch.primitive[j]]:
                number += 1
                scratch.share[j], scratch.listed[j] = (faces + 1) / (2 * faces), number % 2 == 1
    elif within:
        return False
    walls, listed = 0, 0
    for j in range(m):
        if scratch.listed[j]:
            listed += 1
            walls += scratch.kind[j] == TRANSMISSION
    return walls <= setting.max_walls and listed <= setting.max_interactions


@compiled
def _thickness_m(scratch: Scratch, i: int, j: int) -> float:
    """How far apart the faces met at two interactions are, along the normal of either, whichever is less."""
    first_m, other = 0.0, 0.0
    for k in range(3):
        step = scratch.point[j + 1, k] - scratch.point[i + 1, k]
        first_m += step * scratch.normal[i, k]
        other += step * scratch.normal[j, k]
    return min(abs(first_m), abs(other))


@compiled
def weigh(setting: Setting, m: int, n: float, scratch: Scratch) -> tuple[float, float]:
    """Length and power of the path of m interactions laid out in `scratch`, gain set; length -1 if it is none.

    A path without power, having met an opaque wall, is left out.

    A wedge on the path, if there is one, fills an angle of (2 - n) pi.
    """
    if setting.max_through > 0 and not share_walls(setting, m, scratch):
        return -1.0, 0.0
    path = Path(scratch.point, scratch.kind, scratch.normal, scratch.walls, scratch.share)
    scratch.wedge_n[0] = n
    wedge = Wedge(scratch.wedge, n, scratch.wedge_walls, setting.bisector)
    length = path_gain(path, m, wedge, setting.wavenumber, scratch.gain, scratch.work, scratch.field)
    if length < 0:
        return length, 0.0
    g = scratch.gain
    power = setting.vertical * abs(g[0, 0]) ** 2 + setting.horizontal * abs(g[1, 1]) ** 2
    power = power + setting.crossed * (abs(g[0, 1]) ** 2 + abs(g[1, 0]) ** 2)
    return (length if power > 0 else -1.0), power


class Best(NamedTuple):
    """Strongest paths of a link so far, strongest first."""

    rank: Float[np.ndarray, "k 5"]
    """Power, length, directions at both ends and a number for the sequence of interactions: rows that agree in all are
    one path, found twice because it passes an end of a wall."""
    parts: Int[np.ndarray, "k w"]
    """Elements of each path, in as many numbers as the engine needs."""


@compiled
def new_best(setting: Setting, numbers: int) -> Best:
    """An empty list of a link's paths, each made of so many numbers."""
    return Best(np.empty((setting.keep, 5)), np.empty((setting.keep, numbers), np.int64))


@compiled
def list_path(
    best: Best,
    count: int,
    parts: Int[np.ndarray, " w"],
    length: float,
    power: float,
    m: int,
    number: int,
    p: Float[np.ndarray, "m2 3"],
) -> int:
    """Enter a path of m interactions into a list, unless it is weaker than all or there already; its new length."""
    rank, new, place = best.rank, np.empty(5), count
    new[0], new[1], new[4] = power, length, number
    new[2] = np.arctan2(p[1, 1] - p[0, 1], p[1, 0] - p[0, 0]) + (p[1, 2] - p[0, 2]) / length
    new[3] = np.arctan2(p[m, 1] - p[m + 1, 1], p[m, 0] - p[m + 1, 0]) + (p[m, 2] - p[m + 1, 2]) / length
    while place > 0 and rank[place - 1, 0] < power:
        place -= 1
    for step in (-1, 1):
        j = place - 1 if step < 0 else place
        while 0 <= j < count and abs(rank[j, 0] - power) <= 1e-6 * power:
            same = abs(rank[j, 1] - length) < 1e-8 and rank[j, 4] == number
            for i in (2, 3):
                off = abs(rank[j, i] - new[i])
                same = same and min(off, 2 * np.pi - off) < 1e-6
            if same:
                return count
            j += step
    if place >= len(rank):
        return count
    count = min(count + 1, len(rank))
    for j in range(count - 1, place, -1):
        rank[j] = rank[j - 1]
        best.parts[j] = best.parts[j - 1]
    rank[place] = new
    best.parts[place] = parts
    return count


def merged(tables: list[Table], keep: int) -> Table:
    """The strongest paths of tables of the same receivers."""
    n_paths = np.sum([table.n_paths for table in tables], axis=0)
    of = np.concatenate([np.repeat(np.arange(len(table.n_paths)), table.n_paths) for table in tables])
    used = [[column[: table.n_paths.sum()] for column in table[1:]] for table in tables]
    columns = [np.concatenate(parts) for parts in zip(*used, strict=True)]
    order = np.lexsort((-columns[0], of))
    rank = np.arange(len(of)) - np.repeat(np.cumsum(n_paths) - n_paths, n_paths)
    order = order[rank < keep]
    return Table(np.minimum(n_paths, keep), *(column[order] for column in columns))


def chosen(table: Table, mask: Bool[np.ndarray, " q"]) -> Table:
    """A table with some of its paths."""
    of = np.repeat(np.arange(len(table.n_paths)), table.n_paths)
    return Table(np.bincount(of[mask], minlength=len(table.n_paths)), *(column[mask] for column in table[1:]))
