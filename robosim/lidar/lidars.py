"""Lidars by name, as their manufacturers describe them.

    rplidar-a1   Slamtec RPLIDAR A1M8, data sheet rev. 3.0: 360 beams at 5.5 turns a second, 0.15 to 12 m, ranges to
                 1 % of the distance
    lds-01       HLDS LDS-01 of the TurtleBot3 (ROBOTIS e-Manual): 360 beams, 0.12 to 3.5 m, precise to 10 mm up to
                 0.5 m and to 3.5 % beyond
    ust-10lx     Hokuyo UST-10LX, specification: 1081 beams over 270 degrees, 0.06 to 10 m, accurate to 40 mm
    ring-64      no product: 64 beams all around with the errors of an RPLIDAR A1, for learning

Data sheets give bounds: they are treated as two standard deviations, and the error of the Hokuyo, which is common to
all beams of a surface, as its spread. That one beam in a hundred returns nothing is an assumption.
"""

from collections.abc import Sequence
from functools import partial

import trimesh

from robosim.lidar.embree_lidar import EmbreeLidar
from robosim.lidar.lidar import LidarConfig, LidarModel

RPLIDAR_A1 = LidarModel()
LDS_01 = LidarModel(
    beams=360,
    fov_deg=360.0,
    min_range_m=0.12,
    max_range_m=3.5,
    sigma_m=0.005,
    sigma_share=0.0175,
    missing=0.01,
)
UST_10LX = LidarModel(
    beams=1081,
    fov_deg=270.0,
    min_range_m=0.06,
    max_range_m=10.0,
    sigma_m=0.02,
    sigma_share=0.0,
    missing=0.01,
)
RING_64 = LidarModel(beams=64)


def no_lidar(meshes: Sequence[trimesh.Trimesh], config: LidarConfig) -> None:
    """The robot has none."""


rplidar_a1 = partial(EmbreeLidar, model=RPLIDAR_A1)
lds_01 = partial(EmbreeLidar, model=LDS_01)
ust_10lx = partial(EmbreeLidar, model=UST_10LX)
ring_64 = partial(EmbreeLidar, model=RING_64)
