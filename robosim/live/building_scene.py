"""Walls, floor, scale bar and north of a building in a scene, and the view from above.

Walls come from the outlines of free space, which every recorded episode has. Each side of an outline becomes an upright
rectangle that faces free space. Browsers draw only its front, so that walls between the eye and the floor disappear.
Outlines may have either orientation: those inside an even number of others enclose free space. Each building is below a
frame of its own, so that two searches can stand side by side.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from jaxtyping import Float, Int

from robosim.drawing.plan_view import bar_m
from robosim.live.scene_nodes import FLOOR, NO_SHADOW, WALL, WALL_EDGE, add_lines

if TYPE_CHECKING:
    import viser

#: Height between layers on the floor [m], so that none hides the next.
STEP_M = 0.01
#: Height of the scale bar above all maps [m].
OVER_MAPS_M = 0.12
#: Distance of the upper edges from walls [m] at most: an edge is some 4 cm wide where a flat fills the window.
EDGE_M = 0.05
#: Inclination of the view from above towards the south.
TILT_RAD = math.radians(15.0)
#: Vertical field of view of the page [degrees].
FIELD_DEG = 50.0
#: Strength of the light from all sides.
_AMBIENT = 1.4

Rings = Sequence[Float[np.ndarray, "_ 2"]]


class BuildingScene:
    """Walls and floor below a frame."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        root: str,
        rings: Rings,
        height_m: float,
        *,
        offset: tuple[float, float] = (0.0, 0.0),
        target: Float[np.ndarray, "2"] | None = None,
        floor_m: float = 0.0,
        has_scale: bool = True,
        floor_opacity: float | None = None,
    ) -> None:
        """Draw outlines of free space [m] with walls of a height, below a frame at a position [m].

        `target` is a place that must be in view as well, `floor_m` the height of the floor; a floor is opaque without
        `floor_opacity`.
        """
        self.root, self.height_m, self.offset = root, height_m, np.array(offset)
        rings = facing_free(rings)
        seen = [*rings] if target is None else [*rings, target[None]]
        corners = np.concatenate(seen) if seen else np.zeros((1, 2))
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self._frame = scene.add_frame(root, show_axes=False, position=(*offset, floor_m))
        vertices, faces = floor_mesh(rings)
        if len(faces):
            scene.add_mesh_simple(
                f"{root}/floor", vertices, faces, color=FLOOR, flat_shading=True, side="double",
                opacity=floor_opacity, **NO_SHADOW,
            )  # fmt: skip
        walls = wall_mesh(rings, height_m)
        self._upright: list[Any] = [
            scene.add_mesh_simple(f"{root}/walls", *walls, color=WALL, flat_shading=True, **NO_SHADOW),
            add_lines(scene, f"{root}/edges", upper_edges(rings, height_m), WALL_EDGE, 1.2),
        ]
        if has_scale:
            self._draw_scale(scene)

    @property
    def middle(self) -> Float[np.ndarray, "2"]:
        """Middle of the plan in the scene [m]."""
        return (self.low + self.high) / 2 + self.offset

    @property
    def size(self) -> Float[np.ndarray, "2"]:
        """Width and depth [m]."""
        return self.high - self.low

    def cut_walls(self, height_m: float) -> None:
        """Show walls up to a height [m]."""
        share = max(min(height_m / self.height_m, 1.0), 0.01)
        for node in self._upright:
            node.scale = (1.0, 1.0, share)

    def show(self, visible: bool) -> None:
        """Show or hide everything below the frame."""
        self._frame.visible = visible

    def remove(self) -> None:
        """Remove everything below the frame."""
        self._frame.remove()

    def _draw_scale(self, scene: "viser.SceneApi") -> None:
        """A bar of a round length and an arrow along y, below the south-west corner of the plan."""
        size = float(self.size.max())
        length, gap = bar_m(size), 0.05 * max(size, 1.0)
        x, y = self.low[0], self.low[1] - 1.2 * gap
        tick, z = 0.3 * gap, OVER_MAPS_M
        north = x + length + 2.5 * gap
        strokes = [
            [[x, y, z], [x + length, y, z]],
            *([[at, y - tick, z], [at, y + tick, z]] for at in (x, x + length / 2, x + length)),
            [[north, y - gap, z], [north, y + gap, z]],
            [[north, y + gap, z], [north - tick, y + gap - 2 * tick, z]],
            [[north, y + gap, z], [north + tick, y + gap - 2 * tick, z]],
        ]
        add_lines(scene, f"{self.root}/scale", np.array(strokes, float), (20, 20, 20), 2.5)
        scene.add_label(
            f"{self.root}/scale/length", f"{length:g} m", position=(x + length / 2, y - 2 * tick, z),
            anchor="top-center", font_screen_scale=0.9,
        )  # fmt: skip
        scene.add_label(
            f"{self.root}/scale/north", "N (+y)", position=(north + 2 * tick, y, z), anchor="center-left",
            font_screen_scale=0.9,
        )  # fmt: skip


def facing_free(rings: Rings) -> list[Float[np.ndarray, "_ 2"]]:
    """Return the outlines, closed and wound so that free space is on the left of each side [m]."""
    closed = [
        np.asarray(ring, float)
        if len(ring) and np.array_equal(ring[0], ring[-1])
        else np.vstack([ring, ring[:1]])
        for ring in rings
    ]
    areas = [shapely.Polygon(ring) if len(ring) > 3 else None for ring in closed]
    wound = []
    for i, (ring, area) in enumerate(zip(closed, areas, strict=True)):
        if area is None or area.area == 0:
            continue
        inside = shapely.Point(shapely.LineString(ring[:2]).interpolate(0.5, normalized=True))
        n_around = sum(
            other is not None and other.area > area.area and other.contains(inside)
            for k, other in enumerate(areas)
            if k != i
        )
        is_outer = n_around % 2 == 0
        wound.append(ring if shapely.LinearRing(ring).is_ccw == is_outer else ring[::-1])
    return wound


def wall_sides(rings: Rings) -> Float[np.ndarray, "n 2 2"]:
    """Ends of all sides of closed outlines [m]."""
    parts = [np.stack([ring[:-1], ring[1:]], axis=1) for ring in rings]
    return np.concatenate(parts) if parts else np.zeros((0, 2, 2))


def wall_mesh(rings: Rings, height_m: float) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Vertices [m] and triangles of the walls along outlines of `facing_free`, with their fronts to free space."""
    sides = wall_sides(rings)
    if not len(sides):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    a, b = sides[:, 0], sides[:, 1]
    low, high = np.zeros((len(a), 1)), np.full((len(a), 1), height_m)
    corners = np.stack(
        [np.hstack([a, low]), np.hstack([b, low]), np.hstack([b, high]), np.hstack([a, high])], axis=1
    )
    first = 4 * np.arange(len(a))[:, None]
    # Free space is on the left of a to b: seen from there, a is on the right, so that b, a, top of a turns left.
    triangles = np.concatenate([first + np.array([1, 0, 3]), first + np.array([1, 3, 2])])
    return corners.reshape(-1, 3), triangles


def upper_edges(rings: Rings, height_m: float) -> Float[np.ndarray, "n 2 3"]:
    """Lines along the tops of walls, within `EDGE_M` of them [m]: few, for browsers without a graphics card."""
    sides = wall_sides([shapely.get_coordinates(shapely.LinearRing(r).simplify(EDGE_M)) for r in rings])
    return np.dstack([sides, np.full(sides.shape[:2], height_m)])


def floor_mesh(rings: Rings) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Vertices [m] and triangles of the floor between outlines of `facing_free`, at z = 0, with their fronts up."""
    outer = [shapely.Polygon(ring) for ring in rings if shapely.LinearRing(ring).is_ccw]
    inner = [shapely.Polygon(ring) for ring in rings if not shapely.LinearRing(ring).is_ccw]
    free = shapely.difference(shapely.union_all(outer), shapely.union_all(inner))
    corners: list[np.ndarray] = []
    for component in shapely.get_parts(free):
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(component))
        corners += [shapely.get_coordinates(shapely.orient_polygons(triangle))[:3] for triangle in triangles]
    if not corners:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    points = np.concatenate(corners)
    return np.column_stack([points, np.zeros(len(points))]), np.arange(len(points)).reshape(-1, 3)


def light(scene: "viser.SceneApi") -> None:
    """Light a scene evenly, without shadows and reflections, which are slow without a graphics card."""
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map(hdri=None)
    scene.add_light_ambient("/light", intensity=_AMBIENT)


def view_of_all(
    buildings: Sequence[BuildingScene], aspect: float, covered: float = 0.0, right_m: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Position of the eye, and the point it looks at, to see buildings and some metres to their right from above."""
    low = np.min([building.low + building.offset for building in buildings], axis=0)
    high = np.max([building.high + building.offset for building in buildings], axis=0)
    height_m = max(building.height_m for building in buildings)
    return view_from_above(low, high + np.array([right_m, 0.0]), aspect, height_m, covered)


def view_from_above(
    low: np.ndarray, high: np.ndarray, aspect: float, height_m: float, covered: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position of the eye, and the point it looks at, to see a box from above and a little from the south [m].

    `aspect` is the width of the window over its height, of which a share from below may be covered.
    """
    gap = 0.12 * float(max(*(high - low), 1.0))  # for the scale bar
    corners = np.array([
        [x, y, z] for z in (0.0, height_m) for x in (low[0], high[0]) for y in (low[1] - gap * (z == 0), high[1])
    ])  # fmt: skip
    lean, up = math.sin(TILT_RAD), math.cos(TILT_RAD)
    ahead = np.array([0.0, lean, -up])
    axes = np.array([[1.0, 0.0, 0.0], [0.0, -up, -lean], ahead])  # right, down, and into the picture
    right, down, depth = axes @ corners.T
    half = math.tan(math.radians(FIELD_DEG) / 2)
    # Slopes of the lines of sight that bound the free part of the window, with a margin.
    slopes = np.array([
        [-0.92 * half * aspect, 0.92 * half * aspect], [-0.9 * half, (0.94 - 2 * covered) * half]
    ])  # fmt: skip
    across = np.array([right, down])
    least = np.min(across - slopes[:, :1] * depth, axis=1)
    rightmost = np.max(across - slopes[:, 1:] * depth, axis=1)
    far = np.min((least - rightmost) / (slopes[:, 1] - slopes[:, 0]))  # the nearest from which all is in view
    place = (least + slopes[:, 0] * far + rightmost + slopes[:, 1] * far) / 2
    eye = axes.T @ np.array([*place, far])
    return eye, eye - ahead * eye[2] / ahead[2]
