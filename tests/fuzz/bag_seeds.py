"""Seeds of the fuzzer: bags."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from tests.robosim.logs import made_bags


def bags(folder: Path) -> None:
    """A robot's log as a bag of each format, without the list of contents that ROS 2 writes next to it."""
    home, bearing = folder / "bags", np.radians(np.arange(-180.0, 180, 6))
    home.mkdir(parents=True)
    for kind in made_bags.FORMATS:
        is_ros1 = kind == "ros1"
        rows: list[tuple[str, float, Any]] = []
        for k in range(6):
            pose = np.array([0.2 * k, 0.0, 0.1 * k])
            rows.append(("/odom", 1.0 + k, made_bags.odometry(1.0 + k, pose, is_ros1=is_ros1)))
            scan = made_bags.laser_scan(1.0 + k, bearing, 2 + 0.3 * np.cos(bearing), is_ros1=is_ros1)
            rows.append(("/scan", 1.0 + k, scan))
        written = made_bags.write_bag(home / kind, kind, rows)
        if written.is_dir():
            for file in written.glob("*.*"):
                if file.suffix in (".db3", ".mcap"):
                    file.rename(home / file.name)
            shutil.rmtree(written)
