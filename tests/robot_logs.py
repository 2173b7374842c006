"""Logs of a robot that drives once round a small building, in every format that is read."""

import gzip
import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from slam.poses import between, compose
from tests.slam import beams

ROOM = [
    *beams.rectangle(0, 0, 8, 6),
    *beams.rectangle(3, 2, 4, 3.5),
    *beams.rectangle(6, 0, 8, 1.2),
]
ROUTE = beams.along([(1, 1), (5, 1), (5, 5), (1, 5), (1, 1.5)])
BEAMS = 181


class Drive:
    """Scans and odometry of a robot along a route, as lines of a log.

    Args:
        route: True poses x [m], y [m], yaw [rad], one per scan.
        count: Beams of a scan, over 180 degrees.
    """

    def __init__(self, route: list[np.ndarray] = ROUTE, count: int = BEAMS) -> None:
        self.route, self.count = route, count
        self.bearing = np.linspace(-math.pi / 2, math.pi / 2, count)
        rng, measured = np.random.default_rng(0), [np.array([3.0, -2.0, 1.0])]
        for a, b in pairwise(route):
            measured.append(compose(measured[-1], between(a, b) + rng.normal(0, [0.02, 0.02, 0.02])))
        self.odometry = measured

    def fan(self, pose: np.ndarray) -> list[float]:
        """Ranges [m] from a pose; the longest where nothing is near."""
        reach = beams.ranges(ROOM, pose, bearing=self.bearing)
        return [float(value) for value in np.minimum(reach, 81.9)]

    def raw(self) -> str:
        """As a robot writes it: both poses of a scan are odometry."""
        lines = ["# message formats defined: ODOM FLASER"]
        for k, (true, measured) in enumerate(zip(self.route, self.odometry, strict=True)):
            lines.append(_line("ODOM", *measured, 0, 0, 0, float(k), "host", float(k)))
            lines.append(
                _line("FLASER", self.count, *self.fan(true), *measured, *measured, float(k), "host", float(k))
            )
        return "\n".join(lines)

    def corrected(self) -> str:
        """As a mapping program writes it: odometry starts again from each corrected pose."""
        lines = []
        for k, pose in enumerate(self.route):
            if k:
                motion = compose(self.route[k - 1], between(self.odometry[k - 1], self.odometry[k]))
                lines.append(_line("ODOM", *motion, 0, 0, 0, 0, "h", 0))
            lines.append(_line("FLASER", self.count, *self.fan(pose), *pose, *pose, float(k), "h", float(k)))
            lines.append(_line("ODOM", *pose, 0, 0, 0, 0, "h", 0))
        return "\n".join(lines)

    def newer(self) -> str:
        """With the newer lines, the first of whose poses is the laser's."""
        lines, step = [], math.pi / (self.count - 1)
        for k, (true, measured) in enumerate(zip(self.route, self.odometry, strict=True)):
            head = ("ROBOTLASER1", 0, -math.pi / 2, math.pi, step, 80.0, 0.01, 0, self.count)
            laser = compose(measured, np.array([0.1, 0.0, 0.0]))
            lines.append(
                _line(*head, *self.fan(true), 0, *laser, *measured, 0, 0, 0, 0, 0, float(k), "h", float(k))
            )
        return "\n".join(lines)

    def write_tum(self, folder: Path) -> tuple[Path, Path]:
        """Odometry as a TUM file, and a file of scans."""
        odometry, scans = folder / "odometry.tum", folder / "scans.txt"
        odometry.write_text(
            "\n".join(
                f"{k} {x:.9f} {y:.9f} 0 0 0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}"
                for k, (x, y, yaw) in enumerate(self.odometry)
            )
        )
        ends = (-math.pi / 2, math.pi / 2)
        scans.write_text(
            "\n".join(_line(float(k), *ends, *self.fan(pose)) for k, pose in enumerate(self.route))
        )
        return odometry, scans

    def write_all(self, folder: Path) -> None:
        """Every format there is."""
        (folder / "raw.log").write_text(self.raw())
        (folder / "corrected.log.gz").write_bytes(gzip.compress(self.corrected().encode(), mtime=0))
        (folder / "newer.clf").write_text(self.newer())
        self.write_tum(folder)


def _line(*values: object) -> str:
    return " ".join(f"{value:.6f}" if isinstance(value, float) else str(value) for value in values)
