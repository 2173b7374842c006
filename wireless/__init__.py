"""Radio in buildings: materials of walls, what they do to a wave, and the paths between points.

Knows nothing of robots: a mesh and points come in, radio quantities go out.

    Tracer         a building made ready for tracing
    TracerConfig   which paths are looked for
    Paths          what comes out: one row per path, as columns
    LinkState      line of sight, first order, higher order, outage
    Interaction    what happens to a path at a point
    SceneError     a mesh that cannot be traced
    trace_grid     many links into a folder, going on after an interruption
"""

from wireless.dataset import trace_grid
from wireless.paths import Interaction, LinkState, Paths
from wireless.raytrace import SceneError, Tracer, TracerConfig

__all__ = ["Interaction", "LinkState", "Paths", "SceneError", "Tracer", "TracerConfig", "trace_grid"]
