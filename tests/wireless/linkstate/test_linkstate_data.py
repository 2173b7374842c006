"""Links for training from data sets of our own; public measurements are read in the tests of training."""

import json

import numpy as np
import pytest

from wireless import PathEstimates, Tracer
from wireless.formats.link_records import link_table, write_links
from wireless.linkstate.data import is_data_set, read_links
from wireless.linkstate.tokens import AOA, AOD, DELAY, PEAK, SNR

TX = np.array([[1.0, 1.0, 1.5], [3.0, 3.0, 1.5]])
RX = np.array([[2.0, 1.0, 1.5], [2.5, 3.0, 1.5]])


@pytest.fixture
def folder(tmp_path, extruded, ring):
    """Building b with two transmitters, then building a with one; the first link of each finds nothing."""
    paths = Tracer(extruded(ring((0, 0), (4, 0), (4, 4), (0, 4)))).trace(TX, RX)
    units = []
    for plan, tx in (("b", 0), ("b", 1), ("a", 0)):
        column = np.array([[0.0], [0.1 * (1 + tx)]])
        estimates = PathEstimates(
            aoa_rad=np.pad(column, ((0, 0), (0, 4))),
            aod_rad=np.pad(-column, ((0, 0), (0, 4))),
            snr_db=np.pad(np.array([[-np.inf], [12.5]]), ((0, 0), (0, 4)), constant_values=-np.inf),
            delay_s=np.zeros((2, 5)),
            count=np.array([0, 1]),
        )
        file = f"links/{plan}_Tx_{tx + 1}.parquet"
        (tmp_path / "links").mkdir(exist_ok=True)
        write_links(tmp_path / file, [link_table(paths, tx, estimates, np.zeros((2, 2), int), plan=plan)])
        units.append({"file": file})
    (tmp_path / "manifest.json").write_text(json.dumps({"units": units}))
    return tmp_path


def test_a_data_set_is_read_as_links(folder):
    """Buildings are numbered by name, transmitters by file; what was not measured is missing."""
    links = read_links(folder)
    assert is_data_set(folder)
    assert links.names == ("a", "b")
    assert links.building.tolist() == [1, 1, 1, 1, 0, 0]
    assert links.transmitter.tolist() == [0, 0, 1, 1, 2, 2]
    assert links.state.tolist() == [1] * 6
    np.testing.assert_allclose(links.position, np.tile(RX[:, :2], (3, 1)))
    np.testing.assert_allclose(links.tx_position, TX[[0, 0, 1, 1, 0, 0], :2])
    assert np.isnan(links.tokens[::2]).all()
    np.testing.assert_allclose(links.tokens[1::2, 0, AOA], [0.1, 0.2, 0.1], rtol=1e-6)
    np.testing.assert_allclose(links.tokens[1::2, 0, AOD], [-0.1, -0.2, -0.1], rtol=1e-6)
    assert (links.tokens[1::2, 0, SNR] == 12.5).all()
    assert (links.tokens[1::2, 0, DELAY] == 0).all()
    assert np.isnan(links.tokens[1::2, 0, PEAK]).all()
    assert np.isnan(links.tokens[1::2, 1:]).all()
    assert links.measured == ("aoa", "aod", "snr", "delay")


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"units": [1]}', '{"units": []}'])
def test_a_damaged_manifest_is_named(folder, text):
    (folder / "manifest.json").write_text(text)
    with pytest.raises(ValueError, match=r"manifest\.json"):
        read_links(folder)
