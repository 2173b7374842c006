"""Powers of paths that are already traced, after their walls have changed material: no path is searched again.

Points, kinds of interactions and the walls met do not depend on materials, so that only the field is computed again
(`wireless.em.fields`). The two faces of a passed wall count as one wall of the material of the first face.

Left out: paths that the first materials were too weak for (`TracerConfig.max_paths`); scattering; scenes in space.
"""

import numpy as np
from jaxtyping import Float, Int, UInt8

from robosim.support.compiled import compiled
from wireless.em.fields import DIFFRACTION, Path, Wedge, path_gain
from wireless.geometry.layers import Outline
from wireless.tracing.table import Setting, make_scratch


@compiled
def reweigh(
    outline: Outline,
    setting: Setting,
    order: UInt8[np.ndarray, " n"],
    kind: UInt8[np.ndarray, "n m"],
    primitive: Int[np.ndarray, "n m"],
    point: Float[np.ndarray, "n m2 3"],
) -> Float[np.ndarray, " n"]:
    """Power of each path by the setting's weights; points are transmitter, interactions, receiver."""
    s, power = make_scratch(setting), np.zeros(len(order))
    for i in range(len(order)):
        gap = np.pi
        for j in range(order[i]):
            s.kind[j], wall = kind[i, j], primitive[i, j]
            if s.kind[j] == DIFFRACTION:
                gap = outline.edge_gap_rad[wall]
                s.wedge[:] = outline.edge_wedge[wall]
                for side in range(2):
                    s.wedge_walls[side] = setting.walls[outline.edge_walls[wall, side]]
                continue
            s.walls[j] = setting.walls[wall]
            upright = wall < len(outline.wall_along)  # else floor or ceiling
            s.normal[j, 0] = -outline.wall_along[wall, 1] if upright else 0.0
            s.normal[j, 1] = outline.wall_along[wall, 0] if upright else 0.0
            s.normal[j, 2] = 0.0 if upright else 1.0
        path = Path(point[i], s.kind, s.normal, s.walls, s.share)
        wedge = Wedge(s.wedge, gap / np.pi, s.wedge_walls, setting.bisector)
        if path_gain(path, int(order[i]), wedge, setting.wavenumber, s.gain, s.work, s.field) < 0:
            continue
        g = s.gain
        power[i] = setting.vertical * abs(g[0, 0]) ** 2 + setting.horizontal * abs(g[1, 1]) ** 2
        power[i] += setting.crossed * (abs(g[0, 1]) ** 2 + abs(g[1, 0]) ** 2)
    return power
