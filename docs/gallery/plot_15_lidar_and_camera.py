"""
A lidar and a camera
====================

The same robot explores a flat for 40 decisions, once with a depth camera of 90°, once with a 2D lidar of 360° and the
errors of a small one. The upper row shows one scan, the lower row the map.
"""

import matplotlib.pyplot as plt
import numpy as np

import robosim

building = robosim.make_building(robosim.read_plan("flat"), config=robosim.BuildingConfig(tolerance_m=0.05))
places = robosim.reach(building, 0.1)
task = robosim.make_task(places, np.random.default_rng(4))
noise = robosim.NoiseModel(level=1.0)
last = []

figure, axes = plt.subplots(2, 2, figsize=(9, 9.5), layout="constrained")
for column, (camera, lidar) in zip(axes.T, [("pyrender", "none"), ("none", "rplidar-a1")], strict=True):
    simulated = robosim.SimulatorConfig(
        physics="kinematic", camera=camera, robot=robosim.RobotConfig(lidar=lidar, noise=noise)
    )
    config = robosim.EpisodeConfig(
        goal="explore", explorer="gain", mapper="classical", max_steps=40, simulator=simulated
    )
    log, estimate = robosim.run_episode(building, places, task, config, lambda log, step: last.append(step))
    view, (x, y, yaw) = last[-1].sensed, last[-1].true.pose
    if view.laser is not None:
        bearing, reach = view.laser.bearing_rad, view.laser.range_m
    else:
        depth = np.where(view.depth[64] > 0, view.depth[64], np.inf)  # the row at the height of the camera
        bearing = np.arctan((63.5 - np.arange(128)) / 64)
        reach = depth / np.cos(bearing)
    building.plot(column[0])
    points = x + reach * np.cos(bearing + yaw), y + reach * np.sin(bearing + yaw)
    column[0].plot(*points, ".", color="#D55E00", ms=3)
    column[0].plot(x, y, "o", color="black")
    estimate.plot(column[1])
    error_m = np.hypot(*(np.array(log.poses) - log.estimates)[:, :2].T)
    name = "depth camera" if lidar == "none" else lidar
    column[0].set_title(f"{name}: {100 * log.coverage[-1]:.0f} % of the floor seen")
    column[1].set_title(f"position error {100 * np.sqrt((error_m**2).mean()):.1f} cm")
plt.show()
