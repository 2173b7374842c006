"""Plays recordings of searches side by side, while they grow or from the beginning.

One thread draws at most ten times per second and skips steps that come faster: a search never waits for a page.
"""

import logging
import math
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.live.building_scene import BuildingScene
from robosim.live.page_export import export_page
from robosim.live.page_html import camera_picture, picture, search_legend, sentence, step_facts
from robosim.live.recordings import Recording
from robosim.live.search_view import WALLS_M, SearchView
from robosim.step import Step
from robosim.support.colours import css, robot_colour

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
#: Highest number of pictures per second.
MOST_FPS = 10.0
#: Speeds to choose from [decisions per second].
SPEEDS = ("1", "2", "5", "10", "20", "unlimited")
PLAY, PAUSE, STEP = "Play", "Pause", "Step"
#: Colours of the first and the second search in time lines.
STROKES = ("#0072b2", "#d55e00")
#: Titles of the columns of `Recording.time_lines`.
_TIME_LINES = (
    "SNR of the strongest path [dB]",
    "estimated link state (0 outage, 1 LOS, 2, 3 NLOS)",
    "position error [cm]",
)


class Player:
    """Controls, facts and time lines in a tab of the page; searches in its scene."""

    def __init__(
        self,
        server: "viser.ViserServer",
        root: str,
        *,
        on_play: Callable[[bool], None] = lambda playing: None,
        on_step: Callable[[], None] = lambda: None,
        on_speed: Callable[[float], None] = lambda per_s: None,
    ) -> None:
        """Fill the current part of the panel; searches are drawn below the frame `root`.

        `on_play` receives whether running searches continue, and `on_speed` their highest number of decisions per
        second; `on_step` requests one step.
        """
        self._server, self._root = server, root
        self._on_play, self._on_step, self._on_speed = on_play, on_step, on_speed
        self._lock, self._wake = threading.RLock(), threading.Event()
        self._views: list[SearchView] = []
        self._position, self._shown, self._stamp = 0.0, -1, -1
        self._playing, self._following, self._closed = False, False, False
        self._visible = True
        self._charts: list[Any] = []
        self.per_s = math.inf
        self._fill(server.gui)
        self._thread = threading.Thread(target=self._run, name=f"player {root}", daemon=True)
        self._thread.start()

    @property
    def shown(self) -> int:
        """Number of the step that is drawn; -1 before the first."""
        return self._shown

    @property
    def buildings(self) -> list[BuildingScene]:
        """Buildings of all searches."""
        with self._lock:
            return [view.building for view in self._views]

    def load(self, recordings: Sequence[Recording], *, playing: bool, following: bool) -> None:
        """Replace the recordings; `following` shows each new step at once."""
        with self._lock:
            self.clear()
            offset_m = 0.0
            for k, recording in enumerate(recordings):
                # A phone's scene has no space for long titles; the panel shows the same facts.
                view = SearchView(self._server, f"{self._root}/{k}", recording, offset_m, brief=True)
                view.building.show(self._visible)
                self._views.append(view)
                offset_m += 1.15 * float(view.building.size[0]) + 1.0
            self._legend.content = search_legend([robot.robot for robot in recordings[0].robots])
            self._position, self._shown, self._stamp = 0.0, -1, -1
            self._playing, self._following = playing, following
            self._slider.disabled = self._export.disabled = False
        self._wake.set()

    def clear(self) -> None:
        """Remove the recordings."""
        with self._lock:
            for view in self._views:
                view.building.remove()
            self._views.clear()
            self._slider.disabled = self._export.disabled = True

    def show(self, visible: bool) -> None:
        """Show or hide the searches."""
        with self._lock:
            self._visible = visible
            for view in self._views:
                view.building.show(visible)
            self._shown = -1
        self._wake.set()

    def update(self) -> None:
        """Draw new steps."""
        self._wake.set()

    def say(self, text: str, *, bad: bool = False) -> None:
        """Show a message above the controls; an empty one clears it."""
        self._status.content = sentence(text, bad=bad) if text else ""

    def close(self) -> None:
        """End the thread."""
        self._closed = True
        self._wake.set()
        self._thread.join(5)

    def _fill(self, gui: "viser.GuiApi") -> None:
        self._status = gui.add_html("")
        self._buttons = gui.add_button_group("play", (PLAY, PAUSE, STEP))
        self._slider: Any = gui.add_slider("decision", 0, 1, 1, 0, disabled=True)
        speed = gui.add_dropdown("decisions per second", SPEEDS, initial_value=SPEEDS[-1])
        self._camera = gui.add_html("")
        self._numbers = gui.add_html("")
        self._charts_folder = gui.add_folder("Time lines", expand_by_default=True)
        self._legend = gui.add_html(search_legend())
        self._rays = gui.add_checkbox("true rays of the 8 strongest paths", True)
        self._export = gui.add_button("Save as a standalone page (.html)", disabled=True)
        walls = gui.add_slider("walls up to [m]", 0.0, 2.5, 0.1, WALLS_M)

        @self._buttons.on_click
        def _(event: Any) -> None:
            if self._buttons.value == STEP:
                self._do_step()
            else:
                self.play(self._buttons.value == PLAY)

        @self._slider.on_update
        def _(event: Any) -> None:
            if event.client is None:  # set by this program
                return
            number = int(self._slider.value)
            with self._lock:
                self._position, self._following = float(number), self._running and number >= self._last
            self._wake.set()

        @speed.on_update
        def _(event: Any) -> None:
            self.per_s = math.inf if speed.value == SPEEDS[-1] else float(speed.value)
            self._on_speed(self.per_s)

        @self._rays.on_update
        def _(event: Any) -> None:
            self._shown = -1
            self._wake.set()

        @self._export.on_click
        def _(event: Any) -> None:
            if event.client is not None:
                self._send(event.client)

        @walls.on_update
        def _(event: Any) -> None:
            for building in self.buildings:
                building.cut_walls(walls.value)

    def play(self, playing: bool) -> None:
        """Play, or pause."""
        with self._lock:
            if playing and not self._running and self._position >= self._last:
                self._position = 0.0  # from the beginning
            self._playing = playing
            self._following = playing and self._running and self._position >= self._last
        self._on_play(playing)
        self._wake.set()

    def _do_step(self) -> None:
        self.play(False)
        with self._lock:
            if self._position < self._last:
                self._position = math.floor(self._position) + 1.0
            elif self._running:
                self._following = True
                self._on_step()
        self._wake.set()

    def _send(self, client: Any) -> None:
        """Export the recordings, and send the page to a window."""
        with self._lock:
            recordings = [view.recording for view in self._views if len(view.recording)]
        if not recordings:
            return
        self.say("Writing the page, which takes some seconds ...")
        name = "-".join(re.sub(r"\W+", "-", recording.title) for recording in recordings)
        page = export_page(recordings).encode()
        client.send_file_download(f"robosim-{name[:60]}.html", page, save_immediately=True)
        self.say("")

    @property
    def _last(self) -> int:
        """Number of the last step of the longest recording."""
        return max((len(robot) for robot in self._robots()), default=0) - 1

    def _robots(self) -> list[Recording]:
        """The robots of all searches."""
        return [robot for view in self._views for robot in view.recording.robots]

    @property
    def _running(self) -> bool:
        return any(not view.recording.ended for view in self._views)

    def _run(self) -> None:
        before = perf_counter()
        while not self._closed:
            self._wake.wait(1 / MOST_FPS if self._playing else None)
            self._wake.clear()
            now = perf_counter()
            try:
                self._draw(now - before)
            except Exception:  # an error in one step must not end the thread
                logger.exception("a step could not be drawn")
            before = now
            rest = 1 / MOST_FPS - (perf_counter() - now)
            if rest > 0:
                threading.Event().wait(rest)

    def _draw(self, passed_s: float) -> None:
        with self._lock:
            if not self._views or self._last < 0:
                return
            last = self._last
            if self._following:
                self._position = float(last)
                self._following = self._running
            elif self._playing:
                self._position = min(self._position + passed_s * min(self.per_s, 4 * MOST_FPS), float(last))
                self._following = self._running and self._position >= last
            number = int(self._position)
            # The end of a search comes without a step, and is drawn as well.
            stamp = sum(len(robot) + bool(robot.ended) for robot in self._robots())
            if not self._visible or (number == self._shown and stamp == self._stamp):
                return
            shown = []
            for view, stroke in zip(self._views, STROKES, strict=False):
                steps, mates = view.show(number, rays=self._rays.value), view.recording.mates
                for k, (robot, step) in enumerate(zip(view.recording.robots, steps, strict=False)):
                    shown.append((robot, step, css(robot_colour(k)) if mates else stroke))
            self._shown, self._stamp = number, stamp
        self._describe(number, last, shown)

    def _describe(self, number: int, last: int, shown: list[tuple[Recording, Step, str]]) -> None:
        """Show pictures, facts and time lines of robots, each with its step and its colour."""
        if int(self._slider.max) != max(last, 1):
            self._slider.max = max(last, 1)
        if int(self._slider.value) != number:
            self._slider.value = number
        pictures = [camera_picture(step) for _, step, _ in shown if step.sensed.rgb.size]
        if not pictures:
            self._camera.content = ""
        elif len({camera_image.shape for camera_image in pictures}) == 1:
            self._camera.content = picture(np.vstack(pictures), "camera, and depth (dark: far, black: none)")
        self._numbers.content = "".join(
            step_facts(recording, step, stroke if len(shown) > 1 else "") for recording, step, stroke in shown
        )
        self._draw_time_lines(number, {recording: stroke for recording, _, stroke in shown})

    def _draw_time_lines(self, number: int, recordings: Mapping[Recording, str]) -> None:
        """Charts of SNR, link state and position error up to a step, each robot in its colour."""
        if not recordings:
            return
        rows = [recording.time_lines()[: number + 1] for recording in recordings]
        count = max(len(row) for row in rows)
        x = np.arange(count, dtype=float)
        padded = [np.vstack([row, np.full((count - len(row), row.shape[1]), np.nan)]) for row in rows]
        data = [(x, *(row[:, k] for row in padded)) for k in range(len(_TIME_LINES))]
        if self._charts and len(self._charts[0].series) == len(recordings) + 1:
            for chart, values in zip(self._charts, data, strict=True):
                chart.data = values
            return
        for chart in self._charts:
            chart.remove()
        self._charts = []
        series: list[Any] = [{"label": "decision"}]
        series += [
            {"label": recording.robot or recording.title, "stroke": stroke, "width": 2}
            for recording, stroke in recordings.items()
        ]
        for title, values in zip(_TIME_LINES, data, strict=True):
            scales: dict[str, Any] = {"x": {"time": False}}
            if "link state" in title:
                scales["y"] = {"auto": False, "min": -0.2, "max": 3.2}
            options: dict[str, Any] = {"scales": scales, "legend": {"show": False}, "height": 130}
            with self._charts_folder:
                chart = self._server.gui.add_uplot(values, tuple(series), title=title, **options)
            self._charts.append(chart)
