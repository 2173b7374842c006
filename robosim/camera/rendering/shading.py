"""The colours of a building: light and texture, baked once into its vertices.

Drawn in flat colours a picture takes a fraction of the time that it takes with lights:

- Ambient occlusion. Light comes from everywhere but from what is near: at a vertex with normal n, the share

      A = 1/pi * integral over the hemisphere of (1 - max(0, 1 - t(w) / range)) (n.w) dw

  is left, with t(w) the distance to the next surface in direction w. Corners darken, and so do doors' reveals.
  Rays are cast in cosine-weighted directions of a Fibonacci spiral, the same at each vertex.
- A tint by the direction that a surface faces, so that two walls that meet differ.
- A colour for each kind of surface, with a grain by positions on the plan, and a hue for each piece of furniture.

Left out: lamps, windows, the sun, what surfaces reflect, paint of single rooms.

Reference: Zhukov, Iones, Kronin, "An ambient light illumination model", Rendering Techniques (1998).
"""

from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import numpy as np
import scipy
import trimesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from robosim.building.building import Building
from robosim.building.extrusion import CEILING, FLOOR, FURNITURE, WALL
from robosim.camera.rendering.tessellation import Patches, placed_patches, tessellate
from robosim.support.ray_casting import make_ray_scene
from wireless.support.cached_array import cached_array

#: Side of the floor's tiles, and distance of vertices on floor and walls, about; height of skirtings [m].
_STEP_M, _SKIRTING_M = 0.5, 0.10
#: Larger floors have so many tiles only [m2 of the usual tiles].
_LARGE_M2 = 15_000.0
#: Surfaces farther off than this take no ambient light away [m]; rays from each vertex, and rays cast at once.
_RANGE_M, _N_RAYS, _RAYS_AT_ONCE = 1.5, 64, 500_000
#: Brightness of a surface without light, and what ambient light adds.
_DARK, _AMBIENT = 0.40, 0.66
#: Colour and grain of each kind of surface, and the colour of skirtings.
_SURFACES = {
    FLOOR: ((166, 130, 94), 0.08),
    WALL: ((226, 218, 202), 0.012),
    CEILING: ((238, 238, 234), 0.0),
}
_SKIRTING = (112, 92, 76)
# Multipliers of a hash; large odd numbers without a pattern.
_ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F], np.uint64)
#: Shorter walls than this are painted by the mean normal of their surroundings [m].
_STAIRS_M = 0.30
# Golden angle: hues, and directions of a spiral, that never come near an earlier one.
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


@lru_cache(maxsize=1)
def shaded_mesh(building: Building) -> trimesh.Trimesh:
    """A building's surfaces, cut finely enough to carry light and texture in the colours of their vertices.

    Returned is a mesh in `map` with the same surfaces as `building.mesh`; placed sheets have one on either side. The
    last result is cached, since many episodes run in one building: copy it before changing it.
    """
    bare = building.bare
    step_m = _STEP_M * max(1.0, (bare.free.area / _LARGE_M2) ** 0.5)
    patches = tessellate(bare, step_m=step_m, heights_m=(_SKIRTING_M,))
    facing, albedo = _facing(bare)[patches.source], _albedo(patches)
    furniture = patches.kind == FURNITURE
    albedo[furniture] = _hues(bare)[patches.source[furniture]]
    if building.furnishings:
        placed, paint = placed_patches(building.furnishings, step_m=_STEP_M)
        patches = Patches.joined([patches, placed])
        facing, albedo = np.vstack([facing, placed.normals]), np.vstack([albedo, paint])
    # Four even steps around a room, warmer on the bright side.
    tint = 1.0 + (facing @ (0.75, 0.25, 0.15))[:, None] * np.array([0.25, 0.22, 0.17])
    brightness = _DARK + _AMBIENT * _ambient_light(patches, building.mesh)
    colours = albedo * tint * brightness[:, None]
    opaque = np.full((len(colours), 1), 255.0)
    rgba = np.hstack([np.clip(colours, 0, 255), opaque]).round().astype(np.uint8)
    return trimesh.Trimesh(patches.vertices, patches.faces, vertex_colors=rgba, process=False)


def _albedo(patches: Patches) -> Float[np.ndarray, "n 3"]:
    """Colour of each vertex before light falls on it; that of furniture is left grey."""
    colours = np.full((len(patches.vertices), 3), 128.0)
    mixed = (patches.cell.astype(np.uint64) * _ODD).sum(axis=1)
    mixed ^= mixed >> np.uint64(29)
    tone = ((mixed * np.uint64(0xBF58476D1CE4E5B9)) >> np.uint64(40)) / 2.0**23 - 1.0  # of each cell, -1 to 1
    for kind, (colour, grain) in _SURFACES.items():
        colours[patches.kind == kind] = colour * (1 + grain * tone[patches.kind == kind])[:, None]
    colours[(patches.kind == WALL) & (patches.row == 0)] = _SKIRTING
    return colours


def _ambient_light(patches: Patches, mesh: trimesh.Trimesh) -> Float[np.ndarray, " n"]:
    """Ambient light at the patches' vertices; cached on disk, as it takes most of a scene's time."""
    inputs = [patches.vertices, patches.normals, patches.inward, mesh.triangles]
    made_of = [np.ascontiguousarray(values, float).tobytes() for values in inputs]
    made_of.append(repr((_RANGE_M, _N_RAYS, version("embreex"), scipy.__version__)).encode())
    return cached_array(
        "light",
        made_of,
        [Path(__file__)],
        lambda: ambient_light(patches, mesh, range_m=_RANGE_M, n_rays=_N_RAYS),
    )


def ambient_light(
    patches: Patches, mesh: trimesh.Trimesh, *, range_m: float, n_rays: int
) -> Float[np.ndarray, " n"]:
    """Share of the ambient light that reaches the patches' vertices; surfaces within a range [m] take it away.

    Rays start a little inside of the patch: a vertex in a corner of a room lies on the other walls, and would see
    their backs.
    """
    centre = mesh.bounds.mean(axis=0)
    scene = make_ray_scene(mesh.triangles - centre)
    places = np.hstack([patches.vertices - centre, patches.normals])
    _, first, which = np.unique(places.round(6), axis=0, return_index=True, return_inverse=True)
    starts = (places[:, :3] + 0.01 * patches.inward + 0.002 * patches.normals)[first].astype(np.float32)
    directions = cosine_directions(n_rays) @ _frames(patches.normals[first])
    light = [
        _open_share(scene, starts[batch], directions[batch], range_m)
        for batch in np.array_split(np.arange(len(first)), 1 + len(first) * n_rays // _RAYS_AT_ONCE)
    ]
    return np.concatenate(light)[which.ravel()]


def cosine_directions(n: int) -> Float[np.ndarray, "n 3"]:
    """Directions about the z axis, evenly spread when weighted with the cosine of their angle to it.

    They lie above the points of a Fibonacci spiral in the unit disk (Malley's method).
    """
    number = np.arange(n) + 0.5
    radius, angle = np.sqrt(number / n), _GOLDEN * number
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - number / n)])


def _frames(normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Two tangents and the normal, as rows; the first tangent is level."""
    level = np.column_stack([-normals[:, 1], normals[:, 0], np.zeros(len(normals))])
    level[np.hypot(normals[:, 0], normals[:, 1]) < 1e-6] = (1.0, 0.0, 0.0)
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    return np.stack([level, np.cross(normals, level), normals], axis=1)


def _open_share(
    scene: EmbreeScene, starts: np.ndarray, directions: Float[np.ndarray, "n k 3"], range_m: float
) -> Float[np.ndarray, " n"]:
    n, k, _ = directions.shape
    rays = directions.reshape(-1, 3).astype(np.float32)
    hits = scene.run(np.repeat(starts, k, axis=0), rays, np.full(n * k, range_m, np.float32), output=True)
    distance = np.where(hits["primID"] < 0, range_m, hits["tfar"])
    return np.minimum(distance / range_m, 1.0).reshape(n, k).mean(axis=1)


def _facing(building: Building) -> Float[np.ndarray, "n_faces 3"]:
    """Directions that faces face, when seen from a few steps away.

    Walls that are slanted or round on the plan may be steps of cell borders, which would look striped if they were
    painted by their normals: short walls take the mean normal of their surroundings.
    """
    mesh = building.mesh
    facing = mesh.face_normals.copy()
    upright = np.flatnonzero(np.abs(facing[:, 2]) < 0.5)
    low, high = mesh.triangles[upright, :, :2].min(axis=1), mesh.triangles[upright, :, :2].max(axis=1)
    length = np.hypot(*(high - low).T)
    near = cKDTree((low + high) / 2).query_pairs(_STAIRS_M, output_type="ndarray")
    first, other = np.concatenate([near, near[:, ::-1]]).T
    normals = facing[upright]
    same_side = (normals[first] * normals[other]).sum(axis=1) > -0.1
    short = length[first] < _STAIRS_M
    first, other = first[short & same_side], other[short & same_side]
    total = normals * length[:, None]
    np.add.at(total, first, normals[other] * length[other, None])
    facing[upright] = total / np.linalg.norm(total, axis=1, keepdims=True)
    return facing


def _hues(building: Building) -> Float[np.ndarray, "n_faces 3"]:
    """A colour for each face, the same on one piece of furniture and different on the next."""
    mesh = building.mesh
    faces = mesh.faces[building.face_kind == FURNITURE]
    first, other = faces[:, [0, 0]].ravel(), faces[:, [1, 2]].ravel()
    links = coo_array((np.ones(len(first)), (first, other)), shape=(len(mesh.vertices), len(mesh.vertices)))
    _, label = connected_components(links, directed=False)
    hue = _GOLDEN * label[mesh.faces[:, 0]]
    return 138.0 + 28.0 * np.cos(hue[:, None] + np.radians([0.0, 120.0, 240.0]))
