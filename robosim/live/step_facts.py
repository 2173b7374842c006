"""What the panel shows of a step: facts, the reason for its goal, the camera's picture, and time lines."""

import math
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, UInt8

from robosim.live.page_html import block, lines
from robosim.live.recording import Recording
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, css
from wireless.paths import LinkState

if TYPE_CHECKING:
    import viser

#: Depth that is drawn black [m].
_FAR_M = 6.0
#: Colours of the first and the second search in time lines.
STROKES = ("#0072b2", "#d55e00")
#: Titles of the time lines, as `Recording.time_lines` has them.
_TITLES = (
    "SNR of the strongest path [dB]",
    "estimated link state (0 outage, 1 LOS, 2, 3 NLOS)",
    "position error [cm]",
)


class TimeLines:
    """Charts of SNR, link state and position error in the current part of the panel."""

    def __init__(self, gui: "viser.GuiApi") -> None:
        self._gui, self._folder = gui, gui.add_folder("Time lines", expand_by_default=True)
        self._charts: list[Any] = []

    def show(self, recordings: Sequence[Recording], number: int) -> None:
        """Draw them up to a step."""
        rows = [recording.time_lines()[: number + 1] for recording in recordings]
        count = max(len(row) for row in rows)
        x = np.arange(count, dtype=float)
        columns = [np.vstack([row, np.full((count - len(row), len(_TITLES)), np.nan)]) for row in rows]
        data = [(x, *(column[:, k] for column in columns)) for k in range(len(_TITLES))]
        if self._charts and len(self._charts[0].series) == len(recordings) + 1:
            for chart, values in zip(self._charts, data, strict=True):
                chart.data = values
            return
        for chart in self._charts:
            chart.remove()
        series: list[Any] = [{"label": "decision"}]
        series += [
            {"label": recording.title, "stroke": stroke, "width": 2}
            for recording, stroke in zip(recordings, STROKES, strict=False)
        ]
        self._charts = []
        for title, values in zip(_TITLES, data, strict=True):
            scales: dict[str, Any] = {"x": {"time": False}}
            if "link state" in title:
                scales["y"] = {"auto": False, "min": -0.2, "max": 3.2}
            options: dict[str, Any] = {"scales": scales, "legend": {"show": False}, "height": 130}
            with self._folder:
                self._charts.append(self._gui.add_uplot(values, tuple(series), title=title, **options))


def step_facts(recording: Recording, step: Step, stroke: str) -> str:
    """Facts of a step, with the colour of its search in time lines, if there are two."""
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
    if recording.ended and step.number >= len(recording) - 1:
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


def camera_picture(step: Step) -> UInt8[np.ndarray, "h w 3"]:
    """The camera's picture, next to its depth."""
    depth = step.sensed.depth
    grey = np.where(depth > 0, np.clip(255 * (1 - depth / _FAR_M), 0, 255), 0).astype(np.uint8)
    return np.hstack([step.sensed.rgb, np.repeat(grey[..., None], 3, axis=2)])
