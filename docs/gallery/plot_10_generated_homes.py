"""
Generated homes
===============

Each seed generates one building. Networks are trained in generated homes and tested in scanned homes.
"""

import matplotlib.pyplot as plt

from robosim import GeneratorConfig, generate_plan

figure, grid = plt.subplots(2, 4, figsize=(12, 6.6), layout="constrained")
for seed, axes in enumerate(grid.flat):
    style = "office" if seed % 4 == 3 else "home"
    plan = generate_plan(seed, config=GeneratorConfig(style=style))
    plan.plot(axes)
    area_m2 = plan.free.sum() * plan.resolution_m**2
    axes.set_title(f"{style}, seed {seed}: {area_m2:.0f} m² free", fontsize=9)
    axes.tick_params(labelsize=7)
    axes.set(xlabel=None, ylabel=None)
plt.show()
