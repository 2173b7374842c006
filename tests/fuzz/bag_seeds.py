"""Seeds of the fuzzer: bags."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np

from tests.robosim.logs import made_bags


def bags(folder: Path) -> None:
    """A robot's log as a bag of each format, alone, and with the list of contents that ROS 2 writes next to it."""
    home, bearing = folder / "bags", np.radians(np.arange(-180.0, 180, 6))
    home.mkdir(parents=True)
    (folder / "bag-folder").mkdir()
    for kind in made_bags.FORMATS:
        is_ros1 = kind == "ros1"
        place = made_bags.placed((0.1, 0.0, 0.0), is_ros1=is_ros1)
        fixed, other = (
            made_bags.transform(1.0, "base_link", child, place, is_ros1) for child in ("laser", "camera")
        )
        fixed.transforms += other.transforms
        rows: list[tuple[str, float, Any]] = [("/tf", 1.0, fixed)]
        for k in range(6):
            pose = np.array([0.2 * k, 0.0, 0.1 * k])
            rows.append(("/odom", 1.0 + k, made_bags.odometry(1.0 + k, pose, is_ros1=is_ros1)))
            scan = made_bags.laser_scan(1.0 + k, bearing, 2 + 0.3 * np.cos(bearing), is_ros1=is_ros1)
            rows.append(("/scan", 1.0 + k, scan))
        names = {"TFMessage": "tf/msg/tfMessage"} if is_ros1 else {}
        written = made_bags.write_bag(home / kind, kind, rows, names=names)
        if written.is_dir():
            for file in written.glob("*.*"):
                if file.suffix in (".db3", ".mcap"):
                    shutil.copyfile(file, home / file.name)
            written.rename(folder / "bag-folder" / kind)
