"""Radio bands by name: carrier, waveform, power, noise, and antennas of both ends.

    ble        Bluetooth LE, channel 17; class 2 power; a constant tone of 160 us that 8 antennas share in turn gives 16
               samples to each (Bluetooth Core 5.1, vol. 6, parts A and B)
    wifi-2.4   channel 6, 20 MHz        20 dBm; one HE-LTF symbol of 12.8 us (IEEE 802.11ax-2021, 27.3.11.10)
    wifi-5     channel 42, 80 MHz       likewise
    wifi-6     the 6 GHz band, channel 47, 160 MHz; likewise
    uwb-6.5    HRP UWB channel 5, 499.2 MHz; -41.3 dBm/MHz; 64 symbols of 508 chips (IEEE 802.15.4z-2020, 15.2 and 15.4)
    28ghz      the published base station and robot (arXiv 2110.14789), as 3GPP NR band n257; the default
    60ghz      channel 2, 1.76 GHz; a Golay pair of 512 chips each (IEEE 802.11ad-2012, 21.3.6)
    140ghz     the published sounder at 142 GHz: 1 GHz (arXiv 2302.12142); 10 dBm, which amplifiers reach there

Noise figures: 6 dB as in the reference at 28 GHz, 7 dB for Wi-Fi (IEEE 802.11-14/0980), 10 dB for the small receivers
of BLE and UWB, and at 60 GHz (IEEE 802.11-09/0296) and 140 GHz. Below 10 GHz the transmitter is a tag with one dipole,
whose directions of departure are unknown, and the robot has a ring of dipoles. Windows hold paths that are up to 3.5 m
longer than the strongest, where delays are resolved.
Left out: sharing of antennas over time, regulations of countries, duty cycles.
"""

from dataclasses import dataclass
from typing import Literal

from wireless.sounding.sounder import SoundingConfig

BandName = Literal["ble", "wifi-2.4", "wifi-5", "wifi-6", "uwb-6.5", "28ghz", "60ghz", "140ghz"]


@dataclass(frozen=True, kw_only=True)
class Band:
    """What differs between bands; fields have the names of a radio link's configuration."""

    frequency_hz: float
    """Carrier frequency."""
    sounding: SoundingConfig
    """Power, waveform and noise."""
    transmitter: str = "tag"
    """Name of the target's antennas, of `wireless.antennas.codebook.TERMINALS`."""
    receiver: str = "ring-8"
    """Name of the robot's antennas."""


def _band(
    ghz: float, mhz: float, dbm: float, loss_db: float, n_samples: int, half_window: int, *ends: str
) -> Band:
    sounding = SoundingConfig(
        tx_power_dbm=dbm,
        bandwidth_mhz=mhz,
        loss_db=loss_db,
        n_samples=n_samples,
        half_window=half_window,
    )
    return Band(
        frequency_hz=round(ghz * 1e9), sounding=sounding, **dict(zip(("transmitter", "receiver"), ends))
    )


#: Bands by name.
BANDS: dict[BandName, Band] = {
    "ble": _band(2.44, 2.0, 4.0, 10.0, 16, 1),
    "wifi-2.4": _band(2.437, 20.0, 20.0, 7.0, 256, 1),
    "wifi-5": _band(5.21, 80.0, 20.0, 7.0, 1024, 2),
    "wifi-6": _band(6.185, 160.0, 20.0, 7.0, 2048, 3),
    "uwb-6.5": _band(6.4896, 499.2, -14.3, 10.0, 64 * 508, 6),
    "28ghz": Band(frequency_hz=28e9, sounding=SoundingConfig(), transmitter="gnb", receiver="ue"),
    "60ghz": _band(60.48, 1760.0, 10.0, 10.0, 1024, 20, "gnb", "ue"),
    "140ghz": _band(142.0, 1000.0, 10.0, 10.0, 2048, 12, "gnb", "ue"),
}
