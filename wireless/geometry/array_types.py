"""Types of arrays that many functions on geometry take."""

import numpy as np
from jaxtyping import Float, Shaped
from numpy.typing import ArrayLike

#: A point or vector in space.
Point = Float[np.ndarray, "3"]
#: Several of them.
Points = Float[np.ndarray, "n 3"]
#: A point or vector in the plan.
FlatPoint = Float[np.ndarray, "2"]
#: Corners of a polygon in space, in order.
Polygon = Float[np.ndarray, "k 3"]
#: Corners of a polygon in the plan, counter-clockwise.
FlatPolygon = Float[np.ndarray, "k 2"]
#: Corners of triangles.
Triangles = Float[np.ndarray, "t 3 3"]
#: Unit normal of each plane, and where the plane is along it.
Planes = Float[np.ndarray, "p 4"]


def to_array(values: ArrayLike, name: str) -> Shaped[np.ndarray, "..."]:
    """Numbers of a user as an array of floats; ValueError, which names them, if they are none or ragged."""
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} is {str(values)[:60]}, expected numbers in an array or lists of equal length."
        ) from None
