"""The page's tables and legends as HTML; every number with its unit."""

import base64
import math
from collections.abc import Sequence
from html import escape

import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.live.scene_colours import (
    ESTIMATED_ARRIVAL,
    POWER_DBM,
    ROBOT_COLOUR,
    TRUE_ARRIVAL,
    TX_COLOUR,
    TableName,
    gradient,
)
from robosim.radio.measurement import Measurement
from robosim.recording.rerun_recording import RAY_COLOURS, ray_kind
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, Colour, css
from slam.poses import wrap
from wireless.paths import Interaction, LinkCategory, LinkState, Paths
from wireless.support.counting import counted

#: Most rows of a table of paths.
ROWS = 8
#: Elevations below this are not listed [rad]: all paths run level.
LEVEL_RAD = 1e-3
#: Colour of bad news.
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
    """What stands above all else in the panel; the title of the browser's tab is taken from it."""
    return block(
        f'<span data-page="{escape(title)}">{escape(about)}</span><div style="color:{_BAD}" data-dropped></div>'
    )


def path_table(paths: Paths, tx_power_dbm: float) -> str:
    """The paths of a link, the strongest first."""
    if not len(paths):
        return block("<b>No path</b>: nothing arrives.")
    power, delay = tx_power_dbm + paths.power_db, 1e9 * paths.delay_s
    level = bool((np.abs([paths.aoa_el, paths.aod_el]) < LEVEL_RAD).all())
    rows = []
    for i in range(min(len(paths), ROWS)):
        kind = ray_kind(paths.interaction[i])
        letters = (
            " ".join(Interaction(int(k)).name[0] for k in paths.interaction[i, : paths.order[i]]) or "direct"
        )
        angles = [paths.aoa_az[i], paths.aod_az[i]] if level else [
            paths.aoa_az[i], paths.aoa_el[i], paths.aod_az[i], paths.aod_el[i]
        ]  # fmt: skip
        cells = "".join(
            f"<td>{cell}</td>" for cell in (f"{power[i]:.1f}", f"{delay[i]:.2f}", *map(_deg, angles))
        )
        rows.append(f"<tr><td>{_dot(RAY_COLOURS[kind])}{letters}</td>{cells}</tr>")
    more = f", of which {ROWS} are listed" if len(paths) > ROWS else ""
    angles_of = ("AoA [°]", "AoD [°]") if level else ("AoA az [°]", "el [°]", "AoD az [°]", "el [°]")
    heads = ("way", "power [dBm]", "delay [ns]", *angles_of)
    return block(f"<b>{_paths(len(paths))}</b>, the strongest first{more}{_table(heads, rows)}")


def _paths(count: int) -> str:
    return counted(count, "path")


def state_bars(measurement: Measurement, true_state: LinkState) -> str:
    """Probability of each link state, and which one is true."""
    rows = []
    for state in LinkState:
        share = float(measurement.probability[state])
        bar = f'<span class="bar" style="width:{100 * share:.0f}px;background:{css(STATE_COLOURS[state])}"></span>'
        true = " ← true" if state == true_state else ""
        rows.append(
            f'<tr><td>{STATE_NAMES[state]}{true}</td><td style="width:105px;text-align:left">{bar}</td>'
            f"<td>{100 * share:.1f} %</td></tr>"
        )
    return _table(("link state", "", "probability"), rows)


def arrival_table(measurement: Measurement, paths: Paths) -> str:
    """Estimated arrivals, each with how far it is from the nearest true one, the likely state and the SNR."""
    true_state = LinkState(int(paths.link_state()[0, 0]))
    bars = state_bars(measurement, true_state)
    if not len(measurement.snr_db):
        return block(f"{bars}<b>SNR</b>: none, as no path was found in the noise.")
    rows = []
    for i in range(min(len(measurement.snr_db), ROWS)):
        errors = arrival_errors_deg(measurement, paths, i)
        cells = (
            f"{measurement.snr_db[i]:.1f}", _deg(measurement.aoa_rad[i]), errors[0], _deg(measurement.aod_rad[i]),
            errors[1],
        )  # fmt: skip
        told = [
            cell if isinstance(cell, str) else "–" if math.isnan(cell) else f"{cell:.1f}" for cell in cells
        ]
        rows.append(f"<tr><td>{i + 1}</td>{''.join(f'<td>{cell}</td>' for cell in told)}</tr>")
    heads = ("rank", "SNR [dB]", "AoA [°]", "error [°]", "AoD [°]", "error [°]")
    first = f"<b>SNR {measurement.snr_db[0]:.1f} dB</b> of the strongest estimated path"
    return block(f"{bars}{first}{_table(heads, rows)}")


def arrival_errors_deg(measurement: Measurement, paths: Paths, i: int) -> tuple[float, float]:
    """How far the i-th estimated path is from the true one that arrives nearest to it, in arrival and departure.

    Returns:
        Differences of azimuths, 0 to 180 [degrees]; NaN without a true path.
    """
    if not len(paths):
        return math.nan, math.nan
    arrival = np.degrees(np.abs(wrap(paths.aoa_az - measurement.aoa_rad[i])))
    nearest = int(np.argmin(arrival))
    departure = np.degrees(np.abs(wrap(float(paths.aod_az[nearest] - measurement.aod_rad[i]))))
    return float(arrival[nearest]), float(departure)


def radio_legend(coloured_by: str, *, estimates: bool = True) -> str:
    """What is what while a building is explored.

    Args:
        coloured_by: What rays are coloured by, power or kind.
        estimates: Whether estimated arrivals are drawn.
    """
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


def field_legend(what: str) -> str:
    """What the colours of the floor mean."""
    if what == "received power":
        return block(
            _scale("floor: power of the strongest path [dBm]", "cividis", [f"{v:g}" for v in POWER_DBM])
        )
    if what == "link state":
        return block("".join(_item(_dot(STATE_COLOURS[s]), STATE_NAMES[s]) for s in LinkCategory))
    if what == "direction of arrival":
        return block(
            _scale("floor: azimuth of the strongest arrival [° from +x]", "twilight", ["-180", "0", "180"])
        )
    return ""


def search_legend() -> str:
    """What is what while a search is watched."""
    from robosim.drawing.plan_view import ESTIMATE_ORANGE, OBSTACLE_BLACK, PATH_PURPLE, TARGET_RED, TRUE_GREEN

    items = [
        _item(_line(TRUE_GREEN), "true way"),
        _item(_line(ESTIMATE_ORANGE), "way as estimated"),
        _item(_line(PATH_PURPLE), "goal and planned way"),
        _item(_dot(TARGET_RED), "target; red floor: where it may be"),
        _item(_dot(OBSTACLE_BLACK), "obstacle on the robot's map"),
        _item(_dot((255, 243, 176)), "floor that the map anticipates"),
        _item(_dot((110, 115, 140)), "anticipated obstacle"),
    ]
    states = "".join(_item(_line(STATE_COLOURS[s]), STATE_NAMES[s]) for s in LinkState)
    return block(
        "".join(items)
        + "<br><b>Arrows at the robot</b>, where paths seem to come from, by link state: "
        + states
    )


def lines(pairs: Sequence[tuple[str, str]]) -> str:
    """Names and values below each other."""
    rows = [f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in pairs]
    return block(f"<table>{''.join(rows)}</table>")


def sentence(text: str, *, bad: bool = False) -> str:
    """One line of text; red if it is bad news."""
    colour = f' style="color:{_BAD}"' if bad else ""
    return block(f"<span{colour}>{escape(text)}</span>")


def picture(rgb: UInt8[np.ndarray, "h w 3"], title: str) -> str:
    """A picture as part of the text: the page drops one of its own before a browser has read it, if another follows."""
    _, content = cv2.imencode(".jpg", np.ascontiguousarray(rgb[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 80])
    data = base64.b64encode(content.tobytes()).decode()
    style = "width:100%;image-rendering:auto;display:block"
    return block(
        f'{escape(title)}<img alt="{escape(title)}" style="{style}" src="data:image/jpeg;base64,{data}">'
    )


def _table(heads: Sequence[str], rows: Sequence[str]) -> str:
    head = "".join(f"<th>{name}</th>" for name in heads)
    return f'<div class="wide"><table><tr>{head}</tr>{"".join(rows)}</table></div>'


def _scale(title: str, table: TableName, ends: Sequence[str]) -> str:
    marks = "".join(f"<span>{end}</span>" for end in ends)
    bar = f'<div class="scale" style="background:{gradient(table)}"></div>'
    return f'<div>{title}</div>{bar}<div class="ends">{marks}</div>'


def _item(sign: str, text: str) -> str:
    return f'<span class="item">{sign}{text}</span>'


def _dot(colour: Colour) -> str:
    return f'<span class="dot" style="background:{css(colour)};border:1px solid #888"></span>'


def _line(colour: Colour) -> str:
    return f'<span class="key" style="background:{css(colour)}"></span>'


def _deg(angle_rad: float) -> str:
    return f"{math.degrees(float(wrap(float(angle_rad)))):.1f}"
