"""
How many reflections are enough?
================================

Each additional reflection takes longer and adds weaker paths. The reference has six reflections, and diffraction with
two. The curves show the power that a link misses, and the legend the links per second of one core.
"""

import time

import matplotlib.pyplot as plt
import numpy as np

from robosim import BuildingConfig, RadioConfig, RadioScene, read_plan, receiver_grid
from wireless import TracerConfig

settings = {"line of sight": (0, -1), "1 reflection": (1, -1), "3 reflections": (3, -1)}
settings |= {"1, or diffraction": (1, 0), "3, or diffraction and 1": (3, 1), "reference": (6, 2)}
power, rate = {}, {}
for name, (reflections, bent) in settings.items():
    bends = {"diffraction": bent >= 0, "diffraction_reflections": max(bent, 0)}
    config = TracerConfig(max_reflections=reflections, max_paths=100, **bends)
    walls = BuildingConfig(tolerance_m=0.05)
    scene = RadioScene(read_plan("flat"), RadioConfig(tracer=config, building=walls))
    rx, tx = receiver_grid(scene.building, 0.5, 1.5).position, scene.places(((7.0, 7.0),), "tx")
    scene.tracer.trace(tx, rx[:2])  # compiles, and prepares the transmitter
    start = time.perf_counter()
    paths = scene.tracer.trace(tx, rx, workers=1)
    rate[name] = len(rx) / (time.perf_counter() - start)
    power[name] = np.bincount(paths.rx, paths.power, len(rx))
figure, axes = plt.subplots(figsize=(8.5, 4.6), layout="constrained")
colours = "#999999", "#E69F00", "#D55E00", "#56B4E9", "#0072B2"
for name, colour in zip(list(settings)[:-1], colours, strict=True):
    missed = 10 * np.log10(power["reference"] / np.maximum(power[name], 1e-3 * power["reference"]))
    share, label = np.linspace(0, 100, len(missed)), f"{name}: {rate[name]:.0f} links/s"
    axes.plot(np.sort(missed), share, color=colour, label=label)
axes.set(xlim=(0, 30), xlabel="power missed at most [dB]", ylabel="share of links [%]")
axes.legend(title="most reflections (the last is the default)", loc="lower right")
plt.show()
