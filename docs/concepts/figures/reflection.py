"""Reflection and transmission of drywall at 28 GHz, over the angle from the wall's normal."""

import matplotlib.pyplot as plt
import numpy as np
from scipy.constants import speed_of_light

from wireless.em.fresnel import fresnel
from wireless.em.materials import wall_row

angle = np.linspace(0, 89.9, 900)
cos_i, wavenumber = np.cos(np.deg2rad(angle)), 2 * np.pi * 28e9 / speed_of_light
half, layer, cavity = (
    np.array([fresnel(c, wall, wavenumber) for c in cos_i]).T
    for wall in (
        wall_row("drywall", 28e9),
        wall_row("drywall", 28e9, 0.013),
        wall_row("drywall", 28e9, 0.013, 0.089),
    )
)
figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.2), sharey=True, layout="constrained")
for axes, name, part in ((left, "reflected", 0), (right, "transmitted", 2)):
    for values, colour, label in (
        (half, "#0072B2", "half-space"),
        (layer, "#E69F00", "one board, 13 mm"),
        (cavity, "#009E73", "two boards, 89 mm apart"),
    ):
        if values[part].any():
            for k, style in ((0, "-"), (1, "--")):
                level = 20 * np.log10(np.abs(values[part + k]) + 1e-6)
                axes.plot(angle, level, style, color=colour, lw=1.2, label=label if k == 0 else None)
    axes.set(
        xlabel="angle from the normal [degrees]",
        title=f"{name}: TE solid, TM dashed",
        ylim=(-50, 2),
        xlim=(0, 90),
    )
left.set_ylabel("over the incident field [dB]")
left.legend(loc="lower left")
