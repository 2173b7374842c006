"""Shows recordings of searches side by side: as they grow, or played, stepped and scrubbed through.

One thread draws, some ten times a second at most, and skips what comes faster: a search never waits for a page.
"""

import logging
import math
import re
import threading
from collections import deque
from collections.abc import Callable, Sequence
from html import escape
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, UInt8

from robosim.live.export import exported
from robosim.live.recording import Recording
from robosim.live.scenery import Scenery
from robosim.live.search_view import WALLS_M, SearchView
from robosim.live.tables import block, lines, picture, search_legend, sentence
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, css
from wireless.paths import LinkState

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)
#: Pictures a second, at most.
MOST_FPS = 10.0
#: Speeds that are offered [decisions a second].
SPEEDS = ("1", "2", "5", "10", "20", "as fast as it goes")
#: What one can press.
PLAY, PAUSE, STEP = "Play", "Pause", "Step"
#: Depth that is drawn black [m].
_FAR_M = 6.0
#: Colours of the first and the second search in time lines.
_STROKES = ("#0072b2", "#d55e00")


class Player:
    """Controls, numbers and time lines in a tab of the page; the searches in its space."""

    def __init__(
        self,
        server: "viser.ViserServer",
        root: str,
        *,
        on_play: Callable[[bool], None] = lambda playing: None,
        on_step: Callable[[], None] = lambda: None,
        on_speed: Callable[[float], None] = lambda per_s: None,
    ) -> None:
        """Fill the current container of the page.

        Args:
            server: The page.
            root: Name of the frame below which searches are drawn.
            on_play: Is told whether to go on where the recordings end.
            on_step: Is told to make one more decision there.
            on_speed: Is told of decisions wanted a second; infinite for all that can be made.
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
        """Pictures drawn a second, over the last ones."""
        times = list(self._times)
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0

    @property
    def shown(self) -> int:
        """Number of the decision that is drawn; -1 before the first."""
        return self._shown

    @property
    def scenery(self) -> Scenery | None:
        """Of the first search."""
        with self._lock:
            return self._views[0].scenery if self._views else None

    @property
    def sceneries(self) -> list[Scenery]:
        """Of all searches."""
        with self._lock:
            return [view.scenery for view in self._views]

    def load(self, recordings: Sequence[Recording], *, playing: bool, following: bool) -> None:
        """Show other recordings side by side.

        Args:
            recordings: One or two.
            playing: Whether to go on by itself.
            following: Whether to show the last moment, as it comes.
        """
        with self._lock:
            self.clear()
            offset = 0.0
            for k, recording in enumerate(recordings):
                # The panel tells the rest, for which a phone's space has no room.
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
        """Show or hide what is drawn in the page's space."""
        with self._lock:
            self._visible = visible
            for view in self._views:
                view.scenery.show(visible)
            self._shown = -1
        self._wake.set()

    def arrived(self) -> None:
        """Look whether recordings have grown."""
        self._wake.set()

    def say(self, text: str, *, bad: bool = False) -> None:
        """Tell something above the controls; nothing if there is nothing to tell."""
        self._status.content = sentence(text, bad=bad) if text else ""

    def close(self) -> None:
        """End the thread that draws."""
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
        self._charts = Charts(gui)
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
            if event.client is not None:  # a person's, not our own
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
        """Go on, or stay where it is."""
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
        """Export what is shown, and send it to who asked for it."""
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
        """Number of the last moment of the longest recording."""
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
            except Exception:  # one bad picture shall not end all that follow
                logger.exception("a moment could not be drawn")
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
            # That a search has ended is told too, though no decision came with it.
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
        pictures = [_camera(step) for step in steps if step is not None and step.sensed.rgb.size]
        if not pictures:
            self._camera.content = ""
        elif len({one.shape for one in pictures}) == 1:
            self._camera.content = picture(np.vstack(pictures), "camera, and depth (dark: far, black: none)")
        self._numbers.content = "".join(
            _numbers(recording, step, i, stroke if len(recordings) > 1 else "")
            for recording, step, stroke in zip(recordings, steps, _STROKES, strict=False)
            if step is not None
        )
        self._charts.show(recordings, i)


class Charts:
    """Time lines of SNR, link state and error of the pose."""

    def __init__(self, gui: Any) -> None:
        self._gui, self._folder = gui, gui.add_folder("Time lines", expand_by_default=True)
        self._made: list[Any] = []

    def show(self, recordings: Sequence[Recording], i: int) -> None:
        """Draw them up to a decision."""
        rows = [recording.time_lines()[: i + 1] for recording in recordings]
        count = max(len(row) for row in rows)
        x = np.arange(count, dtype=float)
        columns = [np.vstack([row, np.full((count - len(row), 4), np.nan)]) for row in rows]
        data = [
            (x, *(c[:, 0] for c in columns)),
            (x, *(c[:, 1] for c in columns)),
            (x, *(c[:, 3] for c in columns)),
        ]
        if len(self._made) != 3 or len(self._made[0].series) != len(recordings) + 1:
            self._make(recordings, data)
            return
        for chart, values in zip(self._made, data, strict=True):
            chart.data = values

    def _make(self, recordings: Sequence[Recording], data: Sequence[tuple[np.ndarray, ...]]) -> None:
        for chart in self._made:
            chart.remove()
        titles = ("SNR of the strongest path [dB]", "link state as believed (0 outage, 1 LOS, 2, 3 NLOS)",
                  "position error [cm]")  # fmt: skip
        with self._folder:
            self._made = [
                self._chart(title, values, recordings) for title, values in zip(titles, data, strict=True)
            ]

    def _chart(self, title: str, values: tuple[np.ndarray, ...], recordings: Sequence[Recording]) -> Any:
        series: list[dict[str, Any]] = [{"label": "decision"}]
        series += [
            {"label": recording.title, "stroke": stroke, "width": 2}
            for recording, stroke in zip(recordings, _STROKES, strict=False)
        ]
        scales: dict[str, Any] = {"x": {"time": False}}
        if title.startswith("link"):
            scales["y"] = {"auto": False, "min": -0.2, "max": 3.2}
        return self._gui.add_uplot(
            values, tuple(series), title=title, scales=scales, legend={"show": False}, height=130
        )


def _numbers(recording: Recording, step: Step, i: int, stroke: str) -> str:
    """Facts of a step, below the camera."""
    measured, true = step.estimated.measurement, step.true
    pairs = [("link state, estimated", "no radio" if measured is None else STATE_NAMES[measured.state])]
    if true.link_state is not None:
        pairs.append(("link state, true", STATE_NAMES[true.link_state]))
    if not math.isnan(step.snr_db):
        pairs.append(("SNR of the strongest path", f"{step.snr_db:.1f} dB"))
    if recording.target is not None:
        gap_m = float(np.hypot(*(true.pose[:2] - recording.target)))
        pairs.append(("distance to the target", f"{gap_m:.1f} m"))
    heading_deg = math.degrees(step.heading_error_rad)
    pairs.append(("pose error", f"{100 * step.position_error_m:.0f} cm, {heading_deg:.1f}°"))
    pairs.append(("floor seen", f"{100 * true.coverage:.0f} %"))
    if recording.ended and i >= len(recording) - 1:
        pairs.append(("ended", recording.ended))
    bars = "" if measured is None else _probabilities(measured.probability)
    key = f'<span class="key" style="background:{stroke}"></span>' if stroke else ""
    return block(f"{key}<b>{escape(recording.title)}</b>{bars}") + lines(pairs) + _why(step)


def _why(step: Step) -> str:
    """What the goal is, and why it was chosen."""
    reason, far = step.decided.reason, step.actions_to_goal
    if not reason.because:
        return ""
    away = "" if math.isnan(far) else f", {far:.0f} decisions away"
    sure = "" if math.isnan(reason.mass) else f" Belief within 0.5 m of its peak: {100 * reason.mass:.0f} %."
    return block(f"<b>Goal</b>: {escape(reason.kind.value)}{away}.<br>Why: {escape(reason.because)}.{sure}")


def _probabilities(probability: Float[np.ndarray, "4"]) -> str:
    """The probability of each link state as one bar of four parts."""
    parts = "".join(
        f'<span style="display:inline-block;height:.9em;width:{100 * p:.1f}%;background:{css(STATE_COLOURS[s])}"'
        f' title="{STATE_NAMES[s]} {100 * p:.0f} %"></span>'
        for s, p in zip(LinkState, probability, strict=True)
    )
    return f'<div style="width:100%;white-space:nowrap;font-size:0.9em">{parts}</div>'


def _camera(step: Step) -> UInt8[np.ndarray, "h w 3"]:
    """The camera's picture, next to its depth."""
    depth = step.sensed.depth
    grey = np.where(depth > 0, np.clip(255 * (1 - depth / _FAR_M), 0, 255), 0).astype(np.uint8)
    return np.hstack([step.sensed.rgb, np.repeat(grey[..., None], 3, axis=2)])
