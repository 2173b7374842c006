"""Parts of the system and the data between them."""

import matplotlib.pyplot as plt
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

figure, axes = plt.subplots(figsize=(9.6, 4.3))
axes.set(xlim=(0, 9.9), ylim=(0, 4.3))
axes.axis("off")
BLUE, ORANGE, GREEN = "#cfe6f5", "#fbe6c0", "#cdebdd"
boxes = {
    "building": (0.75, 2.15, "building\nwalls, materials", "#eeeeee"),
    "world": (2.75, 3.55, "physics\ntrue pose", GREEN),
    "camera": (2.75, 2.15, "camera\nRGB-D", GREEN),
    "tracer": (2.75, 0.75, "ray tracer\ntrue paths", BLUE),
    "mapper": (4.85, 2.15, "mapper\nmap, pose", ORANGE),
    "sounder": (4.85, 0.75, "sounding and\nestimation", BLUE),
    "state": (6.95, 0.75, "link state\nclassifier", BLUE),
    "goal": (6.95, 2.15, "goal policy", ORANGE),
    "planner": (9.05, 2.15, "planner,\ncontroller", ORANGE),
}
for x, y, text, colour in boxes.values():
    axes.add_patch(
        FancyBboxPatch(
            (x - 0.62, y - 0.34), 1.24, 0.68, boxstyle="round,pad=0.04", fc=colour, ec="0.4", lw=0.8
        )
    )
    axes.text(x, y, text, ha="center", va="center", fontsize=8)


def arrow(a, b, text="", off=(0, 0.12), bend=0.0):
    """An arrow from one box to another, with the name of the data."""
    (x0, y0), (x1, y1) = boxes[a][:2], boxes[b][:2]
    flat = abs(y0 - y1) < 0.1
    side = (0.66 if x1 > x0 else -0.66) if flat or (abs(x1 - x0) > 1.2 and abs(y1 - y0) < 0.1) else 0
    rise = 0 if side else (0.38 if y1 > y0 else -0.38)
    start, end = (x0 + side, y0 + rise), (x1 - side, y1 - rise)
    axes.add_patch(
        FancyArrowPatch(
            start,
            end,
            arrowstyle="-|>",
            mutation_scale=10,
            color="0.3",
            lw=1,
            connectionstyle=f"arc3,rad={bend}",
        )
    )
    middle = (start[0] + end[0]) / 2 + off[0], (start[1] + end[1]) / 2 + off[1]
    axes.text(*middle, text, ha="center", va="center", fontsize=6.5, color="0.2")


arrow("building", "world")
arrow("building", "camera")
arrow("building", "tracer")
arrow("world", "camera", "true pose", (0.38, 0))
arrow("camera", "mapper", "depth")
arrow("tracer", "sounder", "paths")
arrow("sounder", "state", "estimates")
arrow("mapper", "goal", "map, pose")
arrow("state", "goal", "directions,\nstate", (0.42, 0))
arrow("goal", "planner", "goal")
arrow("world", "mapper", "odometry", (0.45, 0.1))
axes.add_patch(
    FancyArrowPatch(
        (9.05, 2.53), (3.41, 3.6), arrowstyle="-|>", mutation_scale=10, color="0.3", lw=1,
        connectionstyle="angle,angleA=90,angleB=0,rad=8",
    )
)  # fmt: skip
axes.text(
    6.3, 3.72, "action: 0.25 m forward or back, 10° left or right", ha="center", fontsize=6.5, color="0.2"
)
axes.text(
    0.15,
    0.1,
    "green: simulated truth    blue: radio    orange: estimates and decisions of the robot",
    fontsize=6.5,
)
