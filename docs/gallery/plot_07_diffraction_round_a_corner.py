"""
Diffraction round a corner
==========================

A receiver circles the outer corner of a building at a distance of 1.5 m, at 3 GHz. With geometrical optics alone the
field jumps where the corner hides the transmitter. The uniform theory of diffraction (UTD) makes it continuous: -6 dB
at the shadow boundary, as in the Fresnel integral of a sharp edge.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from scipy.special import fresnel

from wireless import Tracer, TracerConfig

box = trimesh.creation.box(bounds=[(-40, -40, -40), (0, 0, 40)])  # the corner is at x = y = 0
angle = np.arange(-89.75, 180, 0.25)  # of the receiver, from +x; the walls are at -90 and 180 degrees
rx = 1.5 * np.column_stack([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle)), 0 * angle])
tx = 5 * np.array([[np.cos(np.deg2rad(140)), np.sin(np.deg2rad(140)), 0.0]])
distance, wavelength = np.linalg.norm(rx - tx, axis=1), 299792458 / 3e9
figure, axes = plt.subplots(figsize=(9, 4.8), layout="constrained")
for bent, colour, label in ((True, "#0072B2", "with diffraction (UTD)"), (False, "#E69F00", "without")):
    config = TracerConfig(max_reflections=1, diffraction=bent, diffraction_reflections=0)
    paths = Tracer(box, frequency_hz=3e9, config=config).trace(tx, rx)
    field = np.zeros(len(rx), complex)
    np.add.at(field, paths.rx, paths.gain[:, 0, 0])
    level = 20 * np.log10(np.maximum(np.abs(field) * 4 * np.pi * distance / wavelength, 1e-4))
    axes.plot(angle, level, color=colour, label=label)
# Sharp edge: excess length over the edge in half wavelengths, negative in line of sight.
v = np.sign(-40 - angle) * 2 * np.sqrt((5 + 1.5 - distance) / wavelength)
sine, cosine = fresnel(v)
edge = 20 * np.log10(np.hypot(0.5 - cosine, 0.5 - sine) / np.sqrt(2))
axes.plot(angle, edge, "--", color="#D55E00", lw=1.0, label="sharp edge (Fresnel integral)")
for at, name in ((-40, "hidden | in sight"), (40, "direct only | and reflected")):
    axes.axvline(at, color="0.6", lw=0.8)
    axes.text(at, 8.2, name, ha="center")
axes.set(xlabel="direction of the receiver from the corner [degrees]", ylabel="field over free space [dB]")
axes.set(xlim=(-90, 180), ylim=(-45, 11))
axes.legend(loc="lower right")
plt.show()
