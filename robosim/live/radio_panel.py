"""Explore a building: drag transmitter and robot, and see what arrives.

Three workers share what there is to do, each taking the latest request: paths of the link, which follow the hand; what
the robot's receiver makes of them; the map of radio over the floor. None waits for another.
"""

import logging
import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from jaxtyping import Float

from robosim.building.building import BuildingConfig
from robosim.drawing.plan_view import building_rings
from robosim.live.field import FieldKind, fields
from robosim.live.latest import Latest, close_all
from robosim.live.link_model import WALL_MATERIALS, LinkModel, LinkSettings
from robosim.live.own_plan import ENDINGS, SCALED, plan_of
from robosim.live.radio_view import RadioView, Who
from robosim.live.scenery import Scenery
from robosim.live.tables import arrival_table, field_legend, path_table, radio_legend, sentence
from wireless.paths import Paths

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
#: Root of all that this panel draws.
ROOT = "/radio"
#: How many of the last drags' delays are kept.
_KEPT = 500


class RadioPanel:
    """The part `Radio` of the panel, and what it shows."""

    def __init__(
        self,
        server: "viser.ViserServer",
        model: LinkModel,
        building: BuildingConfig,
        *,
        on_plan: Callable[[], None],
        on_about: Callable[[str, str, str], None],
    ) -> None:
        """Draw the building, and fill the current part of the panel.

        Args:
            server: The page.
            model: The building.
            building: How other plans become buildings.
            on_plan: Called when another building has been drawn.
            on_about: Called with the page's title, what is assumed, and a line of HTML.
        """
        self._server, self.model, self._on_plan, self._on_about = server, model, on_plan, on_about
        self._scale = ""
        self.delays_s: deque[float] = deque(maxlen=_KEPT)
        self._yaw_rad = 0.0
        self._field_kind: FieldKind = "off"
        self._settings = model.settings
        self._building = building
        self._draw_building()
        self._fill()
        self._say("")
        self._links: Latest[float] = Latest("link", self._trace, self._failed)
        self._ears: Latest[Paths] = Latest("receiver", self._listen, self._failed)
        self._floors: Latest[None] = Latest("field", self._colour_floor, self._failed)
        self._opener: Latest[tuple[str, bytes, float]] = Latest("plan", self._open, self._not_opened)
        self._builder: Latest[LinkSettings] = Latest("building", self._rebuild, self._failed)
        self.refresh()

    @property
    def places(self) -> dict[Who, Float[np.ndarray, "2"]]:
        """Where the handles are [m]."""
        return dict(self._places)

    def close(self) -> None:
        """End the workers."""
        close_all((self._opener, self._builder, self._links, self._ears, self._floors))

    def settle(self, timeout_s: float) -> bool:
        """Wait until all that was asked for is drawn; returns whether it came in time."""
        workers = (self._opener, self._builder, self._links, self._ears, self._floors)
        return all(worker.settle(timeout_s) for worker in workers)

    def move(self, who: Who, at: Float[np.ndarray, "2"]) -> None:
        """Put transmitter or robot at a place of free space near to one [m]; the rest follows."""
        asked = perf_counter()
        self._places[who] = self.model.nearest_free(at)
        self._view.place(who, self._places[who])
        self._links.put(asked)
        if who == "transmitter":
            self._floors.put(None)

    def show_floor(self, kind: FieldKind) -> None:
        """Colour the floor by a map of radio, or by none."""
        self._field_kind = kind
        self._floor_legend.content = field_legend(kind)
        self._floors.put(None)

    def refresh(self) -> None:
        """Show everything anew."""
        self._links.put(perf_counter())
        self._floors.put(None)

    def show_plan(self, model: LinkModel, scale: str = "") -> None:
        """Go over to another building; what was assumed of its scale is said."""
        self._scenery.remove()
        self.model, self._settings, self._scale = model, model.settings, scale
        self._draw_building()
        self._view.on_drag(self._dragged)
        self._view.show_heading(self._yaw_rad)
        self._say("")
        self.refresh()
        self._on_plan()

    @property
    def scenery(self) -> Scenery:
        """The building as it is drawn."""
        return self._scenery

    def show(self, visible: bool) -> None:
        """Show or hide all that this panel draws."""
        self._scenery.show(visible)

    def _draw_building(self) -> None:
        building = self.model.building
        self._scenery = Scenery(self._server.scene, ROOT, building_rings(building), building.height_m)
        self._view = RadioView(self._server, f"{ROOT}/link", self.model.settings.height_m)
        tx, rx = self.model.first_places()
        self._places: dict[Who, np.ndarray] = {"transmitter": tx, "robot": rx}
        self._view.place("transmitter", tx)
        self._view.place("robot", rx)

    def _fill(self) -> None:
        gui = self._server.gui
        kind = gui.add_dropdown("floor shows", get_args(FieldKind), initial_value="off")
        self._floor_legend = gui.add_html("")
        colours = gui.add_dropdown("rays by", ("power", "kind"), initial_value="power")
        self._colours = colours
        self._legend = gui.add_html(radio_legend("power"))
        self._paths = gui.add_html(sentence("tracing ..."))
        self._heard = gui.add_html(sentence("making the receiver ready, which takes some seconds ..."))
        with gui.add_folder("What is traced", expand_by_default=False):
            self._add_settings(gui)
        with gui.add_folder("Your own plan", expand_by_default=False):
            self._add_upload(gui)
        heading = gui.add_slider("robot looks to [° from +x]", -180, 180, 5, 0)
        cut = gui.add_slider(
            "walls up to [m]", 0.0, self.model.building.height_m, 0.1, self.model.building.height_m
        )

        @kind.on_update
        def _(event: Any) -> None:
            self.show_floor(kind.value)

        @colours.on_update
        def _(event: Any) -> None:
            self._legend.content = radio_legend(colours.value)
            self._links.put(perf_counter())

        @heading.on_update
        def _(event: Any) -> None:
            self._yaw_rad = math.radians(heading.value)
            self._view.show_heading(self._yaw_rad)
            self._links.put(perf_counter())

        @cut.on_update
        def _(event: Any) -> None:
            self._scenery.cut_walls(cut.value)

        self._view.on_drag(self._dragged)
        self._view.show_heading(self._yaw_rad)

    def _add_upload(self, gui: "viser.GuiApi") -> None:
        resolution = gui.add_number("metres per pixel, for pictures", 0.05, min=0.001, max=10.0, step=0.001)
        upload = gui.add_upload_button("Open a picture, a mesh, .json or .npy", mime_type=",".join(ENDINGS))
        self._unread = gui.add_html("")

        @upload.on_upload
        def _(event: Any) -> None:
            file = upload.value
            self._opener.put((file.name, file.content, float(resolution.value)))

    def _open(self, file: tuple[str, bytes, float]) -> None:
        """Go over to a plan that was put onto the page."""
        self._unread.content = ""
        self._say("reading the plan ...", bad=False)
        plan, warned = plan_of(*file)
        scale = f"{file[2]:g} m per pixel (set it under 'Your own plan', and open {file[0]} again), "
        model = LinkModel(plan, self._building, self._settings)
        self.show_plan(model, scale if file[0].lower().endswith(SCALED) else "")
        self._say(warned)
        self._unread.content = self._said

    def _add_settings(self, gui: Any) -> None:
        s, t = self._settings, self._settings.tracer
        top = self.model.building.height_m - 0.1
        frequency = gui.add_slider(
            "frequency [GHz]", 2.0, 95.0, 0.5, float(np.clip(s.frequency_hz / 1e9, 2, 95))
        )
        height = gui.add_slider(
            "antennas at [m]", 0.1, round(top, 1), 0.1, float(np.clip(s.height_m, 0.1, top))
        )
        names = tuple(dict.fromkeys((str(s.wall_material), *WALL_MATERIALS)))
        walls = gui.add_dropdown("walls", names, initial_value=str(s.wall_material))
        order = gui.add_slider("reflections", 0, 6, 1, t.max_reflections)
        through = gui.add_slider("walls passed", 0, 6, 1, t.walls_passed(s.frequency_hz))
        bent = gui.add_checkbox("diffraction", t.diffraction)
        floor = gui.add_checkbox("floor and ceiling reflect", t.floor_ceiling)

        def changed(event: Any) -> None:
            self._settings = replace(
                self._settings,
                frequency_hz=frequency.value * 1e9,
                height_m=height.value,
                wall_material=walls.value if walls.value != str(s.wall_material) else s.wall_material,
                tracer=replace(
                    t,
                    max_reflections=order.value,
                    max_transmissions=through.value,
                    diffraction=bent.value,
                    floor_ceiling=floor.value,
                ),
            )
            self._builder.put(self._settings)

        for control in (frequency, height, walls, order, through, bent, floor):
            control.on_update(changed)

    def _dragged(self, who: Who, at: Float[np.ndarray, "2"], done: bool) -> None:
        self.move(who, at)

    def _trace(self, asked: float) -> None:
        model, tx, rx = self.model, self._places["transmitter"], self._places["robot"]
        paths = model.paths(tx, rx)
        self._view.show_paths(paths, self._colours.value, model.settings.tx_power_dbm)
        self._paths.content = path_table(paths, model.settings.tx_power_dbm)
        self.delays_s.append(perf_counter() - asked)
        self._ears.put(paths)

    def _listen(self, paths: Paths) -> None:
        model, pose = self.model, np.array([*paths.rx_position[0, :2], self._yaw_rad])
        heard = model.listen(paths.tx_position[0, :2], pose, seed=0)
        if self._ears.stale or model is not self.model:
            return
        self._view.show_estimates(heard.measurement)
        self._heard.content = arrival_table(heard.measurement, heard.paths)

    def _colour_floor(self, _: None) -> None:
        model, tx, kind = self.model, self._places["transmitter"], self._field_kind
        if kind == "off":
            self._view.show_field(None)
            return
        for field in fields(model, tx, kind, lambda: self._floors.stale):
            self._view.show_field(field)

    def _rebuild(self, settings: LinkSettings) -> None:
        model = self.model.changed(settings)
        height = self._view.height_m
        self.model = model
        if settings.height_m != height:
            self._view = RadioView(self._server, f"{ROOT}/link", settings.height_m)
            self._view.on_drag(self._dragged)
            self._view.show_heading(self._yaw_rad)
        for who in ("transmitter", "robot"):
            self._places[who] = model.nearest_free(self._places[who])
            self._view.place(who, self._places[who])
        self._say("")
        self.refresh()

    def _failed(self, error: Exception) -> None:
        logger.debug("in the page: %s", error)
        self._say(" ".join(str(error).split()))

    def _not_opened(self, error: Exception) -> None:
        """Told beside the button too, from where the panel's head may be out of sight."""
        self._failed(error)
        self._unread.content = self._said

    def _say(self, text: str, *, bad: bool = True) -> None:
        """Say above the panel what is shown and assumed, and perhaps something else."""
        self._said = sentence(text, bad=bad) if text else ""
        plan, settings = self.model.plan, self.model.settings
        about = (
            f"{plan.name}: {self.model.building.free.area:.1f} m² of floor, cells of {plan.resolution_m:g} m. Assumed: "
            f"{self._scale}ceiling at {self.model.building.height_m:g} m, walls of {settings.wall_material}, "
            f"{settings.frequency_hz / 1e9:g} GHz, antennas {settings.height_m:g} m high."
        )
        self._on_about(f"robosim live: {plan.name}", about, self._said)
