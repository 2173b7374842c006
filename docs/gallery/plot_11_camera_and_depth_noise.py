"""
Camera pictures and depth noise
===============================

Colour, exact depth, and depth with the noise of a structured-light camera: quantised disparity, ragged edges, missing
returns at grazing angles. The target is the box with markers.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import CameraConfig, DepthNoise, Simulator, SimulatorConfig, Task, make_building, read_plan
from robosim.robot.robots import RobotConfig

image = CameraConfig(width=320, height=320)
config = SimulatorConfig(
    physics="kinematic", robot=RobotConfig(camera=image, depth_noise=DepthNoise(level=1.0))
)
simulator = Simulator(make_building(read_plan("villa")), config)
task = Task(np.array([3.2, 9.6, -0.6]), np.array([5.3, 8.0]), shortest_m=2.3)
view = simulator.reset(task, np.random.default_rng(0))
true = simulator.true_depth
simulator.close()

error_mm = np.where((view.depth > 0) & (true > 0), 1000 * (view.depth - true), np.nan)
figure, axes = plt.subplots(2, 2, figsize=(9.5, 8.2), layout="constrained")
axes[0, 0].imshow(view.rgb)
axes[0, 0].set_title("colour")
for place, values, title, unit, options in (
    (axes[0, 1], np.where(true > 0, true, np.nan), "exact depth", "m", {"cmap": "cividis"}),
    (
        axes[1, 0],
        np.where(view.depth > 0, view.depth, np.nan),
        "measured depth, white: none",
        "m",
        {"cmap": "cividis"},
    ),
    (axes[1, 1], error_mm, "error", "mm", {"cmap": "PuOr", "vmin": -40, "vmax": 40}),
):
    figure.colorbar(place.imshow(values, **options), ax=place, label=f"[{unit}]", shrink=0.85)
    place.set_title(title)
for place in axes.flat:
    place.axis("off")
plt.show()
