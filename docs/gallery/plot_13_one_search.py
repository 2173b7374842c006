"""
One search in six pictures
==========================

The policy ``fused`` maintains a probability for each possible position of the transmitter. The pictures show it at six
decisions (purple: likely) on the robot's map (white: seen and free, black: obstacles), with the trajectory, the goal,
and the angle of arrival of the strongest path.
"""

import matplotlib.pyplot as plt
import numpy as np

import robosim

building = robosim.make_building(robosim.read_plan("villa"), config=robosim.BuildingConfig(tolerance_m=0.05))
places = robosim.reach(building, 0.1)
task = robosim.make_task(places, np.random.default_rng([2, 0]), min_path_m=9.0)
kinematic = robosim.SimulatorConfig(physics="kinematic")
config = robosim.EpisodeConfig(goal="fused", mapper="classical", seed=2, simulator=kinematic)
snapshots = []


def record(log, step):
    """Called at each step."""
    estimate, belief, measurement = step.estimated.map, step.decided.belief, step.estimated.measurement
    seen = np.where(estimate.obstacle, 0.0, np.where(estimate.explored, 1.0, 0.8))
    snapshots.append(
        (estimate.frame, seen, belief.frame, belief.probability().copy(), step.decided.goal, measurement)
    )


def show(axes, frame, cells, **options):
    """Draw a grid at its position."""
    (x, y), (ny, nx), cell = frame.origin_xy, frame.shape, frame.resolution_m
    axes.imshow(cells, origin="lower", extent=(x, x + nx * cell, y, y + ny * cell), **options)


log, _ = robosim.run_episode(building, places, task, config, record)

figure, axes = plt.subplots(2, 3, figsize=(12, 11), layout="constrained")
for place, step in zip(axes.flat, np.linspace(0, len(snapshots) - 5, 6, dtype=int), strict=True):
    map_frame, seen, frame, probability, goal, measurement = snapshots[step]
    show(place, map_frame, seen, cmap="gray", vmin=0, vmax=1)
    shade = np.log10(np.maximum(probability, 1e-12) / probability.max())
    show(place, frame, np.ma.masked_less(shade, -2), cmap="Purples", vmin=-2.5, vmax=0, alpha=0.6)
    place.plot(*np.array(log.poses)[: step + 1, :2].T, color="#009E73", lw=2.5, label="trajectory")
    for angle in measurement.aoa_rad[:1]:
        place.quiver(*measurement.pose[:2], np.cos(angle), np.sin(angle), color="#0072B2", scale=7)
    place.plot(*goal, "X", color="black", mec="white", ms=11, label="goal")
    place.plot(*task.target, "*", color="#D55E00", mec="white", ms=16, label="transmitter")
    title = f"decision {step}: {measurement.state.name.lower().replace('_', ' ')}"
    place.set(
        title=title, xlabel="x [m]", ylabel="y [m]", xlim=(-0.5, 15), ylim=(-0.5, 19.5), facecolor="0.8"
    )
axes[0, 0].legend(loc="upper left")
plt.show()
