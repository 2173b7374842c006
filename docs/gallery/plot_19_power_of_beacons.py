"""
Walls and beacons from received power
=====================================

A robot drives through a flat and receives the power of a Bluetooth beacon, whose transmit power is unknown. First the
place of the beacon: a law of distance with the walls of the plan, and shadowing that is correlated along the route.
Then, with the place known, permittivity and conductivity of the walls, fitted on half of the floor. Powers are traced
here; a table of a real robot's goes to `robosim locate` and `robosim calibrate-materials`.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import RadioConfig, RadioScene, read_plan, receiver_grid
from robosim.calibration.measured_powers import MeasuredPowers
from robosim.calibration.power_fit import PowerFitConfig, fit_powers
from robosim.positioning.beacon_places import locate_beacon
from wireless import TracerConfig
from wireless.positioning.received_power import PowerReadings

plan, rng = read_plan("flat"), np.random.default_rng(4)
tracing = TracerConfig(max_reflections=1, max_transmissions=2, diffraction=False)
fit = PowerFitConfig(tracer=tracing, beacon_orders=0)
scene = RadioScene(plan, RadioConfig(frequency_hz=fit.frequency_hz, tracer=tracing))
beacon, places = np.array([[7.0, 7.0, 2.1]]), receiver_grid(scene.building, 0.5, 1.3).position
paths = scene.tracer.trace(beacon, places)
traced = np.bincount(paths.link, paths.power * np.cos(paths.aoa_el) ** 2, len(places))
places, traced = places[traced > 0], traced[traced > 0]
power = 10 * np.log10(traced) - 5 + rng.normal(0, 4, len(places))
unknown, ones = np.full(len(power), np.nan), np.ones(len(power))
readings = PowerReadings(xy=places[:, :2], heading_rad=unknown, power_dbm=power, count=ones)
found = locate_beacon(readings, plan, 0.3)
measured = MeasuredPowers(
    names=("1",), beacons=beacon, places=places, heading_rad=None, power_dbm=power[None]
)
fitted = fit_powers(measured, plan, fit)
value, deviation = fitted.parameters["relative_permittivity"]

figure, axes = plt.subplots(1, 2, figsize=(12, 5), layout="constrained", width_ratios=(1.2, 1))
plan.plot(axes[0])
points = axes[0].scatter(*places[:, :2].T, c=power, s=12, cmap="viridis")
axes[0].plot(*found.xy, "o", color="#D55E00", mec="white", ms=10, label="located")
axes[0].plot(*beacon[0, :2], "k*", ms=14, mec="white", label="true")
axes[0].legend()
figure.colorbar(points, ax=axes[0], label="power [dBm]")
axes[1].plot(fitted.predicted_dbm[0], power, ".")
axes[1].axline((-60, -60), slope=1, color="black", lw=0.8)
axes[1].set(
    xlabel="predicted [dBm]", ylabel="received [dBm]", title=f"permittivity {value:.1f} ± {deviation:.1f}"
)
plt.show()
