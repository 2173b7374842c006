"""Frames of map, robot and camera from above and from the side; directions of departure and arrival."""

import matplotlib.pyplot as plt
import numpy as np

RED, GREEN, BLUE = "#D55E00", "#009E73", "#0072B2"


def axis(axes, at, to, colour, name):
    """An arrow with the name of an axis."""
    axes.annotate("", at + to, at, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
    axes.text(*(at + 1.16 * to), name, color=colour, ha="center", va="center", fontsize=8)


figure, (plan, side, ray) = plt.subplots(1, 3, figsize=(9.6, 3.1), layout="constrained")
origin, robot, yaw = np.array([0.2, 0.2]), np.array([1.9, 1.2]), np.deg2rad(35)
axis(plan, origin, np.array([0.7, 0]), RED, "x")
axis(plan, origin, np.array([0, 0.7]), GREEN, "y")
plan.text(0.25, 0.02, "map (z up)", fontsize=8)
ahead = 0.75 * np.array([np.cos(yaw), np.sin(yaw)])
plan.add_patch(plt.Circle(robot, 0.25, fc="0.92", ec="0.4"))
axis(plan, robot, ahead, RED, "x")
axis(plan, robot, np.array([-ahead[1], ahead[0]]), GREEN, "y")
plan.plot([robot[0], robot[0] + 0.9], [robot[1]] * 2, ":", color="0.5", lw=0.8)
angle = np.linspace(0, yaw, 30)
plan.plot(robot[0] + 0.5 * np.cos(angle), robot[1] + 0.5 * np.sin(angle), color="0.4", lw=0.8)
plan.text(robot[0] + 0.62, robot[1] + 0.16, "yaw ψ", fontsize=8)
plan.set_title("from above: map and robot", fontsize=9)
plan.set(xlim=(0, 3), ylim=(-0.1, 2.3))

side.plot([0.2, 2.8], [0.3, 0.3], color="0.4", lw=1)
side.add_patch(plt.Rectangle((0.95, 0.3), 0.5, 0.25, fc="0.92", ec="0.4"))
side.plot([1.2, 1.2], [0.55, 1.5], color="0.4", lw=1.5)
axis(side, np.array([1.2, 0.3]), np.array([0.75, 0]), RED, "x")
axis(side, np.array([1.2, 0.3]), np.array([0, 0.6]), BLUE, "z")
axis(side, np.array([1.2, 1.6]), np.array([0.75, 0]), BLUE, "z")
axis(side, np.array([1.2, 1.6]), np.array([0, -0.6]), GREEN, "y")
side.text(1.3, 1.85, "camera (x into the page)", fontsize=8)
side.text(1.55, 0.02, "robot (y into the page)", fontsize=8)
side.set_title("from the side: robot and camera", fontsize=9)
side.set(xlim=(0, 3), ylim=(-0.1, 2.3))

tx, corner, rx = np.array([0.4, 1.9]), np.array([1.6, 1.2]), np.array([2.6, 0.4])
ray.add_patch(plt.Polygon([(0, 0), (1.6, 0), (1.6, 1.2), (0, 1.2)], fc="0.88", ec="0.4"))
ray.plot(*np.array([tx, corner, rx]).T, "--", color="0.5", lw=1)
out, back = (corner - tx) / np.hypot(*(corner - tx)), (corner - rx) / np.hypot(*(corner - rx))
axis(ray, tx, 0.6 * out, RED, "")
axis(ray, rx, 0.6 * back, BLUE, "")
ray.plot(*tx, "*", color=RED, ms=12)
ray.plot(*rx, "o", color=BLUE, ms=7)
ray.text(0.55, 2.0, "transmitter, departure", color=RED, fontsize=8)
ray.text(1.75, 0.12, "receiver, arrival", color=BLUE, fontsize=8)
ray.set_title("directions of one path", fontsize=9)
ray.set(xlim=(0, 3), ylim=(-0.1, 2.3))
for axes in (plan, side, ray):
    axes.set_aspect("equal")
    axes.axis("off")
