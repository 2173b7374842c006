"""Published links traced again: as strong as they were published."""

import numpy as np

from robosim.published import label_links
from tests.benchmarks.labels import prepared
from wireless.estimation.public import PublicReceiver
from wireless.formats.mmwrobotnav_measurements import link_states, read_measurements
from wireless.paths import LinkState
from wireless.sounding.sounder import Rays


def test_paths_are_as_strong_as_published(shared):
    """A published transmitter traced and received again: median strongest SNRs agree within 3 dB in each state."""
    measured = read_measurements(shared / "data" / "mmwrobotnav", "Hominy", 1)
    some = np.arange(0, len(measured.state), 3)
    place = measured.rx_position[some]
    rx = np.column_stack([place, np.full(len(place), measured.tx_position[2])])
    plan = shared / "maps" / "gibson" / "train" / "Hominy.glb_topdownmap.out"
    tracer = prepared(plan)[1]
    paths = label_links.published_paths(measured.tx_position, rx, measured.rx_cell[some], tracer)
    state = link_states(paths)[0]
    snr_db = PublicReceiver().receive(Rays.from_paths(paths), np.random.default_rng(0))[2].max(axis=1)
    for one in (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER):
        both = (state == one) & (measured.state[some] == one)
        assert both.sum() > 40
        off = snr_db[both] - measured.snr_db[some][both].max(axis=1)
        assert abs(np.median(off)) < 3, one
