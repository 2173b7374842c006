"""
Sounding and path estimation
============================

The transmitter sends a known waveform on one beam after the other. The left picture shows the true paths, the right
picture their directions. Circles are true paths, crosses are the five estimated paths.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import RadioConfig, RadioScene, read_plan
from robosim.drawing.radio_pictures import draw_rays
from wireless import Rays, Sounder, estimator_named, terminal_named

scene = RadioScene(read_plan("flat"), RadioConfig())
tx, rx = scene.places(((7.0, 7.0), (11.0, 6.6)), "places")
paths = scene.tracer.trace(tx[None], rx[None])

sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
tensor = sounder.measure(Rays.from_paths(paths), np.random.default_rng(1))
found = estimator_named("sage", sounder).estimate(tensor)

figure, (left, right) = plt.subplots(1, 2, figsize=(13.5, 6.0), layout="constrained")
draw_rays(left, scene.building, paths, 0, 0, sounder.config.tx_power_dbm)
strong = paths.power_db > paths.power_db.max() - 30
right.scatter(
    *np.rad2deg([paths.aoa_az[strong], paths.aod_az[strong]]), facecolor="none", edgecolor="tab:blue"
)
right.plot(*np.rad2deg([found.aoa_rad[0], found.aod_rad[0]]), "x", color="tab:orange")
right.set(xlabel="azimuth of arrival [degrees]", ylabel="azimuth of departure [degrees]")
right.set(xlim=(-180, 180), ylim=(-180, 180))
for i in range(int(found.count[0])):
    print(
        f"path {i + 1}: arrives from {np.rad2deg(found.aoa_rad[0, i]):6.1f}°, departs to "
        f"{np.rad2deg(found.aod_rad[0, i]):6.1f}°, {1e9 * found.delay_s[0, i]:5.1f} ns, {found.snr_db[0, i]:5.1f} dB"
    )
plt.show()
