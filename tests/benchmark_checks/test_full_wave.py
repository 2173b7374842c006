"""Laws of diffraction against a full-wave solution of lossy wedges, once: a minute."""

import pytest

from tests.benchmarks.full_wave import MATERIALS, compared


@pytest.fixture(scope="module")
def rows():
    return compared()


@pytest.mark.parametrize("material", MATERIALS)
def test_the_default_law_is_nearest_to_full_waves(rows, material):
    """In the shadow within 1 dB (root mean square; measured 0.96 and 0.95), the field within 3.5 % (2.8 and 3.2).

    That is of the incident one. Bisectors are off by 2.3 and 2.5 dB there, and by 3.9 and 3.8 %; no law is nearer by
    0.2 dB.
    """
    own = rows[material]["nearer face (default)"]
    assert own[0] < 1.05 and own[2] < 0.035
    assert rows[material]["bisector"][0] > 1.5 * own[0]
    assert rows[material]["bisector"][2] > 1.1 * own[2]
    assert min(row[0] for row in rows[material].values()) > own[0] - 0.2
