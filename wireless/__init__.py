"""Radio in buildings: materials of walls, what they do to a wave, and the paths between points.

Knows nothing of robots: a mesh and points come in, radio quantities go out.

    Tracer         a building made ready for tracing
    TracerConfig   which paths are looked for
    Paths          what comes out: one row per path, as columns
    LinkState      line of sight, first order, higher order, outage
    Interaction    what happens to a path at a point
    SceneError     a mesh that cannot be traced

    terminal_named   antenna arrays and beams of the reference's base station or robot
    Rays             paths as two terminals see them
    Sounder          what a receiver measures of them
    SoundingConfig   with which power and waveform
    estimator_named  what makes paths out of measurements again
    PathEstimates    these paths
"""

from wireless.antennas.codebook import terminal_named
from wireless.estimates import PathEstimates
from wireless.estimation.estimators import estimator_named
from wireless.paths import Interaction, LinkState, Paths
from wireless.sounding.sounder import Rays, Sounder, SoundingConfig
from wireless.tracing.tracer import SceneError, Tracer, TracerConfig

__all__ = [
    "Interaction",
    "LinkState",
    "PathEstimates",
    "Paths",
    "Rays",
    "SceneError",
    "Sounder",
    "SoundingConfig",
    "Tracer",
    "TracerConfig",
    "estimator_named",
    "terminal_named",
]
