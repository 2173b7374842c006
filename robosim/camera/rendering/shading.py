"""What a building looks like: light and texture, baked once into the colours of vertices.

Drawn in flat colours a picture costs a fraction of what it costs with lights, and a building still looks like one:

- Ambient occlusion. Light comes from everywhere but from what is near: at a vertex with normal n, the share

      A = 1/pi * integral over the hemisphere of (1 - max(0, 1 - t(w) / range)) (n.w) dw

  is left, with t(w) the distance to the next surface in direction w. Corners darken, and so do doors' reveals.
  Rays are cast by Embree in cosine-weighted directions of a Fibonacci spiral, the same at each vertex.
- A tint by the direction that a surface faces, so that two walls that meet differ.
- Texture: tiles of the floor, panels and a skirting board on the walls, broad patches of paint, and a hue of its
  own for each piece of furniture. All tones come from positions on the plan, none from chance.

Left out: lamps, windows, shadows, reflections.

Reference: Zhukov, Iones, Kronin, "An ambient light illumination model", Rendering Techniques (1998).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from robosim.building.building import Building
from robosim.building.extrusion import CEILING, FLOOR, FURNITURE, WALL
from robosim.camera.rendering.placed import placed_patches
from robosim.camera.rendering.tessellation import Patches, tessellate
from robosim.support.checks import check_numbers

_SKIRTING_M = 0.10
_STAIRS_M = 0.30
_PAINTS = np.array([(222, 208, 182), (188, 204, 208), (202, 208, 178), (226, 196, 176)], float)
_SKIRTING = np.array([112, 92, 76], float)
_FLOOR = np.array([164, 128, 92], float)
_CEILING = np.array([236, 236, 230], float)
# Golden angle: hues, and directions of a spiral, that never come near an earlier one.
_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
# Multipliers of a hash; large odd numbers without a pattern.
_ODD = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F], np.uint64)


@dataclass(frozen=True, kw_only=True)
class ShadingConfig:
    """How finely light and texture are baked."""

    step_m: float = 0.5
    """Side of the floor's tiles, and distance of vertices on floor and walls, about [m]."""
    range_m: float = 1.5
    """Surfaces farther off than this take no light away [m]."""
    n_rays: int = 64
    """Rays from each vertex."""

    def __post_init__(self) -> None:
        check_numbers(self, step_m=(0.05, 100, "m"), range_m=(0.01, 100, "m"), n_rays=(1, 10_000, "rays"))


@lru_cache(maxsize=1)
def shaded_mesh(building: Building, *, config: ShadingConfig = ShadingConfig()) -> trimesh.Trimesh:
    """A building's surfaces, cut finely enough to carry light and texture in the colours of their vertices.

    Args:
        building: What to colour.
        config: How finely.

    Returns:
        A mesh in `map` with the same surfaces as `building.mesh` and uint8 vertex colours; placed sheets have one on
        either side. The last one is kept, since many episodes run in one building: copy it before changing it.
    """
    bare = building.bare
    patches = tessellate(bare, step_m=config.step_m, heights_m=(_SKIRTING_M,))
    facing, albedo = _facing(bare)[patches.source], _albedo(bare, patches)
    if building.furnishings:
        placed, paint = placed_patches(building.furnishings, step_m=config.step_m)
        patches = Patches.joined([patches, placed])
        facing, albedo = np.vstack([facing, placed.normals]), np.vstack([albedo, paint])
    light = ambient_light(patches, building.mesh, range_m=config.range_m, n_rays=config.n_rays)
    # Four even steps around a room, warmer on the bright side.
    tint = 1.0 + (facing @ (0.75, 0.25, 0.15))[:, None] * np.array([0.25, 0.22, 0.17])
    colours = albedo * tint * (0.35 + 0.75 * light)[:, None]
    opaque = np.full((len(colours), 1), 255.0)
    rgba = np.hstack([np.clip(colours, 0, 255), opaque]).round().astype(np.uint8)
    return trimesh.Trimesh(patches.vertices, patches.faces, vertex_colors=rgba, process=False)


def ambient_light(
    patches: Patches, mesh: trimesh.Trimesh, *, range_m: float, n_rays: int
) -> Float[np.ndarray, " n"]:
    """Share of the ambient light that reaches the patches' vertices, 0 to 1.

    Rays start a little inside of the patch: a vertex in a corner of a room lies on the other walls, and would see
    their backs.

    Args:
        patches: Where the light arrives.
        mesh: What takes it away.
        range_m: Surfaces farther off than this take nothing away [m].
        n_rays: Rays from each vertex.
    """
    centre = mesh.bounds.mean(axis=0)
    scene = EmbreeScene()
    triangles = TriangleMesh(scene, (mesh.triangles - centre).astype(np.float32))
    places = np.hstack([patches.vertices - centre, patches.normals])
    _, some, which = np.unique(places.round(6), axis=0, return_index=True, return_inverse=True)
    starts = (places[:, :3] + 0.01 * patches.inward + 0.002 * patches.normals)[some].astype(np.float32)
    directions = cosine_directions(n_rays) @ _frames(patches.normals[some])
    light = [
        _open_share(scene, starts[part], directions[part], range_m)
        for part in np.array_split(np.arange(len(some)), 1 + len(some) * n_rays // 500_000)
    ]
    del triangles
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
    """Where faces face, when seen from a few steps away.

    Walls that are slanted or round on the plan are stairs of cell borders here. Painted by their normals they
    would look striped: short walls take the mean normal of their surroundings, long ones keep theirs.
    """
    mesh = building.mesh
    facing = mesh.face_normals.copy()
    upright = np.flatnonzero(np.abs(facing[:, 2]) < 0.5)
    low, high = mesh.triangles[upright, :, :2].min(axis=1), mesh.triangles[upright, :, :2].max(axis=1)
    length = np.hypot(*(high - low).T)
    near = cKDTree((low + high) / 2).query_pairs(_STAIRS_M, output_type="ndarray")
    one, other = np.concatenate([near, near[:, ::-1]]).T
    normals = facing[upright]
    same_side = (normals[one] * normals[other]).sum(axis=1) > -0.1
    short = length[one] < _STAIRS_M
    one, other = one[short & same_side], other[short & same_side]
    total = normals * length[:, None]
    np.add.at(total, one, normals[other] * length[other, None])
    facing[upright] = total / np.linalg.norm(total, axis=1, keepdims=True)
    return facing


def _albedo(building: Building, patches: Patches) -> Float[np.ndarray, "n 3"]:
    """Colours of the surfaces before light falls on them."""
    on_plan = building.plan.to_cells(patches.vertices[:, :2]) * building.plan.resolution_m
    colours = np.empty((len(patches.vertices), 3))
    wall, furniture = patches.kind == WALL, patches.kind == FURNITURE
    colours[patches.kind == FLOOR] = _FLOOR
    colours[patches.kind == CEILING] = _CEILING
    colours[wall] = _paint(on_plan[wall])
    colours[wall & (patches.row == 0)] = _SKIRTING
    colours[furniture] = _hues(building)[patches.source[furniture]]
    swing = np.array([0.025, 0.08, 0.015, 0.06])[patches.kind]
    return colours * (1.0 + swing * _tone(patches.cell))[:, None]


def _tone(cell: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, " n"]:
    """A number from -1 to 1 for each square of a grid, with no pattern that one sees."""
    mixed = (cell.astype(np.uint64) * _ODD).sum(axis=1)
    mixed ^= mixed >> np.uint64(29)
    mixed *= np.uint64(0xBF58476D1CE4E5B9)
    return (mixed >> np.uint64(40)) / 2.0**23 - 1.0


def _paint(xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Paint of the walls, which changes smoothly over some metres."""
    place = xy_m / 3.0
    low = np.floor(place).astype(int)
    share = place - low
    share = share * share * (3.0 - 2.0 * share)
    total = np.zeros(len(xy_m))
    for corner in np.ndindex(2, 2):
        weight = np.where(corner, share, 1.0 - share).prod(axis=1)
        total += weight * _tone(low + corner)
    along = np.clip((total + 1.0) / 2.0, 0.0, 1.0) * (len(_PAINTS) - 1)
    numbers = np.arange(len(_PAINTS))
    return np.column_stack([np.interp(along, numbers, channel) for channel in _PAINTS.T])


def _hues(building: Building) -> Float[np.ndarray, "n_faces 3"]:
    """A colour for each face, the same on one piece of furniture and different on the next."""
    mesh = building.mesh
    faces = mesh.faces[building.face_kind == FURNITURE]
    one, other = faces[:, [0, 0]].ravel(), faces[:, [1, 2]].ravel()
    links = coo_array((np.ones(len(one)), (one, other)), shape=(len(mesh.vertices), len(mesh.vertices)))
    _, label = connected_components(links, directed=False)
    hue = _GOLDEN * label[mesh.faces[:, 0]]
    return 142.0 + 56.0 * np.cos(hue[:, None] + np.radians([0.0, 120.0, 240.0]))
