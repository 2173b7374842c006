"""The page: its server, its tabs, and the views of its windows."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.episode_config import EpisodeConfig
from robosim.live.building_scene import FIELD_DEG, BuildingScene, light, view_of_all
from robosim.live.link_model import LinkModel
from robosim.live.page_html import page_head
from robosim.live.radio_panel import RadioPanel
from robosim.live.results_panel import ResultsPanel
from robosim.live.search_panel import SearchPanel
from robosim.live.server import COVERED, close_server, open_server
from robosim.plans.floorplan import FloorPlan
from robosim.plans.storey_plans import StoreysPlan
from robosim.radio.scene import RadioConfig

if TYPE_CHECKING:
    import viser

#: Position of the eye over the robot's shoulder: distance behind it, and height [m].
BEHIND_M, EYE_M = 2.2, 2.4
#: Relative change of a window's shape that sets its view again.
_RESHAPED = 0.02
#: Width over height of windows that are treated as phones, which the panel covers partly. Their size in pixels does not
#: show it: viser renders fewer where drawing is slow, and phones have more.
_PHONE = 0.6


@dataclass(frozen=True, eq=False)
class Tab:
    """A tab of the panel, and its part of the scene."""

    folder: Any
    """The controls."""
    show: Callable[[bool], None]
    """Shows or hides its part of the scene."""
    buildings: Callable[[], list[BuildingScene]]
    """Buildings in its part of the scene."""
    on_select: Callable[[bool], None] = lambda selected: None
    """Called with whether the tab is selected; without buildings of its own it shows those of `Radio`."""


class Page:
    """A page that is served until it is closed."""

    def __init__(self, host: str, port: int, title: str) -> None:
        """Serve an empty page; port 0 stands for any free one.

        Raises:
            ValueError: If viser is not installed, or the address cannot be used.
        """
        self.server: viser.ViserServer = open_server(host, port, title)
        self.host, self._closers = host, list[Callable[[], None]]()
        self._buildings: list[BuildingScene] = []
        self.radio: RadioPanel | None = None
        self.server.gui.main_panel.dock_right()
        self._head = self.server.gui.add_html("", order=-2.0)
        self.set_title(title)
        light(self.server.scene)
        self._tabs: dict[str, Tab] = {}
        #: Shape and eye [m] of windows whose view was set to all buildings.
        self._views: dict[int, tuple[float, np.ndarray]] = {}
        self.server.on_client_connect(self._connect)
        self.server.on_client_disconnect(self._disconnect)
        self._ended = threading.Event()

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def url(self) -> str:
        """Address for a browser on this machine."""
        host = "localhost" if self.host in ("0.0.0.0", "::", "") else self.host
        name = f"[{host}]" if ":" in host else host
        return f"http://{name}:{self.server.get_port()}"

    def set_title(self, title: str, about: str = "", message: str = "") -> None:
        """Set the title of panel and browser tab, the facts at the head of the panel, and a message (HTML)."""
        self.server.gui.set_panel_label(title)
        self._head.content = page_head(title, about) + message

    def explore(self, plan: FloorPlan | StoreysPlan, config: RadioConfig | None = None) -> RadioPanel:
        """Add the tab `Radio` for a building of one or several storeys.

        Raises:
            MapError: If a plan has no free area.
            ValueError: If a setting does not fit.
        """
        model = LinkModel(plan, config or RadioConfig())
        with self.server.gui.add_folder("Radio") as folder:
            radio = self.radio = RadioPanel(
                self.server, model, on_plan=lambda: self.show("Radio"), on_title=self.set_title
            )
            above = self.server.gui.add_button("View from above")
            above.on_click(lambda event: self._view_all(event.client))
            if len(model.storeys) == 1:
                shoulder = self.server.gui.add_button("View over the robot's shoulder")
                shoulder.on_click(lambda event: self._view_robot(event.client))
        self._closers.append(radio.close)
        self._tabs["Radio"] = Tab(folder, radio.show, lambda: radio.buildings)
        self.show("Radio")
        return radio

    def search(self, config: EpisodeConfig) -> SearchPanel:
        """Add the tab `Search` in the building of `Radio`, with settings that the tabs do not have."""
        assert self.radio is not None, "explore a building first"
        with self.server.gui.add_folder("Search") as folder:
            searches = SearchPanel(self.server, self.radio, config, on_view=lambda: self.show("Search"))
        self._closers.append(searches.close)
        player = searches.player
        self._tabs["Search"] = Tab(folder, player.show, lambda: player.buildings, searches.show_marks)
        choice = self.server.gui.add_button_group("show", tuple(self._tabs), order=-1.0)
        choice.on_click(lambda event: self.show(choice.value))
        self.show("Radio")
        return searches

    def replay(self, folder: Path) -> ResultsPanel:
        """Add the tab `Replay` for an episode or an evaluation.

        Raises:
            FileError: If a file in the folder is damaged.
            ValueError: If there is nothing to show.
        """
        with self.server.gui.add_folder("Replay") as gui_folder:
            results = ResultsPanel(self.server, folder, on_view=lambda: self.show("Replay"))
        self._closers.append(results.close)
        player = results.player
        self._tabs["Replay"] = Tab(gui_folder, player.show, lambda: player.buildings)
        self.show("Replay")
        return results

    def show(self, name: str) -> None:
        """Select a tab, in all windows; nothing happens before it has been added."""
        if name not in self._tabs:
            return
        # A tab without buildings, such as Search at first, shows those of Radio.
        shown = name if self._tabs[name].buildings() else "Radio"
        for other, tab in self._tabs.items():
            tab.folder.visible = other == name
            tab.show(other == shown)
            tab.on_select(other == name)
        if shown in self._tabs:
            # viser's initial camera is not used: it does not know the shape of a window, and is set later.
            self._buildings = self._tabs[shown].buildings()
            for client in self.server.get_clients().values():
                self._view_all(client)

    def wait(self) -> None:
        """Serve until the program is interrupted, or the page closed."""
        self._ended.wait()

    def close(self) -> None:
        """End everything."""
        self._ended.set()
        for close in reversed(self._closers):
            close()
        self._closers.clear()
        close_server(self.server)

    def _connect(self, client: Any) -> None:
        """Set the view of a new window, and again when it changes its shape, as when its panel appears."""
        self._view_all(client)
        client.camera.on_update(lambda camera: self._fit(client))

    def _disconnect(self, client: Any) -> None:
        self._views.pop(client.client_id, None)

    def _view_all(self, client: Any) -> None:
        """Set a window's view to all buildings."""
        if client is not None and self._buildings:
            aspect = float(client.camera.aspect)
            eye, target = view_of_all(self._buildings, aspect, covered=COVERED if aspect < _PHONE else 0.0)
            _set_camera(client, eye, target)
            self._views[client.client_id] = aspect, eye

    def _fit(self, client: Any) -> None:
        """Set the view again if the window has another shape, unless its user has turned it."""
        aspect, eye = self._views.get(client.client_id, (0.0, np.zeros(3)))
        if not aspect:
            return
        is_unturned = np.allclose(client.camera.position, eye, atol=0.01 * eye[2])
        if is_unturned and abs(client.camera.aspect / aspect - 1) > _RESHAPED:
            self._view_all(client)

    def _view_robot(self, client: Any) -> None:
        """Set a window's view from behind the robot towards the transmitter."""
        if client is None or self.radio is None:
            return
        robot, transmitter = self.radio.places["robot"], self.radio.places["transmitter"]
        direction = (transmitter - robot) / max(float(np.hypot(*(transmitter - robot))), 0.1)
        # Otherwise a slow window that still reports its view from above would be reset to it.
        self._views.pop(client.client_id, None)
        eye = np.array([*(robot - BEHIND_M * direction), EYE_M])
        _set_camera(client, eye, np.array([*(robot + direction), 1.0]))


def _set_camera(client: Any, eye: np.ndarray, target: np.ndarray) -> None:
    with client.atomic():
        client.camera.fov = math.radians(FIELD_DEG)
        client.camera.up_direction = (0.0, 0.0, 1.0)
        client.camera.position = tuple(eye)
        client.camera.look_at = tuple(target)
