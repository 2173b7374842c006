"""The dimensions that an estimator works in: what beams can distinguish, the same bits on any machine."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from wireless import Sounder, SoundingConfig, terminal_named
from wireless.antennas.codebook import Terminal
from wireless.estimates import wrapped
from wireless.estimation.sage import SageEstimator, _beam_basis
from wireless.sounding.sounder import Rays

CODE = """
import hashlib
from wireless import Sounder, SoundingConfig, terminal_named
from wireless.estimation.sage import _beam_basis

sounder = Sounder(terminal_named("gnb"), terminal_named("ue"), SoundingConfig())
print(hashlib.sha256(_beam_basis(sounder).tobytes()).hexdigest())
"""


def test_it_spans_what_level_waves_excite():
    """Rows are orthonormal (1e-12) and keep all of any level wave but a thousandth of the strongest amplitude."""
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"), SoundingConfig())
    basis = _beam_basis(sounder)
    np.testing.assert_allclose(basis @ basis.conj().T, np.eye(len(basis)), atol=1e-12)
    seen = sounder.tx_response(np.linspace(-np.pi, np.pi, 500))
    lost = np.linalg.norm(seen - seen @ basis.T @ basis.conj(), axis=1)
    assert lost.max() < 2e-3 * np.linalg.norm(seen, axis=1).max()
    assert len(basis) < sounder.tx.n_beams / 2


def test_its_bits_do_not_depend_on_the_number_of_cores():
    """A library that splits sums over threads ends in other last bits, and an episode later differs."""
    reported = set()
    for threads in ("1", "2", "4"):
        done = subprocess.run(
            [sys.executable, "-c", CODE],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        reported.add(done.stdout)
    assert len(reported) == 1


@pytest.mark.parametrize(("faces", "n_beams"), [((0.0, 1.0, 2.5, 4.4), 21), ((0.1, 1.7, 4.0), 50)])
def test_beams_that_do_not_divide_evenly_among_arrays_do(faces: tuple[float, ...], n_beams: int) -> None:
    """Arrays with more and fewer beams than others: lone paths are found, at both ends to 0.1 degrees."""
    ue = terminal_named("ue")
    odd = Terminal(platform=replace(ue.platform, face_rad=faces), n_beams=n_beams)
    sounder = Sounder(odd, ue)
    rng = np.random.default_rng(1)
    aoa, aod = rng.uniform(-3, 3, (2, 6, 1))
    level = np.zeros((6, 1))
    rays = Rays(
        gain=level + 1e-4 + 0j, delay_s=level + 2e-8, aoa_az=aoa, aoa_el=level, aod_az=aod, aod_el=level
    )
    found = SageEstimator(sounder, workers=1).estimate(sounder.measure(rays, rng, workers=1))
    assert np.abs(wrapped(found.aoa_rad[:, 0] - aoa[:, 0])).max() < np.radians(0.1)
    assert np.abs(wrapped(found.aod_rad[:, 0] - aod[:, 0])).max() < np.radians(0.1)
