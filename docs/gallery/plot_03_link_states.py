"""
Link states
===========

Where the strongest path is a straight line (line of sight), where at least one path turns once (first-order NLOS),
where all turn twice or more (higher-order NLOS), and where nothing arrives (outage). Without diffraction, on the left,
most of what lies round a corner would hear nothing.
"""

import matplotlib.pyplot as plt

from robosim import BuildingConfig, RadioConfig, RadioScene, read_plan, receiver_grid
from robosim.drawing.radio import draw_state
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
