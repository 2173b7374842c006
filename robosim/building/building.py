"""A building made from a floor plan: one geometry for camera, collision and radio.

The walls of the plan's outline are extruded from the floor at z = 0 to the ceiling; floor and ceiling are
triangulated between them with no vertices but the corners of the walls. So each free polygon becomes a closed
shell whose normals point into free space (its signed volume is negative, therefore) and that has no seams for
a ray to slip through. Small islands in free space are furniture, which may be lower than walls.

Where walls meet at a point with free space on two sides, each side has vertices of its own and the shell is a
manifold still; a file format that merges vertices by position joins them, which changes no surface. Walls in
passages of no width (`robosim.building.outline`) are added as flat pockets of no volume, with a face on either side.

Any mesh can be placed in it (`robosim.plans.furnishings`), at its own height: camera, lidar and radio see its
triangles as they are, and it stops robots that are higher than its lowest parts (`Building.floor`).

Left out: doors and windows as such, walls with a thickness. Storeys over each other: `robosim.building.multi_storey`.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, TypeVar

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt8

from robosim.building.extrusion import (
    FURNITURE,
    KINDS,
    PLACED,
    WALL,
    Faces,
    Solid,
    extrude,
    plain_mesh,
    pockets,
)
from robosim.building.footprint import filled, footprint
from robosim.building.outline import TOLERANCE_M, closed_passages, free_cells, to_map_exactly
from robosim.building.wall_materials import cut_at_materials, materials_behind
from robosim.parts import MATERIAL, MaterialPart, NextMaterialPart
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.furnishings.furnishing import Furnishing
from robosim.plans.outside import outside_of
from robosim.support.axes import axes_in_metres
from robosim.support.checks import Range, checked
from robosim.support.colours import FURNISHING as FURNISHING_COLOUR
from robosim.support.colours import WALL as WALL_COLOUR
from robosim.support.parts import Part
from wireless.em.materials import Material, check_material

if TYPE_CHECKING:
    from matplotlib.axes import Axes

logger = logging.getLogger(__name__)

AnyBuilding = TypeVar("AnyBuilding", bound=Faces)

#: How far a placed mesh may reach through floor and ceiling [m].
_THROUGH_M = 1e-6
#: Corners of free floor nearer than this are merged [m], and smaller areas are dropped [m2].
_TIDY_M = 1e-7


def material_of(material: Part, field: str) -> str | Material:
    """A radio material: a name of `wireless.em.materials`, or the layers of a file or part; `field` is for messages."""
    if MATERIAL.is_name(material):
        check_material(material, field)
        return str(material)
    made: Material = MATERIAL.make(material, field=field)
    return made


@dataclass(frozen=True, kw_only=True)
@checked
class BuildingConfig:
    """How a floor plan becomes a building."""

    tolerance_m: Annotated[float | None, TOLERANCE_M] = None
    """How far walls may be moved to save corners [m]; 0 keeps the exact outline of the cells. None for straight walls
    under the staircases of a raster, and the exact outline of published grids."""
    height_m: Annotated[float, Range(0.1, 100, "m", "Try 2.5.")] = 2.5
    """Height of the ceiling above the floor [m]."""
    ceiling: bool = True
    """Whether there is a ceiling."""
    furniture_max_m2: Annotated[float, Range(0, 1e6, "m2")] = 4.0
    """Islands in free space of at most this area are furniture [m2]; 0 for none."""
    furniture_height_m: Annotated[float | None, Range(0.01, 100, "m")] = None
    """Height of furniture [m], which gets a lid; None for up to the ceiling, like walls."""
    wall_material: MaterialPart = "partition"
    """Radio material of walls."""
    floor_material: NextMaterialPart = "concrete"
    """Radio material of the floor; names as for walls."""
    ceiling_material: NextMaterialPart = "ceiling_board"
    """Radio material of the ceiling; names as for walls."""
    furniture_material: NextMaterialPart = "partition"
    """Radio material of furniture; names as for walls."""

    def __post_init__(self) -> None:
        low = self.furniture_height_m
        if low is not None and not low < self.height_m:
            raise ValueError(
                f"furniture_height_m is {low}, expected a height between 0 and height_m = {self.height_m}. "
                "Leave it out for furniture up to the ceiling."
            )
        for kind in KINDS[:PLACED]:
            self.material(kind)

    def material(self, kind: str) -> str | Material:
        """Radio material of a kind of face: a name of `wireless.em.materials`, or layers."""
        return material_of(getattr(self, f"{kind}_material"), f"{kind}_material")


@dataclass(frozen=True, kw_only=True, eq=False)
class Storey:
    """Storey of a building."""

    building: "Building"
    """The storey alone, its floor at z = 0."""
    floor_m: float = 0.0
    """Height of its floor above that of the lowest storey [m]."""
    opening: shapely.MultiPolygon = field(default_factory=shapely.MultiPolygon)
    """Where the slab over it is open [m]."""

    @property
    def ceiling_m(self) -> float:
        """Height of its ceiling above the lowest floor [m]."""
        return self.floor_m + self.building.height_m


@dataclass(frozen=True, kw_only=True, eq=False)
class Building(Faces):
    """A storey in three dimensions, in the `map` frame: z up, floor at z = 0."""

    plan: FloorPlan
    """Floor plan of the storey."""
    free: shapely.MultiPolygon
    """Free floor [m] in `map`; walls stand on its boundary. Furnishings are not taken off: see `floor`,
    `free_at`."""
    height_m: float
    """Height of the ceiling above the floor [m]."""

    def __repr__(self) -> str:
        placed = f", {len(self.furnishings)} placed in it" if self.furnishings else ""
        return (
            f"<Building {self.plan.name!r}: {self.free.area:.1f} m2 of free floor, {len(self.mesh.faces)} faces of "
            f"{', '.join(map(str, self.materials))}{placed}>"
        )

    @property
    def storeys(self) -> tuple[Storey, ...]:
        """The building as its own only storey."""
        return (Storey(building=self),)

    @cached_property
    def bare(self) -> "Building":
        """The building without what is placed in it."""
        if not self.furnishings:
            return self
        is_structure = self.face_kind != PLACED
        return replace(
            self,
            mesh=self._part(is_structure),
            face_kind=self.face_kind[is_structure],
            face_material=self.face_material[is_structure],
            furnishings=(),
        )

    def floor(self, height_m: float) -> shapely.MultiPolygon:
        """The floor [m], in `map`, on which an upright body of a height meets no wall, and nothing that is placed.

        Things at this height or higher do not stop it, nor do things lower than `ROLLS_OVER_M` of `footprint`.
        """
        return self._without("floor", height_m)

    def taken(self, height_m: float) -> shapely.MultiPolygon:
        """The free floor that placed things take from an upright body of some height: `free` without `floor`."""
        return self._without("taken", height_m)

    def free_at(self, height_m: float) -> shapely.MultiPolygon:
        """Area at a height [m] in which a point is in neither a wall nor a placed body, from above, in `map` [m]."""
        return self._without("level", height_m)

    def nearest_free(
        self, shape: shapely.Geometry, height_m: float, clearance_m: float = 0.0
    ) -> Float[np.ndarray, "2"]:
        """The point of `free_at` nearest to a shape [m], this far from walls where there is space for it."""
        return shapely.get_coordinates(shapely.shortest_line(self._clear(height_m, clearance_m), shape))[0]

    def _clear(self, height_m: float, clearance_m: float) -> shapely.Geometry:
        key = f"level {clearance_m}", float(height_m)
        if key not in self._free_of:
            free = self.free_at(height_m)
            inside = free.buffer(-clearance_m)
            self._free_of[key] = free if inside.is_empty else inside
        return self._free_of[key]

    @cached_property
    def _free_of(self) -> dict[tuple[str, float], shapely.Geometry]:
        return {}

    def _without(self, what: str, height_m: float) -> shapely.MultiPolygon:
        """Free floor without what is placed, computed once for each height."""
        if not self.furnishings:
            return shapely.MultiPolygon() if what == "taken" else self.free
        key = what, float(height_m)
        if key not in self._free_of:
            take, cut = filled if what == "level" else footprint, shapely.difference
            if what == "taken":
                cut = shapely.intersection
            taken = shapely.union_all([take(furnishing.bodies, height_m) for furnishing in self.furnishings])
            parts = shapely.get_parts(cut(self.free, taken, grid_size=_TIDY_M))
            parts = parts[shapely.area(parts) > _TIDY_M]  # neither slivers nor lines
            self._free_of[key] = shapely.orient_polygons(shapely.MultiPolygon(list(parts)))
        return self._free_of[key]

    @property
    def indoor_m2(self) -> float:
        """Area of the free floor [m2], without free space around the building."""
        return self.free.area - float(outside_of(self.plan).sum()) * self.plan.resolution_m**2

    @property
    def walls_2d(self) -> Float[np.ndarray, "n 2 2"]:
        """Walls and furniture from above: ends (x, y) [m] of segments in `map`, free space on their left.

        A passage of no width has each of its two walls.
        """
        upright = self.mesh.faces[np.isin(self.face_kind, (WALL, FURNITURE))]
        up = self.mesh.vertices[upright][:, :, 2] > 0
        standing = up.sum(axis=1) == 1  # the triangle of each wall that has an edge on the floor
        row, top = np.arange(standing.sum()), np.argmax(up[standing], axis=1)
        # Seen from free space a face turns counter-clockwise, and so runs along the floor from left to right;
        # free space is on the left in the opposite direction.
        triangles = upright[standing]
        ends = np.stack([triangles[row, (top + 2) % 3], triangles[row, (top + 1) % 3]], axis=1)
        return self.mesh.vertices[ends][:, :, :2]

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw walls and furniture from above; None for axes of a new figure."""
        axes = axes_in_metres(axes)
        self.draw_walls(axes)
        axes.autoscale_view()
        axes.set_title(self.plan.name, parse_math=False)  # names may have dollars in them
        return axes

    @cached_property
    def outlines(self) -> list[Float[np.ndarray, "_ 2"]]:
        """Closed outlines (x, y) [m] in `map` of all that is placed in it, from above."""
        things = [footprint(furnishing.bodies, self.height_m) for furnishing in self.furnishings]
        return [shapely.get_coordinates(line) for line in shapely.get_parts(shapely.boundary(things))]

    @property
    def name(self) -> str:
        """Name of its plan."""
        return self.plan.name

    def draw_walls(self, axes: "Axes", *, colour: str = WALL_COLOUR, zorder: float = 2) -> None:
        """Draw walls, furniture and what is placed from above into axes as they are."""
        from matplotlib.collections import LineCollection

        if self.furnishings:
            axes.add_collection(
                LineCollection(self.outlines, colors=FURNISHING_COLOUR, linewidths=0.7, zorder=zorder)
            )
        walls = LineCollection(list(self.walls_2d), colors=colour, linewidths=0.9, zorder=zorder)
        axes.add_collection(walls)


def make_building(
    plan: FloorPlan, *, config: BuildingConfig | None = None, furnishings: Sequence[Furnishing] = ()
) -> Building:
    """Extrude the outline of a floor plan to a building, and place furnishings in it.

    Args:
        plan: Free cells and the position of their walls.
        config: Heights, tolerance and materials; None for the defaults.
        furnishings: Things placed in it in addition to the plan's furnishings.

    Raises:
        MapError: If the plan has no free area, or what is placed is not between floor and ceiling or wholly outside.
    """
    config = config or BuildingConfig()
    cells = free_cells(plan, config.tolerance_m)
    if plan.material is not None:
        cells = cut_at_materials(cells, plan)
    solid = _extruded(plan, cells, config)
    materials, face_material = _materials(plan, solid, config)
    vertices = np.column_stack([to_map_exactly(plan, solid.vertices[:, :2]), solid.vertices[:, 2]])
    free = shapely.transform(cells, lambda points: to_map_exactly(plan, points))
    made_from: dict[str, object] = {
        "plan": plan.name,
        "wall_line": plan.wall_line,
        "tolerance_m": config.tolerance_m,
        "frame": "map",
    }
    logger.info(f"{plan.name}: {len(solid.faces)} faces around {free.area:.1f} m2 of free floor")
    building = Building(
        plan=plan,
        free=free,
        height_m=config.height_m,
        mesh=plain_mesh(vertices, solid.faces, made_from),
        face_kind=solid.kind,
        materials=materials,
        face_material=face_material,
    )
    placed = (*plan.furnishings, *furnishings)
    for furnishing in placed:
        _check_place(building, furnishing)
    return with_furnishings(building, placed)


def _extruded(plan: FloorPlan, cells: shapely.MultiPolygon, config: BuildingConfig) -> Solid:
    """Faces around free cells, and on both sides of walls in passages of no width, in cells and metres of height."""
    islands = _furniture(cells, config.furniture_max_m2 / plan.resolution_m**2)
    solid = extrude(cells, islands, config.height_m, config.furniture_height_m, config.ceiling)
    if config.tolerance_m:
        return solid
    closed = pockets(closed_passages(plan), config.height_m)
    return Solid(
        np.concatenate([solid.vertices, closed.vertices]),
        np.concatenate([solid.faces, closed.faces + len(solid.vertices)]),
        np.concatenate([solid.kind, closed.kind]),
    )


def _materials(
    plan: FloorPlan, solid: Solid, config: BuildingConfig
) -> tuple[tuple[str | Material, ...], UInt8[np.ndarray, " n_faces"]]:
    """Materials that faces have, and the index of each face among them."""
    known = [config.material(kind) for kind in KINDS[:PLACED]]
    of_face = solid.kind.astype(np.int64)
    if plan.material is not None:
        known += [material_of(name, "materials of the plan") for name in plan.materials]
        coloured = _coloured_walls(plan, solid)
        of_face = np.where(coloured > 0, PLACED - 1 + coloured, of_face)
    used = tuple(dict.fromkeys(known[i] for i in np.unique(of_face)))
    index = np.array([used.index(each) if each in used else 0 for each in known], np.uint8)
    return used, index[of_face]


def with_furnishings(bare: AnyBuilding, furnishings: tuple[Furnishing, ...]) -> AnyBuilding:
    """A building of one or several storeys with meshes placed in it, whose faces come last."""
    if not furnishings:
        return bare
    made_of = [
        material_of(furnishing.material, f"material of {furnishing.name}") for furnishing in furnishings
    ]
    materials = tuple(dict.fromkeys([*bare.materials, *made_of]))
    bodies = [furnishing.bodies for furnishing in furnishings]
    vertices = [np.asarray(bare.mesh.vertices), *(body.vertices for body in bodies)]
    first = np.cumsum([len(corners) for corners in vertices[:-1]])
    faces = [np.asarray(bare.mesh.faces), *(body.faces + at for body, at in zip(bodies, first, strict=True))]
    counts = [len(body.faces) for body in bodies]
    material = np.repeat(np.array([materials.index(each) for each in made_of], np.uint8), counts)
    logger.info(f"{len(furnishings)} things of {sum(counts)} faces are placed in the building")
    return replace(
        bare,
        mesh=plain_mesh(np.concatenate(vertices), np.concatenate(faces), bare.mesh.metadata),
        face_kind=np.concatenate([bare.face_kind, np.full(sum(counts), PLACED, np.uint8)]),
        materials=materials,
        face_material=np.concatenate([bare.face_material, material]),
        furnishings=furnishings,
    )


def _check_place(bare: Building, furnishing: Furnishing) -> None:
    """Raise MapError for a mesh that reaches through floor or ceiling, or does not stand on free floor."""
    low, high = furnishing.bodies.vertices[:, 2].min(), furnishing.bodies.vertices[:, 2].max()
    at = f"{furnishing.source or bare.plan.name}: {furnishing.name} at ({furnishing.at[0]:g}, {furnishing.at[1]:g}) m"
    if low < -_THROUGH_M:
        raise MapError(
            f"{at} reaches {-low:.3g} m below the floor, expected z = 0 or more. Give it z_m: {-low:.4g}."
        )
    if high > bare.height_m + _THROUGH_M:
        raise MapError(
            f"{at} reaches to {high:.3g} m, expected at most the ceiling at {bare.height_m:g} m. Check its unit_m and "
            "up, or raise the ceiling: height_m."
        )
    outline = shapely.convex_hull(shapely.multipoints(furnishing.bodies.vertices[:, :2]))
    inside = outline.intersection(bare.free)
    if inside.is_empty:
        near = bare.nearest_free(outline, 0.0)
        raise MapError(
            f"{at} stands in a wall or outside of the building; the nearest free floor is at ({near[0]:.2f}, "
            f"{near[1]:.2f}) m."
        )
    if inside.area < outline.area / 2:
        logger.warning(f"{at} stands in walls by more than half of its outline.")


def _coloured_walls(plan: FloorPlan, solid: Solid) -> Int[np.ndarray, " n_faces"]:
    """Number of the plan's material of each upright face, 0 for none."""
    corners = solid.vertices[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, :2]
    upright = np.flatnonzero(np.isin(solid.kind, (WALL, FURNITURE)) & normal.any(axis=1))
    material = np.zeros(len(corners), np.int64)
    along = normal[upright][:, ::-1] * (1, -1)  # free space, which normals point into, is on the left of it
    middle = (corners[upright, :, :2].min(axis=1) + corners[upright, :, :2].max(axis=1)) / 2
    material[upright] = materials_behind(plan, middle, along)
    return material


def _furniture(free: shapely.MultiPolygon, max_area: float) -> Bool[np.ndarray, " n_rings"]:
    """Mask of rings around islands of at most this area without free space inside."""
    parts = shapely.get_parts(free)
    rings, polygon = shapely.get_rings(parts, return_index=True)
    island = np.append(False, polygon[1:] == polygon[:-1])  # the first ring of each part is its outer one
    filled = shapely.polygons(rings)
    holds, _ = shapely.STRtree(shapely.point_on_surface(parts)).query(filled, predicate="contains")
    island[holds] = False
    return island & (shapely.area(filled) <= max_area)
