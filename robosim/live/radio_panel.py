"""The tab `Radio`: drag transmitter and robot, and see the paths, the estimates and the radio map.

Workers process their latest requests independently: the paths of the link, which follow the hand; the estimates of the
robot's receiver; the radio map. In a building of several storeys each handle is on a storey of its own, and only paths
are shown.
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

from robosim.drawing.plan_view import building_rings
from robosim.live.building_scene import BuildingScene
from robosim.live.latest_worker import LatestWorker, close_all
from robosim.live.link_model import ENDINGS, SCALED, WALL_MATERIALS, LinkModel, plan_of
from robosim.live.page_html import arrival_table, map_legend, path_table, radio_legend, sentence
from robosim.live.radio_view import MapKind, RadioView, Terminal, radio_maps
from robosim.radio.scene import RadioConfig
from wireless.paths import Paths

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
#: Frame above everything that this panel draws.
ROOT = "/radio"
TERMINALS: tuple[Terminal, ...] = get_args(Terminal)
#: Number of delays of drags that are recorded.
_DELAYS = 500
#: Opacity of the floors above the lowest one.
_OPACITY = 0.45


class RadioPanel:
    """The controls of the tab `Radio`, and its scene."""

    def __init__(
        self,
        server: "viser.ViserServer",
        model: LinkModel,
        *,
        on_plan: Callable[[], None],
        on_title: Callable[[str, str, str], None],
    ) -> None:
        """Draw the building, and fill the current part of the panel.

        `on_plan` is called when another building has been drawn, `on_title` with the page's title, the assumptions and
        a message (HTML).
        """
        self._server, self.model, self._on_plan, self._on_title = server, model, on_plan, on_title
        #: Settings of the controls, which the model follows.
        self._config, self._scale = model.config, ""
        self.delays_s: deque[float] = deque(maxlen=_DELAYS)
        self._yaw_rad = 0.0
        self._map_kind: MapKind = "off"
        self._draw_building()
        self._links: LatestWorker[float] = LatestWorker("link", self._trace, self._show_error)
        self._receptions: LatestWorker[Paths] = LatestWorker("receiver", self._measure, self._show_error)
        self._maps: LatestWorker[None] = LatestWorker("map", self._colour_floor, self._show_error)
        self._opener: LatestWorker[tuple[str, bytes, float]] = LatestWorker(
            "plan", self._open, self._show_file_error
        )
        self._builder: LatestWorker[RadioConfig] = LatestWorker("building", self._rebuild, self._show_error)
        self._workers = (self._opener, self._builder, self._links, self._receptions, self._maps)
        self._fill(server.gui)
        self._say("")
        self.refresh()

    @property
    def places(self) -> dict[Terminal, Float[np.ndarray, "2"]]:
        """Positions of the handles [m]."""
        return {terminal: position[:2] for terminal, position in self._positions.items()}

    @property
    def building(self) -> BuildingScene:
        """The lowest storey in the scene."""
        return self.buildings[0]

    @property
    def _has_one_storey(self) -> bool:
        return len(self.model.storeys) == 1

    def close(self) -> None:
        """End the workers."""
        close_all(self._workers)

    def settle(self, timeout_s: float) -> bool:
        """Wait until all requests are drawn; returns False on timeout."""
        return all(worker.settle(timeout_s) for worker in self._workers)

    def move(self, terminal: Terminal, place: Float[np.ndarray, "2"], storey: int | None = None) -> None:
        """Move a handle to the free place nearest to a point [m], perhaps on another storey."""
        requested = perf_counter()
        self.storey[terminal] = self.storey[terminal] if storey is None else storey
        self._put(terminal, place)
        self._links.put(requested)
        if terminal == "transmitter":
            self._maps.put(None)

    def show_floor(self, kind: MapKind) -> None:
        """Colour the floor by a radio map."""
        self._map_kind = kind
        self._map_legend.content = map_legend(kind)
        self._maps.put(None)

    def refresh(self) -> None:
        """Trace and draw everything again."""
        self._links.put(perf_counter())
        self._maps.put(None)

    def show_plan(self, model: LinkModel, scale: str = "") -> None:
        """Replace the building; `scale` names the assumed scale of the plan."""
        self._frame.remove()
        self.model, self._config, self._scale = model, model.config, scale
        self._draw_building()
        self._say("")
        self.refresh()
        self._on_plan()

    def show(self, visible: bool) -> None:
        """Show or hide the scene of this panel."""
        self._frame.visible = visible

    def _draw_building(self) -> None:
        scene, model = self._server.scene, self.model
        self._frame = scene.add_frame(ROOT, show_axes=False)
        self.buildings = [
            BuildingScene(
                scene, f"{ROOT}/{number}", building_rings(storey.building), storey.building.height_m,
                floor_m=storey.floor_m, has_scale=number == 0, floor_opacity=_OPACITY if number else None,
            )
            for number, storey in enumerate(model.storeys)
        ]  # fmt: skip
        top, tx = len(model.storeys) - 1, model.first_place()
        self.storey: dict[Terminal, int] = {"transmitter": 0, "robot": top}
        rx = model.first_place(top) if top else model.place_out_of_sight(tx)
        self._positions: dict[Terminal, np.ndarray] = {"transmitter": tx, "robot": rx}
        self._draw_handles()

    def _draw_handles(self) -> None:
        self._view = RadioView(self._server, f"{ROOT}/link", self.model.config.height_m)
        self._view.on_drag(self.move)
        if self._has_one_storey:
            self._view.show_heading(self._yaw_rad)
        for terminal in TERMINALS:
            self._put(terminal, self._positions[terminal][:2])

    def _put(self, terminal: Terminal, place: Float[np.ndarray, "2"]) -> None:
        self._positions[terminal] = self.model.antenna(place, self.storey[terminal])
        self._view.place(terminal, self._positions[terminal])

    def _fill(self, gui: "viser.GuiApi") -> None:
        if self._has_one_storey:
            kind = gui.add_dropdown("floor shows", get_args(MapKind), initial_value="off")
            self._map_legend = gui.add_html("")
            kind.on_update(lambda event: self.show_floor(kind.value))
        else:
            self._add_storeys(gui)
        colours = self._colours = gui.add_dropdown("rays by", ("power", "kind"), initial_value="power")
        legend = gui.add_html(radio_legend("power", estimates=self._has_one_storey))
        self._paths = gui.add_html(sentence("tracing ..."))
        self._reception = gui.add_html("")
        if self._has_one_storey:
            self._reception.content = sentence("preparing the receiver, which takes some seconds ...")
        with gui.add_folder("Tracer", expand_by_default=False):
            self._add_settings(gui)
        if self._has_one_storey:
            with gui.add_folder("Open a plan", expand_by_default=False):
                self._add_upload(gui)
            heading = gui.add_slider("robot's heading [° from +x]", -180, 180, 5, 0)
            heading.on_update(lambda event: self._turn(math.radians(heading.value)))
        highest = max(building.height_m for building in self.buildings)
        cut = gui.add_slider("walls up to [m]", 0.0, highest, 0.1, highest)

        @colours.on_update
        def _(event: Any) -> None:
            legend.content = radio_legend(colours.value, estimates=self._has_one_storey)
            self._links.put(perf_counter())

        @cut.on_update
        def _(event: Any) -> None:
            for building in self.buildings:
                building.cut_walls(cut.value)

    def _turn(self, yaw_rad: float) -> None:
        self._yaw_rad = yaw_rad
        self._view.show_heading(yaw_rad)
        self._links.put(perf_counter())

    def _add_storeys(self, gui: "viser.GuiApi") -> None:
        names = [f"{number}, from {storey.floor_m:g} m" for number, storey in enumerate(self.model.storeys)]

        def add(terminal: Terminal) -> None:
            first = names[self.storey[terminal]]
            choice = gui.add_dropdown(f"{terminal} on storey", tuple(names), initial_value=first)
            choice.on_update(
                lambda event: self.move(terminal, self.places[terminal], names.index(choice.value))
            )

        for terminal in TERMINALS:
            add(terminal)
        top = gui.add_dropdown("storeys shown up to", tuple(names), initial_value=names[-1])

        @top.on_update
        def _(event: Any) -> None:
            for number, building in enumerate(self.buildings):
                building.show(number <= names.index(top.value))

    def _add_upload(self, gui: "viser.GuiApi") -> None:
        resolution = gui.add_number("metres per pixel of pictures", 0.05, min=0.001, max=10.0, step=0.001)
        upload = gui.add_upload_button("Open a picture, a mesh, .json or .npy", mime_type=",".join(ENDINGS))
        self._file_message = gui.add_html("")

        @upload.on_upload
        def _(event: Any) -> None:
            file = upload.value
            self._opener.put((file.name, file.content, float(resolution.value)))

    def _add_settings(self, gui: "viser.GuiApi") -> None:
        c, t = self._config, self._config.tracer
        frequency = gui.add_slider(
            "frequency [GHz]", 2.0, 95.0, 0.5, float(np.clip(c.frequency_hz / 1e9, 2, 95))
        )
        order = gui.add_slider("reflections", 0, 6, 1, t.max_reflections)
        through = gui.add_slider("walls passed", 0, 6, 1, t.walls_passed(c.frequency_hz))
        bent = gui.add_checkbox("diffraction", t.diffraction)
        controls: list[Any] = [frequency, order, through, bent]
        if self._has_one_storey:
            top = round(self.model.building.height_m - 0.1, 1)
            height = gui.add_slider("antennas at [m]", 0.1, top, 0.1, float(np.clip(c.height_m, 0.1, top)))
            names = tuple(dict.fromkeys((str(c.building.wall_material), *WALL_MATERIALS)))
            walls = gui.add_dropdown("walls", names, initial_value=str(c.building.wall_material))
            floor = gui.add_checkbox("floor and ceiling reflect", bool(t.floor_ceiling))
            controls += [height, walls, floor]

        def changed(event: Any) -> None:
            tracer = replace(
                self._config.tracer,
                max_reflections=order.value,
                max_transmissions=through.value,
                diffraction=bent.value,
            )
            config = replace(self._config, frequency_hz=frequency.value * 1e9, tracer=tracer)
            if self._has_one_storey:
                # A material that is an object is not replaced by its name.
                material = (
                    walls.value if walls.value != str(c.building.wall_material) else c.building.wall_material
                )
                tracer = replace(tracer, floor_ceiling=floor.value)
                building = replace(config.building, wall_material=material)
                config = replace(config, height_m=height.value, building=building, tracer=tracer)
            self._config = config
            self._builder.put(config)

        for control in controls:
            control.on_update(changed)

    def _open(self, file: tuple[str, bytes, float]) -> None:
        """Replace the building by that of a file: its name, content and metres per pixel."""
        name, _, resolution_m = file
        self._file_message.content = ""
        self._say("reading the plan ...", bad=False)
        plan, warning = plan_of(*file)
        scale = f"{resolution_m:g} m per pixel (set it under 'Open a plan', and open {name} again), "
        model = LinkModel(plan, self._config)
        self.show_plan(model, scale if name.lower().endswith(SCALED) else "")
        self._say(warning)
        self._file_message.content = self._message

    def _trace(self, requested: float) -> None:
        model, tx, rx = self.model, self._positions["transmitter"], self._positions["robot"]
        paths = model.trace(tx[None], rx[None], workers=1)
        self._view.show_paths(paths, self._colours.value, model.config.tx_power_dbm)
        self._paths.content = path_table(paths, model.config.tx_power_dbm)
        self.delays_s.append(perf_counter() - requested)
        if self._has_one_storey:
            self._receptions.put(paths)

    def _measure(self, paths: Paths) -> None:
        model, pose = self.model, np.array([*paths.rx_position[0, :2], self._yaw_rad])
        measurement, true_paths = model.measure(paths.tx_position[0, :2], pose, seed=0)
        if not self._receptions.is_stale and model is self.model:
            self._view.show_estimates(measurement)
            self._reception.content = arrival_table(measurement, true_paths)

    def _colour_floor(self, _: None) -> None:
        model, tx, kind = self.model, self._positions["transmitter"], self._map_kind
        if kind == "off":
            self._view.show_map(None)
            return
        for radio_map in radio_maps(model, tx, kind, lambda: self._maps.is_stale):
            self._view.show_map(radio_map)

    def _rebuild(self, config: RadioConfig) -> None:
        height_m = self._view.height_m
        self.model = self.model.with_config(config)
        if config.height_m != height_m:
            self._draw_handles()
        for terminal in TERMINALS:
            self._put(terminal, self._positions[terminal][:2])
        self._say("")
        self.refresh()

    def _show_error(self, error: Exception) -> None:
        logger.debug(f"on the page: {error}")
        self._say(" ".join(str(error).split()))

    def _show_file_error(self, error: Exception) -> None:
        """Show the error next to the button, too: the head of the panel may be out of sight."""
        self._show_error(error)
        self._file_message.content = self._message

    def _say(self, text: str, *, bad: bool = True) -> None:
        """Show title, assumptions and a message at the head of the panel."""
        self._message = sentence(text, bad=bad) if text else ""
        plan, config, building = self.model.plan, self.model.config, self.model.building
        about = ""
        if self._has_one_storey:
            about = (
                f"{plan.name}: {building.free.area:.1f} m² of floor, cells of {building.plan.resolution_m:g} m. "
                f"Assumed: {self._scale}ceiling at {building.height_m:g} m, walls of {config.building.wall_material}, "
                f"{config.frequency_hz / 1e9:g} GHz, antennas {config.height_m:g} m high."
            )
        self._on_title(f"robosim live: {plan.name}", about, self._message)
