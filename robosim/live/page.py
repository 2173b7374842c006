"""The page: its server, its tabs, and how one looks at what they show."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.building.building import BuildingConfig
from robosim.episode import EpisodeConfig
from robosim.live.building_scene import FIELD_DEG, Scenery, light, view_from_above
from robosim.live.client import COVERED
from robosim.live.link_model import LinkModel, LinkSettings
from robosim.live.page_html import page_head
from robosim.live.radio_panel import RadioPanel
from robosim.live.results_panel import ResultsPanel
from robosim.live.search_panel import SearchPanel
from robosim.live.server import close_server, open_server
from robosim.plans.floorplan import FloorPlan
from robosim.plans.storey_plans import StoreysPlan

if TYPE_CHECKING:
    import viser


@dataclass(frozen=True, eq=False)
class Mode:
    """One of the things that a page can show."""

    folder: Any
    """Its part of the panel."""
    show: Callable[[bool], None]
    """Shows or hides its part of the space."""
    sceneries: Callable[[], list[Scenery]]
    """Buildings in its part of the space."""
    on_chosen: Callable[[bool], None] = lambda chosen: None
    """Is told whether this one was chosen, though another's building may be shown as long as it has none."""


#: From where one looks over the robot's shoulder: behind it, and above the floor [m].
BEHIND_M, EYE_M = 2.2, 2.4
#: A window is looked at anew when its width over its height has changed by more than this share.
_OTHER_SHAPE = 0.02
#: A space so narrow, by its height, is taken for a phone's, over which the panel lies. Its pixels tell nothing:
#: viser takes fewer where drawing is slow, and phones have more of them.
_PHONE = 0.6


class Page:
    """A page that is served until it is closed."""

    def __init__(self, host: str, port: int, title: str) -> None:
        """Start to serve it, empty.

        Args:
            host: Where.
            port: 0 for any that is free.
            title: Of its panel.

        Raises:
            ValueError: If viser is not installed, or the address cannot be had.
        """
        self.server: viser.ViserServer = open_server(host, port, title)
        self.host, self._closers = host, list[Any]()
        self._sceneries: list[Scenery] = []
        self.radio: RadioPanel | None = None
        self.server.gui.main_panel.dock_right()
        self._about = self.server.gui.add_html("", order=-2.0)
        self.entitle(title)
        light(self.server.scene)
        self._modes: dict[str, Mode] = {}
        self._choice: Any = None
        #: How windows were turned to all of it: their shape then, and the eye's place [m].
        self._turned: dict[int, tuple[float, np.ndarray]] = {}
        self.server.on_client_connect(self._meet)
        self.server.on_client_disconnect(self._part)
        self._ended = threading.Event()

    def __enter__(self) -> "Page":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def url(self) -> str:
        """What to open in a browser of this machine."""
        host = "localhost" if self.host in ("0.0.0.0", "::", "") else self.host
        name = f"[{host}]" if ":" in host else host
        return f"http://{name}:{self.server.get_port()}"

    def entitle(self, title: str, about: str = "", said: str = "") -> None:
        """Set the title of the panel and of the browser's tab, and what stands above all else: facts, and a line."""
        self.server.gui.set_panel_label(title)
        self._about.content = page_head(title, about) + said

    def explore(
        self, plan: FloorPlan | StoreysPlan, building: BuildingConfig, settings: LinkSettings
    ) -> RadioPanel:
        """Add the tab `Radio` for a building of one or several storeys.

        Raises:
            MapError: If a plan has no free area.
            ValueError: If a setting does not fit.
        """
        model = LinkModel(plan, building, settings)
        with self._folder("Radio") as folder:
            radio = self.radio = RadioPanel(
                self.server, model, building, on_plan=lambda: self.show("Radio"), on_about=self.entitle
            )
            above = self.server.gui.add_button("See it from above")
            above.on_click(lambda event: self._welcome(event.client) if event.client else None)
            if len(model) == 1:
                self._add_inside(radio)
        self._closers.append(radio.close)
        self._modes["Radio"] = Mode(folder, radio.show, lambda: radio.sceneries)
        self.show("Radio")
        return radio

    def search(self, config: EpisodeConfig, building: BuildingConfig) -> SearchPanel:
        """Add the tab `Search` in the building that is explored.

        Args:
            config: How searches are run, but for what is chosen in the tab.
            building: How plans become buildings.
        """
        assert self.radio is not None, "explore a building first"
        with self._folder("Search") as folder:
            searches = SearchPanel(
                self.server, self.radio, config, building, on_view=lambda: self.show("Search")
            )
        self._closers.append(searches.close)
        self._modes["Search"] = Mode(
            folder, searches.player.show, lambda: searches.player.sceneries, searches.picker.show
        )
        self._offer_modes()
        self.show("Radio")
        return searches

    def look_back(self, folder: Path) -> ResultsPanel:
        """Show an episode or an evaluation.

        Raises:
            FileError: If a file in the folder is damaged.
            ValueError: If there is nothing to show.
        """
        with self._folder("Look back") as shown:
            results = ResultsPanel(self.server, folder, on_view=lambda: self._recorded())
        self._closers.append(results.close)
        self._modes["Look back"] = Mode(shown, results.player.show, lambda: results.player.sceneries)
        self.show("Look back")
        return results

    def _recorded(self) -> None:
        if "Look back" in self._modes:
            self.show("Look back")

    def show(self, name: str) -> None:
        """Go over to one of the page's modes, in all its windows."""
        # Before there is a search to look at, its building is.
        seen = name if self._modes[name].sceneries() else "Radio"
        for other, mode in self._modes.items():
            mode.folder.visible = other == name
            mode.show(other == seen)
            mode.on_chosen(other == name)
        if seen in self._modes:
            self._look_at(self._modes[seen].sceneries())

    def _folder(self, name: str) -> Any:
        return self.server.gui.add_folder(name)

    def _offer_modes(self) -> None:
        """Let people choose what is shown, above all else."""
        if self._choice is not None:
            self._choice.remove()
        choice = self._choice = self.server.gui.add_button_group("show", tuple(self._modes), order=-1.0)
        choice.on_click(lambda event: self.show(choice.value))

    def wait(self) -> None:
        """Serve until the program is interrupted, or the page closed."""
        self._ended.wait()

    def close(self) -> None:
        """End what runs, and stop to serve."""
        self._ended.set()
        for close in reversed(self._closers):
            close()
        self._closers.clear()
        close_server(self.server)

    def _look_at(self, sceneries: list[Scenery]) -> None:
        """Look at buildings from above, in every window, and in those to come."""
        # Not by the server's first camera, which knows no window's shape and would be set after it.
        self._sceneries = sceneries
        for client in self.server.get_clients().values():
            self._welcome(client)

    def _meet(self, client: Any) -> None:
        """Have a new window look at all of it, and again when it has another shape: its panel comes after its space."""
        self._welcome(client)
        client.camera.on_update(lambda camera: self._fit(client))

    def _part(self, client: Any) -> None:
        """Forget a window that is closed."""
        self._turned.pop(client.client_id, None)

    def _welcome(self, client: Any) -> None:
        """Have a window look at all of it, as wide as it is."""
        if self._sceneries:
            self._turned[client.client_id] = _look_from_above(client, self._sceneries)

    def _fit(self, client: Any) -> None:
        """Look anew where a window's shape has changed, unless somebody has turned its view."""
        turned = self._turned.get(client.client_id)
        if turned is None:
            return
        (aspect, eye), camera = turned, client.camera
        still = np.allclose(camera.position, eye, atol=0.01 * eye[2])
        if still and abs(camera.aspect / aspect - 1) > _OTHER_SHAPE:
            self._welcome(client)

    def _add_inside(self, radio: RadioPanel) -> None:
        inside = self.server.gui.add_button("See it over the robot's shoulder")

        @inside.on_click
        def _(event: Any) -> None:
            if event.client is None:
                return
            at, to = radio.places["robot"], radio.places["transmitter"]
            way = (to - at) / max(float(np.hypot(*(to - at))), 0.1)
            # What a slow window still tells of its view from above would have it look there again.
            self._turned.pop(event.client.client_id, None)
            _look(event.client, np.array([*(at - BEHIND_M * way), EYE_M]), np.array([*(at + way), 1.0]))


def _look_from_above(client: Any, sceneries: list[Scenery]) -> tuple[float, np.ndarray]:
    """Turn the camera of a window to all of it; returns the window's shape and the eye's place [m]."""
    low = np.min([one.low + one.offset for one in sceneries], axis=0)
    high = np.max([one.high + one.offset for one in sceneries], axis=0)
    height_m = max(one.height_m for one in sceneries)
    aspect = float(client.camera.aspect)
    covered = COVERED if aspect < _PHONE else 0.0
    eye, target = view_from_above(low, high, aspect, height_m, covered)
    _look(client, eye, target)
    return aspect, eye


def _look(client: Any, eye: np.ndarray, target: np.ndarray) -> None:
    """Turn the camera of one window."""
    with client.atomic():
        client.camera.fov = math.radians(FIELD_DEG)
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = tuple(eye)
        client.camera.look_at = tuple(target)
