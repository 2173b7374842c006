"""
From a floor plan to a building
===============================

A floor plan is a grid of free, occupied and unknown cells. The program extrudes its outline to walls; islands of cells
in a room become furniture. Camera, collisions and radio use the same triangles.
"""

import matplotlib.pyplot as plt
import numpy as np

from robosim import BuildingConfig, CameraConfig, make_building, read_plan
from robosim.camera.cameras import make_camera
from robosim.camera.rendering.shading import shaded_mesh

plan = read_plan("villa")
building = make_building(plan, config=BuildingConfig(ceiling=False, height_m=1.6, furniture_height_m=0.8))

# A camera south of the building, looking down at its middle: columns are its x (right), y (down) and z (ahead).
low, high = building.bounds
ahead = np.array([0.0, 0.5, -0.87])
T_map_camera = np.eye(4)
T_map_camera[:3, :3] = np.column_stack([[1, 0, 0], np.cross(ahead, [1, 0, 0]), ahead])
T_map_camera[:3, 3] = (low + high) / 2 - 19.5 * ahead
camera = make_camera([shaded_mesh(building)], CameraConfig(width=800, height=860, hfov_deg=52))
picture = camera.render(T_map_camera)
camera.close()

figure, (left, right) = plt.subplots(1, 2, figsize=(10.5, 5.8), layout="constrained")
plan.plot(left)
rows, columns = plan.shape
left.set_title(f"{columns} x {rows} cells of {plan.resolution_m} m")
right.imshow(np.where(picture.depth[..., None] > 0, picture.rgb, 255))
right.set_title(f"{len(building.mesh.faces)} triangles, drawn by the robot's camera from above")
right.axis("off")
plt.show()
