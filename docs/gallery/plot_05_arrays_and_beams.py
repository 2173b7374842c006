"""
Arrays and beams
================

The base station has three arrays of 4 x 4 patches and 48 beams, the robot has three lines of 8 and 24 beams. Thin
lines are beams, thick lines are the best directivity of each array. With three arrays, every direction is within a few
decibels of the best one.
"""

import matplotlib.pyplot as plt
import numpy as np

from wireless import terminal_named

azimuth = np.linspace(-np.pi, np.pi, 1441)
figure, both = plt.subplots(1, 2, figsize=(10, 5.8), subplot_kw={"projection": "polar"}, layout="constrained")
for axes, name in zip(both, ("gnb", "ue"), strict=True):
    terminal = terminal_named(name)
    beams = 20 * np.log10(np.abs(terminal.beam_response(azimuth)) + 1e-6)
    best = 10 * np.log10(terminal.platform.directivity(azimuth) + 1e-12)
    for beam, array in zip(beams.T, terminal.beam_array, strict=True):
        axes.plot(azimuth, beam, lw=0.5, color=("#0072B2", "#E69F00", "#009E73")[array])
    for array, colour in enumerate(("#0072B2", "#E69F00", "#009E73")):
        face = np.rad2deg(terminal.platform.face_rad[array])
        axes.plot(azimuth, best[:, array], lw=2, color=colour, label=f"array facing {face:.0f}°")
    worst = best.max(axis=1)
    axes.set_title(f"{name}: {terminal.n_beams} beams, best {worst.min():.1f} to {worst.max():.1f} dBi")
    axes.set(ylim=(-15, 20), yticks=(-10, 0, 10, 20))
    axes.set_rlabel_position(60)
figure.suptitle("Directivity [dBi] by azimuth, at the horizon")
both[0].legend(loc="lower center", bbox_to_anchor=(1.1, -0.24), ncols=3)
plt.show()
