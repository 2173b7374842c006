"""
One search in six pictures
==========================

The policy ``fused`` keeps a probability for each place where the transmitter may be. The pictures show it at six
decisions (purple: likely), on the map that the robot has by then (white: seen and free, black: obstacles), with its way
so far, its goal, and the direction in which the strongest path arrives.
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
    estimate, belief, heard = decision.estimate, decision.belief, decision.situation.measured()
    seen = np.where(estimate.obstacle, 0.0, np.where(estimate.explored, 1.0, 0.8))
    kept.append((belief.frame, belief.probability().copy(), estimate.frame, seen, decision.goal, heard))


def extent(frame):
    """Edges of a grid [m]: left, right, below, above."""
    (x, y), (ny, nx), cell = frame.origin_xy, frame.shape, frame.resolution_m
    return x, x + nx * cell, y, y + ny * cell


log, _ = robosim.run_episode(building, places, task, config, keep)

figure, axes = plt.subplots(2, 3, figsize=(12, 11), layout="constrained")
for place, part in zip(axes.flat, (0.0, 0.3, 0.6, 0.72, 0.82, 0.97), strict=True):
    step = int(part * (len(kept) - 1))
    frame, probability, cells, seen, goal, heard = kept[step]
    place.set_facecolor("0.8")
    place.imshow(seen, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent(cells))
    shade = np.log10(np.maximum(probability, 1e-12) / probability.max())
    place.imshow(
        np.ma.masked_less(shade, -2),
        cmap="Purples",
        vmin=-2.5,
        vmax=0,
        alpha=0.6,
        origin="lower",
        extent=extent(frame),
    )
    place.plot(*np.array(log.poses)[: step + 1, :2].T, color="#009E73", lw=2.5, label="way")
    if len(heard.aoa_rad):
        ahead = 2.0 * np.array([np.cos(heard.aoa_rad[0]), np.sin(heard.aoa_rad[0])])
        place.annotate(
            "",
            heard.pose[:2] + ahead,
            heard.pose[:2],
            arrowprops={"color": "#0072B2", "width": 2, "headwidth": 9},
        )
    place.plot([], [], color="#0072B2", lw=2, label="strongest arrival")
    place.plot(*goal, "X", color="black", mec="white", ms=11, label="goal")
    place.plot(*task.target, "*", color="#D55E00", mec="white", ms=16, label="transmitter")
    title = f"decision {step}: {heard.state.name.lower().replace('_', ' ')}"
    place.set(title=title, xlabel="x [m]", ylabel="y [m]", xlim=(-0.5, 15), ylim=(-0.5, 19.5))
axes[0, 0].legend(loc="upper left")
plt.show()
