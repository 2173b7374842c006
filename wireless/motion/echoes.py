"""Paths off bodies: from the transmitter to a person and on to the receiver.

A body of radar cross-section sigma at the distances d1 and d2 from both ends adds a path of the gain
    g = lambda sqrt(sigma) / ((4 pi)^1.5 d1 d2) e^(-j k (d1 + d2)),
the radar equation between isotropic antennas; theta stays theta, and phi stays phi. It leaves from the middle of the
body, and is there where both ends see that point. Its interaction is a scattering, of no wall (-1).

Left out: the fluctuation of the cross-section (3.94 dB) and its dependence on direction; forward scattering, which is
blockage; bodies that shadow each other's paths, unless they are blocked afterwards; paths with further interactions.
Reference: 3GPP TR 38.901 V19, section 7.9.2: the mean cross-section of a person, -1.37 dB over a square metre.
"""

from dataclasses import fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool
from scipy.constants import speed_of_light

from wireless.motion.bodies import Bodies
from wireless.paths import Interaction, Paths
from wireless.tracing.tracer import POLARISATIONS, Tracer, TracerConfig

#: Mean radar cross-section of a person [m^2].
PERSON_CROSS_SECTION_M2 = 10**-0.137
#: Finds direct paths only.
SIGHT = TracerConfig(max_reflections=0, diffraction=False, max_transmissions=0, max_paths=1)


def add_echoes(
    paths: Paths, bodies: Bodies, sight: Tracer, *, cross_section_m2: float = PERSON_CROSS_SECTION_M2
) -> Paths:
    """Return the paths and an echo off each body that both ends of a link see, strongest first.

    Args:
        paths: Paths of any links.
        bodies: Bodies.
        sight: Decides what is in sight: a tracer of the same building, whose other paths are ignored, with the
            configuration `SIGHT` at least cost. Its polarisation weighs the powers of echoes.
        cross_section_m2: Radar cross-section of each body.
    """
    if not len(bodies):
        return paths
    middle = bodies.position + bodies.height_m[:, None] * [0.0, 0.0, 0.5]
    out = _is_seen(sight.trace(paths.tx_position, middle))
    back = _is_seen(sight.trace(middle, paths.rx_position))
    tx, rx, body = np.nonzero(out[:, None] & back.T)
    first, second = middle[body] - paths.tx_position[tx], middle[body] - paths.rx_position[rx]
    # A terminal is not inside of the body.
    d1, d2 = (np.maximum(np.linalg.norm(leg, axis=1), bodies.radius_m[body]) for leg in (first, second))
    wavelength_m = speed_of_light / paths.frequency_hz
    size = wavelength_m * np.sqrt(cross_section_m2 / (4 * np.pi) ** 3) / (d1 * d2)
    g = size * np.exp(-2j * np.pi / wavelength_m * (d1 + d2))
    n, m = len(body), max(paths.point.shape[1], 1)
    gain = np.zeros((n, 2, 2), complex)
    gain[:, 0, 0], gain[:, 1, 1] = g, -g
    point, primitive = np.full((n, m, 3), np.nan), np.full((n, m), -1)
    interaction = np.zeros((n, m), np.uint8)
    point[:, 0], interaction[:, 0] = middle[body], Interaction.SCATTERING
    vertical, horizontal, _ = POLARISATIONS[sight.config.polarisation]
    echoes = replace(
        paths,
        tx=tx,
        rx=rx,
        gain=gain,
        power=(vertical + horizontal) * size**2,
        delay_s=(d1 + d2) / speed_of_light,
        aoa_az=np.arctan2(second[:, 1], second[:, 0]),
        aoa_el=np.arctan2(second[:, 2], np.hypot(second[:, 0], second[:, 1])),
        aod_az=np.arctan2(first[:, 1], first[:, 0]),
        aod_el=np.arctan2(first[:, 2], np.hypot(first[:, 0], first[:, 1])),
        order=np.ones(n, np.uint8),
        interaction=interaction,
        primitive=primitive,
        point=point,
    )
    return _merge(paths, echoes)


def _is_seen(direct: Paths) -> Bool[np.ndarray, "n_tx n_rx"]:
    """Whether each transmitter sees each receiver."""
    return direct.select(direct.order == 0).count() > 0


def _merge(first: Paths, other: Paths) -> Paths:
    """The paths of both, strongest first; columns of points become as wide as the wider."""
    width = max(first.point.shape[1], other.point.shape[1])
    columns: dict[str, Any] = {}
    for field in fields(Paths)[3:]:
        beyond = {"primitive": -1, "point": np.nan}.get(field.name, 0)
        both = [getattr(paths, field.name) for paths in (first, other)]
        if field.name in ("interaction", "primitive", "point"):
            pads = [[(0, 0), (0, width - values.shape[1])] + [(0, 0)] * (values.ndim - 2) for values in both]
            both = [
                np.pad(values, pad, constant_values=beyond) for values, pad in zip(both, pads, strict=True)
            ]
        columns[field.name] = np.concatenate(both)
    merged = replace(first, **columns)
    return merged.select(np.lexsort((-merged.power, merged.link)))
