"""
Reach of two robots
===================

A small robot passes every door of this cottage, a robot with a radius of 0.36 m does not. Blue is the area that the
hull can cover, orange is floor that it cannot reach from the largest part.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from robosim import make_building, reach, read_plan

plan = read_plan("cottage")
building = make_building(plan)
rows, columns = plan.occupancy.shape
extent = (0, columns * plan.resolution_m, 0, rows * plan.resolution_m)
colours = ListedColormap(["0.35", "#E69F00", "#56B4E9"])

figure, both = plt.subplots(1, 2, figsize=(9.5, 5.2), sharey=True, layout="constrained")
for axes, radius_m in zip(both, (0.10, 0.36), strict=True):
    places = reach(building, radius_m)
    areas = [places.swept(part) for part in range(1, places.n_parts + 1)]
    largest = max(areas, key=np.sum)
    kind = np.where(largest, 2, np.where(plan.free, 1, 0))
    axes.imshow(kind, cmap=colours, vmin=0, vmax=2, origin="lower", extent=extent)
    share = 100 * largest.sum() / plan.free.sum()
    axes.set(xlabel="x [m]", title=f"hull of {radius_m:.2f} m radius: {share:.0f} % of the floor")
both[0].set_ylabel("y [m]")
names = {"#56B4E9": "the hull can cover it", "#E69F00": "out of its reach", "0.35": "walls and outside"}
figure.legend([Patch(color=c) for c in names], names.values(), loc="outside lower center", ncols=3)
plt.show()
