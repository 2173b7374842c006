"""
Link states
===========

Line of sight: the strongest path is a straight line. First-order NLOS: at least one path has one interaction.
Higher-order NLOS: all paths have two or more. Outage: there is no path. Without diffraction, on the left, most places
round a corner are in outage.
"""

import matplotlib.pyplot as plt

from robosim import BuildingConfig, RadioConfig, RadioScene, read_plan, receiver_grid
from robosim.drawing.radio_pictures import draw_state
from wireless import TracerConfig

plan, walls = read_plan("office"), BuildingConfig(tolerance_m=0.05)
figure, both = plt.subplots(1, 2, figsize=(11, 6.6), layout="constrained")
for axes, diffraction in zip(both, (False, True), strict=True):
    config = RadioConfig(tracer=TracerConfig(diffraction=diffraction), building=walls)
    scene = RadioScene(plan, config)
    tx = scene.places(((6.5, 13.0),), "tx")
    grid = receiver_grid(scene.building, 0.25, config.height_m)
    state = scene.tracer.trace(tx, grid.position).link_state()[0]
    title = "with diffraction" if diffraction else "reflections only"
    draw_state(axes, scene.building, grid, state, tx[0], title)
plt.show()
