"""An RGB-D camera on a robot: optics, mounting, and the interface of all cameras.

A pinhole without distortion. In the camera frame x points right, y down and z forward; a point (x, y, z) is seen
at u = f x / z + w / 2 columns and v = f y / z + h / 2 rows from the upper left corner of the picture, with
f = w / (2 tan(hfov / 2)) for both axes, as pixels are square. Pixel (row i, column j) is what lies behind its
centre, u = j + 0.5 and v = i + 0.5. (OpenCV counts pixels from the centre of the first: subtract 0.5 from the
principal point there.)

Depth is measured along z, not along the ray; 0 where nothing was hit.

Left out: lens distortion, noise, motion blur, exposure.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32, UInt8

from robosim.support.checks import SIZE_PX, Range, checked
from slam.poses import moved_ahead
from slam.sensing.projection import CameraModel


@dataclass(frozen=True, kw_only=True)
@checked
class CameraConfig(CameraModel):
    """Size, optics and mount of an RGB-D camera."""

    width: Annotated[int, SIZE_PX] = 128
    """Columns of a picture [pixels]."""
    height: Annotated[int, SIZE_PX] = 128
    """Rows of a picture [pixels]."""
    near_m: Annotated[float, Range(1e-4, 1e4, "m")] = 0.05
    """Nearer things are not seen [m along the view]."""
    far_m: Annotated[float, Range(1e-3, 1e5, "m")] = 50.0
    """Farther things are not seen [m along the view]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.near_m < self.far_m:
            raise ValueError(
                f"near_m is {self.near_m} and far_m is {self.far_m}, expected near_m < far_m. Try 0.05 and 50."
            )

    @property
    def focal_px(self) -> float:
        """Focal length of both axes [pixels]."""
        return 0.5 * self.width / np.tan(0.5 * np.radians(self.hfov_deg))

    @property
    def K(self) -> Float[np.ndarray, "3 3"]:
        """Intrinsic matrix: (u, v, 1) z = K (x, y, z), with (0, 0) the picture's upper left corner."""
        f = self.focal_px
        return np.array([[f, 0.0, 0.5 * self.width], [0.0, f, 0.5 * self.height], [0.0, 0.0, 1.0]])

    def directions(self) -> Float[np.ndarray, "h w 3"]:
        """Rays through the pixel centres in the camera frame, one metre long along z.

        Times the depth, these are the points seen.
        """
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / self.focal_px
        y = (np.arange(self.height) + 0.5 - 0.5 * self.height) / self.focal_px
        grid_x, grid_y = np.meshgrid(x, y)
        return np.stack([grid_x, grid_y, np.ones_like(grid_x)], axis=-1)


class RGBD(NamedTuple):
    """A picture: colour and depth of the same pixels."""

    rgb: UInt8[np.ndarray, "h w 3"]
    """Red, green and blue, row 0 on top."""
    depth: Float32[np.ndarray, "h w"]
    """Metres along the camera's z axis; 0 where nothing was hit."""


@runtime_checkable
class Camera(Protocol):
    """Interface of cameras. One thread may use a camera at a time; different ones are independent."""

    def render(self, T_map_camera: Float[np.ndarray, "4 4"]) -> RGBD:
        """Take a picture from a pose."""

    def close(self) -> None:
        """Free what the camera holds; it takes no pictures after that."""


class ClosingCamera(AbstractContextManager["ClosingCamera"]):
    """A camera that a `with` block closes at its end."""

    def close(self) -> None:
        """Free what the camera holds; nothing happens the second time."""

    def __exit__(self, *error: object) -> None:
        self.close()


def camera_pose(robot_pose: Float[np.ndarray, "3"], config: CameraConfig) -> Float[np.ndarray, "4 4"]:
    """Pose T_map_camera of the camera of a robot at x [m], y [m], yaw [rad] in `map`, looking ahead."""
    x, y, yaw = moved_ahead(robot_pose, config.ahead_m)
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array(
        [[s, 0.0, c, x], [-c, 0.0, s, y], [0.0, -1.0, 0.0, config.height_m], [0.0, 0.0, 0.0, 1.0]]
    )
