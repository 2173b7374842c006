"""Frequency responses of traced links on the subcarriers of OFDM (channel state information), as files and figures.

`csi_txK.npz` holds what `wireless.channel.Channel.cfr` computes between the ports of an antenna or array at each end:
with both polarisations the vertical ports before the horizontal ones.
"""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.datasets.trace import PATHS
from robosim.drawing.csi_picture import plot_response
from robosim.drawing.radio_pictures import choose_link
from robosim.support.checks import shown
from robosim.support.files import npz_bytes, write_whole
from wireless.antennas.mounting import MountedArray
from wireless.channel import Channel, subcarriers
from wireless.paths import Paths

_UNITS = {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}
_MOST = 65_536
#: Complex numbers of the responses of a transmitter: they are computed at once, in 3 GB.
_MOST_NUMBERS = 200_000_000


def parse_csi(text: str, frequency_hz: float) -> Float[np.ndarray, " f"]:
    """Frequencies of the subcarriers of a text such as 64x312.5kHz, counted from the carrier.

    Raises:
        ValueError: If the text is not understood, or the subcarriers reach down to 0 Hz.
    """
    match = re.fullmatch(r"(\d{1,6})x(\d+(?:\.\d+)?)(Hz|kHz|MHz|GHz)", text, re.ASCII)
    count, spacing_hz = (int(match[1]), float(match[2]) * _UNITS[match[3]]) if match else (0, 0.0)
    if not (1 <= count <= _MOST and 0 < count * spacing_hz < 2 * frequency_hz):
        raise ValueError(
            f"csi is {shown(text)}, expected a number of subcarriers (1 to {_MOST}) and their spacing, such as "
            f"64x312.5kHz, within the carrier frequency of {frequency_hz / 1e9:g} GHz to either side."
        )
    return subcarriers(count, spacing_hz)


def write_csi(
    folder: Path,
    offset_hz: Float[np.ndarray, " f"],
    antennas: tuple[MountedArray, MountedArray],
    n_tx: int,
    *,
    rx: tuple[float, ...] | None,
    plots: bool,
) -> None:
    """Write the responses of the paths of a folder, and draw that of the receiver at `rx`, or of a chosen one.

    Frequencies count from the carrier; antennas are those of transmitters and of receivers.

    Raises:
        ValueError: If there are too many numbers.
    """
    tx_ports, rx_ports = (antenna.array.position_wl for antenna in antennas)
    for tx in range(n_tx):
        paths = Paths.read_parquet(folder / PATHS, tx)
        shape = len(paths.rx_position), len(rx_ports), len(tx_ports), len(offset_hz)
        if math.prod(shape) > _MOST_NUMBERS:
            raise ValueError(
                f"csi of {shape[0]} receivers, {shape[1]} x {shape[2]} ports and {shape[3]} subcarriers has "
                f"{math.prod(shape)} numbers, expected at most {_MOST_NUMBERS}. Take fewer of them, or a wider grid."
            )
        paths = replace(paths, tx_position=paths.tx_position[tx : tx + 1], tx=np.zeros_like(paths.tx))
        response = Channel.from_paths(paths, tx=antennas[0], rx=antennas[1]).cfr(offset_hz)[0]
        arrays = {
            "response": response.astype(np.complex64),
            "offset_hz": offset_hz,
            "frequency_hz": paths.frequency_hz,
            "tx_position_m": paths.tx_position[0],
            "rx_position_m": paths.rx_position,
            "tx_port_wl": tx_ports,
            "rx_port_wl": rx_ports,
        }
        write_whole(folder / f"csi_tx{tx + 1}.npz", npz_bytes(arrays))
        if plots:
            if rx is None:
                drawn = choose_link(paths, 0)
            else:
                drawn = int(np.argmin(np.linalg.norm(paths.rx_position[:, : len(rx)] - rx, axis=1)))
            title = "Frequency response, transmitter {} to ({:.2f}, {:.2f}, {:.2f}) m"
            plot_response(
                folder / f"csi_tx{tx + 1}.png",
                response[drawn],
                offset_hz,
                is_array=bool(tx_ports.any() or rx_ports.any()),
                frequency_hz=paths.frequency_hz,
                title=title.format(tx + 1, *paths.rx_position[drawn]),
            )
