"""Frequency responses of traced links on the subcarriers of OFDM (channel state information), as files and figures.

`csi_txK.npz` holds what `wireless.channel.Channel.cfr` computes between one antenna at each end, or between pairs of
vertical and horizontal ones with both polarisations.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Float

from robosim.drawing.csi_picture import plot_over_time, plot_response
from robosim.support.checks import shown
from robosim.support.files import npz_bytes, write_whole
from wireless.antennas.arrays import Array
from wireless.antennas.elements import ELEMENTS, element_named
from wireless.antennas.mounting import MountedArray
from wireless.channel import Channel, subcarriers
from wireless.motion.impulse_responses import ImpulseResponses
from wireless.paths import Paths

_UNITS = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}
_MOST = 65_536
#: Angles of the ports from the vertical, by the polarisation of the tracer.
_SLANT_RAD = {"vertical": [0.0], "horizontal": [np.pi / 2], "both": [0.0, np.pi / 2]}


@dataclass(frozen=True, kw_only=True, eq=False)
class Csi:
    """Subcarriers, and the antennas between which responses are computed."""

    offset_hz: Float[np.ndarray, " f"]
    """Frequencies from the carrier."""
    tx: MountedArray
    """Antenna of each transmitter, one port for each polarisation."""
    rx: MountedArray
    """Likewise of each receiver."""


def parse_csi(text: str, *, tx_antenna: str, rx_antenna: str, frequency_hz: float, polarisation: str) -> Csi:
    """Subcarriers of a text such as 64x312.5kHz, between antennas of texts such as sector.msi,90,6.

    Raises:
        ValueError: If a text is not understood, or the subcarriers reach down to 0 Hz.
        FileError: If a pattern file is missing or damaged.
    """
    found = re.fullmatch(r"(\d{1,6})x(\d+(?:\.\d+)?)(Hz|kHz|MHz|GHz)", text, re.ASCII)
    count, spacing_hz = (int(found[1]), float(found[2]) * _UNITS[found[3]]) if found else (0, 0.0)
    if not (1 <= count <= _MOST and 0 < count * spacing_hz < 2 * frequency_hz):
        raise ValueError(
            f"csi is {shown(text)}, expected a number of subcarriers (1 to {_MOST}) and their spacing, such as "
            f"64x312.5kHz, within the carrier frequency of {frequency_hz / 1e9:g} GHz to either side."
        )
    slant_rad = np.array(_SLANT_RAD[polarisation])
    return Csi(
        offset_hz=subcarriers(count, spacing_hz),
        tx=_parse_antenna(tx_antenna, "tx_antenna", slant_rad),
        rx=_parse_antenna(rx_antenna, "rx_antenna", slant_rad),
    )


def _parse_antenna(text: str, option: str, slant_rad: Float[np.ndarray, " ports"]) -> MountedArray:
    name, *words = text.split(",")
    try:
        angles = np.radians([float(word) for word in words])
    except ValueError:
        angles = np.array([np.nan])
    if len(angles) > 3 or not np.isfinite(angles).all():
        raise ValueError(
            f"{option} is {shown(text)}, expected an element, or an element and its yaw, pitch (down) and roll "
            "[degrees] with commas and no spaces, such as 3gpp,90,6."
        )
    yaw_rad, pitch_rad, roll_rad = np.append(angles, np.zeros(3 - len(angles))).tolist()
    return MountedArray(
        array=Array(element=element_named(name), position_wl=np.zeros((len(slant_rad), 3))),
        yaw_rad=yaw_rad,
        pitch_rad=pitch_rad,
        roll_rad=roll_rad,
        slant_rad=slant_rad,
        scaling="directivity" if name in ELEMENTS else "given",
    )


def write_link_csi(
    out: Path,
    paths: Paths,
    tx: int,
    csi: Csi,
    *,
    drawn_rx: int | None,
) -> None:
    """Write the responses from one of the transmitters to all receivers, and draw that to one of them if given."""
    mine = paths.select(paths.tx == tx)
    mine = replace(mine, tx_position=paths.tx_position[tx : tx + 1], tx=np.zeros_like(mine.tx))
    response = Channel.from_paths(mine, tx=csi.tx, rx=csi.rx).cfr(csi.offset_hz)[0]
    _write(
        out,
        tx,
        response,
        offset_hz=csi.offset_hz,
        frequency_hz=paths.frequency_hz,
        tx_position_m=paths.tx_position[tx],
        rx_position_m=paths.rx_position,
    )
    if drawn_rx is not None:
        x, y, z = paths.rx_position[drawn_rx]
        plot_response(
            out / f"csi_tx{tx + 1}.png",
            response[drawn_rx],
            csi.offset_hz,
            frequency_hz=paths.frequency_hz,
            title=f"Frequency response, transmitter {tx + 1} to ({x:.2f}, {y:.2f}, {z:.2f}) m",
        )


def write_sampled_csi(
    out: Path,
    samples: ImpulseResponses,
    tx: int,
    csi: Csi,
    frequency_hz: float,
    *,
    plots: bool,
) -> None:
    """Write the responses between isotropic antennas to a receiver that moves, at each time, and draw them."""
    offset_hz, ports = csi.offset_hz, np.rint(csi.rx.slant_rad / (np.pi / 2)).astype(int)
    gain = samples.gain[:, :, ports][..., ports]
    response = np.zeros((len(gain), len(ports), len(ports), len(offset_hz)), complex)
    for i, delay_s in enumerate(np.nan_to_num(samples.delay_s).T):
        response += gain[:, i, :, :, None] * np.exp(-2j * np.pi * np.outer(delay_s, offset_hz))[:, None, None]
    _write(out, tx, response, offset_hz=offset_hz, frequency_hz=frequency_hz, time_s=samples.time_s)
    if plots:
        plot_over_time(
            out / f"csi_tx{tx + 1}.png",
            response[:, 0, 0],
            samples.time_s,
            offset_hz,
            frequency_hz=frequency_hz,
            title=f"Frequency response, transmitter {tx + 1} to the moving receiver",
        )


def _write(
    out: Path, tx: int, response: Complex[np.ndarray, "n rx_ports tx_ports f"], **about: np.ndarray | float
) -> None:
    content = npz_bytes({"response": response.astype(np.complex64), **about})
    write_whole(out / f"csi_tx{tx + 1}.npz", content)
