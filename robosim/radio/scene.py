"""Where radio is: plans, buildings of several storeys and Mitsuba scenes behind one interface.

Positions are x, y [m] in `map`, or in the frame of the scene, and heights above the lowest floor [m].
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import shapely
import trimesh
from jaxtyping import Bool, Float

from robosim.building.building import Building, BuildingConfig, Storey, make_building
from robosim.building.multi_storey import Storeys, StoreysConfig, make_storeys
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.storey_plans import OneStorey
from robosim.radio.no_paths import explain_missing_paths
from robosim.radio.receivers import ReceiverGrid, random_transmitters, receiver_grid
from robosim.support.checks import FARTHEST, FREQUENCY_HZ, Range, check_number, checked
from wireless.coverage import CoverageMap
from wireless.motion.blockage import block
from wireless.motion.bodies import Bodies
from wireless.paths import Paths
from wireless.tracing.coverage import level_grid
from wireless.tracing.mitsuba_scene import MitsubaScene, read_mitsuba
from wireless.tracing.tracer import Tracer, TracerConfig

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from mpl_toolkits.mplot3d import Axes3D

#: A place this far from free space still counts as on its edge [m].
ON_EDGE_M = 1e-6
#: Faces that meet at a smaller angle are one surface in pictures.
FLAT_RAD = 1e-3
Place = FloorPlan | OneStorey
AnyPlace = Place | MitsubaScene


@dataclass(frozen=True, kw_only=True)
@checked
class RadioConfig:
    """Radio to trace: carrier, antennas, physics and limits."""

    frequency_hz: Annotated[float, FREQUENCY_HZ] = 28e9
    """Carrier frequency."""
    height_m: Annotated[float, Range(0, 100, "m")] = 1.5
    """Height of receivers, and of transmitters without a height of their own [m]."""
    tx_power_dbm: Annotated[float, Range(-200, 200, "dBm", "Try 23.")] = 23.0
    """Transmit power, from which received powers count."""
    threshold_dbm: Annotated[float | None, Range(-400, 200, "dBm", "Try -100.")] = None
    """Paths received with less do not count for link states; None counts all."""
    tracer: TracerConfig = field(default_factory=TracerConfig)
    """Which paths are traced."""
    building: BuildingConfig = field(default_factory=BuildingConfig)
    """Walls of the plan."""

    @property
    def threshold_db(self) -> float:
        """Least power gain of paths that count for link states."""
        return -np.inf if self.threshold_dbm is None else self.threshold_dbm - self.tx_power_dbm


class RadioSite(ABC):
    """Where radio is: surfaces with a tracer, and the places that terminals can have among them."""

    name: str
    """Its name in reports and files."""
    config: RadioConfig
    """Radio to trace."""
    whole: Building | Storeys | MitsubaScene
    """All surfaces, and their materials."""
    mesh: trimesh.Trimesh
    """Triangles of all surfaces."""
    storeys: tuple[Storey, ...] = ()
    """Storeys of a building, from the lowest up; a scene has none."""
    building: Building | None = None
    """The building that receivers are in; a scene has none."""
    floor_m: float = 0.0
    """Height of the floor below terminals without a height of their own [m]."""

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer, made at the first use; ValueError if a material is unknown at the carrier frequency."""
        return Tracer(self.whole, frequency_hz=self.config.frequency_hz, config=self.config.tracer)

    @property
    def engine(self) -> str:
        """Engine of the tracer: `plan` or `storeys`, which are fast, or `space`."""
        return self.tracer.scene.engine

    @property
    def digest(self) -> str:
        """A text that changes with any vertex, face or material."""
        return self.whole.digest

    @abstractmethod
    def section(self, grid: ReceiverGrid) -> "Building | SceneSection":
        """Level section at the height of a grid, for pictures from above."""

    @property
    def height_m(self) -> float:
        """Height of terminals without one of their own, above the lowest floor [m]."""
        return self.floor_m + self.config.height_m

    def places(self, points: tuple[tuple[float, ...], ...], name: str) -> Float[np.ndarray, "n 3"]:
        """Points (x, y) or (x, y, z) [m] as positions; heights count from the lowest floor.

        Without z a point is at `height_m`.

        Raises:
            ValueError: If a point is not in free space; the message says where the nearest free point is.
            MapError: If a point has no height, and `height_m` is above the ceiling of its storey.
        """
        if any(len(point) < 3 for point in points):
            self.check_height()
        positions = np.array([[*point, self.height_m][:3] for point in points], float).reshape(-1, 3)
        for value in positions.ravel():
            check_number(name, float(value), -FARTHEST, FARTHEST, "m")
        for position in positions:
            if problem := self.problem_at(position, name):
                raise ValueError(problem)
        return positions

    def check_height(self, every: bool = False) -> None:
        """Raise MapError if terminals without a height of their own would be above their ceiling, or that of any."""
        return None

    @abstractmethod
    def grid(self, step_m: float, **options: Any) -> ReceiverGrid:
        """Receivers in cells of a side [m] at `height_m`; ValueError if there is none.

        Scenes need `tx`, the transmitters [m], which are in air, and take `bounds_m`, a box x, y, x, y.
        """

    def coverage(
        self,
        tx: Float[np.ndarray, "n_tx 3"],
        cell_m: float,
        bounds_m: tuple[float, ...] | None = None,
        **options: Any,
    ) -> CoverageMap:
        """Coverage of the cells of a grid by transmitters [m]; `options` are those of `Tracer.coverage`."""
        about = {"tx_power_dbm": self.config.tx_power_dbm, "threshold_db": self.config.threshold_db}
        return self.tracer.coverage(tx, grid=self.grid(cell_m, tx=tx, bounds_m=bounds_m), **about | options)

    def nearest_free(self, place: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The free point nearest to a place (x, y) or (x, y, z) [m]."""
        return np.array(place, float)

    def problem_at(self, position: Float[np.ndarray, "3"], name: str) -> str | None:
        """Why a terminal of a name cannot be at a position [m]; None in free space."""
        return None

    def trace(
        self,
        tx: Float[np.ndarray, "n_tx 3"],
        rx: Float[np.ndarray, "n_rx 3"],
        workers: int | None = None,
        bodies: Bodies | None = None,
    ) -> Paths:
        """Paths from transmitters to receivers [m], attenuated by bodies; see `wireless.motion.blockage.block`."""
        paths = self.tracer.trace(tx, rx, workers=workers)
        return paths if bodies is None else block(paths, bodies)[0]

    def remarks(self, transmitters: Float[np.ndarray, "n 3"]) -> list[str]:
        """Return remarks on a trace from transmitters [m] before it starts."""
        return []

    def explain_missing_paths(
        self, tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "n 3"], reached: Bool[np.ndarray, " n"]
    ) -> str:
        """Return why receivers [m] that are not `reached` lack paths from a transmitter [m]; empty if not known."""
        return ""

    def draw(self, axes: "Axes3D", near: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "2 3"]:
        """Draw the edges of surfaces around a box [m] in three dimensions; returns the box that is shown."""
        from mpl_toolkits.mplot3d.art3d import Line3DCollection

        margin = 1.0 + 0.1 * (near[1] - near[0]).max()
        low = np.maximum(near[0] - margin, np.minimum(near[0], self.mesh.bounds[0]))
        high = np.minimum(near[1] + margin, np.maximum(near[1], self.mesh.bounds[1]))
        lines = clipped(surface_edges(self.mesh), low, high)
        if len(lines):
            axes.add_collection3d(Line3DCollection(list(lines), colors="0.25", linewidths=0.6, zorder=2))
        return np.array([low, high])


def radio_site(place: AnyPlace | Path, config: RadioConfig) -> RadioSite:
    """The building of a plan, all storeys of a building around one of them, or the Mitsuba scene of a file."""
    match place:
        case Path():
            return MeshScene(read_mitsuba(place), config)
        case MitsubaScene():
            return MeshScene(place, config)
    return RadioScene(place, config)


#: Terminals are no farther below a scene [m].
_BELOW_M = 10.0


class MeshScene(RadioSite):
    """A Mitsuba scene: places are anywhere but far below it, its floor is at its lowest point."""

    def __init__(self, scene: MitsubaScene, config: RadioConfig):
        self.name, self.config, self.mesh = scene.name, config, scene.mesh
        self.whole: MitsubaScene = scene
        self.floor_m = float(scene.mesh.bounds[0, 2])

    def problem_at(self, position: Float[np.ndarray, "3"], name: str) -> str | None:
        """Why a terminal of a name cannot be at a position [m]; None but far below the scene."""
        if position[2] >= self.floor_m - _BELOW_M:
            return None
        return (
            f"{name} is at z = {position[2]:g} m, but {self.name} begins at {self.floor_m:g} m. Give metres."
        )

    def explain_missing_paths(
        self, tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "n 3"], reached: Bool[np.ndarray, " n"]
    ) -> str:
        """Return what `robosim.radio.no_paths` finds."""
        return explain_missing_paths(self.whole, tx, rx, reached)

    def section(self, grid: ReceiverGrid) -> "SceneSection":
        """The surfaces of the scene at the height of a grid."""
        return SceneSection(self.name, self.mesh, grid)

    def grid(self, step_m: float, **options: Any) -> ReceiverGrid:
        """Cells over all of the scene, or over a box."""
        return level_grid(self.mesh, step_m, self.height_m, **options)


class SceneSection:
    """A level section of a scene, with the members of a `Building` that pictures from above need."""

    furnishings = ()

    def __init__(self, name: str, mesh: trimesh.Trimesh, grid: ReceiverGrid):
        self.name = name
        corners = grid.edges.reshape(-1, 2)
        self.free = shapely.MultiPolygon([shapely.box(*corners.min(axis=0), *corners.max(axis=0))])
        lines = trimesh.intersections.mesh_plane(mesh, [0, 0, 1], [0, 0, grid.position[0, 2]])
        self._lines = np.asarray(lines).reshape(-1, 2, 3)[..., :2]

    def draw_walls(self, axes: "Axes", *, colour: str, zorder: float) -> None:
        """Draw the surfaces that the section meets."""
        from matplotlib.collections import LineCollection

        axes.add_collection(LineCollection(list(self._lines), colors=colour, linewidths=0.9, zorder=zorder))


class RadioScene(RadioSite):
    """The building of a plan, or all storeys of a building around the one in which receivers are.

    Raises:
        MapError: If a plan has no free area.
        ValueError: If a setting does not fit a building of several storeys.
    """

    clearance_m = 0.01
    """Distance of nearest free points from walls, where there is space [m]; more than messages round away."""

    building: Building
    """The building that receivers are in."""

    def __init__(self, plan: Place, config: RadioConfig):
        self.config = config
        number, self._label = 0, plan.name
        match plan:
            case FloorPlan():
                self.whole: Building | Storeys = make_building(plan, config=config.building)
            case _:
                number, building = plan.number, plan.building
                self._label = building.label
                self.whole = make_storeys(building, config=StoreysConfig(building=config.building))
        self.name, self.mesh, self.storeys = plan.name, self.whole.mesh, self.whole.storeys
        self._number, self.building = number, self.storeys[number].building
        self.floor_m = self.storeys[number].floor_m

    def check_height(self, every: bool = False) -> None:
        """Raise MapError if terminals without a height of their own would be above the ceiling of their storey."""
        for number in range(len(self.storeys)) if every else [self._number]:
            high_m, height_m = self.storeys[number].building.height_m, self.config.height_m
            if height_m > high_m:
                storey = f"storey {number}" if len(self.storeys) > 1 else "the building"
                raise MapError(
                    f"{self._label}: height of terminals (--height) is {height_m:g} m, expected 0 to {high_m:g} m, "
                    f"that of {storey}. Give --height {high_m / 2:g}, or places with heights of their own, X,Y,Z."
                )

    def section(self, grid: ReceiverGrid) -> Building:
        """The building of the storey."""
        return self.building

    def grid(self, step_m: float, **options: Any) -> ReceiverGrid:
        """Receivers on a grid over the plan, or the storey, at the configured height above its floor."""
        if options.get("bounds_m") is not None:
            raise ValueError(f"bounds are given for {self.name}, but they are for scenes. Leave them out.")
        self.check_height()
        grid = receiver_grid(self.building, step_m, self.config.height_m)
        return replace(grid, position=grid.position + np.array([0.0, 0.0, self.floor_m]))

    def transmitters(
        self, count: int, stream: Callable[[int], np.random.Generator]
    ) -> Float[np.ndarray, "count 3"]:
        """Random places [m], one storey after the other from the lowest up; each storey has its random numbers."""
        turns = -(-count // len(self.storeys))
        self.check_height(every=True)
        each = [
            random_transmitters(storey.building, turns, self.config.height_m, stream(number))
            + np.array([0.0, 0.0, storey.floor_m])
            for number, storey in enumerate(self.storeys)
        ]
        return np.stack(each, axis=1).reshape(-1, 3)[:count]

    def nearest_free(self, place: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The free point nearest to a place on its storey [m]; any free point for NaN or infinite values."""
        x, y, z = [*place, self.height_m][:3]
        storey = min(self.storeys, key=lambda s: max(s.floor_m - z, z - s.ceiling_m))
        height_m = min(max(z - storey.floor_m, 0.0), storey.building.height_m)
        point = shapely.Point(x, y)
        if not np.isfinite([x, y]).all():
            point = storey.building.free_at(height_m).representative_point()
        nearest = storey.building.nearest_free(point, height_m, self.clearance_m)
        return np.array([*nearest, storey.floor_m + height_m][: len(place)])

    def problem_at(self, position: Float[np.ndarray, "3"], name: str) -> str | None:
        """Why a terminal of a name cannot be at a position [m]; None in free space."""
        x, y, z = position.tolist()
        storey = next((s for s in self.storeys if s.floor_m <= z <= s.ceiling_m), None)
        if storey is None:
            spans = ", ".join(f"{s.floor_m:g} to {s.ceiling_m:g}" for s in self.storeys)
            return (
                f"height of {name} ({x:g}, {y:g}) is {z:g} m, expected {spans} m, between floor and ceiling."
            )
        if storey.building.free_at(z - storey.floor_m).distance(shapely.Point(x, y)) > ON_EDGE_M:
            near = self.nearest_free(position)
            within = " at this height" if storey.building.furnishings else ""
            return (
                f"{name} is ({x:g}, {y:g}) m, outside of the free space of {storey.building.plan.name}{within}; the "
                f"nearest free point is ({near[0]:.2f}, {near[1]:.2f}) m."
            )
        return None

    def remarks(self, transmitters: Float[np.ndarray, "n 3"]) -> list[str]:
        """Why tracing is slow, and which transmitters are cut off from the largest part of free space."""
        remarks = []
        if self.engine == "space":
            remarks.append(
                f"{self.name} is traced in space, ten to a hundred times slower: not all of its "
                f"{len(self.mesh.faces)} triangles are walls from floor to ceiling, floors and ceilings."
            )
            if (order := self.config.tracer.max_reflections) > 1:
                remarks[0] += f" One reflection less (--max-reflections {order - 1}) makes it faster."
        if len(self.storeys) > 1 or self.config.tracer.walls_passed(self.config.frequency_hz):
            return remarks  # stairs and walls may lead on
        components = shapely.get_parts(self.building.free)
        areas = shapely.area(components)
        for x, y, _ in transmitters:
            area = areas[np.argmin(shapely.distance(components, shapely.Point(x, y)))]
            if area < areas.max():
                remarks.append(
                    f"tx ({x:g}, {y:g}) is in a part of {area:.1f} m2 without a passage to the largest one, of "
                    f"{areas.max():.1f} m2: only receivers in its own part have paths."
                )
        return remarks


def surface_edges(mesh: trimesh.Trimesh) -> Float[np.ndarray, "n 2 3"]:
    """Edges of a mesh, but for those within a flat surface."""
    solid = mesh.copy()
    solid.merge_vertices()
    flat = solid.face_adjacency_edges[solid.face_adjacency_angles < FLAT_RAD]
    edges = np.unique(solid.edges_sorted, axis=0)
    key, key_of_flat = (pairs.astype(np.int64) @ [len(solid.vertices), 1] for pairs in (edges, flat))
    return solid.vertices[edges[~np.isin(key, key_of_flat)]]


def clipped(
    lines: Float[np.ndarray, "n 2 3"], low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "m 2 3"]:
    """The sections of straight lines within a box (Liang and Barsky, 1984)."""
    start, along = lines[:, 0], lines[:, 1] - lines[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        enter, leave = np.sort([(low - start) / along, (high - start) / along], axis=0)
    apart = ((along == 0) & ((start < low) | (start > high))).any(axis=1)
    first = np.fmax(np.where(along == 0, 0.0, enter).max(axis=1), 0.0)
    last = np.fmin(np.where(along == 0, 1.0, leave).min(axis=1), 1.0)
    is_inside = ~apart & (first < last)
    ends = np.stack([first, last], axis=1)[is_inside, :, None]
    return start[is_inside, None] + ends * along[is_inside, None]
