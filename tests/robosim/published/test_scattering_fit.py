"""How rough walls of a measured hall would have to be is found from paths that rough walls scattered."""

from dataclasses import replace

import numpy as np
from scipy.constants import speed_of_light

from robosim.published.material_fit import tracer_of
from robosim.published.measured_match import MatchConfig, trace_hall
from robosim.published.measured_paths import MeasuredHall
from robosim.published.scattering_fit import ROUGH, fit_scattering
from tests.plans import two_rooms
from wireless.paths import Interaction

FREQUENCY_HZ = 60e9


def test_walls_that_scattered_are_found_as_rough_as_they_were():
    """Direct paths and, 3 dB under what S = 1 scatters (S = 0.71), paths by way of tiles: S comes out within 20 %.

    Paths are the strongest tile of each place's cells, so that the cell's other tiles make S smaller than it was by no
    more than that.
    """
    plan, rng = two_rooms(0.8), np.random.default_rng(0)
    tx = (*plan.to_map(np.array([20.0, 22.0])), 0.0)
    places = plan.to_map(rng.uniform((8, 8), (50, 50), (12, 2)))
    rows = np.array([[i, *tx, *place, 0.0, 1.0, 0, 0] for i, place in enumerate(places)])
    config = MatchConfig(delay_ns=0.05, angle_deg=0.5)
    tracer = tracer_of(plan, "concrete", FREQUENCY_HZ, replace(ROUGH, scattering=np.sqrt(0.5)))
    paths = trace_hall(MeasuredHall(rows), tracer, config.height_m)
    rough = np.flatnonzero(paths.interaction[:, 0] == Interaction.SCATTERING)
    chosen = rng.choice(rough, 80, replace=False)
    kept = paths.select(np.sort(np.concatenate([np.flatnonzero(paths.order == 0), chosen])))
    table = np.column_stack([
        kept.rx, np.tile(tx, (len(kept), 1)), places[kept.rx], np.zeros(len(kept)),
        kept.delay_s * speed_of_light, kept.aod_az, kept.aoa_az,
    ])  # fmt: skip
    hall = MeasuredHall(table, kept.power_db + 5.0)
    found = fit_scattering(hall, plan, "concrete", FREQUENCY_HZ, config)
    assert found.paths >= 70 and found.explained > 0.9
    assert 0.45 < found.coefficient < 0.75 and found.near > 0.85
    assert found.correlation > 0.8
