"""Rays, arrivals and the map of radio in a page's space, and the two handles that are dragged."""

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from robosim.live.building_scene import STEP_M
from robosim.live.nodes import Nodes
from robosim.live.radio_map import Field
from robosim.live.scene_colours import (
    ESTIMATED_ARRIVAL,
    ROBOT_COLOUR,
    TRUE_ARRIVAL,
    TX_COLOUR,
    kind_colours,
    linear,
    power_colours,
)
from robosim.radio.measurement import Measurement
from robosim.recording.rerun_recording import ray_kind, rays
from wireless.paths import Paths

if TYPE_CHECKING:
    import viser

Who = Literal["transmitter", "robot"]
#: Radius of a handle, and length of the strongest arrival [m].
HANDLE_M, ARRIVAL_M = 0.22, 1.4
#: Arrivals this far under the strongest are as short as they get [dB].
_RANGE_DB = 40.0
#: Pixels across that a cell of the map of radio has at least in its picture, whose edges viser smooths.
_PIXELS = 4


class RadioView:
    """Draws a link below a frame."""

    def __init__(self, server: "viser.ViserServer", root: str, height_m: float) -> None:
        """Draw the handles; they are put in place by `place`.

        Args:
            server: Whose space.
            root: Name of the frame.
            height_m: Of the antennas [m].
        """
        self._server, self._scene, self._root = server, server.scene, root
        self.height_m = height_m
        self._levels_m: dict[Who, float] = {"transmitter": height_m, "robot": height_m}
        self._scene.add_frame(root, show_axes=False)
        self._nodes = Nodes(server.scene, root)
        self.handles: dict[Who, Any] = {
            "transmitter": self._handle("transmitter", TX_COLOUR),
            "robot": self._handle("robot", ROBOT_COLOUR),
        }

    def _handle(self, who: Who, colour: tuple[int, int, int]) -> Any:
        handle = self._scene.add_icosphere(
            f"{self._root}/{who}", radius=HANDLE_M, color=colour, subdivisions=3, cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        self._scene.add_label(
            f"{self._root}/{who}/name", who, position=(0, 0, HANDLE_M + 0.05), anchor="bottom-center"
        )
        pole = np.array([[[0, 0, -self.height_m], [0, 0, 0]]], float)
        self._scene.add_line_segments(
            f"{self._root}/{who}/pole", pole, colour, thickness=2.5, thickness_units="screen"
        )
        return handle

    def on_drag(self, moved: Callable[[Who, Float[np.ndarray, "2"], bool], None]) -> None:
        """Call a function with the place to which a handle is dragged [m], and whether it was let go."""
        for who, handle in self.handles.items():
            self._watch(who, handle, moved)

    def _watch(self, who: Who, handle: Any, moved: Callable[[Who, np.ndarray, bool], None]) -> None:
        # On the page's own loop, so that places come in order.
        async def drag(event: Any) -> None:
            eye = np.array(event.client.camera.position)
            at = on_level(eye, np.array(event.end_position), self._levels_m[who])
            if at is not None:
                moved(who, at, event.phase == "end")

        handle.on_drag(drag)

    def place(self, who: Who, at: Float[np.ndarray, "2"], level_m: float) -> None:
        """Put a handle at a place [m], at a height above the lowest floor [m]."""
        self._levels_m[who] = level_m
        self.handles[who].position = (float(at[0]), float(at[1]), self._levels_m[who])

    def show_heading(self, yaw_rad: float) -> None:
        """Show where the robot looks."""
        tip = 2.2 * HANDLE_M * np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
        points = np.array([[np.zeros(3), tip]])
        self._scene.add_arrows(
            f"{self._root}/robot/heading", points, ROBOT_COLOUR, shaft_radius=0.05, head_radius=0.11,
            head_length=0.16,
        )  # fmt: skip

    def show_paths(self, paths: Paths, coloured_by: str, tx_power_dbm: float) -> None:
        """Draw the rays of a link, where they turn, and where they truly come from."""
        segments, colours, spots = ray_segments(paths, coloured_by, tx_power_dbm)
        fan = arrival_fan(paths.rx_position[0], paths.aoa_az, paths.power_db)
        with self._server.atomic():
            self._nodes.lines("rays", segments, colours, 2.0)
            self._nodes.lines("arrivals", fan, TRUE_ARRIVAL, 4.0)
            self._nodes.points("turns", spots, (0, 0, 0), 0.06, "circle")

    def show_estimates(self, measurement: Measurement | None) -> None:
        """Draw where the robot's receiver takes paths to come from."""
        fan = np.zeros((0, 2, 3))
        if measurement is not None:
            at = np.array([*measurement.pose[:2], self.height_m + 2 * STEP_M])
            fan = arrival_fan(at, measurement.aoa_rad, measurement.snr_db)
        with self._server.atomic():
            self._nodes.lines("estimates", fan, ESTIMATED_ARRIVAL, 4.0)

    def show_field(self, field: Field | None) -> None:
        """Colour the floor."""
        name = f"{self._root}/field"
        if field is None:
            self._scene.remove_by_name(name)
            return
        rows, columns = field.grid.shape
        corner, along, up = field.grid.edges[0, 0], field.grid.edges[0, -1], field.grid.edges[-1, 0]
        turn = math.atan2(*(along - corner)[::-1])
        middle = (along + up) / 2
        # The page lays a picture's first row along its lower side in y, where the grid has it too.
        picture = np.repeat(np.repeat(field.rgba, _PIXELS, axis=0), _PIXELS, axis=1)
        self._scene.add_image(
            name, picture, columns * field.step_m, rows * field.step_m, format="png", cast_shadow=False,
            receive_shadow=False, position=(*middle, STEP_M),
            wxyz=(math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)),
        )  # fmt: skip


def on_level(
    eye: Float[np.ndarray, "3"], through: Float[np.ndarray, "3"], height_m: float
) -> Float[np.ndarray, "2"] | None:
    """Where the line of sight from an eye through a point meets a level [m]; None if it goes along it or away."""
    way = through - eye
    if abs(way[2]) < 1e-9:
        return None
    share = (height_m - eye[2]) / way[2]
    return None if share <= 0 else np.array((eye + share * way)[:2])


def ray_segments(
    paths: Paths, coloured_by: str, tx_power_dbm: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Legs of all rays (n, 2, 3) [m], their colours (n, 2, 3), and where rays turn (m, 3) [m].

    Args:
        paths: Of one link.
        coloured_by: power or kind.
        tx_power_dbm: Power sent.
    """
    corners = rays(paths)
    if coloured_by == "power":
        colours = power_colours(tx_power_dbm + paths.power_db, "plasma")
    else:
        colours = kind_colours([ray_kind(row) for row in paths.interaction])
    if not corners:
        return np.zeros((0, 2, 3)), np.zeros((0, 2, 3), np.uint8), np.zeros((0, 3))
    legs = np.concatenate([np.stack([c[:-1], c[1:]], axis=1) for c in corners])
    count: Sequence[int] = [len(c) - 1 for c in corners]
    of_leg = np.repeat(linear(colours), count, axis=0)
    spots = np.concatenate([c[1:-1] for c in corners])
    return legs, np.repeat(of_leg[:, None], 2, axis=1), spots


def arrival_fan(
    at: Float[np.ndarray, "3"], azimuth_rad: Float[np.ndarray, " n"], level_db: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2 3"]:
    """Lines from a place towards where paths come from, the stronger the longer [m]."""
    if not len(azimuth_rad):
        return np.zeros((0, 2, 3))
    share = np.clip(1 - (level_db.max() - level_db) / _RANGE_DB, 0.25, 1.0)
    way = np.column_stack([np.cos(azimuth_rad), np.sin(azimuth_rad), np.zeros(len(azimuth_rad))])
    return np.stack([np.tile(at, (len(way), 1)), at + ARRIVAL_M * share[:, None] * way], axis=1)
