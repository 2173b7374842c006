"""A step of a search in a scene: map, trajectories, belief, arrivals, rays and the robot."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, UInt8

from robosim.drawing.picture import ANTICIPATING_PALETTE, status_line
from robosim.drawing.plan_view import (
    BODY_YELLOW,
    ESTIMATE_ORANGE,
    OBSTACLE_BLACK,
    PATH_PURPLE,
    TARGET_RED,
)
from robosim.layers import BLOCKED, FREE, GUESS, GUESS_LEVELS, OBSTACLE, TOP_LEVEL, Layer
from robosim.live.building_scene import STEP_M, BuildingScene
from robosim.live.radio_view import arrival_fan, ray_segments
from robosim.live.recordings import Recording
from robosim.live.scene_nodes import NO_SHADOW, Nodes, add_lines, repeat_colour
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS, robot_colour
from slam.grid import GridFrame

if TYPE_CHECKING:
    import viser

#: Height of the walls of a search [m], low enough to see the map behind them.
WALLS_M = 0.3
#: Width of the map's margin around the plan [m].
MARGIN_M = 0.5
#: Heights at which the robot's radio and its mapped obstacles are drawn [m].
_RADIO_M, _OBSTACLE_M = 0.6, 0.25
#: Heights of robots and of people as they are drawn [m].
_ROBOT_M, _BODY_M = 0.2, 1.7


def _map_palette() -> UInt8[np.ndarray, "256 4"]:
    """Colour of each kind of cell; transparent where it is unknown."""
    palette = np.zeros((256, 4), np.uint8)
    palette[:, :3] = ANTICIPATING_PALETTE[:, 0]
    palette[[FREE, OBSTACLE, BLOCKED], 3] = 255
    level = np.arange(GUESS_LEVELS) / (GUESS_LEVELS - 1)
    palette[GUESS : GUESS + GUESS_LEVELS, 3] = 255 * np.abs(2 * level - 1) ** 0.5
    return palette


_PALETTE = _map_palette()


class SearchView:
    """Draws steps of one recording below a frame."""

    def __init__(
        self, server: "viser.ViserServer", root: str, recording: Recording, offset_m: float, *, brief: bool
    ) -> None:
        """Draw what does not change, below a frame; the title of a brief view shows only the number of the step."""
        self._brief = brief
        self._server, self._root, self.recording = server, root, recording
        self.building = BuildingScene(
            server.scene, root, recording.rings, recording.height_m, offset=(offset_m, 0.0),
            target=recording.target,
        )  # fmt: skip
        self.building.cut_walls(WALLS_M)
        scene = server.scene
        self._nodes = Nodes(scene, root)
        if recording.target is not None:
            x, y = map(float, recording.target)
            name, place = f"{root}/target", (x, y, _RADIO_M)
            scene.add_icosphere(name, radius=0.2, color=TARGET_RED, position=place, cast_shadow=False)
            scene.add_label(f"{name}/name", "target", position=(0, 0, 0.25), anchor="bottom-center")
        low, high, size = self.building.low, self.building.high, self.building.size
        place = (float(low[0]), float(high[1] + 0.03 * size.max()), 0.0)
        self._title = scene.add_label(f"{root}/title", recording.title, position=place, anchor="bottom-left")
        self._robots: dict[str, Any] = {}
        colours = {f"true{k}": robot_colour(k) for k in range(len(recording.robots))}
        if not recording.mates:
            colours["estimated"] = ESTIMATE_ORANGE
        for name, colour in colours.items():
            self._robots[name] = scene.add_cylinder(
                f"{root}/{name}", radius=0.14, height=_ROBOT_M, color=colour, visible=False,
                opacity=0.6 if name == "estimated" else None, **NO_SHADOW,
            )  # fmt: skip
            nose = np.array([[[0.0, 0, 0.12], [0.42, 0, 0.12]]])
            add_lines(scene, f"{root}/{name}/nose", nose, colour, 4)
        self._bodies: list[Any] = []
        self._shown: tuple[Layer | None, Layer | None] = None, None

    def show(self, number: int, *, rays: bool = True) -> list[Step]:
        """Draw a step of each robot, the last one if it has fewer, with or without true rays; returns those drawn.

        Map and belief are those of the first robot that was not lost.
        """
        robots = self.recording.robots
        if not all(map(len, robots)):
            return []
        steps = [robot[min(max(number, 0), len(robot) - 1)] for robot in robots]
        step = max(steps, key=lambda step: step.number)
        with self._server.atomic():
            status = "" if self._brief else f": {status_line(step, self.recording.target)}"
            self._title.text = f"{self.recording.title}: step {step.number}{status}"
            if not self.recording.mates:
                _place(self._robots["estimated"], step.estimated.pose, _ROBOT_M / 2)
            # The first bodies that a robot meets are the other robots.
            self._show_bodies(step.true.bodies[len(robots) - 1 :])
            self._show_maps(step.map_layer, step.belief_layer)
            for k, of_robot in enumerate(steps):
                _place(self._robots[f"true{k}"], of_robot.true.pose, _ROBOT_M / 2)
                self._show_motion(k, of_robot)
                self._show_radio(k, of_robot, rays)
        return steps

    def _show_bodies(self, bodies: Float[np.ndarray, "n 4"]) -> None:
        """People and others who move, as cylinders that face where they walk."""
        for k in range(max(len(bodies), len(self._bodies))):
            if k >= len(self._bodies):
                name = f"{self._root}/body{k}"
                self._bodies.append(
                    self._server.scene.add_cylinder(
                        name, radius=float(bodies[k, 3]), height=_BODY_M, color=BODY_YELLOW, **NO_SHADOW
                    )
                )
                add_lines(
                    self._server.scene,
                    f"{name}/nose",
                    np.array([[[0.0, 0, 0.6], [0.35, 0, 0.6]]]),
                    OBSTACLE_BLACK,
                    4,
                )
            if k < len(bodies):
                # The bodies that are there change.
                self._bodies[k].radius = float(bodies[k, 3])
                _place(self._bodies[k], bodies[k, :3], _BODY_M / 2)
            else:
                self._bodies[k].visible = False

    def _show_maps(self, built: Layer, belief: Layer | None) -> None:
        if not _is_same(built, self._shown[0]):
            self._nodes.image("built", *self._cut(built.frame, _PALETTE[built.values]), STEP_M)
            cells = np.argwhere(built.values == OBSTACLE)[:, ::-1] + 0.5
            places = cells * built.frame.resolution_m + np.array(built.frame.origin_xy)
            high = np.column_stack([places, np.full(len(places), _OBSTACLE_M)])
            self._nodes.points("obstacles", high, OBSTACLE_BLACK, built.frame.resolution_m)
        if belief is not None and not _is_same(belief, self._shown[1]):
            rgba = np.empty((*belief.values.shape, 4), np.uint8)
            rgba[..., :3] = TARGET_RED
            rgba[..., 3] = (0.8 * 255 / TOP_LEVEL * belief.values).astype(np.uint8)
            self._nodes.image("belief", *self._cut(belief.frame, rgba), 3 * STEP_M)
        elif belief is None:
            self._nodes.hide("belief")
        self._shown = built, belief

    def _cut(
        self, frame: GridFrame, rgba: UInt8[np.ndarray, "ny nx 4"]
    ) -> tuple[GridFrame, UInt8[np.ndarray, "my mx 4"]]:
        """The part of a map on the plan and its margin, of one size however far the map extends."""
        cell, origin = frame.resolution_m, np.array(frame.origin_xy)
        first = np.floor((self.building.low - MARGIN_M - origin) / cell + 1e-6).astype(int)
        count = np.ceil((self.building.size + 2 * MARGIN_M) / cell).astype(int)
        texture = np.zeros((count[1], count[0], 4), np.uint8)
        rows, columns = rgba.shape[:2]
        left, right = max(first[0], 0), min(first[0] + count[0], columns)
        low, high = max(first[1], 0), min(first[1] + count[1], rows)
        if right > left and high > low:
            to = slice(low - first[1], high - first[1]), slice(left - first[0], right - first[0])
            texture[to] = rgba[low:high, left:right]
        x, y = origin + first * cell
        shape = int(count[1]), int(count[0])
        return GridFrame(origin_xy=(float(x), float(y)), resolution_m=cell, shape=shape), texture

    def _show_motion(self, k: int, step: Step) -> None:
        """Trajectories of a robot so far, planned path and goal; those of a team are in the robot's colour."""
        true, estimated = self.recording.robots[k].trajectories(step.number + 1)
        colour = robot_colour(k) if self.recording.mates else PATH_PURPLE
        self._nodes.polyline(f"true_trajectory{k}", true, 6 * STEP_M, robot_colour(k), 4.0)
        if not self.recording.mates:
            self._nodes.polyline("estimated_trajectory", estimated, 7 * STEP_M, ESTIMATE_ORANGE, 2.0)
        self._nodes.polyline(f"path{k}", step.decided.path, 8 * STEP_M, colour, 2.5)
        arms = 0.18 * np.array([[[-1, -1, 0], [1, 1, 0]], [[-1, 1, 0], [1, -1, 0]]])
        self._nodes.lines(f"goal{k}", arms + np.array([*step.decided.goal, 8 * STEP_M]), colour, 5.0)

    def _show_radio(self, k: int, step: Step, rays: bool) -> None:
        measured = step.estimated.measurement
        fan, colour = np.zeros((0, 2, 3)), TARGET_RED
        if measured is not None:
            place = np.array([*step.true.pose[:2], _RADIO_M])
            known, colour = measured.directed, STATE_COLOURS[measured.state]
            fan = arrival_fan(place, measured.aoa_rad[known], measured.snr_db[known])
        self._nodes.lines(f"arrivals{k}", fan, repeat_colour(colour, len(fan)), 5.0)
        legs, colours = np.zeros((0, 2, 3)), np.zeros((0, 2, 3), np.uint8)
        if rays and step.true.paths is not None:
            legs, colours, _ = ray_segments(step.true.paths, "kind", 0.0)
        self._nodes.lines(f"rays{k}", legs, colours, 1.5)


def _place(node: Any, pose: Float[np.ndarray, "3"], z_m: float) -> None:
    """Show a node at a pose, its middle at a height [m]."""
    node.visible = True
    node.position = (float(pose[0]), float(pose[1]), z_m)
    node.wxyz = (math.cos(pose[2] / 2), 0.0, 0.0, math.sin(pose[2] / 2))


def _is_same(layer: Layer, other: Layer | None) -> bool:
    return other is not None and layer.frame == other.frame and np.array_equal(layer.values, other.values)
