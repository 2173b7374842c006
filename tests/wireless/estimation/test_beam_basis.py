"""The dimensions that an estimator works in: what beams can tell apart, the same bits on any machine."""

import os
import subprocess
import sys

import numpy as np

from wireless import Sounder, SoundingConfig, terminal_named
from wireless.estimation.sage import _beam_basis

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
    """A library that splits sums over threads ends in other last bits, and an episode later in another way."""
    told = set()
    for threads in ("1", "2", "4"):
        done = subprocess.run(
            [sys.executable, "-c", CODE],
            env={**os.environ, "OPENBLAS_NUM_THREADS": threads, "OMP_NUM_THREADS": threads},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        told.add(done.stdout)
    assert len(told) == 1
