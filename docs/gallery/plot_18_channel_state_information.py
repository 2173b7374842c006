"""
Channel state information
=========================

What a Wi-Fi receiver with four antennas estimates: the frequency response of each antenna on the 64 subcarriers of
20 MHz, here of all 256 of 80 MHz, and the taps of the channel. The transmitter has a half-wave dipole. The map shows
the root mean square delay spread at each place, which is small where one path is far stronger than all others.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import RadioConfig, RadioScene, read_plan, receiver_grid
from wireless import Channel, MountedArray, TracerConfig, subcarriers, uniform_array

tracing = TracerConfig(floor_ceiling=True, max_reflections=2, max_transmissions=2)
config = RadioConfig(frequency_hz=5.2e9, tracer=tracing)
scene = RadioScene(read_plan("flat"), config)
tx = scene.places(((7.0, 7.0),), "tx")
grid = receiver_grid(scene.building, 0.3, config.height_m)
one = int(np.argmin(np.hypot(*(grid.position[:, :2] - (11.5, 6.5)).T)))

dipole = MountedArray(array=uniform_array(1, element="dipole"))
line = MountedArray(array=uniform_array(4, element="dipole"), yaw_rad=-np.pi / 4)
channel = Channel.from_paths(scene.tracer.trace(tx, grid.position), tx=dipole, rx=line)
offset_hz = subcarriers(256, 312.5e3)
response = channel.cfr(offset_hz)[0, one, :, 0]
taps = channel.synchronised().taps(80e6, -6, 20)[0, one, 0, 0]

figure, axes = plt.subplots(1, 3, figsize=(14, 4), layout="constrained", width_ratios=(1.2, 1, 1.2))
axes[0].axvspan(-10, 10, color="0.92", label="20 MHz")
for port in range(4):
    axes[0].plot(offset_hz / 1e6, 20 * np.log10(np.abs(response[port])), label=f"antenna {port + 1}")
axes[0].set(xlabel="frequency from 5.2 GHz [MHz]", ylabel="|H| [dB]", title="frequency response")
axes[0].legend(fontsize="small")
axes[1].stem(np.arange(-6, 21), 20 * np.log10(np.abs(taps)), bottom=-160)
axes[1].set(
    xlabel="tap of 12.5 ns after the first path", ylabel="|h| [dB]", title="taps at 80 MHz, antenna 1"
)
axes[1].set_ylim(-120, None)
scene.building.plot(axes[2])
spread = axes[2].scatter(*grid.position[:, :2].T, c=1e9 * channel.delay_spread_s()[0], s=20, marker="s")
axes[2].plot(*tx[0, :2], "r*", ms=12)
axes[2].plot(*grid.position[one, :2], "wP", mec="k", ms=12)
figure.colorbar(spread, ax=axes[2], label="delay spread [ns]")
plt.show()
