"""
Mapping step by step
====================

A robot explores a flat with noisy odometry and a noisy depth camera. The maps show what it has seen after 20, 80 and
250 decisions (white: free, black: obstacles, blue: true walls). The true trajectory is green, the estimated one is
orange. The last picture compares the error of the estimated position with that of odometry alone.
"""

import matplotlib.pyplot as plt
import numpy as np

import robosim
from slam.poses import compose

building = robosim.make_building(robosim.read_plan("flat"))
places = robosim.reach(building, 0.1)
task = robosim.make_task(places, np.random.default_rng(3))
simulated = robosim.SimulatorConfig(
    physics="kinematic", robot=robosim.RobotConfig(depth_noise=robosim.DepthNoise(level=1.0))
)
config = robosim.EpisodeConfig(goal="explore", mapper="classical", max_steps=251, simulator=simulated)
steps = []
log, _ = robosim.run_episode(
    building, places, task, config, lambda _, step: steps.append((step.estimated.map, step.sensed.odometry))
)
true, estimated, by_odometry = np.array(log.poses), np.array(log.estimates), [task.start]
for _, motion in steps[1:]:
    by_odometry.append(compose(by_odometry[-1], motion))

figure, axes = plt.subplots(2, 2, figsize=(10, 9), layout="constrained")
for place, step in zip(axes.flat, (20, 80, 250), strict=False):
    steps[step][0].plot(place, robot=False)
    building.plot(place)
    place.plot(*true[: step + 1, :2].T, color="#009E73", lw=3)
    place.plot(*estimated[: step + 1, :2].T, color="#E69F00", lw=1)
    place.set(title=f"after {step} decisions", xlim=(0, 15.5), ylim=(0, 14), xlabel="x [m]", facecolor="0.85")
for trajectory, colour, label in (
    (by_odometry, "#D55E00", "odometry alone"),
    (estimated, "#E69F00", "mapper"),
):
    error_cm = 100 * np.hypot(*(np.array(trajectory)[:251, :2] - true[:251, :2]).T)
    axes[1, 1].semilogy(error_cm + 0.01, color=colour, label=label)
axes[1, 1].set(xlabel="decision", ylabel="position error [cm]", ylim=(0.1, 1000))
axes[1, 1].legend()
plt.show()
