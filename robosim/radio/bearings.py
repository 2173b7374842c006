"""What a measurement of a robot's radio says to its mapper: in which directions a transmitter appears, and how far.

The strongest path tells by its power gain g about how far it came, as if through free space (Friis): r = lambda /
(4 pi) 10^(-g / 20 dB). Delays tell much better how much farther other paths came, within the window that the receiver
keeps. A path with another beside it that the receiver can hardly tell apart, in angle nor delay, may be off by degrees,
as at grazing angles along a corridor; one that stands alone hardly is.

How well all this is known is what estimates of the shipped receiver came to in halls, corridors, rings and offices.
Directions of paths that stand alone are within 0.1 degrees in 90 % of all cases on most floors; of paths with others
beside them within 0.5 degrees in 80 %. Some are far off, in corridors for metres: that is for the triangulation of
landmarks, and for a robust kernel, to bear.
"""

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light

from robosim.radio.link import RadioLinkConfig
from robosim.radio.measurement import Measurement, free_path_m
from slam.poses import wrap
from slam.sensing.bearings import Bearing
from wireless.paths import LinkState

#: Standard deviation of directions: of a path alone, and of one beside others. Not by the link state: a path that
#: appears from its landmark's place, and as strong as from there, is as exact whatever it is taken for.
_SIGMA_RAD = np.radians([0.1, 0.5])
#: Of what they have in common for metres.
_SHARED_RAD = np.radians([0.0, 1.0])
#: The same of the logarithm of distances, and what those of one place have in common.
_LOG_RANGE, _SHARED_LOG_RANGE = np.array([0.06, 0.3]), 0.03
#: Of how much farther a path came than the strongest [m].
_BEYOND_M = 0.05
#: Paths nearer to each other than this in azimuth [rad] and delay [samples] are beside each other.
_BESIDE_RAD, _BESIDE_SAMPLES = math.radians(20.0), 1.3
#: Distances that power may tell [m].
_NEAREST_M, _FARTHEST_M = 0.1, 1e5
#: Weaker paths are not trusted: the strongest, others [dB].
_LEAST_SNR_DB, _LEAST_OTHER_DB = 0.0, 20.0


def bearings_of(
    heard: Mapping[str, Measurement], radio: RadioLinkConfig, known: Mapping[str, Float[np.ndarray, "2"]]
) -> list[Bearing]:
    """Directions of well received transmitters, by name: of each the strongest path, then others.

    `known` are the places [m] in `map` of transmitters whose places are known.
    """
    bearings = []
    for name, measurement in heard.items():
        heard_well = len(measurement.aoa_rad) > 0 and measurement.snr_db[0] >= _LEAST_SNR_DB
        if heard_well and np.isfinite([measurement.aoa_rad[0], measurement.gain_db[0]]).all():
            bearings.append(_first(name, measurement, radio, known.get(name)))
            bearings += _further(name, measurement, radio)
    return bearings


def _first(
    name: str, measurement: Measurement, radio: RadioLinkConfig, place_xy: Float[np.ndarray, "2"] | None
) -> Bearing:
    """The strongest path."""
    # Estimators and classifiers may be anybody's, and round a little over 1.
    direct = float(np.clip(np.nan_to_num(measurement.probability[LinkState.LOS]), 0.0, 1.0))
    beside = int(_beside(measurement, 0, radio))
    return Bearing(
        source=name,
        bearing_rad=wrap(float(measurement.aoa_rad[0] - measurement.pose[2])),
        sigma_rad=float(_SIGMA_RAD[beside]),
        shared_rad=float(_SHARED_RAD[beside]),
        range_m=_lossless_m(measurement, radio),
        sigma_log_range=float(_LOG_RANGE[beside]),
        shared_log_range=_SHARED_LOG_RANGE,
        direct=direct,
        apart_rad=_BESIDE_RAD,
        apart_m=_BESIDE_SAMPLES * speed_of_light * radio.sounding.sample_s,
        place_xy=place_xy,
    )


def _further(name: str, measurement: Measurement, radio: RadioLinkConfig) -> list[Bearing]:
    """Other strong paths that stand alone, well within the window of delays."""
    most_m = speed_of_light * (radio.sounding.half_window - 1) * radio.sounding.sample_s
    found = []
    for k in range(1, len(measurement.aoa_rad)):
        beyond_m = speed_of_light * float(measurement.delay_s[k])
        strong = measurement.snr_db[k] >= _LEAST_OTHER_DB and np.isfinite(measurement.aoa_rad[k])
        if not (strong and abs(beyond_m) <= most_m) or _beside(measurement, k, radio):
            continue
        bearing = Bearing(
            source=name,
            bearing_rad=wrap(float(measurement.aoa_rad[k] - measurement.pose[2])),
            sigma_rad=float(_SIGMA_RAD[0]),
            range_m=max(_lossless_m(measurement, radio) + beyond_m, _NEAREST_M),
            sigma_log_range=1.0,
            direct=0.0,
            beyond_m=beyond_m,
            sigma_m=_BEYOND_M,
        )
        found.append(bearing)
    return found


def _lossless_m(measurement: Measurement, radio: RadioLinkConfig) -> float:
    """How far the strongest path came, if nothing but free space made it weak [m]."""
    free_m = free_path_m(float(measurement.gain_db[0]), radio.frequency_hz)
    return float(np.clip(free_m, _NEAREST_M, _FARTHEST_M))


def _beside(measurement: Measurement, k: int, radio: RadioLinkConfig) -> bool:
    """Whether another strong path lies so near that it can hardly be told apart."""
    turn = wrap(measurement.aoa_rad - measurement.aoa_rad[k])
    gap = np.abs(measurement.delay_s - measurement.delay_s[k]) / radio.sounding.sample_s
    near = (np.abs(turn) < _BESIDE_RAD) & (gap < _BESIDE_SAMPLES) & (measurement.snr_db >= _LEAST_OTHER_DB)
    near[k] = False
    return bool(near.any())
