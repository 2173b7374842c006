"""People and other upright bodies among the paths of a link: where they stand, and their size."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from wireless.support.arrays import to_array

#: Size of a person as a screen: 0.3 m by 1.7 m [m] (3GPP TR 38.901 V17, table 7.6.4.2-5).
PERSON_RADIUS_M, PERSON_HEIGHT_M = 0.15, 1.7


@dataclass(frozen=True, kw_only=True, eq=False)
class Bodies:
    """Upright cylinders."""

    position: Float[np.ndarray, "n 3"]
    """Position of the feet, on the axis [m]."""
    radius_m: Float[np.ndarray, " n"]
    """Half of the width that each path sees."""
    height_m: Float[np.ndarray, " n"]
    """Height above the feet."""

    def __post_init__(self) -> None:
        for name in ("position", "radius_m", "height_m"):
            object.__setattr__(self, name, values := to_array(getattr(self, name), name))
            expected = (len(self.position), 3) if name == "position" else (len(self.position),)
            if values.shape != expected:
                raise ValueError(f"{name} of bodies has shape {values.shape}, expected {expected}.")
            if not np.isfinite(values).all():
                raise ValueError(f"{name} of bodies has NaN or infinite values, expected finite ones.")
            if name.endswith("_m") and (values <= 0).any():
                raise ValueError(f"{name} of bodies has {values.min():g}, expected more than 0 m.")

    def __len__(self) -> int:
        return len(self.position)


def people(
    position: ArrayLike,
    *,
    radius_m: ArrayLike = PERSON_RADIUS_M,
    height_m: ArrayLike = PERSON_HEIGHT_M,
) -> Bodies:
    """Bodies of one size or of many, by default persons who stand still.

    Args:
        position: Position of the feet [m], n x 2 or n x 3; on the height 0 if there are two columns.
        radius_m: Half of the width [m], of all or of each.
        height_m: Height above the feet [m], likewise.

    Raises:
        ValueError: If a value is not finite, or a size is not positive.
    """
    feet = _with_height(position)
    sizes = to_array(radius_m, "radius_m"), to_array(height_m, "height_m")
    radius, height = (size if size.ndim else np.full(len(feet), size) for size in sizes)
    return Bodies(position=feet, radius_m=radius, height_m=height)


def _with_height(position: ArrayLike) -> Float[np.ndarray, "n 3"]:
    """Positions with a third column, of zeros if there is none."""
    level = to_array(position, "position")
    if not level.size:
        return np.empty((0, 3))
    if level.ndim != 2 or level.shape[1] not in (2, 3):
        raise ValueError(f"position of bodies has shape {level.shape}, expected (n, 2) or (n, 3).")
    return np.pad(level, ((0, 0), (0, 3 - level.shape[1])))
