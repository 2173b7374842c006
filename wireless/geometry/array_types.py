"""Types of arrays that many functions on geometry take."""

import numpy as np
from jaxtyping import Float

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
