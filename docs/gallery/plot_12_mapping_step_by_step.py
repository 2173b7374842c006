"""
Mapping step by step
====================

A robot explores a flat with noisy odometry and a noisy depth camera. White is what it has seen after 20, 80 and 250
decisions, black are the obstacles it has mapped, blue the true walls. The true way is green, the estimated one orange:
they hardly differ. The last picture compares the error of the estimated place with that of odometry alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import robosim
from slam.poses import compose

building = robosim.make_building(robosim.read_plan("flat"))
places = robosim.reach(building, 0.1)
task = robosim.make_task(places, np.random.default_rng(3))
simulated = robosim.SimulatorConfig(physics="kinematic", depth_noise=robosim.DepthNoise(level=1.0))
config = robosim.EpisodeConfig(goal="explore", mapper="classical", max_steps=251, simulator=simulated)
seen = []
log, _ = robosim.run_episode(
    building, places, task, config, lambda _, d: seen.append((d.estimate, d.view.odometry))
)
true, believed, alone = np.array(log.poses), np.array(log.estimates), [task.start]
for _, moved in seen[1:]:
    alone.append(compose(alone[-1], moved))

figure, axes = plt.subplots(2, 2, figsize=(10, 9), layout="constrained")
for place, step in zip(axes.flat, (20, 80, 250), strict=False):
    seen[step][0].plot(place, robot=False)
    building.plot(place)
    place.plot(*true[: step + 1, :2].T, color="#009E73", lw=3)
    place.plot(*believed[: step + 1, :2].T, color="#E69F00", lw=1)
    place.set(title=f"after {step} decisions", xlim=(0, 15.5), ylim=(0, 14), xlabel="x [m]", facecolor="0.85")
for ways, colour, label in ((alone, "#D55E00", "odometry alone"), (believed, "#E69F00", "mapper")):
    error_cm = 100 * np.hypot(*(np.array(ways)[:251, :2] - true[:251, :2]).T)
    axes[1, 1].semilogy(error_cm + 0.01, color=colour, label=label)
axes[1, 1].set(xlabel="decision", ylabel="error of the place [cm]", ylim=(0.1, 1000))
axes[1, 1].legend()
plt.show()
