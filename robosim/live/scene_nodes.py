"""Lines, points and pictures of a scene that change often, and the colours of the page.

Colour-blind readers can distinguish the colours, which are those of the pictures of `robosim trace`: power over the
floor in cividis, power of rays in plasma, the brighter the stronger; angles in twilight. Browsers change a node several
times as fast as they replace it. viser rejects empty arrays: an empty node is hidden.
"""

from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float, UInt8

from robosim.support.colours import STATE_COLOURS, Colour, css
from slam.grid import GridFrame
from wireless.paths import Interaction, LinkCategory, LinkState
from wireless.support.ray_colours import RAY_MAP, RAY_SHARE

if TYPE_CHECKING:
    import viser

TX_COLOUR: Colour = (213, 94, 0)
ROBOT_COLOUR: Colour = (0, 158, 115)
TRUE_ARRIVAL: Colour = (60, 60, 60)
ESTIMATED_ARRIVAL: Colour = (230, 159, 0)
WALL: Colour = (205, 212, 220)
WALL_EDGE: Colour = (70, 80, 95)
FLOOR: Colour = (246, 246, 244)
#: Colours of traced paths by their interactions: none, else the most informative kind.
RAY_COLOURS = {
    "line of sight": STATE_COLOURS[LinkState.LOS],
    "reflection": STATE_COLOURS[LinkState.FIRST_ORDER],
    "diffraction": (204, 121, 167),
    "reflection and diffraction": (230, 159, 0),
    "transmission": STATE_COLOURS[LinkCategory.OBSTRUCTED_LOS],
    "scattering": (213, 94, 0),
}

#: Ends of the colour scale of received power [dBm].
POWER_DBM = (-110.0, -40.0)
#: Colour maps, and the part of each that is used.
_PARTS = {"cividis": (0.0, 1.0), "twilight": (0.0, 1.0), RAY_MAP: RAY_SHARE}
TableName = Literal["cividis", "twilight", "plasma"]
#: Nodes that throw and receive no shadows.
NO_SHADOW: dict[str, Any] = {"cast_shadow": False, "receive_shadow": False}
#: Pixels per cell of a picture along each axis, since browsers smooth pictures.
_PIXELS = 2


class Nodes:
    """Nodes below a frame, by their names."""

    def __init__(self, scene: "viser.SceneApi", root: str) -> None:
        self._scene, self._root = scene, root
        self._nodes: dict[str, Any] = {}

    def hide(self, name: str) -> None:
        """Hide a node, if it exists."""
        if name in self._nodes:
            self._nodes[name].visible = False

    def lines(
        self,
        name: str,
        segments: Float[np.ndarray, "n 2 3"],
        colours: UInt8[np.ndarray, "n 2 3"] | Colour,
        pixels: float,
    ) -> None:
        """Draw lines between ends [m]; colours are one for all, or one of each end as `linear` returns them."""
        if not len(segments):
            self.hide(name)
            return
        node, each = self._nodes.get(name), np.asarray(colours, np.uint8)
        if node is None:
            self._nodes[name] = add_lines(self._scene, f"{self._root}/{name}", segments, each, pixels)
            return
        node.points, node.visible = segments.astype(np.float32), True
        if each.ndim > 1:
            node.colors = each

    def polyline(
        self, name: str, places: Float[np.ndarray, "n 2"], z_m: float, colour: Colour, pixels: float
    ) -> None:
        """Draw a line along places [m] at a height [m], interrupted at NaN."""
        high = np.column_stack([places, np.full(len(places), z_m)])
        legs = np.stack([high[:-1], high[1:]], axis=1) if len(high) > 1 else np.zeros((0, 2, 3))
        self.lines(name, legs[np.isfinite(legs).all(axis=(1, 2))], colour, pixels)

    def points(
        self,
        name: str,
        places: Float[np.ndarray, "n 3"],
        colour: Colour,
        size_m: float,
        shape: Literal["square", "circle"] = "square",
    ) -> None:
        """Draw points; their colour never changes."""
        if not len(places):
            self.hide(name)
            return
        node = self._nodes.get(name)
        if node is None:
            self._nodes[name] = self._scene.add_point_cloud(
                f"{self._root}/{name}", places, colour, point_size=size_m, point_shape=shape
            )
            return
        # For each new colour a browser compiles its shader again, some 100 ms without a graphics card.
        node.points, node.visible = places.astype(np.float32), True

    def image(self, name: str, frame: GridFrame, rgba: UInt8[np.ndarray, "ny nx 4"], z_m: float) -> None:
        """Draw cells, rows upwards, on the floor at a height [m]."""
        rows, columns = frame.shape
        width, depth = columns * frame.resolution_m, rows * frame.resolution_m
        x, y = frame.origin_xy
        # The first row of a picture is drawn at its lower side in y, as in the grid.
        pixels = np.repeat(np.repeat(rgba, _PIXELS, axis=0), _PIXELS, axis=1)
        node, position = self._nodes.get(name), (x + width / 2, y + depth / 2, z_m)
        # Browsers report an error if a picture is replaced before they have read it: only another size replaces it.
        if node is None or not np.allclose((node.render_width, node.render_height), (width, depth)):
            self._nodes[name] = self._scene.add_image(
                f"{self._root}/{name}", pixels, width, depth, format="png", position=position, **NO_SHADOW
            )
            return
        node.image, node.position, node.visible = pixels, position, True


def add_lines(
    scene: "viser.SceneApi", name: str, segments: Float[np.ndarray, "n 2 3"], colours: Any, pixels: float
) -> Any:
    """Add lines of a width in pixels, in one colour or in one of each end."""
    return scene.add_line_segments(name, segments, colours, thickness=pixels, thickness_units="screen")


def repeat_colour(colour: Colour, count: int) -> UInt8[np.ndarray, "n 2 3"]:
    """A colour for both ends of lines, which can change later."""
    return np.tile(linear(np.array([colour], np.uint8)), (count, 2, 1)).reshape(count, 2, 3)


@cache
def _table(name: TableName) -> UInt8[np.ndarray, "256 3"]:
    import matplotlib

    return np.round(255 * matplotlib.colormaps[name](np.linspace(*_PARTS[name], 256))[:, :3]).astype(np.uint8)


def power_colours(
    power_dbm: Float[np.ndarray, " n"], table: TableName = "cividis"
) -> UInt8[np.ndarray, "n 3"]:
    """Colours of received powers [dBm], clipped to `POWER_DBM`."""
    low, high = POWER_DBM
    level = np.clip((np.asarray(power_dbm) - low) / (high - low), 0, 1)
    return _table(table)[np.round(255 * level).astype(np.int64)]


def angle_colours(angle_rad: Float[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of azimuths [rad], the same at both ends of the circle."""
    level = (np.asarray(angle_rad) + np.pi) / (2 * np.pi) % 1
    return _table("twilight")[np.floor(255.999 * level).astype(np.int64)]


def state_colours(state: UInt8[np.ndarray, " n"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of link states or categories."""
    return np.array([STATE_COLOURS[category] for category in LinkCategory], np.uint8)[state]


def ray_kind(interaction: UInt8[np.ndarray, " m"]) -> str:
    """Kind of interactions of a path, as a key of `RAY_COLOURS`."""
    met = {Interaction(int(kind)) for kind in interaction} - {Interaction.NONE}
    if Interaction.TRANSMISSION in met:
        return "transmission"
    if Interaction.SCATTERING in met:
        return "scattering"
    names = [kind.name.lower() for kind in (Interaction.REFLECTION, Interaction.DIFFRACTION) if kind in met]
    return " and ".join(names) or "line of sight"


def kind_colours(interaction: UInt8[np.ndarray, "n m"]) -> UInt8[np.ndarray, "n 3"]:
    """Colours of paths by the kind of their interactions."""
    return np.array([RAY_COLOURS[ray_kind(row)] for row in interaction], np.uint8).reshape(-1, 3)


def linear(colours: UInt8[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Linear colours for the ends of lines, which viser does not draw as sRGB (IEC 61966-2-1)."""
    value = np.asarray(colours) / 255
    light = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return np.round(255 * light).astype(np.uint8)


def gradient(name: TableName) -> str:
    """A colour map as a CSS background."""
    stops = ", ".join(css(tuple(_table(name)[i].tolist())) for i in range(0, 256, 51))
    return f"linear-gradient(to right, {stops})"
