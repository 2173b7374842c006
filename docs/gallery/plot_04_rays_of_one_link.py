"""
Rays of one link
================

All paths between two points without line of sight, from above. Circles are reflections, triangles are diffractions.
The delay profile shows when each path arrives, and with which power.
"""

import matplotlib.pyplot as plt

from robosim import RadioConfig, RadioScene, read_plan
from robosim.drawing.radio_pictures import draw_rays

scene = RadioScene(read_plan("flat"), RadioConfig())
tx, rx = scene.places(((7.0, 7.0), (11.5, 11.5)), "places")
paths = scene.tracer.trace(tx[None], rx[None])

figure, (above, below) = plt.subplots(2, 1, figsize=(7.5, 8.6), height_ratios=(3, 1), layout="constrained")
draw_rays(above, scene.building, paths, 0, 0, 23.0)
for order, colour, marker in (
    (0, "#0072B2", "s"),
    (1, "#56B4E9", "o"),
    (2, "#E69F00", "^"),
    (3, "#CC79A7", "D"),
):
    mine = paths.order == order
    if mine.any():
        lines = below.stem(1e9 * paths.delay_s[mine], 23 + paths.power_db[mine], bottom=-150, basefmt=" ")
        plt.setp(
            lines.markerline, color=colour, marker=marker, label=f"{order} interaction{'s' * (order != 1)}"
        )
        plt.setp(lines.stemlines, color=colour)
below.set(ylim=(-150, None), xlabel="delay [ns]", ylabel="received power [dBm]")
below.legend(ncols=4, loc="upper right", fontsize=8)
plt.show()
