"""People and other upright bodies among the paths of a link: where they stand, their size, and how they move."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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
    velocity: Float[np.ndarray, "n 3"]
    """Velocity [m/s]."""

    def __post_init__(self) -> None:
        for name in ("position", "radius_m", "height_m", "velocity"):
            values = getattr(self, name)
            if not np.isfinite(values).all():
                raise ValueError(f"{name} of bodies has NaN or infinite values, expected finite ones.")
            if name.endswith("_m") and (values <= 0).any():
                raise ValueError(f"{name} of bodies has {values.min():g}, expected more than 0 m.")

    def __len__(self) -> int:
        return len(self.position)


def people(
    position: Float[np.ndarray, "n 2"] | Float[np.ndarray, "n 3"],
    *,
    radius_m: float | Float[np.ndarray, " n"] = PERSON_RADIUS_M,
    height_m: float | Float[np.ndarray, " n"] = PERSON_HEIGHT_M,
    velocity: Float[np.ndarray, "n 2"] | Float[np.ndarray, "n 3"] | None = None,
) -> Bodies:
    """Bodies of one size or of many, by default persons who stand still.

    Args:
        position: Position of the feet [m]; on the height 0 if there are two columns.
        radius_m: Half of the width.
        height_m: Height above the feet.
        velocity: Velocity [m/s], level if there are two columns; None for none.

    Raises:
        ValueError: If a value is not finite, or a size is not positive.
    """
    n = len(position)
    return Bodies(
        position=_with_height(position),
        radius_m=np.broadcast_to(np.asarray(radius_m, float), n),
        height_m=np.broadcast_to(np.asarray(height_m, float), n),
        velocity=np.zeros((n, 3)) if velocity is None else _with_height(velocity),
    )


def _with_height(level: Float[np.ndarray, "n _"]) -> Float[np.ndarray, "n 3"]:
    """Vectors with a third column, of zeros if there is none."""
    return np.pad(np.asarray(level, float), ((0, 0), (0, 3 - level.shape[1])))
