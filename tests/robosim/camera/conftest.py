"""Views of a room."""

import numpy as np
import pytest

from robosim.camera.model import CameraConfig, camera_pose


@pytest.fixture
def view() -> np.ndarray:
    """A pose in the empty room."""
    return camera_pose(np.array([0.3, -0.4, 0.7]), CameraConfig())
