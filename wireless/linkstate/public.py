"""Links of the public measurements, ready for training: all buildings and transmitters of a folder.

The public files have no delays. A link without paths holds zeros there, which `make_tokens` takes as missing.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

from wireless.linkstate.tokens import make_tokens
from wireless.mmwrobotnav import find_measurements, read_measurements


@dataclass(frozen=True, kw_only=True, eq=False)
class Links:
    """Links with known states."""

    tokens: Float32[np.ndarray, "n 5 5"]
    """Estimated paths from `make_tokens`."""
    state: UInt8[np.ndarray, "n"]
    """True `wireless.paths.LinkState`."""
    building: Int[np.ndarray, "n"]
    """Building of each link, as a number into the names."""
    names: tuple[str, ...]
    """Names of the buildings, sorted."""

    def within(self, buildings: tuple[int, ...]) -> Bool[np.ndarray, "n"]:
        """Which links are in some buildings."""
        return np.isin(self.building, buildings)


def read_links(data: Path, report: Callable[[int, int], None] | None = None) -> Links:
    """All links of a folder of public measurements.

    Args:
        data: Folder with a folder for each building, see `wireless.mmwrobotnav`.
        report: Called with how many files are read, of how many.

    Raises:
        wireless.mmwrobotnav.DataError: If a file is missing or damaged.
    """
    wanted = find_measurements(data)
    names = tuple(sorted({name for name, _ in wanted}))
    tokens, state, building = [], [], []
    for i, (name, number) in enumerate(wanted):
        links = read_measurements(data, name, number)
        tokens.append(make_tokens(links.aoa_az, links.snr_db, aod_rad=links.aod_az, peak=links.peak_fraction))
        state.append(links.state)
        building.append(np.full(len(links.state), names.index(name)))
        if report:
            report(i + 1, len(wanted))
    return Links(
        tokens=np.concatenate(tokens),
        state=np.concatenate(state),
        building=np.concatenate(building),
        names=names,
    )
