"""The picture of a team: its map with all robots in their colours, and what each camera sees."""

import math
from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.drawing.plan_view import HEIGHT, PALETTE, PlanView, write
from robosim.step import Step
from robosim.support.colours import robot_colour

#: Side of a camera's picture, and width of the frame around it [pixels].
_CAMERA, _FRAME = 160, 3
#: Height of the text below the map [pixels].
_STRIP = 24


class TeamPicture:
    """Draws the steps of a team."""

    #: It has no legend.
    legend_width = 0

    def __init__(
        self,
        rings: Sequence[Float[np.ndarray, "_ 2"]],
        target: Float[np.ndarray, "2"] | None,
        names: Sequence[str],
        *,
        title: str = "",
    ) -> None:
        """Fix the scale so that the whole building fits; see `robosim.drawing.picture.Picture`."""
        self._view, self.target, self._title = PlanView(rings), target, title
        self._trails = {name: np.zeros((0, 2)) for name in names}
        self._cameras = {
            name: np.full((_CAMERA, _CAMERA, 3), robot_colour(k), np.uint8) for k, name in enumerate(names)
        }
        self._steps: dict[str, Step] = {}
        self._columns = math.ceil(len(names) / (HEIGHT // _CAMERA))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [pixels]."""
        return self._columns * _CAMERA + self._view.width, HEIGHT + _STRIP

    def add(self, robot: str, step: Step) -> UInt8[np.ndarray, "height width 3"] | None:
        """Add a step of a robot; returns a picture of the last steps of all where the first robot's next begins."""
        image = self.draw(self._steps) if robot in self._steps else None
        if image is not None:
            self._steps = {}
        self._steps[robot] = step
        return image

    def last(self) -> UInt8[np.ndarray, "height width 3"] | None:
        """The picture of the steps after the last one that was returned; None if there are none."""
        return self.draw(self._steps) if self._steps else None

    def draw(self, steps: Mapping[str, Step]) -> UInt8[np.ndarray, "height width 3"]:
        """The picture of one step of each robot; the map is that of the first of them."""
        image = np.full((*self.size[::-1], 3), 255, np.uint8)
        first = next(iter(steps.values()))
        view, canvas = self._view, self._view.canvas(first.map_layer, PALETTE)
        if first.belief_layer is not None:
            view.tint(canvas, first.belief_layer)
        view.draw_walls(canvas)
        if self.target is not None:
            view.draw_target(canvas, self.target)
        # The first bodies that a robot meets are the other robots.
        view.draw_bodies(canvas, first.true.bodies[len(self._trails) - 1 :])
        for k, name in enumerate(self._trails):
            if (step := steps.get(name)) is not None:
                self._trails[name] = np.vstack([self._trails[name], step.true.pose[:2]])
                inner = slice(_FRAME, _CAMERA - _FRAME)
                self._cameras[name][inner, inner] = cv2.resize(
                    step.sensed.rgb, (_CAMERA - 2 * _FRAME,) * 2, interpolation=cv2.INTER_LINEAR
                )
                view.draw_line(canvas, np.vstack([step.true.pose[:2], step.decided.path]), robot_colour(k), 1)
            view.draw_line(canvas, self._trails[name], robot_colour(k), 2)
            if len(self._trails[name]):
                view.draw_dot(canvas, self._trails[name][-1], robot_colour(k))
        view.draw_scale(canvas)
        image[:HEIGHT, -view.width :] = canvas
        rows = HEIGHT // _CAMERA
        for k, (name, picture) in enumerate(self._cameras.items()):
            y, x = k % rows * _CAMERA, k // rows * _CAMERA
            image[y : y + _CAMERA, x : x + _CAMERA] = picture
            write(image, name, (x + 8, y + 16))
        words = f"{self._title}  step {first.number}"
        write(image, words, (8, HEIGHT + 17))
        return image
