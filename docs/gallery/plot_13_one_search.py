"""
One search, and what the robot believes
=======================================

The policy ``fused`` keeps a probability for each place where the transmitter may be. The pictures show it at four
decisions (dark: likely), with the robot's way so far and its goal.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim.building.building import BuildingConfig, make_building
from robosim.building.reach import reach
from robosim.drawing.plots import draw_walls
from robosim.episode import EpisodeConfig, run_episode
from robosim.plans.files import read_plan
from robosim.simulator import SimulatorConfig
from robosim.task.tasks import make_task

building = make_building(read_plan("villa"), config=BuildingConfig(tolerance_m=0.05))
places = reach(building, 0.1)
task = make_task(places, np.random.default_rng([2, 0]), min_path_m=9.0)
config = EpisodeConfig(
    goal="fused", mapper="classical", seed=2, simulator=SimulatorConfig(physics="kinematic")
)
kept = []
log, _ = run_episode(
    building,
    places,
    task,
    config,
    lambda d: kept.append((d.belief.probability().copy(), d.goal, d.heard.state)),
)

figure, axes = plt.subplots(2, 2, figsize=(9, 11), layout="constrained")
for place, part in zip(axes.flat, (0.1, 0.3, 0.6, 0.95), strict=True):
    step = int(part * (len(kept) - 1))
    probability, goal, state = kept[step]
    x, y = task.start[:2] - 30.0  # the belief reaches 30 m from there
    shade = np.log10(np.maximum(probability, 1e-12) / probability.max())
    place.imshow(shade, cmap="Purples", vmin=-3, vmax=0, origin="lower", extent=(x, x + 60, y, y + 60))
    draw_walls(place, building)
    place.plot(*np.array(log.poses)[: step + 1, :2].T, color="#009E73", lw=2.5, label="way")
    place.plot(*goal, "X", color="black", mec="white", ms=11, label="goal")
    place.plot(*task.target, "*", color="#D55E00", mec="white", ms=16, label="transmitter")
    title = f"decision {step}: {state.name.lower().replace('_', ' ')}"
    place.set(title=title, xlabel="x [m]", ylabel="y [m]", xlim=(-0.5, 15), ylim=(-0.5, 19.5))
axes[0, 0].legend(loc="upper right")
plt.show()
