"""Plays recordings of searches side by side, as they grow or from the beginning.

One thread draws at most ten times per second and skips steps that come faster: a search never waits for a page.
"""

import logging
import math
import re
import threading
from collections import deque
from collections.abc import Callable, Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.live.building_scene import Scenery
from robosim.live.page_export import exported
from robosim.live.page_html import picture, search_legend, sentence
from robosim.live.recording import Recording
from robosim.live.search_view import WALLS_M, SearchView
from robosim.live.step_facts import STROKES, TimeLines, camera_picture, step_facts
from robosim.step import Step

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
#: Most pictures per second.
MOST_FPS = 10.0
#: Speeds to choose from [decisions per second].
SPEEDS = ("1", "2", "5", "10", "20", "as fast as it goes")
#: Labels of buttons.
PLAY, PAUSE, STEP = "Play", "Pause", "Step"


class Player:
    """Controls, facts and time lines in a tab of the page; the searches in its scene."""

    def __init__(
        self,
        server: "viser.ViserServer",
        root: str,
        *,
        on_play: Callable[[bool], None] = lambda playing: None,
        on_step: Callable[[], None] = lambda: None,
        on_speed: Callable[[float], None] = lambda per_s: None,
    ) -> None:
        """Fill the current part of the panel.

        Args:
            server: The page.
            root: Name of the frame below which searches are drawn.
            on_play: Called with whether searches that run are to go on.
            on_step: Called to make one more step of them.
            on_speed: Called with the wanted decisions per second; infinite for as many as possible.
        """
        self._server, self._root = server, root
        self._on_play, self._on_step, self._on_speed = on_play, on_step, on_speed
        self._lock, self._wake = threading.RLock(), threading.Event()
        self._views: list[SearchView] = []
        self._at, self._shown, self._stamp = 0.0, -1, -1
        self._playing, self._following, self._closed = False, False, False
        self._visible, self._times = True, deque[float](maxlen=50)
        self.per_s = math.inf
        self._fill(server.gui)
        self._thread = threading.Thread(target=self._run, name=f"player {root}", daemon=True)
        self._thread.start()

    @property
    def fps(self) -> float:
        """Pictures drawn per second, over the last ones."""
        times = list(self._times)
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0

    @property
    def shown(self) -> int:
        """Number of the step that is drawn; -1 before the first."""
        return self._shown

    @property
    def sceneries(self) -> list[Scenery]:
        """Buildings of all searches."""
        with self._lock:
            return [view.scenery for view in self._views]

    def load(self, recordings: Sequence[Recording], *, playing: bool, following: bool) -> None:
        """Replace the recordings.

        Args:
            recordings: One or two.
            playing: Whether to play.
            following: Whether to show the latest step as it comes.
        """
        with self._lock:
            self.clear()
            offset = 0.0
            for k, recording in enumerate(recordings):
                # The panel shows the rest, for which a phone's scene has no room.
                view = SearchView(self._server, f"{self._root}/{k}", recording, (offset, 0.0), brief=True)
                view.scenery.show(self._visible)
                self._views.append(view)
                offset += 1.15 * float(view.scenery.size[0]) + 1.0
            self._at, self._shown, self._stamp = 0.0, -1, -1
            self._playing, self._following = playing, following
            self._controls(True)
        self._wake.set()

    def clear(self) -> None:
        """Show nothing."""
        with self._lock:
            for view in self._views:
                view.scenery.remove()
            self._views.clear()
            self._controls(False)

    def show(self, visible: bool) -> None:
        """Show or hide the searches."""
        with self._lock:
            self._visible = visible
            for view in self._views:
                view.scenery.show(visible)
            self._shown = -1
        self._wake.set()

    def update(self) -> None:
        """Draw what recordings have gained."""
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
        speed = gui.add_dropdown("decisions a second", SPEEDS, initial_value=SPEEDS[-1])
        self._camera = gui.add_html("")
        self._numbers = gui.add_html("")
        self._time_lines = TimeLines(gui)
        gui.add_html(search_legend())
        self._rays = gui.add_checkbox("true rays of the 8 strongest paths", True)
        self._export = gui.add_button("Save as a page that plays by itself (.html)", disabled=True)
        walls = gui.add_slider("walls up to [m]", 0.0, 2.5, 0.1, WALLS_M)

        @self._buttons.on_click
        def _(event: Any) -> None:
            if self._buttons.value == STEP:
                self._do_step()
            else:
                self.play(self._buttons.value == PLAY)

        @self._slider.on_update
        def _(event: Any) -> None:
            if event.client is not None:  # by a person, not by this program
                self._scrub(int(self._slider.value))

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
            for scenery in self.sceneries:
                scenery.cut_walls(walls.value)

    def _controls(self, usable: bool) -> None:
        self._slider.disabled = self._export.disabled = not usable

    def play(self, playing: bool) -> None:
        """Play, or pause."""
        with self._lock:
            if playing and not self._running and self._at >= self._last:
                self._at = 0.0  # from the beginning
            self._playing = playing
            self._following = playing and self._running and self._at >= self._last
        self._on_play(playing)
        self._wake.set()

    def _do_step(self) -> None:
        self.play(False)
        with self._lock:
            if self._at < self._last:
                self._at = math.floor(self._at) + 1.0
            elif self._running:
                self._following = True
                self._on_step()
        self._wake.set()

    def _scrub(self, i: int) -> None:
        with self._lock:
            self._at, self._following = float(i), self._running and i >= self._last
        self._wake.set()

    def _send(self, client: Any) -> None:
        """Export what is shown, and send it to a window."""
        with self._lock:
            recordings = [view.recording for view in self._views if len(view.recording)]
        if not recordings:
            return
        self.say("Writing the page, which takes some seconds ...")
        name = "-".join(re.sub(r"\W+", "-", recording.title) for recording in recordings)
        client.send_file_download(
            f"robosim-{name[:60]}.html", exported(recordings).encode(), save_immediately=True
        )
        self.say("")

    @property
    def _last(self) -> int:
        """Number of the last step of the longest recording."""
        return max((len(view.recording) for view in self._views), default=0) - 1

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
            except Exception:  # one bad picture must not end the thread
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
                self._at = float(last)
                self._following = self._running
            elif self._playing:
                self._at = min(self._at + passed_s * min(self.per_s, 4 * MOST_FPS), float(last))
                self._following = self._running and self._at >= last
            i = int(self._at)
            # The end of a search is drawn too, though no step comes with it.
            stamp = sum(len(view.recording) + bool(view.recording.ended) for view in self._views)
            if not self._visible or (i == self._shown and stamp == self._stamp):
                return
            steps = [view.show(i, rays=self._rays.value) for view in self._views]
            self._shown, self._stamp = i, stamp
            recordings = [view.recording for view in self._views]
        self._times.append(perf_counter())
        self._describe(i, last, recordings, steps)

    def _describe(self, i: int, last: int, recordings: list[Recording], steps: list[Step | None]) -> None:
        if int(self._slider.max) != max(last, 1):
            self._slider.max = max(last, 1)
        if int(self._slider.value) != i:
            self._slider.value = i
        pictures = [camera_picture(step) for step in steps if step is not None and step.sensed.rgb.size]
        if not pictures:
            self._camera.content = ""
        elif len({one.shape for one in pictures}) == 1:
            self._camera.content = picture(np.vstack(pictures), "camera, and depth (dark: far, black: none)")
        self._numbers.content = "".join(
            step_facts(recording, step, stroke if len(recordings) > 1 else "")
            for recording, step, stroke in zip(recordings, steps, STROKES, strict=False)
            if step is not None
        )
        self._time_lines.show(recordings, i)
