"""Tables, facts and legends of the page as HTML; each number with its unit."""

import base64
import math
from collections.abc import Sequence
from html import escape

import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.drawing.plan_view import ESTIMATE_ORANGE, OBSTACLE_BLACK, PATH_PURPLE, TARGET_RED, TRUE_GREEN
from robosim.live.recordings import Recording
from robosim.live.scene_nodes import (
    ESTIMATED_ARRIVAL,
    POWER_DBM,
    RAY_COLOURS,
    ROBOT_COLOUR,
    TRUE_ARRIVAL,
    TX_COLOUR,
    TableName,
    gradient,
    ray_kind,
)
from robosim.radio.measurement import Measurement
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, Colour, css, robot_colour
from slam.poses import wrap
from wireless.paths import Interaction, LinkCategory, LinkState, Paths
from wireless.support.counting import counted

#: Largest number of rows of a table of paths.
ROWS = 8
#: Elevations are listed only if one is larger [rad].
LEVEL_RAD = 1e-3
#: Depth that is drawn black [m].
_FAR_M = 6.0
#: Colour of errors.
_BAD = "#b3261e"
_STYLE = (
    "<style>.rs{font:12px/1.35 system-ui,sans-serif;margin:0 .75em .4em;color:inherit}"
    ".rs table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}"
    ".rs th{font-weight:600;text-align:right;border-bottom:1px solid #999;padding:1px 3px;white-space:nowrap}"
    ".rs td{text-align:right;padding:1px 3px;white-space:nowrap}"
    ".rs th:first-child,.rs td:first-child{text-align:left}"
    ".rs .bar{display:inline-block;height:.75em;vertical-align:-.05em}"
    ".rs .key{display:inline-block;width:1.5em;height:.3em;margin:0 .4em .2em 0;vertical-align:middle}"
    ".rs .dot{display:inline-block;width:.75em;height:.75em;border-radius:50%;margin:0 .4em 0 0;vertical-align:-.05em}"
    ".rs .item{display:inline-block;margin-right:1em;white-space:nowrap}"
    ".rs .scale{height:.8em;margin:.2em 0 0}.rs .ends{display:flex;justify-content:space-between}"
    ".rs .heads th{white-space:normal;vertical-align:bottom}.rs .heads th,.rs .heads td{padding:1px 2px}"
    ".rs .wide{overflow-x:auto}.rs b{font-weight:600}</style>"
)


def block(content: str) -> str:
    """HTML in the page's style."""
    return f'{_STYLE}<div class="rs">{content}</div>'


def page_head(title: str, about: str) -> str:
    """Head of the panel, from which the browser's tab takes its title."""
    return block(
        f'<span data-page="{escape(title)}">{escape(about)}</span><div style="color:{_BAD}" data-dropped></div>'
    )


def sentence(text: str, *, bad: bool = False) -> str:
    """Return a line of text; red if it reports an error."""
    colour = f' style="color:{_BAD}"' if bad else ""
    return block(f"<span{colour}>{escape(text)}</span>")


def picture(rgb: UInt8[np.ndarray, "h w 3"], title: str) -> str:
    """A picture as a part of the text: viser drops a picture if another follows before a browser has read it."""
    _, content = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 80])
    data = base64.b64encode(content.tobytes()).decode()
    style = "width:100%;image-rendering:auto;display:block"
    return block(
        f'{escape(title)}<img alt="{escape(title)}" style="{style}" src="data:image/jpeg;base64,{data}">'
    )


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of HTML cells; a row's first entry may be its own opening tag, `<tr ...>`."""
    head = "".join(f"<th>{name}</th>" for name in heads)
    body = ""
    for row in rows:
        opening, cells = (row[0], row[1:]) if row[0].startswith("<tr") else ("<tr>", row)
        body += f"{opening}{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"
    return f"<table>{f'<tr>{head}</tr>' if heads else ''}{body}</table>"


def path_table(paths: Paths, tx_power_dbm: float) -> str:
    """The paths of a link, the strongest first."""
    if not len(paths):
        return block("<b>No path</b>: no power is received.")
    is_level = bool((np.abs([paths.aoa_el, paths.aod_el]) < LEVEL_RAD).all())
    rows = []
    for i in range(min(len(paths), ROWS)):
        letters = (
            " ".join(Interaction(int(k)).name[0] for k in paths.interaction[i, : paths.order[i]]) or "direct"
        )
        angles = (
            (paths.aoa_az[i], paths.aod_az[i])
            if is_level
            else (paths.aoa_az[i], paths.aoa_el[i], paths.aod_az[i], paths.aod_el[i])
        )
        rows.append((
            _dot(RAY_COLOURS[ray_kind(paths.interaction[i])]) + letters,
            f"{tx_power_dbm + paths.power_db[i]:.1f}",
            f"{1e9 * paths.delay_s[i]:.2f}",
            *map(_degrees, angles),
        ))  # fmt: skip
    more = f", of which {ROWS} are listed" if len(paths) > ROWS else ""
    angle_heads = ("AoA [°]", "AoD [°]") if is_level else ("AoA az [°]", "el [°]", "AoD az [°]", "el [°]")
    heads = ("path", "power [dBm]", "delay [ns]", *angle_heads)
    listed = _wide(table(heads, rows))
    return block(f"<b>{counted(len(paths), 'path')}</b>, the strongest first{more}{listed}")


def arrival_table(measurement: Measurement, paths: Paths) -> str:
    """Probabilities of link states, the SNR, and estimated paths with their errors."""
    true_state = LinkState(int(paths.link_state()[0, 0]))
    rows = []
    for state in LinkState:
        share = float(measurement.probability[state])
        style = f"width:{100 * share:.0f}px;background:{css(STATE_COLOURS[state])}"
        bar = f'<div style="width:105px;text-align:left"><span class="bar" style="{style}"></span></div>'
        true = " ← true" if state == true_state else ""
        rows.append((STATE_NAMES[state] + true, bar, f"{100 * share:.1f} %"))
    states = _wide(table(("link state", "", "probability"), rows))
    if not len(measurement.snr_db):
        return block(f"{states}<b>SNR</b>: none, since no path was found in the noise.")
    estimates = []
    for i in range(min(len(measurement.snr_db), ROWS)):
        aoa, aod = measurement.aoa_rad[i], measurement.aod_rad[i]
        errors = [
            "–" if math.isnan(error) else f"{error:.1f}"
            for error in arrival_errors_deg(measurement, paths, i)
        ]
        estimates.append(
            (str(i + 1), f"{measurement.snr_db[i]:.1f}", _degrees(aoa), errors[0], _degrees(aod), errors[1])
        )
    listed = _wide(table(("rank", "SNR [dB]", "AoA [°]", "error [°]", "AoD [°]", "error [°]"), estimates))
    return block(f"{states}<b>SNR {measurement.snr_db[0]:.1f} dB</b> of the strongest estimated path{listed}")


def arrival_errors_deg(measurement: Measurement, paths: Paths, i: int) -> tuple[float, float]:
    """Errors of an estimated path's azimuths of arrival and departure, 0 to 180; NaN without a true path.

    It is compared with the true path whose arrival is nearest.
    """
    if not len(paths):
        return math.nan, math.nan
    arrival = np.degrees(np.abs(wrap(paths.aoa_az - measurement.aoa_rad[i])))
    nearest = int(np.argmin(arrival))
    departure = np.degrees(np.abs(wrap(float(paths.aod_az[nearest] - measurement.aod_rad[i]))))
    return float(arrival[nearest]), float(departure)


def step_facts(recording: Recording, step: Step, stroke: str) -> str:
    """Facts of a step, with the colour of its search in time lines (empty without), and the reason of its goal."""
    measured, true = step.estimated.measurement, step.true
    facts = [("link state, estimated", "no radio" if measured is None else STATE_NAMES[measured.state])]
    if true.link_state is not None:
        facts.append(("link state, true", STATE_NAMES[true.link_state]))
    if not math.isnan(step.snr_db):
        facts.append(("SNR of the strongest path", f"{step.snr_db:.1f} dB"))
    if recording.target is not None:
        gap_m = float(np.hypot(*(true.pose[:2] - recording.target)))
        facts.append(("distance to the target", f"{gap_m:.1f} m"))
    heading_deg = math.degrees(step.heading_error_rad)
    facts.append(("pose error", f"{100 * step.position_error_m:.0f} cm, {heading_deg:.1f}°"))
    facts.append(("coverage", f"{100 * true.coverage:.0f} %"))
    if recording.ended and step.number >= len(recording) - 1:
        facts.append(("ended", recording.ended))
    key = f'<span class="key" style="background:{stroke}"></span>' if stroke else ""
    bar = ""
    if measured is not None:
        parts = "".join(
            f'<span style="display:inline-block;height:.9em;width:{100 * p:.1f}%;background:{css(STATE_COLOURS[s])}"'
            f' title="{STATE_NAMES[s]} {100 * p:.0f} %"></span>'
            for s, p in zip(LinkState, measured.probability, strict=True)
        )
        bar = f'<div style="width:100%;white-space:nowrap;font-size:0.9em">{parts}</div>'
    rows = table((), [(escape(name), escape(value)) for name, value in facts])
    title = recording.robot or recording.title
    return block(f"{key}<b>{escape(title)}</b>{bar}") + block(rows) + _goal(step)


def _goal(step: Step) -> str:
    """The goal, and why it was chosen."""
    reason, n_actions = step.decided.reason, step.actions_to_goal
    if not reason.because:
        return ""
    far = "" if math.isnan(n_actions) else f", {n_actions:.0f} decisions away"
    mass = "" if math.isnan(reason.mass) else f" Belief within 0.5 m of its peak: {100 * reason.mass:.0f} %."
    return block(f"<b>Goal</b>: {escape(reason.kind.value)}{far}.<br>Why: {escape(reason.because)}.{mass}")


def camera_picture(step: Step) -> UInt8[np.ndarray, "h w 3"]:
    """The camera's picture next to its depth: black is far or unknown."""
    depth = step.sensed.depth
    grey = np.where(depth > 0, np.clip(255 * (1 - depth / _FAR_M), 0, 255), 0).astype(np.uint8)
    return np.hstack([step.sensed.rgb, np.repeat(grey[..., None], 3, axis=2)])


def radio_legend(coloured_by: str, *, estimates: bool = True) -> str:
    """Legend of the tab `Radio`, for rays coloured by power or kind, with or without estimated arrivals."""
    items = [
        _item(_dot(TX_COLOUR), "transmitter (drag it)"),
        _item(_dot(ROBOT_COLOUR), "robot (drag it)"),
        _item(_line(TRUE_ARRIVAL), "true arrival"),
        *([_item(_line(ESTIMATED_ARRIVAL), "estimated arrival")] if estimates else []),
    ]
    if coloured_by == "power":
        rays = _scale("ray: received power [dBm]", "plasma", [f"{v:g}" for v in POWER_DBM])
    else:
        rays = "".join(_item(_line(colour), kind) for kind, colour in RAY_COLOURS.items())
    return block("".join(items) + rays + "<br>R reflection, D diffraction, T through a wall, S scattering")


def map_legend(kind: str) -> str:
    """Legend of a radio map."""
    if kind == "received power":
        scale = _scale("floor: power of the strongest path [dBm]", "cividis", [f"{v:g}" for v in POWER_DBM])
        return block(scale)
    if kind == "link state":
        return block("".join(_item(_dot(STATE_COLOURS[s]), STATE_NAMES[s]) for s in LinkCategory))
    if kind == "direction of arrival":
        title = "floor: azimuth of the strongest arrival [° from +x]"
        return block(_scale(title, "twilight", ["-180", "0", "180"]))
    return ""


def search_legend(robots: Sequence[str] = ()) -> str:
    """Legend of a search by one robot, or by several of these names."""
    alone = [
        _item(_line(TRUE_GREEN), "true trajectory"),
        _item(_line(ESTIMATE_ORANGE), "estimated trajectory"),
        _item(_line(PATH_PURPLE), "goal and planned path"),
    ]
    team = [_item(_line(robot_colour(k)), escape(name)) for k, name in enumerate(robots)]
    items = [
        *(team if len(robots) > 1 else alone),
        _item(_dot(TARGET_RED), "target; on the floor: belief"),
        _item(_dot(OBSTACLE_BLACK), "obstacle on the robot's map"),
        _item(_dot((255, 243, 176)), "anticipated floor"),
        _item(_dot((110, 115, 140)), "anticipated obstacle"),
    ]
    states = "".join(_item(_line(STATE_COLOURS[s]), STATE_NAMES[s]) for s in LinkState)
    return block(
        "".join(items) + "<br><b>Arrows at the robot</b>: estimated arrivals, by link state: " + states
    )


def _wide(content: str) -> str:
    return f'<div class="wide">{content}</div>'


def _scale(title: str, name: TableName, ends: Sequence[str]) -> str:
    marks = "".join(f"<span>{end}</span>" for end in ends)
    bar = f'<div class="scale" style="background:{gradient(name)}"></div>'
    return f'<div>{title}</div>{bar}<div class="ends">{marks}</div>'


def _item(sign: str, text: str) -> str:
    return f'<span class="item">{sign}{text}</span>'


def _dot(colour: Colour) -> str:
    return f'<span class="dot" style="background:{css(colour)};border:1px solid #888"></span>'


def _line(colour: Colour) -> str:
    return f'<span class="key" style="background:{css(colour)}"></span>'


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(float(wrap(float(angle_rad)))):.1f}"
