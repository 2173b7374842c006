"""
One search, and what the robot believes
=======================================

The policy ``fused`` keeps a probability for each place where the transmitter may be. The pictures show it at four
decisions (dark: likely), with the robot's way so far and its goal.
"""

import matplotlib.pyplot as plt
import numpy as np

import robosim

building = robosim.make_building(robosim.read_plan("villa"), config=robosim.BuildingConfig(tolerance_m=0.05))
places = robosim.reach(building, 0.1)
task = robosim.make_task(places, np.random.default_rng([2, 0]), min_path_m=9.0)
kinematic = robosim.SimulatorConfig(physics="kinematic")
config = robosim.EpisodeConfig(goal="fused", mapper="classical", seed=2, simulator=kinematic)
kept = []


def keep(log, decision):
    """Called once a decision."""
    kept.append((decision.belief.probability().copy(), decision.goal, decision.situation.measured().state))


log, _ = robosim.run_episode(building, places, task, config, keep)

figure, axes = plt.subplots(2, 2, figsize=(9, 11), layout="constrained")
for place, part in zip(axes.flat, (0.1, 0.3, 0.6, 0.95), strict=True):
    step = int(part * (len(kept) - 1))
    probability, goal, state = kept[step]
    x, y = task.start[:2] - 30.0  # the belief reaches 30 m from there
    shade = np.log10(np.maximum(probability, 1e-12) / probability.max())
    place.imshow(shade, cmap="Purples", vmin=-3, vmax=0, origin="lower", extent=(x, x + 60, y, y + 60))
    building.plot(place)
    place.plot(*np.array(log.poses)[: step + 1, :2].T, color="#009E73", lw=2.5, label="way")
    place.plot(*goal, "X", color="black", mec="white", ms=11, label="goal")
    place.plot(*task.target, "*", color="#D55E00", mec="white", ms=16, label="transmitter")
    title = f"decision {step}: {state.name.lower().replace('_', ' ')}"
    place.set(title=title, xlabel="x [m]", ylabel="y [m]", xlim=(-0.5, 15), ylim=(-0.5, 19.5))
axes[0, 0].legend(loc="upper right")
plt.show()
