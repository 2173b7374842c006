"""A Mitsuba scene with its tracer, and places of terminals in it.

It has no floor plan: places are coordinates of the scene, anywhere, and all of its surfaces reflect, level ones too.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.radio.scene import RadioConfig
from wireless.tracing.mitsuba_scene import read_mitsuba
from wireless.tracing.tracer import Tracer


class MeshScene:
    """A scene ready for tracing.

    Raises:
        FileError: If a file is damaged, or a shape or material is not understood.
        ValueError: If a material is unknown at this frequency.
    """

    def __init__(self, path: Path, config: RadioConfig):
        self.name = path.stem
        self.config = config
        scene = read_mitsuba(path)
        self.mesh = scene.mesh
        self.tracer = Tracer(
            scene, frequency_hz=config.frequency_hz, config=replace(config.tracer, floor_ceiling=True)
        )

    def places(self, points: tuple[tuple[float, ...], ...], name: str) -> Float[np.ndarray, "n 3"]:
        """Points (x, y) or (x, y, z) [m] as positions; without z a point is at the configured height."""
        return np.array([[*point, self.config.height_m][:3] for point in points], float).reshape(-1, 3)
