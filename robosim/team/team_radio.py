"""The radio between robots: a link of each pair through the building."""

import math
from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

from robosim.radio.link import RadioLink
from robosim.simulator import Simulator

#: Nothing is received below this SNR [dB]; most bits per second and hertz.
_LEAST_SNR_DB, _MOST_BITS = -6.0, 8.0


class TeamRadio:
    """Links of all pairs of robots."""

    def __init__(self, robots: Mapping[str, Simulator]) -> None:
        """Make the links; both ends have the arrays that robots receive with."""
        self._robots = robots
        first = next(iter(robots.values()))
        config = first.config.radio
        config = replace(config, transmitter=config.receiver, engine="live", tables=None)
        self._link = RadioLink(first.building, config)
        self._snr_db = dict.fromkeys(combinations(robots, 2), -math.inf)

    def measure(self) -> None:
        """Trace all links at the true places of the robots."""
        for pair in self._snr_db:
            sender, receiver = (self._robots[name] for name in pair)
            self._link.place(sender.pose[:2])
            gain = float(self._link.trace(receiver.pose[:2]).power.sum())
            sounder = self._link.sounder
            self._snr_db[pair] = sounder.budget_db + 10 * math.log10(gain) if gain > 0 else -math.inf

    def rate_bps(self, pair: tuple[str, str]) -> float:
        """Rate of a pair [bit/s]: Shannon's, up to 8 bit/s for each hertz of the bandwidth."""
        if self._snr_db[pair] < _LEAST_SNR_DB:
            return 0.0
        bandwidth_hz = 1e6 * self._link.sounder.config.bandwidth_mhz
        return bandwidth_hz * min(math.log2(1 + 10 ** (self._snr_db[pair] / 10)), _MOST_BITS)
