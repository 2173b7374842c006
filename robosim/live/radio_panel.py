"""Explore a building: drag transmitter and robot, and see what arrives.

Three workers share the work, each on its latest request: paths of the link, which follow the hand; what the robot's
receiver makes of them; the map of radio over the floor. None waits for another. In a building of several storeys each
handle stands on a storey of its own, and only paths are shown.
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
from robosim.live.building_scene import Scenery
from robosim.live.latest import Latest, close_all
from robosim.live.link_model import WALL_MATERIALS, LinkModel, LinkSettings
from robosim.live.own_plan import ENDINGS, SCALED, plan_of
from robosim.live.page_html import arrival_table, field_legend, path_table, radio_legend, sentence
from robosim.live.radio_map import FieldKind, fields
from robosim.live.radio_view import RadioView, Who
from wireless.paths import Paths

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
#: Root of all that this panel draws.
ROOT = "/radio"
WHO: tuple[Who, ...] = ("transmitter", "robot")
#: Number of delays of drags that are recorded.
_DELAYS = 500
#: Opacity of the floors above the lowest one.
_OPACITY = 0.45


class RadioPanel:
    """The tab `Radio` of the panel, and what it draws."""

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
        self._building, self._settings, self._scale = building, model.settings, ""
        self.delays_s: deque[float] = deque(maxlen=_DELAYS)
        self._yaw_rad = 0.0
        self._field_kind: FieldKind = "off"
        self._draw_building()
        self._links: Latest[float] = Latest("link", self._trace, self._failed)
        self._receptions: Latest[Paths] = Latest("receiver", self._receive, self._failed)
        self._floors: Latest[None] = Latest("field", self._colour_floor, self._failed)
        self._opener: Latest[tuple[str, bytes, float]] = Latest("plan", self._open, self._not_opened)
        self._builder: Latest[LinkSettings] = Latest("building", self._rebuild, self._failed)
        self._workers = (self._opener, self._builder, self._links, self._receptions, self._floors)
        self._fill(server.gui)
        self._say("")
        self.refresh()

    @property
    def places(self) -> dict[Who, Float[np.ndarray, "2"]]:
        """Positions of the handles [m]."""
        return dict(self._places)

    @property
    def scenery(self) -> Scenery:
        """The lowest storey as it is drawn."""
        return self.sceneries[0]

    @property
    def _one_storey(self) -> bool:
        return len(self.model) == 1

    def close(self) -> None:
        """End the workers."""
        close_all(self._workers)

    def settle(self, timeout_s: float) -> bool:
        """Wait until all requests are drawn; returns whether they were in time."""
        return all(worker.settle(timeout_s) for worker in self._workers)

    def move(self, who: Who, at: Float[np.ndarray, "2"], storey: int | None = None) -> None:
        """Put a handle at the free place nearest to a point [m], perhaps on another storey."""
        asked = perf_counter()
        self.storey[who] = self.storey[who] if storey is None else storey
        self._put(who, at)
        self._links.put(asked)
        if who == "transmitter":
            self._floors.put(None)

    def show_floor(self, kind: FieldKind) -> None:
        """Colour the floor by a map of radio, or by none."""
        self._field_kind = kind
        self._floor_legend.content = field_legend(kind)
        self._floors.put(None)

    def refresh(self) -> None:
        """Trace and draw everything again."""
        self._links.put(perf_counter())
        self._floors.put(None)

    def show_plan(self, model: LinkModel, scale: str = "") -> None:
        """Replace the building.

        Args:
            model: The other building.
            scale: What was assumed of the plan's scale, in words.
        """
        self._scene.remove()
        self.model, self._settings, self._scale = model, model.settings, scale
        self._draw_building()
        self._say("")
        self.refresh()
        self._on_plan()

    def show(self, visible: bool) -> None:
        """Show or hide all that this panel draws."""
        self._scene.visible = visible

    def _draw_building(self) -> None:
        scene, model = self._server.scene, self.model
        self._scene = scene.add_frame(ROOT, show_axes=False)
        self.sceneries = [
            Scenery(
                scene, f"{ROOT}/{number}", building_rings(one.building), one.building.height_m,
                floor_m=one.floor_m, has_scale=number == 0, floor_opacity=_OPACITY if number else None,
            )
            for number, one in enumerate(model.storeys)
        ]  # fmt: skip
        self.storey: dict[Who, int] = {"transmitter": 0, "robot": len(model) - 1}
        tx = model.first_place()
        rx = model.place_out_of_sight(tx) if self._one_storey else model.first_place(len(model) - 1)
        self._places: dict[Who, np.ndarray] = {"transmitter": tx, "robot": rx}
        self._draw_handles()

    def _draw_handles(self) -> None:
        self._view = RadioView(self._server, f"{ROOT}/link", self.model.settings.height_m)
        self._view.on_drag(lambda who, at, done: self.move(who, at))
        if self._one_storey:
            self._view.show_heading(self._yaw_rad)
        for who in WHO:
            self._put(who, self._places[who])

    def _put(self, who: Who, at: Float[np.ndarray, "2"]) -> None:
        self._places[who] = self.model.nearest_free(at, self.storey[who])
        self._view.place(who, self._places[who], self.model.level_m(self.storey[who]))

    def _fill(self, gui: "viser.GuiApi") -> None:
        if self._one_storey:
            self._add_floor(gui)
        else:
            self._add_storeys(gui)
        colours = self._colours = gui.add_dropdown("rays by", ("power", "kind"), initial_value="power")
        legend = gui.add_html(radio_legend("power", estimates=self._one_storey))
        self._paths = gui.add_html(sentence("tracing ..."))
        self._reception = gui.add_html("")
        if self._one_storey:
            self._reception.content = sentence("preparing the receiver, which takes some seconds ...")
        with gui.add_folder("What is traced", expand_by_default=False):
            self._add_settings(gui)
        if self._one_storey:
            with gui.add_folder("Your own plan", expand_by_default=False):
                self._add_upload(gui)
            heading = gui.add_slider("robot looks to [° from +x]", -180, 180, 5, 0)
            heading.on_update(lambda event: self._turn(math.radians(heading.value)))
        highest = max(one.height_m for one in self.sceneries)
        cut = gui.add_slider("walls up to [m]", 0.0, highest, 0.1, highest)

        @colours.on_update
        def _(event: Any) -> None:
            legend.content = radio_legend(colours.value, estimates=self._one_storey)
            self._links.put(perf_counter())

        @cut.on_update
        def _(event: Any) -> None:
            for scenery in self.sceneries:
                scenery.cut_walls(cut.value)

    def _turn(self, yaw_rad: float) -> None:
        self._yaw_rad = yaw_rad
        self._view.show_heading(yaw_rad)
        self._links.put(perf_counter())

    def _add_floor(self, gui: "viser.GuiApi") -> None:
        kind = gui.add_dropdown("floor shows", get_args(FieldKind), initial_value="off")
        self._floor_legend = gui.add_html("")
        kind.on_update(lambda event: self.show_floor(kind.value))

    def _add_storeys(self, gui: "viser.GuiApi") -> None:
        names = [f"{number}, from {one.floor_m:g} m" for number, one in enumerate(self.model.storeys)]

        def add(who: Who) -> None:
            chosen = gui.add_dropdown(f"{who} on storey", tuple(names), initial_value=names[self.storey[who]])
            chosen.on_update(lambda event: self.move(who, self._places[who], names.index(chosen.value)))

        for who in WHO:
            add(who)
        top = gui.add_dropdown("storeys shown up to", tuple(names), initial_value=names[-1])

        @top.on_update
        def _(event: Any) -> None:
            for number, scenery in enumerate(self.sceneries):
                scenery.show(number <= names.index(top.value))

    def _add_upload(self, gui: "viser.GuiApi") -> None:
        resolution = gui.add_number("metres per pixel, for pictures", 0.05, min=0.001, max=10.0, step=0.001)
        upload = gui.add_upload_button("Open a picture, a mesh, .json or .npy", mime_type=",".join(ENDINGS))
        self._unread = gui.add_html("")

        @upload.on_upload
        def _(event: Any) -> None:
            file = upload.value
            self._opener.put((file.name, file.content, float(resolution.value)))

    def _add_settings(self, gui: "viser.GuiApi") -> None:
        s, t = self._settings, self._settings.tracer
        frequency = gui.add_slider(
            "frequency [GHz]", 2.0, 95.0, 0.5, float(np.clip(s.frequency_hz / 1e9, 2, 95))
        )
        order = gui.add_slider("reflections", 0, 6, 1, t.max_reflections)
        through = gui.add_slider("walls passed", 0, 6, 1, t.walls_passed(s.frequency_hz))
        bent = gui.add_checkbox("diffraction", t.diffraction)
        controls: list[Any] = [frequency, order, through, bent]
        if self._one_storey:
            top = round(self.model.building.height_m - 0.1, 1)
            height = gui.add_slider("antennas at [m]", 0.1, top, 0.1, float(np.clip(s.height_m, 0.1, top)))
            names = tuple(dict.fromkeys((str(s.wall_material), *WALL_MATERIALS)))
            walls = gui.add_dropdown("walls", names, initial_value=str(s.wall_material))
            floor = gui.add_checkbox("floor and ceiling reflect", t.floor_ceiling)
            controls += [height, walls, floor]

        def changed(event: Any) -> None:
            tracer = replace(
                self._settings.tracer,
                max_reflections=order.value,
                max_transmissions=through.value,
                diffraction=bent.value,
            )
            settings = replace(self._settings, frequency_hz=frequency.value * 1e9, tracer=tracer)
            if self._one_storey:
                # A material that is an object, not a name, stays one.
                material = walls.value if walls.value != str(s.wall_material) else s.wall_material
                tracer = replace(tracer, floor_ceiling=floor.value)
                settings = replace(settings, height_m=height.value, wall_material=material, tracer=tracer)
            self._settings = settings
            self._builder.put(settings)

        for control in controls:
            control.on_update(changed)

    def _open(self, file: tuple[str, bytes, float]) -> None:
        """Replace the building by that of an uploaded plan."""
        self._unread.content = ""
        self._say("reading the plan ...", bad=False)
        plan, warning = plan_of(*file)
        scale = f"{file[2]:g} m per pixel (set it under 'Your own plan', and open {file[0]} again), "
        model = LinkModel(plan, self._building, self._settings)
        self.show_plan(model, scale if file[0].lower().endswith(SCALED) else "")
        self._say(warning)
        self._unread.content = self._message

    def _trace(self, asked: float) -> None:
        model, places = self.model, self._places
        storeys = self.storey["transmitter"], self.storey["robot"]
        paths = model.paths(places["transmitter"], places["robot"], storeys)
        self._view.show_paths(paths, self._colours.value, model.settings.tx_power_dbm)
        self._paths.content = path_table(paths, model.settings.tx_power_dbm)
        self.delays_s.append(perf_counter() - asked)
        if self._one_storey:
            self._receptions.put(paths)

    def _receive(self, paths: Paths) -> None:
        model, pose = self.model, np.array([*paths.rx_position[0, :2], self._yaw_rad])
        received = model.receive(paths.tx_position[0, :2], pose, seed=0)
        if self._receptions.stale or model is not self.model:
            return
        self._view.show_estimates(received.measurement)
        self._reception.content = arrival_table(received.measurement, received.paths)

    def _colour_floor(self, _: None) -> None:
        model, tx, kind = self.model, self._places["transmitter"], self._field_kind
        if kind == "off":
            self._view.show_field(None)
            return
        for field in fields(model, tx, kind, lambda: self._floors.stale):
            self._view.show_field(field)

    def _rebuild(self, settings: LinkSettings) -> None:
        height_m = self._view.height_m
        self.model = self.model.changed(settings)
        if settings.height_m != height_m:
            self._draw_handles()
        for who in WHO:
            self._put(who, self._places[who])
        self._say("")
        self.refresh()

    def _failed(self, error: Exception) -> None:
        logger.debug("in the page: %s", error)
        self._say(" ".join(str(error).split()))

    def _not_opened(self, error: Exception) -> None:
        """Show the error at the button too, since the panel's head may be out of sight there."""
        self._failed(error)
        self._unread.content = self._message

    def _say(self, text: str, *, bad: bool = True) -> None:
        """Show above the panel what is drawn and assumed, and a message."""
        self._message = sentence(text, bad=bad) if text else ""
        plan, settings, building = self.model.plan, self.model.settings, self.model.building
        about = ""
        if self._one_storey:
            about = (
                f"{plan.name}: {building.free.area:.1f} m² of floor, cells of {building.plan.resolution_m:g} m. "
                f"Assumed: {self._scale}ceiling at {building.height_m:g} m, walls of {settings.wall_material}, "
                f"{settings.frequency_hz / 1e9:g} GHz, antennas {settings.height_m:g} m high."
            )
        self._on_about(f"robosim live: {plan.name}", about, self._message)
