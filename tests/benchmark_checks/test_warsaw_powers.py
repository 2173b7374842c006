"""The benchmark of powers in a real flat: walls fitted to half of the floor predict the other half."""

from robosim.calibration.power_fit import fit_powers
from tests.benchmarks.warsaw_powers import CONFIG, read_flat


def test_a_real_flat_is_predicted_where_nothing_was_fitted(shared):
    """Every fourth place: 5.3 dB at the held-out ones, mean of six beacons, where laws of distance leave 6.5 dB."""
    plan, measured = read_flat(shared / "data" / "warsaw-flat-ble", every=4)
    errors = fit_powers(measured, plan, CONFIG).rms_db
    assert errors["mean"][1] < 5.3 < 6.2 < errors["mean"][3]
