"""
The same search with two policies
=================================

The robot starts at the circle and does not know the position of the transmitter. With its camera alone it must look
into the rooms; with its radio it follows angles of arrival. Both searches have the same building and the same noise.
"""

import matplotlib.pyplot as plt
import numpy as np

import robosim

building = robosim.make_building(
    robosim.read_plan("townhouse"), config=robosim.BuildingConfig(tolerance_m=0.05)
)
places = robosim.reach(building, 0.1)
task = robosim.make_task(places, np.random.default_rng([1, 0]), min_path_m=8.0)
simulated = robosim.SimulatorConfig(physics="kinematic")

figure, both = plt.subplots(1, 2, figsize=(9.5, 6.6), sharey=True, layout="constrained")
for axes, goal in zip(both, ("visual", "los-or-first"), strict=True):
    config = robosim.EpisodeConfig(goal=goal, mapper="classical", simulator=simulated)
    log, _ = robosim.run_episode(building, places, task, config)
    trajectory = np.array(log.poses)
    building.plot(axes)
    axes.scatter(*trajectory[:, :2].T, c=np.arange(len(trajectory)), cmap="viridis", s=8)
    axes.plot(*trajectory[0, :2], "o", color="white", mec="black", ms=9)
    axes.plot(*task.target, "*", color="#D55E00", ms=16)
    score = log.result()
    driven = f"{score['path_length_m']:.1f} m driven, SPL {score['spl']:.2f}"
    title = f"{goal}: {log.ended} after {log.steps} steps\n{driven}"
    axes.set(xlabel="x [m]", aspect="equal", title=title)
both[0].set_ylabel("y [m]")
plt.show()
