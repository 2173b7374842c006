"""The surface of a union of boxes along the axes, closed and without a face inside.

All planes of the boxes cut space into cells; a face stands wherever a cell that is in a box meets one that is not. So
neighbours share whole sides, however the boxes overlap, and the surface is closed.
"""

from collections.abc import Sequence

import numpy as np
import trimesh

#: x, y, z of the lowest corner and of the highest [m].
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


def solid_of_boxes(boxes: Sequence[Box]) -> trimesh.Trimesh:
    """The union of boxes as a closed mesh with normals outwards.

    Boxes that share no more than a side or a corner make a surface of which more than two faces meet there.
    """
    corners = np.round(np.array(boxes, float), 9)  # planes that differ by rounding are one
    planes = [np.unique(corners[:, :, axis]) for axis in range(3)]
    filled = np.zeros([len(along) + 1 for along in planes], bool)  # a rim of cells that are in no box
    for low, high in corners:
        filled[tuple(slice(*(1 + np.searchsorted(planes[k], (low[k], high[k])))) for k in range(3))] = True
    quads = []
    for axis in range(3):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        step = np.diff(filled.astype(np.int8), axis=axis)
        for change in (-1, 1):  # leaving a box along the axis, and entering one
            index = np.argwhere(step == change)
            cell = np.repeat(index[:, None], 4, axis=1)
            for corner, (u, v) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                cell[:, corner, one] += u - 1
                cell[:, corner, other] += v - 1
            quads.append(cell if change < 0 else cell[:, ::-1])
    cell = np.concatenate(quads)
    points = np.stack([planes[axis][cell[:, :, axis]] for axis in range(3)], axis=-1).reshape(-1, 3)
    vertices, number = np.unique(points, axis=0, return_inverse=True)
    quad = number.reshape(-1, 4)
    faces = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]])
    return trimesh.Trimesh(vertices, faces, process=False)
