"""Frequency responses of traced links on the subcarriers of OFDM (channel state information), as files and figures.

`csi_txK.npz` holds what `wireless.channel.Channel.cfr` computes between one antenna at each end, or between pairs of
vertical and horizontal ones with both polarisations.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.datasets.trace import PATHS
from robosim.drawing.csi_picture import plot_response
from robosim.drawing.radio_pictures import choose_link
from robosim.support.checks import shown
from robosim.support.files import npz_bytes, write_whole
from wireless.antennas.arrays import Array
from wireless.antennas.elements import ELEMENTS, element_named
from wireless.antennas.mounting import MountedArray
from wireless.channel import Channel, subcarriers
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


def parse_csi(text: str, frequency_hz: float, polarisation: str, antennas: dict[str, str]) -> Csi:
    """Subcarriers of a text such as 64x312.5kHz, between a tx_antenna and an rx_antenna such as sector.msi,90,6.

    Raises:
        ValueError: If a text is not understood, or the subcarriers reach down to 0 Hz.
        FileError: If a pattern file is missing or damaged.
    """
    match = re.fullmatch(r"(\d{1,6})x(\d+(?:\.\d+)?)(Hz|kHz|MHz|GHz)", text, re.ASCII)
    count, spacing_hz = (int(match[1]), float(match[2]) * _UNITS[match[3]]) if match else (0, 0.0)
    if not (1 <= count <= _MOST and 0 < count * spacing_hz < 2 * frequency_hz):
        raise ValueError(
            f"csi is {shown(text)}, expected a number of subcarriers (1 to {_MOST}) and their spacing, such as "
            f"64x312.5kHz, within the carrier frequency of {frequency_hz / 1e9:g} GHz to either side."
        )
    slant_rad = np.array(_SLANT_RAD[polarisation])
    tx, rx = (_parse_antenna(antennas[end], end, slant_rad) for end in ("tx_antenna", "rx_antenna"))
    return Csi(offset_hz=subcarriers(count, spacing_hz), tx=tx, rx=rx)


def _parse_antenna(text: str, option: str, slant_rad: Float[np.ndarray, " ports"]) -> MountedArray:
    name, *words = text.split(",")
    try:
        angles = np.radians([float(word) for word in words])
    except ValueError:
        angles = np.array([np.nan])
    if len(angles) > 3 or not (np.abs(angles) <= 2 * np.pi).all():
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


def write_csi(folder: Path, csi: Csi, n_tx: int, *, rx: tuple[float, ...] | None, plots: bool) -> None:
    """Write the responses of the paths of a folder, and draw that of the receiver at `rx`, or of a chosen one."""
    for tx in range(n_tx):
        paths = Paths.read_parquet(folder / PATHS, tx)
        paths = replace(paths, tx_position=paths.tx_position[tx : tx + 1], tx=np.zeros_like(paths.tx))
        response = Channel.from_paths(paths, tx=csi.tx, rx=csi.rx).cfr(csi.offset_hz)[0]
        arrays = {
            "response": response.astype(np.complex64),
            "offset_hz": csi.offset_hz,
            "frequency_hz": paths.frequency_hz,
            "tx_position_m": paths.tx_position[0],
            "rx_position_m": paths.rx_position,
        }
        write_whole(folder / f"csi_tx{tx + 1}.npz", npz_bytes(arrays))
        if plots:
            near = [] if rx is None else np.linalg.norm(paths.rx_position[:, : len(rx)] - rx, axis=1)
            drawn = choose_link(paths, 0) if rx is None else int(np.argmin(near))
            title = "Frequency response, transmitter {} to ({:.2f}, {:.2f}, {:.2f}) m"
            plot_response(
                folder / f"csi_tx{tx + 1}.png",
                response[drawn],
                csi.offset_hz,
                frequency_hz=paths.frequency_hz,
                title=title.format(tx + 1, *paths.rx_position[drawn]),
            )
