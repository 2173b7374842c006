"""Rays, arrivals, sphere handles and the radio map of a link in a scene."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float, UInt8

from robosim.live.building_scene import STEP_M
from robosim.live.scene_nodes import (
    ESTIMATED_ARRIVAL,
    NO_SHADOW,
    ROBOT_COLOUR,
    TRUE_ARRIVAL,
    TX_COLOUR,
    Nodes,
    add_lines,
    angle_colours,
    kind_colours,
    linear,
    power_colours,
    state_colours,
)
from robosim.radio.measurement import Measurement
from robosim.radio.receivers import ReceiverGrid
from robosim.radio.scene import RadioSite
from wireless.paths import Paths

if TYPE_CHECKING:
    import viser

Terminal = Literal["transmitter", "robot"]
MapKind = Literal["off", "received power", "link state", "direction of arrival"]
#: Radius of a handle, and length of the strongest arrival [m].
HANDLE_M, ARRIVAL_M = 0.22, 1.4
#: Arrivals that are this much weaker than the strongest have the least length [dB].
_RANGE_DB = 40.0
#: Pixels per cell of a radio map along each axis, since browsers smooth pictures.
_PIXELS = 4
#: Distances between the receivers of radio maps [m], from coarse to fine.
MAP_STEPS_M = (1.0, 0.5, 0.25, 0.15)
#: Receivers that are traced together, in some 10 ms.
_BATCH = 64
#: Largest number of receivers of a radio map: large floors have coarser maps.
_MOST_RECEIVERS = 40_000


class RadioView:
    """Draws a link below a frame."""

    def __init__(self, server: "viser.ViserServer", root: str, height_m: float) -> None:
        """Draw the handles, at a height of antennas [m]; `place` moves them."""
        self._server, self._scene, self._root = server, server.scene, root
        self.height_m = height_m
        self._levels_m: dict[Terminal, float] = {"transmitter": height_m, "robot": height_m}
        self._scene.add_frame(root, show_axes=False)
        self._nodes = Nodes(server.scene, root)
        self.handles: dict[Terminal, Any] = {
            "transmitter": self._add_handle("transmitter", TX_COLOUR),
            "robot": self._add_handle("robot", ROBOT_COLOUR),
        }

    def _add_handle(self, terminal: Terminal, colour: tuple[int, int, int]) -> Any:
        name = f"{self._root}/{terminal}"
        handle = self._scene.add_icosphere(name, radius=HANDLE_M, color=colour, subdivisions=3, **NO_SHADOW)
        label_at = (0.0, 0.0, HANDLE_M + 0.05)
        self._scene.add_label(f"{name}/name", terminal, position=label_at, anchor="bottom-center")
        pole = np.array([[[0, 0, -self.height_m], [0, 0, 0]]], float)
        add_lines(self._scene, f"{name}/pole", pole, colour, 2.5)
        return handle

    def on_drag(self, move: Callable[[Terminal, Float[np.ndarray, "2"]], None]) -> None:
        """Call a function with each place that a handle is dragged to [m]."""

        # A coroutine runs on the page's own loop, so that places come in order.
        async def drag(terminal: Terminal, event: Any) -> None:
            eye, end = np.array(event.client.camera.position), np.array(event.end_position)
            place = intersect_level(eye, end, self._levels_m[terminal])
            if place is not None:
                move(terminal, place)

        for terminal, handle in self.handles.items():
            handle.on_drag(partial(drag, terminal))

    def place(self, terminal: Terminal, position: Float[np.ndarray, "3"]) -> None:
        """Move a handle to a position, its height above the lowest floor [m]."""
        self._levels_m[terminal] = float(position[2])
        self.handles[terminal].position = tuple(position.tolist())

    def show_heading(self, yaw_rad: float) -> None:
        """Draw an arrow along the robot's heading."""
        tip = 2.2 * HANDLE_M * np.array([math.cos(yaw_rad), math.sin(yaw_rad), 0.0])
        self._scene.add_arrows(
            f"{self._root}/robot/heading", np.array([[np.zeros(3), tip]]), ROBOT_COLOUR, shaft_radius=0.05,
            head_radius=0.11, head_length=0.16,
        )  # fmt: skip

    def show_paths(self, paths: Paths, coloured_by: str, tx_power_dbm: float) -> None:
        """Draw the rays of a link, their turning points, and the true arrivals."""
        segments, colours, turns = ray_segments(paths, coloured_by, tx_power_dbm)
        fan = arrival_fan(paths.rx_position[0], paths.aoa_az, paths.power_db)
        with self._server.atomic():
            self._nodes.lines("rays", segments, colours, 2.0)
            self._nodes.lines("arrivals", fan, TRUE_ARRIVAL, 4.0)
            self._nodes.points("turns", turns, (0, 0, 0), 0.06, "circle")

    def show_estimates(self, measurement: Measurement) -> None:
        """Draw the arrivals that the robot's receiver estimates."""
        place = np.array([*measurement.pose[:2], self.height_m + 2 * STEP_M])
        fan = arrival_fan(place, measurement.aoa_rad, measurement.snr_db)
        with self._server.atomic():
            self._nodes.lines("estimates", fan, ESTIMATED_ARRIVAL, 4.0)

    def show_map(self, radio_map: "RadioMap | None") -> None:
        """Colour the floor."""
        name = f"{self._root}/field"
        if radio_map is None:
            self._scene.remove_by_name(name)
            return
        edges, step_m = radio_map.grid.edges, radio_map.step_m
        rows, columns = radio_map.grid.shape
        turn = math.atan2(*(edges[0, -1] - edges[0, 0])[::-1])
        middle = (edges[0, -1] + edges[-1, 0]) / 2
        # The first row of a picture is drawn at its lower side in y, as in the grid.
        pixels = np.repeat(np.repeat(radio_map.rgba, _PIXELS, axis=0), _PIXELS, axis=1)
        self._scene.add_image(
            name, pixels, columns * step_m, rows * step_m, format="png", position=(*middle, STEP_M),
            wxyz=(math.cos(turn / 2), 0.0, 0.0, math.sin(turn / 2)), **NO_SHADOW,
        )  # fmt: skip


def intersect_level(
    eye: Float[np.ndarray, "3"], through: Float[np.ndarray, "3"], height_m: float
) -> Float[np.ndarray, "2"] | None:
    """Where the line of sight from an eye through a point meets a level [m]; None if it does not."""
    direction = through - eye
    if abs(direction[2]) < 1e-9:
        return None
    share = (height_m - eye[2]) / direction[2]
    return None if share <= 0 else np.array((eye + share * direction)[:2])


def ray_segments(
    paths: Paths, coloured_by: str, tx_power_dbm: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Legs of all rays (n, 2, 3) [m], their colours by power or kind (n, 2, 3), and turning points (m, 3) [m]."""
    corners = [
        np.vstack([paths.tx_position[tx], points[: int(order)], paths.rx_position[rx]])
        for tx, rx, order, points in zip(paths.tx, paths.rx, paths.order, paths.point, strict=True)
    ]
    if coloured_by == "power":
        colours = power_colours(tx_power_dbm + paths.power_db, "plasma")
    else:
        colours = kind_colours(paths.interaction)
    if not corners:
        return np.zeros((0, 2, 3)), np.zeros((0, 2, 3), np.uint8), np.zeros((0, 3))
    legs = np.concatenate([np.stack([c[:-1], c[1:]], axis=1) for c in corners])
    of_leg = np.repeat(linear(colours), [len(c) - 1 for c in corners], axis=0)
    turns = np.concatenate([c[1:-1] for c in corners])
    return legs, np.repeat(of_leg[:, None], 2, axis=1), turns


def arrival_fan(
    place: Float[np.ndarray, "3"], azimuth_rad: Float[np.ndarray, " n"], level_db: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2 3"]:
    """Lines from a place towards arrivals, the stronger the longer [m]."""
    if not len(azimuth_rad):
        return np.zeros((0, 2, 3))
    share = np.clip(1 - (level_db.max() - level_db) / _RANGE_DB, 0.25, 1.0)
    direction = np.column_stack([np.cos(azimuth_rad), np.sin(azimuth_rad), np.zeros(len(azimuth_rad))])
    return np.stack(
        [np.tile(place, (len(direction), 1)), place + ARRIVAL_M * share[:, None] * direction], axis=1
    )


@dataclass(frozen=True, eq=False)
class RadioMap:
    """Colours of the floor."""

    rgba: UInt8[np.ndarray, "ny nx 4"]
    """Colour of each cell, rows upwards; transparent without a receiver or a path."""
    grid: ReceiverGrid
    step_m: float
    """Side of a cell."""


def radio_maps(
    site: RadioSite, tx: Float[np.ndarray, "3"], kind: MapKind, is_stale: Callable[[], bool]
) -> Iterator[RadioMap]:
    """Maps of a transmitter, each finer than the last, until `is_stale`, which is called every 10 ms."""
    for step_m in MAP_STEPS_M:
        try:
            grid = site.grid(step_m)
        except ValueError:  # too coarse for a small room, or too fine for a large one
            continue
        if len(grid.position) > _MOST_RECEIVERS:
            return
        colours = np.zeros((len(grid.position), 4), np.uint8)
        for first in range(0, len(grid.position), _BATCH):
            if is_stale():
                return
            batch = slice(first, first + _BATCH)
            colours[batch] = _map_colours(site, tx, grid.position[batch], kind)
        rgba = np.zeros((*grid.shape, 4), np.uint8)
        rgba[tuple(grid.cell.T)] = colours
        yield RadioMap(rgba, grid, step_m)


def _map_colours(
    site: RadioSite, tx: Float[np.ndarray, "3"], places: Float[np.ndarray, "n 3"], kind: MapKind
) -> UInt8[np.ndarray, "n 4"]:
    paths = site.trace(tx[None], places, workers=1)
    first = paths.select(paths.rank == 0)
    rgba = np.zeros((len(places), 4), np.uint8)
    rgba[first.rx, 3] = 255
    if kind == "link state":
        rgba[:, :3] = state_colours(paths.link_category()[0])
    elif kind == "direction of arrival":
        rgba[first.rx, :3] = angle_colours(first.aoa_az)
    else:
        rgba[first.rx, :3] = power_colours(site.config.tx_power_dbm + first.power_db)
    return rgba
