"""
Radio map of a flat
===================

Paths from one transmitter to receivers on a grid: the power of the strongest path as a heat map, and its angle of
arrival. Behind a door, arrows point at the door instead of the transmitter, which is why following them leads there.
"""

import matplotlib.pyplot as plt

from robosim import RadioConfig, RadioScene, read_plan, receiver_grid
from robosim.drawing.radio_pictures import draw_arrival, draw_power

config = RadioConfig()
scene = RadioScene(read_plan("flat"), config)
tx = scene.places(((7.0, 7.0),), "tx")
grid = receiver_grid(scene.building, 0.2, config.height_m)
paths = scene.tracer.trace(tx, grid.position)
strongest = paths.strongest()

figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5.4), layout="constrained")
draw_power(left, scene.building, grid, strongest, tx[0], config.tx_power_dbm)
draw_arrival(right, scene.building, grid, strongest, tx[0])
plt.show()
