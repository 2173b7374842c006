"""What stands in a page's space whatever is shown there: walls, floor, scale bar and north.

Everything lies below one frame, so that two searches can stand side by side.
"""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from robosim.drawing.scale import bar_m
from robosim.live.scene_colours import FLOOR, WALL, WALL_EDGE
from robosim.live.walls import facing_free, floor_mesh, upper_edges, wall_mesh

if TYPE_CHECKING:
    import viser

#: Lines on the floor lie so high over each other [m], that none hides the next.
STEP_M = 0.01
#: Strength of the light that comes from all sides.
_AMBIENT = 1.4
#: What is to be seen over all of them is so high.
OVER_MAPS_M = 0.12


class Scenery:
    """Walls and floor below a frame."""

    def __init__(
        self,
        scene: "viser.SceneApi",
        root: str,
        rings: Sequence[Float[np.ndarray, "_ 2"]],
        height_m: float,
        offset: tuple[float, float] = (0.0, 0.0),
        around: Sequence[Float[np.ndarray, "2"]] = (),
        *,
        floor_m: float = 0.0,
        has_scale: bool = True,
        floor_opacity: float | None = None,
    ) -> None:
        """Draw them.

        Args:
            scene: Where.
            root: Name of the frame.
            rings: Outlines of free space [m].
            height_m: Of the walls.
            offset: Where the frame stands [m].
            around: Places that are to be seen too [m].
            floor_m: Height of the floor [m].
            has_scale: Whether a scale bar and north stand beside it.
            floor_opacity: How much of what is below the floor it hides, 0 to 1; None for all.
        """
        self.root, self.height_m, self.offset = root, height_m, np.array(offset)
        rings = facing_free(rings)
        seen = [*rings, *(np.reshape(place, (1, 2)) for place in around)]
        corners = np.concatenate(seen) if seen else np.zeros((1, 2))
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self._frame = scene.add_frame(root, show_axes=False, position=(*offset, floor_m))
        self._draw_walls(scene, rings, floor_opacity)
        if has_scale:
            self._draw_scale(scene)

    @property
    def middle(self) -> Float[np.ndarray, "2"]:
        """Of the plan, where it stands [m]."""
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
        """Show or hide it, and whatever was drawn below the same frame."""
        self._frame.visible = visible

    def remove(self) -> None:
        """Take it away, and whatever was drawn below the same frame."""
        self._frame.remove()

    def _draw_walls(
        self, scene: "viser.SceneApi", rings: list[np.ndarray], floor_opacity: float | None
    ) -> None:
        vertices, faces = floor_mesh(rings)
        if len(faces):
            scene.add_mesh_simple(
                f"{self.root}/floor", vertices, faces, color=FLOOR, flat_shading=True, cast_shadow=False,
                receive_shadow=False, side="double", opacity=floor_opacity,
            )  # fmt: skip
        vertices, faces = wall_mesh(rings, self.height_m)
        self._upright: list[Any] = [
            scene.add_mesh_simple(
                f"{self.root}/walls", vertices, faces, color=WALL, flat_shading=True, cast_shadow=False,
                receive_shadow=False,
            )
        ]  # fmt: skip
        edges = upper_edges(rings, self.height_m)
        self._upright.append(
            scene.add_line_segments(
                f"{self.root}/edges", edges, WALL_EDGE, thickness=1.2, thickness_units="screen"
            )
        )

    def _draw_scale(self, scene: "viser.SceneApi") -> None:
        """A bar of a round length, and an arrow along the plan's y, below the plan's south-west corner."""
        length = bar_m(float(self.size.max()))
        gap = 0.05 * max(float(self.size.max()), 1.0)
        x, y = self.low[0], self.low[1] - 1.2 * gap
        tick, z = 0.3 * gap, OVER_MAPS_M
        bar = [
            [[x, y, z], [x + length, y, z]],
            *([[at, y - tick, z], [at, y + tick, z]] for at in (x, x + length / 2, x + length)),
        ]
        north = x + length + 2.5 * gap
        arrow = [
            [[north, y - gap, z], [north, y + gap, z]],
            [[north, y + gap, z], [north - tick, y + gap - 2 * tick, z]],
            [[north, y + gap, z], [north + tick, y + gap - 2 * tick, z]],
        ]
        scene.add_line_segments(
            f"{self.root}/scale", np.array([*bar, *arrow], float), (20, 20, 20), thickness=2.5,
            thickness_units="screen",
        )  # fmt: skip
        scene.add_label(
            f"{self.root}/scale/length", f"{length:g} m", position=(x + length / 2, y - 2 * tick, z),
            anchor="top-center", font_screen_scale=0.9,
        )  # fmt: skip
        scene.add_label(
            f"{self.root}/scale/north", "N (+y)", position=(north + 2 * tick, y, z), anchor="center-left",
            font_screen_scale=0.9,
        )  # fmt: skip


def light(scene: "viser.SceneApi") -> None:
    """Light a space evenly, without what takes long where there is no graphics card: shadows, and a sky to mirror."""
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map(hdri=None)
    scene.add_light_ambient("/light", intensity=_AMBIENT)


def view_from_above(
    low: np.ndarray, high: np.ndarray, aspect: float = 1.3, height_m: float = 0.0, covered: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Where the eye is to see all of a rectangle from above and a little from the south, and what it looks at [m].

    Args:
        low: South-west corner [m].
        high: North-east corner [m].
        aspect: Width of the window over its height.
        height_m: Of what stands there.
        covered: Share of the window's height, from below, that something lies over, 0 to 0.9.
    """
    gap = 0.12 * float(max(*(high - low), 1.0))  # for the scale bar
    corners = np.array([
        [x, y, z] for z in (0.0, height_m) for x in (low[0], high[0]) for y in (low[1] - gap * (z == 0), high[1])
    ])  # fmt: skip
    lean, up = math.sin(TILT_RAD), math.cos(TILT_RAD)
    ahead = np.array([0.0, lean, -up])
    axes = np.array([[1.0, 0.0, 0.0], [0.0, -up, -lean], ahead])  # right, down, and into the picture
    to_right, down, deep = axes @ corners.T
    # Slopes of the lines of sight that bound what is free of the window, with a margin.
    half = math.tan(math.radians(FIELD_DEG) / 2)
    across = (-0.92 * half * aspect, 0.92 * half * aspect)
    along = (-0.9 * half, (0.94 - 2 * covered) * half)
    (x, far_x), (y, far_y) = _between(to_right, deep, across), _between(down, deep, along)
    far = min(far_x, far_y)  # the nearest from where all is seen
    eye = axes.T @ np.array([x(far), y(far), far])
    return eye, eye - ahead * eye[2] / ahead[2]


def _between(
    across: Float[np.ndarray, " n"], deep: Float[np.ndarray, " n"], slopes: tuple[float, float]
) -> tuple[Callable[[float], float], float]:
    """Where an eye sees points between two lines of sight: its place across, by its depth, and its largest depth."""
    low, high = np.min(across - slopes[0] * deep), np.max(across - slopes[1] * deep)
    return (
        lambda at: float(low + slopes[0] * at + high + slopes[1] * at) / 2,
        float((low - high) / (slopes[1] - slopes[0])),
    )


#: How far the eye leans to the south.
TILT_RAD = math.radians(15.0)
#: Vertical field of view of the page [degrees].
FIELD_DEG = 50.0
