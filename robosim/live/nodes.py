"""Lines, points and pictures of a page that change from moment to moment.

Changing a node is several times as fast in a browser as putting another in its place. The page takes no empty arrays:
a node with nothing in it is hidden.
"""

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float, UInt8

from robosim.live.scene_colours import linear
from robosim.support.colours import Colour
from slam.grid import GridFrame

if TYPE_CHECKING:
    import viser

#: A picture's cell has so many pixels each way, since the page smooths pictures.
_PIXELS = 2


class Nodes:
    """Nodes below a frame, by their names."""

    def __init__(self, scene: "viser.SceneApi", root: str) -> None:
        self._scene, self._root = scene, root
        self._nodes: dict[str, Any] = {}

    def hide(self, name: str) -> None:
        """Show nothing under a name."""
        if name in self._nodes:
            self._nodes[name].visible = False

    def lines(
        self,
        name: str,
        segments: Float[np.ndarray, "n 2 3"],
        colours: UInt8[np.ndarray, "n 2 3"] | Colour,
        pixels: float,
    ) -> None:
        """Draw lines.

        Args:
            name: Of the node.
            segments: Their ends [m].
            colours: One for all, or one for each end, as `linear` makes them.
            pixels: How thick they are.
        """
        if not len(segments):
            self.hide(name)
            return
        node, each = self._nodes.get(name), np.asarray(colours, np.uint8)
        if node is None:
            self._nodes[name] = self._scene.add_line_segments(
                f"{self._root}/{name}", segments, each, thickness=pixels, thickness_units="screen"
            )
            return
        node.points, node.visible = segments.astype(np.float32), True
        if each.ndim > 1:
            node.colors = each

    def way(
        self, name: str, places: Float[np.ndarray, "n 2"], z_m: float, colour: Colour, pixels: float
    ) -> None:
        """Draw a line along places [m], at a height [m]; breaks where one is unknown."""
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
        """Draw points so wide [m], of one colour for good."""
        if not len(places):
            self.hide(name)
            return
        node = self._nodes.get(name)
        if node is None:
            self._nodes[name] = self._scene.add_point_cloud(
                f"{self._root}/{name}", places, colour, point_size=size_m, point_shape=shape
            )
            return
        # Not the colour: for each new one a browser compiles its program anew, some 100 ms without a graphics card.
        node.points, node.visible = places.astype(np.float32), True

    def image(self, name: str, frame: GridFrame, rgba: UInt8[np.ndarray, "ny nx 4"], z_m: float) -> None:
        """Lay a picture on the floor.

        Args:
            name: Of the node.
            frame: Where its cells are.
            rgba: Colours of the cells, rows upwards.
            z_m: How high over the floor [m].
        """
        rows, columns = frame.shape
        wide, deep = columns * frame.resolution_m, rows * frame.resolution_m
        x, y = frame.origin_xy
        # The page lays a picture's first row along its lower side in y, where the grid has it too.
        fine = np.repeat(np.repeat(rgba, _PIXELS, axis=0), _PIXELS, axis=1)
        node, at = self._nodes.get(name), (x + wide / 2, y + deep / 2, z_m)
        # A picture that is replaced before a browser has read it is an error there: only other maps replace one.
        if node is None or not np.allclose((node.render_width, node.render_height), (wide, deep)):
            self._nodes[name] = self._scene.add_image(
                f"{self._root}/{name}", fine, wide, deep, format="png", cast_shadow=False, receive_shadow=False,
                position=at,
            )  # fmt: skip
            return
        node.image, node.position, node.visible = fine, at, True


def of_each_end(colour: Colour, count: int) -> UInt8[np.ndarray, "n 2 3"]:
    """One colour for both ends of so many lines, which may be another the next time."""
    return np.tile(linear(np.array([colour], np.uint8)), (count, 2, 1)).reshape(count, 2, 3)
