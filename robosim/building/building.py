"""A building made from a floor plan: one geometry for camera, collision and radio.

The walls of the plan's outline are extruded from the floor at z = 0 to the ceiling; floor and ceiling are
triangulated between them with no vertices but the corners of the walls. So each free polygon becomes a closed
shell whose normals point into free space (its signed volume is negative, therefore) and that has no seams for
a ray to slip through. Small islands in free space are furniture, which may be lower than walls.

Where walls meet at a point with free space on two sides, each side has vertices of its own and the shell is a
manifold still; a file format that merges vertices by position joins them, which changes no surface. Walls in
passages of no width (`robosim.building.outline`) are added as flat pockets of no volume, with a face on either side.

Left out: doors and windows as such, walls with a thickness. Storeys over each other: `robosim.building.storeys`.
"""

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely
import trimesh
from jaxtyping import Bool, Float, Int, UInt8

from robosim.building.extrusion import FURNITURE, WALL, Solid, extrude, pockets
from robosim.building.faces import KINDS, Faces, plain_mesh
from robosim.building.outline import check_tolerance, closed_passages, free_cells, placed
from robosim.building.wall_materials import cut_at_materials, materials_behind
from robosim.parts import MATERIAL, MaterialPart
from robosim.plans.floorplan import FloorPlan
from robosim.support.checks import check_numbers
from robosim.support.colours import WALL as WALL_COLOUR
from robosim.support.parts import Part
from wireless.em.materials import Material, check_material
from wireless.support.axes import axes_in_metres

if TYPE_CHECKING:
    from matplotlib.axes import Axes

logger = logging.getLogger(__name__)


def material_of(given: Part, field: str) -> str | Material:
    """A radio material: a name of `wireless.em.materials` as it is, or the layers that a file or part stands for.

    Args:
        given: One of `robosim.parts.MATERIAL`.
        field: What messages call it.

    Raises:
        ValueError: If there is none.
    """
    if MATERIAL.is_name(given):
        check_material(given, field)
        return str(given)
    made: Material = MATERIAL.make(given, field=field)
    return made


@dataclass(frozen=True, kw_only=True)
class BuildingConfig:
    """How a floor plan becomes a building."""

    tolerance_m: float | None = None
    """How far walls may be moved to save corners [m]; 0 keeps the exact outline of the cells. None for straight walls
    under the staircases of a raster, and the exact outline of published grids."""
    height_m: float = 2.5
    """Height of the ceiling above the floor [m]."""
    ceiling: bool = True
    """Whether there is a ceiling."""
    furniture_max_m2: float = 4.0
    """Islands in free space of at most this area are furniture [m2]; 0 for none."""
    furniture_height_m: float | None = None
    """Height of furniture [m], which gets a lid; None for up to the ceiling, like walls."""
    wall_material: MaterialPart = "partition"
    """Radio material of walls."""
    floor_material: MaterialPart = "concrete"
    """Radio material of the floor."""
    ceiling_material: MaterialPart = "ceiling_board"
    """Radio material of the ceiling."""
    furniture_material: MaterialPart = "partition"
    """Radio material of furniture."""

    def __post_init__(self) -> None:
        check_tolerance(self.tolerance_m)
        check_numbers(
            self,
            height_m=(0.1, 100, "m, such as 2.5"),
            furniture_max_m2=(0, 1e6, "m2, 0 for no furniture"),
            furniture_height_m=(0.01, 100, "m. Leave it out for furniture up to the ceiling"),
        )
        low = self.furniture_height_m
        if low is not None and not low < self.height_m:
            raise ValueError(
                f"furniture_height_m is {low}, expected a height between 0 and height_m = {self.height_m}. "
                "Leave it out for furniture up to the ceiling."
            )
        for kind in KINDS:
            self.material(kind)

    def material(self, kind: str) -> str | Material:
        """Radio material of a kind of face: a name of `wireless.em.materials`, or layers.

        Raises:
            ValueError: If there is none.
        """
        return material_of(getattr(self, f"{kind}_material"), f"{kind}_material")


@dataclass(frozen=True, kw_only=True, eq=False)
class Building(Faces):
    """A storey in three dimensions, in the `map` frame: z up, floor at z = 0."""

    plan: FloorPlan
    """What it was made from."""
    free: shapely.MultiPolygon
    """Free floor [m] in `map`; walls stand on its boundary."""
    height_m: float
    """Height of the ceiling above the floor [m]."""
    mesh: trimesh.Trimesh
    """All faces, with normals into free space; vertices are corners of walls only."""
    face_kind: UInt8[np.ndarray, " n_faces"]
    """What each face is: index into `KINDS`."""
    materials: tuple[str | Material, ...]
    """Radio materials of the faces, by the names of `wireless.em.materials`, or of layers of their own."""
    face_material: UInt8[np.ndarray, " n_faces"]
    """What each face is made of: index into `materials`."""

    def __repr__(self) -> str:
        return (
            f"<Building {self.plan.name!r}: {self.free.area:.1f} m2 of free floor, {len(self.mesh.faces)} faces of "
            f"{', '.join(map(str, self.materials))}>"
        )

    @property
    def walls_2d(self) -> Float[np.ndarray, "n 2 2"]:
        """Walls and furniture from above: ends (x, y) [m] of segments in `map`, free space on their left.

        A passage of no width has each of its two walls.
        """
        upright = self.mesh.faces[np.isin(self.face_kind, (WALL, FURNITURE))]
        up = self.mesh.vertices[upright][:, :, 2] > 0
        standing = up.sum(axis=1) == 1  # the triangle of each wall that has an edge on the floor
        row, top = np.arange(standing.sum()), np.argmax(up[standing], axis=1)
        # Seen from free space a face turns counter-clockwise, and so runs along the floor from left to right.
        # Free space is on the left of the way back.
        triangles = upright[standing]
        ends = np.stack([triangles[row, (top + 2) % 3], triangles[row, (top + 1) % 3]], axis=1)
        return self.mesh.vertices[ends][:, :, :2]

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw walls and furniture from above.

        Args:
            axes: Where to draw; None for axes of a new figure.
        """
        axes = axes_in_metres(axes)
        self.draw_walls(axes)
        axes.autoscale_view()
        axes.set_title(self.plan.name, parse_math=False)  # names may have dollars in them
        return axes

    def draw_walls(self, axes: "Axes") -> None:
        """Draw walls and furniture from above into axes as they are."""
        from matplotlib.collections import LineCollection

        axes.add_collection(LineCollection(list(self.walls_2d), colors=WALL_COLOUR, linewidths=0.9))


def make_building(plan: FloorPlan, *, config: BuildingConfig | None = None) -> Building:
    """Extrude the outline of a floor plan to a building.

    Args:
        plan: Free cells and where their walls stand.
        config: Heights, tolerance and materials; None for the defaults.

    Raises:
        MapError: If the plan has no free area.
    """
    config = config or BuildingConfig()
    cells = free_cells(plan, config.tolerance_m)
    if plan.material is not None:
        cells = cut_at_materials(cells, plan)
    islands = _furniture(cells, config.furniture_max_m2 / plan.resolution_m**2)
    solid = extrude(cells, islands, config.height_m, config.furniture_height_m, config.ceiling)
    if not config.tolerance_m:
        solid = _joined(solid, pockets(closed_passages(plan), config.height_m))
    vertices = np.column_stack([placed(plan, solid.vertices[:, :2]), solid.vertices[:, 2]])
    free = shapely.transform(cells, lambda points: placed(plan, points))
    wanted = [config.material(kind) for kind in KINDS]
    of_face = solid.kind.astype(np.int64)
    if plan.material is not None:
        wanted += [material_of(name, "materials of the plan") for name in plan.materials]
        own = _own_materials(plan, solid)
        of_face = np.where(own > 0, len(KINDS) - 1 + own, of_face)
    materials = tuple(dict.fromkeys(wanted[i] for i in np.unique(of_face)))
    index = np.array([materials.index(one) if one in materials else 0 for one in wanted], np.uint8)
    made_from: dict[str, object] = {
        "plan": plan.name,
        "wall_line": plan.wall_line,
        "tolerance_m": config.tolerance_m,
        "frame": "map",
    }
    logger.info("%s: %d faces around %.1f m2 of free floor", plan.name, len(solid.faces), free.area)
    return Building(
        plan=plan,
        free=free,
        height_m=config.height_m,
        mesh=plain_mesh(vertices, solid.faces, made_from),
        face_kind=solid.kind,
        materials=materials,
        face_material=index[of_face],
    )


def _own_materials(plan: FloorPlan, solid: Solid) -> Int[np.ndarray, " n_faces"]:
    """Number of the plan's material of each upright face, 0 for none."""
    corners = solid.vertices[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, :2]
    upright = np.flatnonzero(np.isin(solid.kind, (WALL, FURNITURE)) & normal.any(axis=1))
    found = np.zeros(len(corners), np.int64)
    along = normal[upright][:, ::-1] * (1, -1)  # free space, which normals point into, is on the left of it
    middle = (corners[upright, :, :2].min(axis=1) + corners[upright, :, :2].max(axis=1)) / 2
    found[upright] = materials_behind(plan, middle, along)
    return found


def _furniture(free: shapely.MultiPolygon, max_area: float) -> Bool[np.ndarray, " n_rings"]:
    """Which rings go around islands of at most this area that have no free space inside."""
    parts = shapely.get_parts(free)
    rings, part = shapely.get_rings(parts, return_index=True)
    island = np.append(False, part[1:] == part[:-1])  # the first ring of each part is its outer one
    filled = shapely.polygons(rings)
    holds, _ = shapely.STRtree(shapely.point_on_surface(parts)).query(filled, predicate="contains")
    island[holds] = False
    return island & (shapely.area(filled) <= max_area)


def _joined(one: Solid, other: Solid) -> Solid:
    """Both together, without merging vertices."""
    faces = np.concatenate([one.faces, other.faces + len(one.vertices)])
    return Solid(
        np.concatenate([one.vertices, other.vertices]), faces, np.concatenate([one.kind, other.kind])
    )
