"""Start and target of a search, set by a click on the floor."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from robosim.live.building_scene import Scenery
from robosim.live.radio_view import on_level
from robosim.live.scene_colours import ROBOT_COLOUR, TX_COLOUR

if TYPE_CHECKING:
    import viser

What = Literal["start", "target"]
#: What can be pressed: one of the places, or that neither is set any more.
SET_START, SET_TARGET, FORGET = "set start", "set target", "forget both"
_SIZE_M, _HIGH_M = 0.16, 0.3


class TaskPicker:
    """Waits for a click after a button was pressed, and marks what was set."""

    def __init__(
        self,
        server: "viser.ViserServer",
        *,
        nearest_free: Callable[[Float[np.ndarray, "2"]], Float[np.ndarray, "2"]],
        sceneries: Callable[[], list[Scenery]],
        say: Callable[[str], None],
        on_change: Callable[[], None],
    ) -> None:
        """Add its buttons to the current part of the panel.

        Args:
            server: The page.
            nearest_free: Gives the free place that is nearest to one [m].
            sceneries: Buildings that are shown, of which one is clicked into.
            say: Tells people something.
            on_change: Called when a place was set or forgotten.
        """
        self._server, self._nearest_free, self._sceneries = server, nearest_free, sceneries
        self._say, self._on_change = say, on_change
        self._asked: What | None = None
        self._places: dict[What, Float[np.ndarray, 2]] = {}
        self._marks: dict[What, Any] = {}
        self._visible = True
        buttons = server.gui.add_button_group("by a click on the floor", (SET_START, SET_TARGET, FORGET))

        @buttons.on_click
        def _(event: Any) -> None:
            if buttons.value == FORGET:
                self.forget()
            else:
                self.ask("start" if buttons.value == SET_START else "target")

    @property
    def places(self) -> dict[What, Float[np.ndarray, "2"]]:
        """What is set [m]."""
        return dict(self._places)

    def ask(self, what: What) -> None:
        """Take the next click for a place."""
        if self._asked is None:
            self._server.scene.on_click()(self._clicked)
        self._asked = what
        self._say(f"Click on the floor where the {'robot starts' if what == 'start' else 'target stands'}.")

    def forget(self) -> None:
        """Nothing is set."""
        self._places.clear()
        for mark in self._marks.values():
            mark.remove()
        self._marks.clear()
        self._say("")
        self._on_change()

    def show(self, visible: bool) -> None:
        """Show or hide the marks."""
        self._visible = visible
        for mark in self._marks.values():
            mark.visible = visible

    def put(self, what: What, at: Float[np.ndarray, "2"]) -> None:
        """Set a place: the free one that is nearest to a point [m]."""
        place = self._places[what] = self._nearest_free(at)
        self._mark(what, place)
        self._say("")
        self._on_change()

    def _clicked(self, event: Any) -> None:
        what, self._asked = self._asked, None
        self._server.scene.remove_click_callback(self._clicked)
        origin = np.array(event.ray_origin)
        at = on_level(origin, origin + np.array(event.ray_direction), 0.0)
        if what is not None and at is not None:
            self.put(what, at - self._offset(at))

    def _offset(self, at: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """Where the building stands that is clicked into [m]: of those side by side, the one nearest to the click."""
        shown = self._sceneries()
        if not shown:
            return np.zeros(2)
        away = [float(np.hypot(*(one.middle - at))) for one in shown]
        return np.array(shown[int(np.argmin(away))].offset)

    def _mark(self, what: What, place: Float[np.ndarray, "2"]) -> None:
        position = (float(place[0]), float(place[1]), _HIGH_M)
        if what in self._marks:
            self._marks[what].position = position
            return
        scene, colour = self._server.scene, ROBOT_COLOUR if what == "start" else TX_COLOUR
        mark = scene.add_icosphere(
            f"/task/{what}", radius=_SIZE_M, color=colour, position=position, cast_shadow=False,
            receive_shadow=False, visible=self._visible,
        )  # fmt: skip
        scene.add_label(f"/task/{what}/name", f"{what}, as set", position=(0, 0, 0.2), anchor="bottom-center")
        self._marks[what] = mark
