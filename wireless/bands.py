"""Radio bands by name: carrier, waveform, power, noise, and antennas of both ends.

    ble        Bluetooth LE, channel 17; class 2 power; a constant tone of 160 us that 8 antennas share in turn gives 16
               samples to each (Bluetooth Core 5.1, vol. 6, parts A and B)
    wifi-2.4   channel 6, 20 MHz        20 dBm; one HE-LTF symbol of 12.8 us (IEEE 802.11ax-2021, 27.3.11.10)
    wifi-5     channel 42, 80 MHz       likewise
    wifi-6     the 6 GHz band, channel 47, 160 MHz; likewise
    uwb-6.5    HRP UWB channel 5, 499.2 MHz; -41.3 dBm/MHz; 64 symbols of 508 chips (IEEE 802.15.4z-2020, clause 15)
    28ghz      the published base station and robot (arXiv 2110.14789), as 3GPP NR band n257; the default
    60ghz      channel 2, 1.76 GHz; a Golay pair of 512 chips each (IEEE 802.11ad-2012, 21.3.6)
    140ghz     the published sounder at 142 GHz: 1 GHz (arXiv 2302.12142); 10 dBm, which amplifiers reach there

Noise figures: 6 dB as in the reference at 28 GHz, 7 dB for Wi-Fi (IEEE 802.11-14/0980), 10 dB for the small receivers
of BLE and UWB, and at 60 GHz (IEEE 802.11ad-2012, table 21-3) and 140 GHz. Below 10 GHz the transmitter is a tag with
one dipole, whose directions of departure are unknown, and the robot has a ring of dipoles. Where delays are resolved,
windows hold paths that are at least 3.4 m longer than the strongest.
Left out: sharing of antennas over time, regulations of countries, duty cycles.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

from robosim.support.checks import check_choice

if TYPE_CHECKING:
    from wireless.sounding.sounder import SoundingConfig

BandName = Literal["ble", "wifi-2.4", "wifi-5", "wifi-6", "uwb-6.5", "28ghz", "60ghz", "140ghz"]


@dataclass(frozen=True)
class Band:
    """Radio band: its carrier and everything else that differs between bands."""

    frequency_hz: float
    """Carrier frequency."""
    tx_power_dbm: float
    """Transmit power [dBm]."""
    bandwidth_mhz: float
    """Bandwidth [MHz]."""
    n_samples: int
    """Samples of the waveform, sent once in each beam."""
    loss_db: float
    """Noise figure and other losses [dB]."""
    half_window: int
    """Samples that are recorded before and after the strongest delay."""
    transmitter: str = "tag"
    """Name of the target's antennas, of `wireless.antennas.codebook.TERMINALS`."""
    receiver: str = "ring-8"
    """Name of the robot's antennas."""

    @property
    def sounding(self) -> "SoundingConfig":
        """Power, waveform and noise."""
        # Its modules take a while to load, and the command line starts without them.
        from wireless.sounding.sounder import SoundingConfig

        return SoundingConfig(
            tx_power_dbm=self.tx_power_dbm,
            bandwidth_mhz=self.bandwidth_mhz,
            n_samples=self.n_samples,
            loss_db=self.loss_db,
            half_window=self.half_window,
        )


#: Bands by name.
BANDS: dict[BandName, Band] = {
    "ble": Band(2.44e9, 4.0, 2.0, 16, 10.0, 1),
    "wifi-2.4": Band(2.437e9, 20.0, 20.0, 256, 7.0, 1),
    "wifi-5": Band(5.21e9, 20.0, 80.0, 1024, 7.0, 2),
    "wifi-6": Band(6.185e9, 20.0, 160.0, 2048, 7.0, 3),
    "uwb-6.5": Band(6.4896e9, -14.3, 499.2, 64 * 508, 10.0, 6),
    "28ghz": Band(28e9, 23.0, 400.0, 2048, 6.0, 5, "gnb", "ue"),
    "60ghz": Band(60.48e9, 10.0, 1760.0, 1024, 10.0, 20, "gnb", "ue"),
    "140ghz": Band(142e9, 10.0, 1000.0, 2048, 10.0, 12, "gnb", "ue"),
}


def band_named(name: str) -> Band:
    """A band by its name; ValueError if there is none."""
    check_choice("band", name, BANDS)
    return BANDS[cast(BandName, name)]


def check_bandwidth(bandwidth_mhz: float, frequency_hz: float) -> None:
    """Raise ValueError for a bandwidth that reaches down to 0 Hz from a carrier."""
    if bandwidth_mhz * 1e6 >= 2 * frequency_hz:
        raise ValueError(
            f"bandwidth_mhz is {bandwidth_mhz:g} at a carrier of {frequency_hz / 1e9:g} GHz, expected less than twice "
            "the carrier. Bandwidths are in MHz, not in kHz."
        )
