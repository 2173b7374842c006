"""Large buildings: networks of corridors, rows of rooms along them, and halls along a foyer.

A network is one or two parallel corridors with others across: combs (L, T, U, E, H), rings around courtyards, and
double corridors around a core. A row of rooms stands along each loaded side of a corridor where nothing else does.
Rectangles reach to the middle of the walls between them. Left out: stairs, lifts, and walls not at right angles.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robosim.generator.canvas import Polygon, Rect
from robosim.generator.subdivision import Style

#: Floor area of large buildings [m2]; longest corridor, and narrowest courtyard [m].
AREA_M2, LONGEST_M, COURT_M = (1000.0, 5000.0), 97.0, 6.0
#: Area with walls over floor area, and how far a drawn building may be off the requested one.
_GROSS, _OFF = 1.07, 0.05
#: Usual areas of rooms by use [m2].
_USUAL_M2 = {
    "classroom": (50, 70), "kitchen": (10, 18), "meeting": (20, 45), "office": (10, 25), "open office": (60, 150),
    "storage": (8, 20), "bath": (11, 24), "bedroom": (15, 25),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LargeStyle(Style):
    """Corridors and rooms of a kind of large building."""

    depth_m: tuple[float, float]
    """Depth of rows of rooms."""
    uses: Mapping[str, float]
    """Relative frequencies of uses of rooms."""
    single: float = 0.0
    """Chance that corridors have rooms along one side only."""
    hall: float | None = None
    """Chance of a hall at the end of a corridor; None for halls along a foyer in place of a network."""
    narrowest_m: float = 2.2
    uneven: float = 0.08
    loops: float = 0.04
    open_plan: float = 0.5
    crowding: float = 0.4


LARGE_STYLES = {
    "campus": LargeStyle(
        corridor_m=(1.8, 2.6), depth_m=(4.5, 6.5), hall=0.3,
        uses={"office": 65, "meeting": 10, "open office": 7, "kitchen": 4, "bath": 6, "storage": 5, "classroom": 3},
    ),
    "school": LargeStyle(
        corridor_m=(2.4, 3.6), depth_m=(7.0, 8.5), single=0.4, hall=0.8,
        uses={"classroom": 60, "office": 12, "bath": 10, "storage": 10, "meeting": 8},
    ),
    "hospital": LargeStyle(
        corridor_m=(2.2, 3.0), depth_m=(5.0, 6.5), hall=0.2,
        uses={"bedroom": 60, "office": 15, "bath": 8, "storage": 10, "kitchen": 3, "meeting": 4},
    ),
    "hall": LargeStyle(
        corridor_m=(2.4, 4.0), depth_m=(5.0, 8.0),
        uses={"office": 40, "storage": 25, "bath": 10, "meeting": 15, "open office": 10},
    ),
}  # fmt: skip


class Hub(NamedTuple):
    """A corridor along axis 0 or 1, or a hall (None), and the depths of rooms around it (south, east, north, west)."""

    rect: Rect
    axis: int | None
    depths_m: Sequence[float]


Row = tuple[Rect, int | None]  # a strip of rooms along axis 0 or 1, or one room (None)


def cut_wings(rng: np.random.Generator, area_m2: float, style: LargeStyle) -> tuple[list[Rect], list[str]]:
    """Draw rectangles between wall axes, corridors and halls first, and the use of each."""
    while True:
        seed, gross_m2 = int(rng.integers(2**62)), 0.0
        low, high = 5.0, 1000.0  # length of all corridors, or depth of halls
        while high - low > 0.02:
            draw, size_m = np.random.default_rng(seed), (low + high) / 2
            hubs, is_sound = (_halls if style.hall is None else _network)(draw, size_m, style)
            rows = _rows(hubs, style.narrowest_m)
            gross_m2 = sum(rect.area for rect in (*(hub.rect for hub in hubs), *(row for row, _ in rows)))
            low, high = (size_m, high) if gross_m2 < _GROSS * area_m2 else (low, size_m)
        if is_sound and abs(gross_m2 / area_m2 / _GROSS - 1) < _OFF:
            break
    cells = [(rect, "great hall" if axis is None else "hall") for rect, axis, _ in hubs]
    cells += [room for row in rows for room in _cut_row(rng, row, style)]
    return [rect for rect, _ in cells], [kind for _, kind in cells]


def _network(rng: np.random.Generator, size_m: float, style: LargeStyle) -> tuple[list[Hub], bool]:
    """Draw one or two corridors along x and others across; and whether none is too long, nor two too near."""
    width, depth = rng.uniform(*style.corridor_m), rng.uniform(*style.depth_m)
    is_double, is_core, is_single = (rng.random(3) < (0.5, 0.4, style.single)).tolist()
    count = int(rng.integers(2, 5) if is_double else rng.integers(1, 6))
    # Rooms between two corridors along x: above the lower one, below the upper one.
    above = below = 0.0 if is_single else depth
    court_m = COURT_M + rng.uniform(0, 0.1) * size_m
    if is_core:
        above, below = [(depth, depth), (rng.uniform(4, 9), 0.0)][int(rng.integers(2))]
        court_m = 0.0
    gap_m, inner = is_double * (above + below + court_m), 0.0 if is_core or is_single else depth
    # Lengths of wings, below and above.
    wings_m = rng.uniform(0.5, 1, (count, 2)) * [rng.random() < 0.4, not is_double or rng.random() < 0.3]
    along_m = (size_m - count * gap_m) / (1 + is_double) * (rng.uniform(0.2, 0.6) if wings_m.any() else 1.0)
    wings_m *= (size_m - count * gap_m - (1 + is_double) * along_m) / max(wings_m.sum(), 1e-9)
    margin = rng.uniform(0.1, 0.3) * (rng.random() < 0.5)
    places = np.linspace(margin, 1 - margin, count) if count > 1 else rng.choice([0, 0.4, 1], 1)
    columns = (places * (along_m - width)).tolist()
    caps = (depth * rng.uniform(0.7, 1, 2 + count) * (rng.random(2 + count) < 0.7)).tolist()
    top = is_double * (gap_m + width)
    hubs = [Hub(Rect(0, 0, along_m, width), 0, (depth, caps[0], above, caps[0]))]
    if is_double:
        hubs.append(Hub(Rect(0, top, along_m, top + width), 0, (below, caps[1], depth, caps[1])))
    for n, (x, (down, up)) in enumerate(zip(columns, wings_m.tolist(), strict=True)):
        rung = (depth if n == count - 1 else inner, depth if n == 0 else inner)
        for low, high, (east, west) in (
            (-down, 0.0, (depth, inner)), (width, top, rung), (top + width, top + width + up, (inner, depth)),
        ):  # fmt: skip
            if high - low > 0.1:
                hubs.append(Hub(Rect(x, low, x + width, high), 1, (caps[2 + n], east, caps[2 + n], west)))
    if rng.random() < (style.hall or 0):
        y, (long_m, half_m) = width / 2 + rng.uniform(-3, 3), rng.uniform((14, 5), (26, 9)).tolist()
        hubs.append(Hub(Rect(along_m, y - half_m, along_m + long_m, y + half_m), None, (0.0,) * 4))
    longest_m, shortest_m = max(along_m, wings_m.max()), np.min(wings_m[wings_m > 0], initial=20.0)
    pitch_m = (along_m - width) * (1 - 2 * margin) / max(count - 1, 1e-9)
    apart_m = width + (12.0 if is_core and not wings_m.any() else 2 * inner + COURT_M)
    is_sound = longest_m <= LONGEST_M and shortest_m >= depth + 8 and pitch_m >= apart_m and along_m >= 15
    return hubs, bool(is_sound)


def _halls(rng: np.random.Generator, size_m: float, style: LargeStyle) -> tuple[list[Hub], bool]:
    """Draw one to three halls along a foyer, with or without corridors between; and whether their size is usual."""
    width, depth = rng.uniform(*style.corridor_m), rng.uniform(*style.depth_m)
    widths = (size_m * rng.uniform(0.5, 0.8, rng.integers(1, 4))).tolist()
    north, east, west = (depth * (rng.random(3) < 0.7)).tolist()
    passage, x, halls = width * (rng.random() < 0.5), 0.0, list[Hub]()
    for n, wide_m in enumerate(widths):
        if n and passage:
            halls.append(Hub(Rect(x - passage, 0, x, size_m), 1, (0.0,) * 4))
        sides = (0.0, east * (n == len(widths) - 1), north, west * (n == 0))
        halls.append(Hub(Rect(x, 0, x + wide_m, size_m), None, sides))
        x += wide_m + passage
    beyond = (rng.uniform(8, 25, 2) * (rng.random(2) < 0.5)).tolist()
    foyer = Rect(-beyond[0], -width, x - passage + beyond[1], 0)
    is_sound = min(widths) >= 14 and size_m <= 55 and foyer.size[0] <= LONGEST_M
    return [Hub(foyer, 0, (depth,) * 4), *halls], is_sound


def _rows(hubs: Sequence[Hub], narrowest_m: float) -> list[Row]:
    """Rows along hubs, and single rooms at the ends of corridors, where nothing else is."""
    rows, taken = list[Row](), [hub.rect for hub in hubs]

    def add(rect: Rect, axis: int | None) -> bool:
        is_free = not any(rect.meets(other) for other in taken)
        if is_free:
            rows.append((rect, axis))
            taken.append(rect)
        return is_free

    sides = [(hub, side, side % 2) for hub in hubs for side in range(4) if hub.depths_m[side]]
    for hub, side, axis in sides:
        strip = _beyond(hub.rect, side, hub.depths_m[side])
        others = sorted((other[axis], other[axis + 2]) for other in taken if other.meets(strip))
        low = strip[axis]
        for first, last in [*others, (strip[axis + 2],) * 2] if hub.axis in (None, axis) else []:
            if first - low >= narrowest_m:
                add(_span(strip, axis, low, first), axis)
            low = max(low, last)
    for hub, side, axis in sides:
        if hub.axis == 1 - axis:
            end, (south, east, north, west) = _beyond(hub.rect, side, hub.depths_m[side]), hub.depths_m
            lower, upper = (south, north) if axis else (west, east)
            # Across both rows at a dead end, across one of them where corridors form a corner.
            for before, after in ((lower, upper), (lower, 0.0), (0.0, upper)):
                if add(_span(end, axis, end[axis] - before, end[axis + 2] + after), None):
                    break
    return rows


def _beyond(rect: Rect, side: int, depth: float) -> Rect:
    """The strip of some depth beyond a side (south, east, north, west)."""
    axis, is_upper = 1 - side % 2, side in (1, 2)
    edge = rect[axis + 2 * is_upper]
    return _span(rect, axis, edge, edge + depth) if is_upper else _span(rect, axis, edge - depth, edge)


def _span(rect: Rect, axis: int, low: float, high: float) -> Rect:
    """A rectangle with another extent along an axis."""
    return rect._replace(x0=low, x1=high) if axis == 0 else rect._replace(y0=low, y1=high)


def _cut_row(rng: np.random.Generator, row: Row, style: LargeStyle) -> Iterator[tuple[Rect, str]]:
    """Cut a row into rooms of about their usual area, which are alike by use; some have another one behind them."""
    rect, axis = row
    areas_m2 = {kind: rng.uniform(*_USUAL_M2[kind]) for kind in style.uses}
    if axis is None:
        yield rect, min(areas_m2, key=lambda kind: abs(areas_m2[kind] - rect.area))
        return
    length, depth, weights = rect.size[axis], rect.size[1 - axis], np.array(list(style.uses.values()))
    kinds, widths = list[str](), list[float]()
    while sum(widths) < length:
        kinds.append(str(rng.choice(list(areas_m2), p=weights / weights.sum())))
        usual_m = areas_m2[kinds[-1]] / depth * rng.lognormal(0, style.uneven)
        widths.append(max(usual_m, style.narrowest_m))
    if len(widths) > 1 and sum(widths) - length > widths[-1] / 2:
        widths.pop()
    ends = (rect[axis] + np.cumsum([0, *widths]) * length / sum(widths)).tolist()
    for kind, low, high in zip(kinds, ends, ends[1:], strict=False):
        room = _span(rect, axis, low, high)
        if depth > max(2 * style.narrowest_m, high - low) and rng.random() < 0.1:
            middle = room[1 - axis] + rng.uniform(0.4, 0.6) * depth
            yield _span(room, 1 - axis, room[1 - axis], middle), kind
            room = _span(room, 1 - axis, middle, room[3 - axis])
        yield room, kind


def draw_posts(rng: np.random.Generator, floor: Rect) -> list[Polygon]:
    """Draw posts of a large room, if it has any, on a grid away from its walls."""
    side, pitch, has_posts = rng.uniform(0.25, 0.6), rng.uniform(5, 9), rng.random() < 0.7
    if min(floor.size) < 9 or not has_posts:
        return []
    x, y = (
        np.linspace(floor[axis], floor[axis + 2], max(round(floor.size[axis] / pitch), 1) + 1)[1:-1].tolist()
        for axis in (0, 1)
    )
    return [Rect(a, b, a, b).grown(side / 2).polygon() for a in x for b in y]
