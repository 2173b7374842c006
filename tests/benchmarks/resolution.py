"""How well an estimator can find the strongest path if it does not resolve paths that look alike.

Paths arrive with phases of their own. Where they differ by less than a measurement resolves, only the sum of their
fields is seen: two strong ones may cancel, two weak ones pass for a strong one. The limit here is that of a receiver
that knows all directions and delays, has no noise, and takes the strongest of such sums for the strongest path.

A path's signature is the outer product of what it leaves on receive ports, delays and beams. From the strongest
path on, each takes to itself what is left of those whose signatures agree with its own by `ALIKE`, the modulus of the
inner product of unit signatures; their sum is its field. 0.95 is two paths of equal departure and delay, 2.5 degrees
apart in front of a line of 8, a fifth of a beam.
"""

import numpy as np
from jaxtyping import Float

from wireless.sounding.sounder import Rays, Sounder

#: Paths whose signatures agree by this are not resolved.
ALIKE = 0.95


def strongest_sum_rad(
    sounder: Sounder, rays: Rays, rng: np.random.Generator, *, alike: float = ALIKE
) -> Float[np.ndarray, " links"]:
    """Azimuth of arrival of the strongest sum's strongest path, for each link.

    Args:
        sounder: What measures.
        rays: Paths of links, the strongest first.
        rng: Source of the paths' phases.
        alike: Agreement of signatures from which paths are one.
    """
    n, most = rays.gain.shape
    field = rays.gain * np.exp(2j * np.pi * rng.random((n, most)))
    agree = signature_agreement(sounder, rays)
    free = np.abs(field) > 0
    best, first = np.zeros(n), np.zeros(n, int)
    for i in range(most):
        mine = free & (np.abs(agree[:, i]) >= alike) & free[:, i : i + 1]
        total = np.abs(np.sum(np.where(mine, field * agree[:, i], 0), axis=1))
        first = np.where(total > best, i, first)
        best = np.maximum(best, total)
        free &= ~mine
    return rays.aoa_az[np.arange(n), first]


def signature_agreement(sounder: Sounder, rays: Rays) -> np.ndarray:
    """Inner products of the unit signatures of all pairs of a link's paths."""
    rx = sounder.rx_response(rays.aoa_az, rays.aoa_el)
    tx = sounder.tx_response(rays.aod_az, rays.aod_el)
    late = (rays.delay_s[:, None, :] - rays.delay_s[:, :, None]) / sounder.config.sample_s
    return _products(rx) * _products(tx) * sounder.pulse(late)


def _products(signature: np.ndarray) -> np.ndarray:
    """Inner products of vectors scaled to one, of all pairs of each row."""
    unit = signature / np.maximum(np.linalg.norm(signature, axis=-1, keepdims=True), 1e-12)
    return unit.conj() @ unit.swapaxes(-1, -2)
