"""
Over and under a table
======================

Furniture of true height in a room. The camera looks over the table and under it; a robot of 0.4 m drives below the
top, where a robot of 1.25 m cannot; the top reflects waves, and its edges diffract them.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import CameraConfig, make_building, make_piece, plan_from_array, reach
from robosim.camera.cameras import make_camera
from robosim.camera.model import camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from wireless import Tracer, TracerConfig

pieces = [
    make_piece("table", at=(3.0, 2.0), yaw_rad=0.3),
    make_piece("chair", at=(2.8, 2.75), yaw_rad=0.3 + np.pi),
    make_piece("cupboard", at=(2.2, 3.6), yaw_rad=np.pi),
    make_piece("sofa", at=(4.3, 3.45), yaw_rad=np.pi),
    make_piece("shelf", at=(5.75, 1.6), yaw_rad=np.pi / 2),
    make_piece("plant", at=(5.65, 3.5)),
]
cells = np.zeros((80, 120), np.uint8)
building = make_building(plan_from_array(cells, resolution_m=0.05, name="room"), furnishings=pieces)

figure, axes = plt.subplots(2, 2, figsize=(10, 7.6), layout="constrained")
for place, height_m in ((axes[0, 0], 1.25), (axes[0, 1], 0.38)):
    image = CameraConfig(width=400, height=300, height_m=height_m)
    with make_camera([shaded_mesh(building)], image) as camera:
        place.imshow(camera.render(camera_pose(np.array([0.4, 0.9, 0.32]), image)).rgb)
    place.set_title(f"from {height_m:g} m")
    place.axis("off")

building.plot(axes[1, 0])
for height_m, colour in ((0.4, "C1"), (1.25, "C0")):
    where = reach(building, 0.1, height_m)
    x, y = building.plan.centres(where.parts > 0).T
    axes[1, 0].plot(x, y, ".", color=colour, ms=1.6, label=f"{height_m:g} m high")
axes[1, 0].legend(loc="lower left", markerscale=5)
axes[1, 0].set_title("where the hull of a robot can be")

tracer = Tracer(building, config=TracerConfig(max_reflections=1, diffraction_reflections=0, max_paths=200))
tx, x = np.array([[0.5, 1.1, 1.2]]), np.linspace(0.7, 5.5, 240)
for height_m, colour in ((0.9, "C0"), (0.4, "C1")):
    paths = tracer.trace(tx, np.column_stack([x, 1.1 + (x - 0.5) * 0.32, np.full(len(x), height_m)]))
    power = np.bincount(paths.rx, paths.power, len(x))
    axes[1, 1].plot(x, 10 * np.log10(np.maximum(power, 1e-15)), color=colour, label=f"at {height_m:g} m")
axes[1, 1].set(xlabel="x [m]", ylabel="power gain [dB]", title="received along a line across the table")
axes[1, 1].legend()
plt.show()
