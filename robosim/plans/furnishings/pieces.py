"""Pieces of furniture made from boxes, in the sizes that shops sell, and a plant of free form.

Each stands on the floor around its origin, with its back, if it has one, to -y. Seats are 0.42 to 0.48 m high, tables
0.72 to 0.76 m, which is what EN 1335-1 and EN 527-1 have for offices; the rest is common.
Left out: doors, drawers, cushions, and all that is rounded but the plant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any

import numpy as np
import trimesh

from robosim.plans.furnishings.furnishing import Furnishing
from robosim.support.checks import Range, check_choice, checked

#: x, y, z of the lowest corner and of the highest [m].
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


def solid_of_boxes(boxes: Sequence[Box]) -> trimesh.Trimesh:
    """The union of boxes as a closed mesh with normals outwards.

    Boxes that share no more than a side or a corner make a surface of which more than two faces meet there.
    """
    corners = np.round(np.array(boxes, float), 9)  # planes that differ by rounding are one
    planes = [np.unique(corners[:, :, axis]) for axis in range(3)]
    filled = np.zeros([len(along) + 1 for along in planes], bool)  # a rim of cells that are in no box
    for low, high in corners:
        filled[tuple(slice(*(1 + np.searchsorted(planes[k], (low[k], high[k])))) for k in range(3))] = True
    quads = []
    for axis in range(3):
        first, other = (axis + 1) % 3, (axis + 2) % 3
        step = np.diff(filled.astype(np.int8), axis=axis)
        for change in (-1, 1):  # leaving a box along the axis, and entering one
            index = np.argwhere(step == change)
            cell = np.repeat(index[:, None], 4, axis=1)
            for corner, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                cell[:, corner, first] += u - 1
                cell[:, corner, other] += v - 1
            quads.append(cell if change < 0 else cell[:, ::-1])
    cell = np.concatenate(quads)
    points = np.stack([planes[axis][cell[:, :, axis]] for axis in range(3)], axis=-1).reshape(-1, 3)
    vertices, number = np.unique(points, axis=0, return_inverse=True)
    quad = number.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return trimesh.Trimesh(vertices, faces, process=False)


_SIDE_M, _BOARD_M = Range(0.05, 20, "m"), Range(0.002, 1, "m")


def _check_below(piece: object, low: str, high: str) -> None:
    """See that one size is below another one."""
    if not getattr(piece, low) < getattr(piece, high):
        raise ValueError(
            f"{low} is {getattr(piece, low)}, expected less than {high} = {getattr(piece, high)} m of a "
            f"{type(piece).__name__.lower()}."
        )


@dataclass(frozen=True, kw_only=True)
@checked
class Cupboard:
    """A closed box on the floor: wardrobes, sideboards, kitchen counters, machines; base of what is made from boxes."""

    width_m: Annotated[float, _SIDE_M] = 1.0
    """Along x [m]."""
    depth_m: Annotated[float, _SIDE_M] = 0.6
    """Along y [m]."""
    height_m: Annotated[float, _SIDE_M] = 2.0
    """Height of the upper edge above the floor [m]."""

    def mesh(self) -> trimesh.Trimesh:
        """The closed surface [m], z up, on the floor around the origin."""
        return solid_of_boxes(self._boxes())

    def _boxes(self) -> list[Box]:
        return [self._slab(0.0, self.height_m)]

    def _slab(self, low_m: float, high_m: float) -> Box:
        return (-self.width_m / 2, -self.depth_m / 2, low_m), (self.width_m / 2, self.depth_m / 2, high_m)

    def _back(self, thick_m: float, low_m: float, high_m: float) -> Box:
        x, y = self.width_m / 2, self.depth_m / 2
        return (-x, -y, low_m), (x, -y + thick_m, high_m)

    def _legs(self, leg_m: float, top_m: float) -> list[Box]:
        """Four square legs at the corners, from the floor to a height."""
        x, y = self.width_m / 2 - leg_m, self.depth_m / 2 - leg_m
        starts = product((-self.width_m / 2, x), (-self.depth_m / 2, y))
        return [((a, b, 0.0), (a + leg_m, b + leg_m, top_m)) for a, b in starts]


@dataclass(frozen=True, kw_only=True)
@checked
class Table(Cupboard):
    """A top on four legs; things lower than its underside pass below."""

    width_m: Annotated[float, _SIDE_M] = 1.4
    depth_m: Annotated[float, _SIDE_M] = 0.8
    height_m: Annotated[float, _SIDE_M] = 0.74
    top_m: Annotated[float, _BOARD_M] = 0.03
    """Thickness of the top [m]."""
    leg_m: Annotated[float, _BOARD_M] = 0.06
    """Side of a leg [m]."""

    def __post_init__(self) -> None:
        _check_below(self, "top_m", "height_m")

    @property
    def clearance_m(self) -> float:
        """Height of the top's underside [m]."""
        return self.height_m - self.top_m

    def _boxes(self) -> list[Box]:
        return [self._slab(self.clearance_m, self.height_m), *self._legs(self.leg_m, self.clearance_m)]


@dataclass(frozen=True, kw_only=True)
@checked
class Chair(Cupboard):
    """A seat on four legs with a back."""

    width_m: Annotated[float, _SIDE_M] = 0.44
    depth_m: Annotated[float, _SIDE_M] = 0.44
    height_m: Annotated[float, _SIDE_M] = 0.85
    seat_m: Annotated[float, _SIDE_M] = 0.45
    """Height of the seat [m]."""
    board_m: Annotated[float, _BOARD_M] = 0.03
    """Thickness of seat and back [m]."""
    leg_m: Annotated[float, _BOARD_M] = 0.04
    """Side of a leg [m]."""

    def __post_init__(self) -> None:
        _check_below(self, "board_m", "seat_m")
        _check_below(self, "seat_m", "height_m")

    def _boxes(self) -> list[Box]:
        below = self.seat_m - self.board_m
        back = self._back(self.board_m, self.seat_m, self.height_m)
        return [self._slab(below, self.seat_m), back, *self._legs(self.leg_m, below)]


@dataclass(frozen=True, kw_only=True)
@checked
class Shelf(Cupboard):
    """Boards between two sides, with a back."""

    width_m: Annotated[float, _SIDE_M] = 0.8
    depth_m: Annotated[float, _SIDE_M] = 0.3
    height_m: Annotated[float, _SIDE_M] = 1.8
    boards: Annotated[int, Range(2, 50)] = 5
    """Number of boards, the lowest and the uppermost among them."""
    board_m: Annotated[float, _BOARD_M] = 0.02
    """Thickness of boards, sides and back [m]."""

    def __post_init__(self) -> None:
        for side in ("width_m", "depth_m"):
            _check_below(self, "board_m", side)
        if self.boards * self.board_m >= self.height_m:
            raise ValueError(
                f"boards is {self.boards}, expected so few of {self.board_m} m that they leave room in "
                f"{self.height_m} m."
            )

    def _boxes(self) -> list[Box]:
        x, y, thick = self.width_m / 2, self.depth_m / 2, self.board_m
        lows = np.linspace(0.0, self.height_m - thick, self.boards).tolist()
        return [
            ((-x, -y, 0.0), (-x + thick, y, self.height_m)),
            ((x - thick, -y, 0.0), (x, y, self.height_m)),
            self._back(thick, 0.0, self.height_m),
            *(self._slab(low, low + thick) for low in lows),
        ]


@dataclass(frozen=True, kw_only=True)
@checked
class Sofa(Cupboard):
    """A seat with a back and two arms on low feet."""

    width_m: Annotated[float, _SIDE_M] = 1.9
    depth_m: Annotated[float, _SIDE_M] = 0.9
    height_m: Annotated[float, _SIDE_M] = 0.82
    seat_m: Annotated[float, _SIDE_M] = 0.43
    """Height of the seat [m]."""
    foot_m: Annotated[float, _BOARD_M] = 0.12
    """Height of the feet, which leave the floor below free [m]."""
    arm_m: Annotated[float, _BOARD_M] = 0.18
    """Width of an arm, and depth of the back [m]."""

    def __post_init__(self) -> None:
        _check_below(self, "foot_m", "seat_m")
        _check_below(self, "seat_m", "height_m")
        if 2 * self.arm_m >= self.width_m or self.arm_m >= self.depth_m:
            raise ValueError(
                f"arm_m is {self.arm_m}, expected so little that a seat is left in {self.width_m} by {self.depth_m} m."
            )

    def _boxes(self) -> list[Box]:
        x, y, arm = self.width_m / 2, self.depth_m / 2, self.arm_m
        arms_m = (self.seat_m + self.height_m) / 2
        return [
            self._slab(self.foot_m, self.seat_m),
            self._back(arm, self.foot_m, self.height_m),
            ((-x, -y, self.foot_m), (-x + arm, y, arms_m)),
            ((x - arm, -y, self.foot_m), (x, y, arms_m)),
            *self._legs(0.06, self.foot_m),
        ]


@dataclass(frozen=True, kw_only=True)
@checked
class Bed(Cupboard):
    """A mattress in a frame on four legs, with a headboard; its depth goes from head to foot."""

    width_m: Annotated[float, Range(0.2, 20, "m")] = 1.4
    depth_m: Annotated[float, Range(0.2, 20, "m")] = 2.05
    height_m: Annotated[float, _SIDE_M] = 0.5
    clearance_m: Annotated[float, _BOARD_M] = 0.22
    """Height of the frame above the floor [m]."""
    head_m: Annotated[float, _SIDE_M] = 0.95
    """Height of the headboard [m]."""

    def __post_init__(self) -> None:
        _check_below(self, "clearance_m", "height_m")
        _check_below(self, "height_m", "head_m")

    def _boxes(self) -> list[Box]:
        head = self._back(0.05, self.clearance_m, self.head_m)
        return [self._slab(self.clearance_m, self.height_m), head, *self._legs(0.07, self.clearance_m)]


@dataclass(frozen=True, kw_only=True)
@checked
class Plant:
    """A pot, a stem and a crown of uneven leaves: a coarse form of revolution, made smooth by Loop's subdivision.

    Reference: Loop, "Smooth subdivision surfaces based on triangles", master's thesis, University of Utah (1987).
    """

    width_m: Annotated[float, _SIDE_M] = 0.6
    """Across the crown, along x and y [m]."""
    height_m: Annotated[float, _SIDE_M] = 1.2
    """Along z [m]."""
    sides: Annotated[int, Range(3, 64)] = 6
    """Number of sides of the coarse form."""
    subdivisions: Annotated[int, Range(0, 4)] = 1
    """Number of times that each triangle becomes four."""

    def mesh(self) -> trimesh.Trimesh:
        """The closed surface [m]."""
        # Radius and height of the rings: pot, stem, crown; leaves stand out on every other corner of the crown.
        ring = np.array(
            [(0.45, 0), (0.6, 0.25), (0.1, 0.3), (0.1, 0.45), (0.8, 0.55), (1, 0.75), (0.5, 0.95)]
        )
        n, angle = self.sides, np.arange(self.sides) * 2 * np.pi / self.sides
        leaf = np.where(np.arange(n) % 2, 0.75, 1.0)
        radius = np.where((np.arange(len(ring)) >= 4)[:, None], ring[:, :1] * leaf, ring[:, :1])
        xyz = np.stack(
            [radius * np.cos(angle), radius * np.sin(angle), np.broadcast_to(ring[:, 1:], radius.shape)],
            axis=-1,
        )
        vertices = np.vstack([xyz.reshape(-1, 3), [(0, 0, 0), (0, 0, 1)]])
        here, following = np.arange(n), (np.arange(n) + 1) % n
        faces = [np.column_stack([following, here, np.full(n, len(vertices) - 2)])]
        for k in range(len(ring) - 1):
            low, high = k * n, (k + 1) * n
            faces.append(np.column_stack([low + here, low + following, high + following]))
            faces.append(np.column_stack([low + here, high + following, high + here]))
        last = (len(ring) - 1) * n
        faces.append(np.column_stack([last + here, last + following, np.full(n, len(vertices) - 1)]))
        made = trimesh.Trimesh(vertices, np.concatenate(faces), process=False)
        if self.subdivisions:
            made = made.subdivide_loop(iterations=self.subdivisions)
        low, high = made.bounds
        size = np.array([self.width_m, self.width_m, self.height_m])
        vertices = (made.vertices - [*(low + high)[:2] / 2, low[2]]) * (size / (high - low))
        return trimesh.Trimesh(vertices, made.faces, process=False)


#: Pieces by name.
PIECES: dict[str, type[Cupboard | Plant]] = {
    "table": Table,
    "chair": Chair,
    "shelf": Shelf,
    "sofa": Sofa,
    "bed": Bed,
    "cupboard": Cupboard,
    "plant": Plant,
}
#: Pieces of chipboard; the others are of wood.
_CHIPBOARD = ("sofa", "bed", "cupboard", "shelf")
#: Their colours; the others have that of wood.
_COLOUR = {
    "plant": (74, 124, 68),
    "sofa": (112, 128, 158),
    "bed": (196, 190, 206),
    "cupboard": (206, 192, 170),
    "shelf": (188, 160, 124),
    "chair": (150, 96, 62),
}


def make_piece(
    piece: str,
    *,
    at: tuple[float, float],
    yaw_rad: float = 0.0,
    z_m: float = 0.0,
    name: str | None = None,
    material: Any = None,
    colour: tuple[int, int, int] | None = None,
    **sizes: float,
) -> Furnishing:
    """A piece of furniture at a place.

    Args:
        piece: Key of `PIECES`.
        at: Place of its middle, x, y [m] in `map`.
        yaw_rad: Its rotation, counter-clockwise [rad]; its back is at -y.
        z_m: Its height above the floor [m].
        name: Its name in messages; the piece's name if not given.
        material: Its radio material; the usual one of such pieces if not given.
        colour: Red, green and blue, 0 to 255.
        sizes: Fields of the piece, such as width_m.

    Raises:
        ValueError: If there is no such piece, a size is unknown or out of its bounds.
    """
    check_choice("piece", piece, PIECES)
    kind: Any = PIECES[piece]
    for size in sizes:
        check_choice(f"a size of a {piece}", size, kind.__dataclass_fields__)
    return Furnishing(
        mesh=kind(**sizes).mesh(),
        at=at,
        z_m=z_m,
        yaw_rad=yaw_rad,
        name=name or piece,
        material=material if material is not None else "chipboard" if piece in _CHIPBOARD else "wood",
        colour=_COLOUR.get(piece, Furnishing.colour) if colour is None else colour,
        said={"piece": piece, **sizes},
    )
