"""Explore a building of several storeys: drag transmitter and robot, each on a storey of its own."""

import logging
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from robosim.building.building import BuildingConfig
from robosim.drawing.plan_view import building_rings
from robosim.live.latest import Latest, close_all
from robosim.live.link_model import LinkSettings
from robosim.live.radio_view import RadioView, Who
from robosim.live.scenery import Scenery
from robosim.live.storeys_model import StoreysModel
from robosim.live.tables import path_table, radio_legend, sentence

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
ROOT = "/storeys"
WHO: tuple[Who, ...] = ("transmitter", "robot")
#: Floors over the lowest one let so much of what is below them through.
_OPACITY = 0.45


class StoreysPanel:
    """The part `Radio` of the panel for several storeys, and what it shows."""

    def __init__(self, server: "viser.ViserServer", model: StoreysModel, building: BuildingConfig) -> None:
        """Draw the building, and fill the current part of the panel.

        Args:
            server: The page.
            model: The building.
            building: How plans become storeys.
        """
        self._server, self.model, self._building = server, model, building
        self._scene = server.scene.add_frame(ROOT, show_axes=False)
        self.sceneries = [
            Scenery(
                server.scene, f"{ROOT}/{number}", building_rings(one.building), one.building.height_m,
                floor_m=one.floor_m, has_scale=number == 0, floor_opacity=_OPACITY if number else None,
            )
            for number, one in enumerate(model.whole.storeys)
        ]  # fmt: skip
        self._view = RadioView(server, f"{ROOT}/link", model.settings.height_m)
        self.storey: dict[Who, int] = {"transmitter": 0, "robot": len(model) - 1}
        self._places = {who: model.first_place(self.storey[who]) for who in WHO}
        for who in WHO:
            self._view.place(who, self._places[who], model.level_m(self.storey[who]))
        self._fill(server.gui)
        self._links: Latest[float] = Latest("link", self._trace, self._failed)
        self._builder: Latest[LinkSettings] = Latest("building", self._rebuild, self._failed)
        self._links.put(perf_counter())

    @property
    def places(self) -> dict[Who, Float[np.ndarray, "3"]]:
        """Where the handles are, heights above the lowest floor [m]."""
        return {who: np.array([*self._places[who], self.model.level_m(self.storey[who])]) for who in WHO}

    def move(self, who: Who, at: Float[np.ndarray, "2"], storey: int | None = None) -> None:
        """Put transmitter or robot at a free place near to one [m], perhaps on another storey; the rest follows."""
        self.storey[who] = self.storey[who] if storey is None else storey
        self._places[who] = self.model.nearest_free(at, self.storey[who])
        self._view.place(who, self._places[who], self.model.level_m(self.storey[who]))
        self._links.put(perf_counter())

    def settle(self, timeout_s: float) -> bool:
        """Wait until all that was asked for is drawn; returns whether it came in time."""
        return self._builder.settle(timeout_s) and self._links.settle(timeout_s)

    def show(self, visible: bool) -> None:
        """Show or hide all that this panel draws."""
        self._scene.visible = visible

    def close(self) -> None:
        """End the workers."""
        close_all((self._builder, self._links))

    def _fill(self, gui: "viser.GuiApi") -> None:
        self._status = gui.add_html("")
        names = [f"{number}, from {one.floor_m:g} m" for number, one in enumerate(self.model.whole.storeys)]
        for who in WHO:
            self._add_storey(gui, who, names)
        top = gui.add_dropdown("storeys shown up to", tuple(names), initial_value=names[-1])
        colours = self._colours = gui.add_dropdown("rays by", ("power", "kind"), initial_value="power")
        legend = gui.add_html(radio_legend("power", estimates=False))
        self._paths = gui.add_html(sentence("tracing ..."))
        with gui.add_folder("What is traced", expand_by_default=False):
            self._add_settings(gui)
        highest = max(one.height_m for one in self.sceneries)
        cut = gui.add_slider("walls up to [m]", 0.0, highest, 0.1, highest)

        @top.on_update
        def _(event: Any) -> None:
            for number, scenery in enumerate(self.sceneries):
                scenery.show(number <= names.index(top.value))

        @colours.on_update
        def _(event: Any) -> None:
            legend.content = radio_legend(colours.value, estimates=False)
            self._links.put(perf_counter())

        @cut.on_update
        def _(event: Any) -> None:
            for scenery in self.sceneries:
                scenery.cut_walls(cut.value)

        self._view.on_drag(lambda who, at, done: self.move(who, at))

    def _add_storey(self, gui: "viser.GuiApi", who: Who, names: list[str]) -> None:
        chosen = gui.add_dropdown(f"{who} on storey", tuple(names), initial_value=names[self.storey[who]])

        @chosen.on_update
        def _(event: Any) -> None:
            self.move(who, self._places[who], names.index(chosen.value))

    def _add_settings(self, gui: "viser.GuiApi") -> None:
        s, t = self.model.settings, self.model.settings.tracer
        frequency = gui.add_slider(
            "frequency [GHz]", 2.0, 95.0, 0.5, float(np.clip(s.frequency_hz / 1e9, 2, 95))
        )
        order = gui.add_slider("reflections", 0, 6, 1, t.max_reflections)
        through = gui.add_slider("walls passed", 0, 6, 1, t.walls_passed(s.frequency_hz))
        bent = gui.add_checkbox("diffraction", t.diffraction)

        def changed(event: Any) -> None:
            traced = replace(
                t,
                max_reflections=order.value,
                max_transmissions=through.value,
                diffraction=bent.value,
            )
            self._builder.put(replace(s, frequency_hz=frequency.value * 1e9, tracer=traced))

        for control in (frequency, order, through, bent):
            control.on_update(changed)

    def _trace(self, asked: float) -> None:
        model, places = self.model, self.places
        paths = model.paths(places["transmitter"], places["robot"])
        self._view.show_paths(paths, self._colours.value, model.settings.tx_power_dbm)
        self._paths.content = path_table(paths, model.settings.tx_power_dbm)

    def _rebuild(self, settings: LinkSettings) -> None:
        self.model = StoreysModel(self.model.plan, self._building, settings)
        self._say("")
        self._links.put(perf_counter())

    def _failed(self, error: Exception) -> None:
        logger.debug("in the page: %s", error)
        self._say(" ".join(str(error).split()))

    def _say(self, text: str) -> None:
        self._status.content = sentence(text, bad=True) if text else ""
