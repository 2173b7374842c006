"""Radio paths between points in a building: line of sight, reflections, diffraction, by exact geometry.

    paths = Tracer(mesh, frequency_hz=28e9).trace(tx, rx)
    paths = Tracer(building, frequency_hz=28e9).trace(tx, rx)   # a mesh with materials

A mesh that was extruded from a floor plan is traced as one, storeys over each other as several: views through their
exact outlines (`wireless.geometry.visibility`), joined and weighed per link (`wireless.tracing.plan_engine`). Any other
mesh, and points above a plan's ceiling or below its floor, are traced in space (`wireless.tracing.space_engine`),
slower, to the same paths. All decide in double precision. Work that depends on the building only (outline, corners,
triangulation; facets, edges, boxes) is done once, when the tracer is made.

Left out: more than one diffraction on a path; scattering by rough walls unless `TracerConfig.scattering` is set.
"""

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from multiprocessing import parent_process
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol, runtime_checkable

import numpy as np
import trimesh
from jaxtyping import Bool, Complex, Float, Int, Integer
from numpy.typing import ArrayLike
from scipy.constants import speed_of_light

from robosim.support.checks import Range, checked
from wireless.em.materials import WALLS, Material, scattering_of, wall_row
from wireless.em.scattering import MOST_NARROW
from wireless.geometry.array_types import Point
from wireless.geometry.closed_surfaces import find_two_faced
from wireless.geometry.extruded import find_extruded
from wireless.geometry.plan import REACH_M
from wireless.geometry.stack import find_stack
from wireless.paths import Paths
from wireless.support.arrays import to_positions
from wireless.tracing.blocks import Rows
from wireless.tracing.coverage import trace_coverage
from wireless.tracing.curved import CurvedWalls
from wireless.tracing.mesh_check import SceneError as SceneError
from wireless.tracing.mesh_check import check_mesh
from wireless.tracing.reweighed import reweigh
from wireless.tracing.scattered import Scattering, scattering_in_plan, scattering_in_space
from wireless.tracing.scenes import PlanScene, SpaceScene
from wireless.tracing.stack_scene import NoStackError, StackScene
from wireless.tracing.table import Setting

logger = logging.getLogger(__name__)

#: Most reflections of a path, walls that it passes, and paths of a link. The list of a link takes memory for each of
#: its paths; each reflection more takes a half to three times longer (12 of them: a second a link of a home's exact
#: outline, where 3 take 30 ms), and costs a drywall's path some 10 dB.
MOST_IN_A_ROW, MOST_PATHS = 12, 5000
#: Walls that paths pass below this frequency, by default; above it, walls lose too much power for
#: these paths to matter much [Hz].
OPAQUE_HZ, WALLS_PASSED = 10e9, 2
#: Thickest layer of a wall, and widest gap between two [m].
THICKEST_M = 100.0
#: Most interactions of all kinds on a path: those before an edge, the edge, and those after it.
MOST_INTERACTIONS = 4 * MOST_IN_A_ROW + 1
#: Why curved walls cannot be had.
NO_CURVES = (
    "curved walls are traced in floor plans only, from floor to ceiling. Leave them out (curved_walls=False), or trace "
    "a building whose walls reach the ceiling, between floor and ceiling."
)
#: Weights of theta to theta, phi to phi and the crossed gains in a path's power.
POLARISATIONS = {"vertical": (1.0, 0.0, 0.0), "horizontal": (0.0, 1.0, 0.0), "both": (0.5, 0.5, 0.5)}


@runtime_checkable
class Scene(Protocol):
    """A mesh that knows what its faces are made of, such as a building of `robosim`."""

    @property
    def mesh(self) -> trimesh.Trimesh:
        """Walls (and floor and ceiling) as triangles [m], z up."""

    @property
    def materials(self) -> tuple[str | Material, ...]:
        """Radio materials, by the names of `wireless.em.materials`, or of layers of their own."""

    @property
    def face_material(self) -> Integer[np.ndarray, " n_faces"]:
        """Material of each face: index into `materials`."""

    @property
    def floor_ceiling(self) -> bool:
        """Whether floor and ceiling reflect where `TracerConfig.floor_ceiling` is None."""


@dataclass(frozen=True, kw_only=True)
@checked
class TracerConfig:
    """Which paths are looked for, and how many are listed."""

    max_reflections: Annotated[int, Range(0, MOST_IN_A_ROW)] = 3
    """Most reflections on a path without diffraction."""
    diffraction: bool = True
    """Whether edges diffract."""
    diffraction_reflections: Annotated[int, Range(0, MOST_IN_A_ROW)] = 1
    """Most reflections, before and after together, on a path with diffraction."""
    diffraction_side_reflections: Annotated[int | None, Range(0, MOST_INTERACTIONS)] = None
    """Most of them on either side of the edge; None for no such limit."""
    diffraction_law: Literal["nearer_face", "bisector"] = "nearer_face"
    """Angle at which the faces of an edge reflect: that of source or observer, whichever is nearer to the face, or half
    the angle between both. The former agrees with full-wave solutions, the latter with one commercial ray tracer."""
    floor_ceiling: bool | None = None
    """Whether floor and ceiling, such as the ground, reflect; these reflections count like those of walls. None as the
    scene says: buildings of floor plans and storeys say no, scene files yes; meshes reflect at both, unless they are
    extruded floor plans or storeys."""
    max_transmissions: Annotated[int | None, Range(0, MOST_IN_A_ROW, "walls")] = None
    """Most walls that a path passes; half-spaces let nothing through. None for 2 below 10 GHz, and for no wall from
    there on."""
    wall_passage: Literal["wall", "face"] = "wall"
    """Wall of a transmission: the two faces of a drawn wall or a solid together, which are passed once, or each face
    alone, as in the published grids. A sheet without thickness is a wall in both."""
    max_interactions: Annotated[int | None, Range(0, MOST_INTERACTIONS)] = None
    """Most interactions on a path, walls that it passes included; None for no such limit."""
    wall_thickness_m: Annotated[float | None, Range(1e-9, THICKEST_M, "m")] = None
    """Thickness of walls of one material, which are layers then [m]; None for half-spaces. Walls that have layers of
    their own, such as partition, keep them."""
    wall_gap_m: Annotated[float, Range(0, THICKEST_M, "m")] = 0.0
    """Air between two layers of that thickness, which are a wall then [m]; 0 for one layer."""
    scattering: Annotated[float | None, Range(0, 1)] = None
    """Scattering coefficient S of walls whose material says none; 0 scatters only from those that do, None
    from none. One scattering a path (`wireless.tracing.scattered`); storeys are traced in space then."""
    scattering_lobe: Annotated[int | None, Range(0, MOST_NARROW)] = 4
    """Exponent of the scattered lobe of such walls; None for Lambert's law."""
    scattering_tile_m: Annotated[float, Range(0.05, 10, "m")] = 0.5
    """Largest side of the pieces that walls scatter by, each a path [m]."""
    curved_walls: bool = False
    """Whether four or more short walls that follow a circle, as those of round posts do, reflect as the circle does. In
    floor plans (`wireless.tracing.curved`)."""
    max_paths: Annotated[int, Range(1, MOST_PATHS, "paths")] = 25
    """Most paths of a link: the strongest ones."""
    polarisation: Literal["vertical", "horizontal", "both"] = "vertical"
    """Antennas' polarisation, for a path's power; "both" is the mean over the two at the transmitter."""
    scene: Literal["auto", "plan", "storeys", "space"] = "auto"
    """Trace as floor plan, as storeys over each other, in space, or as what it is."""
    search: Literal["auto", "exhaustive", "rays"] = "auto"
    """How chains of facets are found in space: all that there are, by rays, or by rays if there are many facets."""
    rays: Annotated[int, Range(10, 10_000_000, "rays")] = 100_000
    """Rays that each transmitter shoots in a search by rays; edges bend some more for each."""
    snap_m: Annotated[float, Range(1e-9, 1e-2, "m")] = 1e-6
    """Ends of walls closer than this are one, and corners closer than this to a plane lie in it [m]; farther where
    coordinates were rounded to 32 bits (`wireless.geometry.tolerance`)."""

    def __post_init__(self) -> None:
        if self.wall_gap_m and self.wall_thickness_m is None:
            raise ValueError(
                f"wall_gap_m is {self.wall_gap_m}, but half-spaces have no gap. "
                "Give wall_thickness_m, the thickness of each of the two layers, such as 0.013."
            )
        if self.scattering is not None and self.scene == "storeys":
            raise ValueError(
                "scattering is traced in floor plans and in space, but scene is 'storeys'. Leave it out "
                "(scattering=None), or use scene='space'."
            )

    def walls_passed(self, frequency_hz: float) -> int:
        """Most walls that a path passes at a carrier frequency [Hz]."""
        if self.max_transmissions is not None:
            return self.max_transmissions
        return WALLS_PASSED if frequency_hz < OPAQUE_HZ else 0


def _whole(value: object) -> bool:
    """Whether a value is a whole number."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _checked_faces(
    face_material: Integer[np.ndarray, " n"] | None, n_faces: int, n_materials: int
) -> Int[np.ndarray, " n_faces"]:
    """Material of each face, the first where none is given."""
    of_face = np.zeros(n_faces, np.int64) if face_material is None else np.asarray(face_material)
    if of_face.shape != (n_faces,) or of_face.dtype.kind not in "iu":
        raise ValueError(
            f"face_material has shape {of_face.shape} of {of_face.dtype}, expected ({n_faces},) whole numbers."
        )
    if of_face.min() < 0 or of_face.max() >= n_materials:
        raise ValueError(
            f"face_material has values {of_face.min()} to {of_face.max()}, expected indices into "
            f"{n_materials} materials."
        )
    return of_face.astype(np.int64)


class Tracer:
    """A building made ready for tracing.

    Args:
        scene: Walls (and floor and ceiling) as triangles [m], z up, of any orientation; or something that has
            such a mesh, and its materials with it.
        materials: Radio materials, by the names of `wireless.em.materials` or as a `Material`; None for the
            scene's own, or drywall.
        face_material: What each face is made of, index into materials; None for the scene's own, or if all are of
            the first.
        frequency_hz: Carrier frequency.
        config: Which paths to look for; None for the defaults.

    Raises:
        ValueError: If a material is unknown at this frequency, or face_material does not fit, or the scene has
            materials of its own.
        SceneError: If the mesh has no area, corners that it does not have or that are not finite, or is so large
            that it cannot be in metres.
    """

    def __init__(
        self,
        scene: trimesh.Trimesh | Scene,
        *,
        materials: tuple[str | Material, ...] | None = None,
        face_material: Integer[np.ndarray, " n_faces"] | None = None,
        frequency_hz: float = 28e9,
        config: TracerConfig | None = None,
    ):
        self.config = config or TracerConfig()
        self.frequency_hz = float(frequency_hz)
        slabs_reflect: bool | None = None
        if isinstance(scene, trimesh.Trimesh):
            mesh = scene
        else:
            if materials is not None or face_material is not None:
                raise ValueError(
                    "materials or face_material is given, but the scene has its own: leave them out, or trace its mesh."
                )
            mesh, materials, face_material = scene.mesh, scene.materials, scene.face_material
            # Scenes of users may lack it: then the geometry decides, as for a mesh.
            slabs_reflect = getattr(scene, "floor_ceiling", None)
        materials = ("drywall",) if materials is None else materials
        check_mesh(mesh, self.config.snap_m)
        self.mesh = mesh
        of_face = _checked_faces(face_material, len(mesh.faces), len(materials))
        self._of_face = of_face
        self._face_wall = self._walls(materials)[of_face]
        self._face_half = self._halves(mesh)
        upright = np.abs(mesh.face_normals[:, 2]) < 0.5
        if self.config.walls_passed(self.frequency_hz) and not self.config.wall_thickness_m:
            for number in np.unique(of_face[upright]):
                if isinstance(material := materials[number], str) and material not in WALLS:
                    _report_half_space(material)
        # A face that is a wall by itself is another wall than one of a pair.
        self.scene, self._in_space = self._scenes(mesh, 2 * of_face + self._face_half, slabs_reflect)
        self.config = replace(self.config, floor_ceiling=self.scene.floor_ceiling)
        self._scattering: Scattering | None = None
        if self.config.scattering is not None:
            self._scattering = self._rough(self.scene, materials)
            self._scattering_in_space = cache(lambda: self._rough(self._in_space(), materials))
        self._curved: CurvedWalls | None = None
        if self.config.curved_walls:
            if not isinstance(self.scene, PlanScene):
                raise SceneError(NO_CURVES)
            self._curved = CurvedWalls(self.scene, self.config.snap_m)

    @classmethod
    def from_mitsuba(
        cls,
        path: str | Path,
        *,
        materials: Mapping[str, str | Material] | None = None,
        frequency_hz: float = 28e9,
        config: TracerConfig | None = None,
        allow_large: bool = False,
    ) -> "Tracer":
        """A tracer of a Mitsuba scene, such as one of Sionna RT; see `wireless.tracing.mitsuba_scene`.

        Args:
            path: The scene (.xml).
            materials: Materials by their names in the scene, instead of its own.
            frequency_hz: Carrier frequency.
            config: Which paths to look for; None for the defaults.
            allow_large: Whether the scene may have more triangles than `wireless.tracing.scene_size` expects.

        Raises:
            FileError: If a file is damaged, a shape or material is not understood, or there are too many triangles.
        """
        from wireless.tracing.mitsuba_scene import read_mitsuba

        scene = read_mitsuba(Path(path), materials, allow_large=allow_large)
        return cls(scene, frequency_hz=frequency_hz, config=config)

    def _walls(self, materials: tuple[str | Material, ...]) -> Complex[np.ndarray, "m l"]:
        """Layers of walls of each material, see `wireless.em.fresnel.fresnel`."""
        c = self.config
        rows = [
            wall_row(material, self.frequency_hz, c.wall_thickness_m or 0.0, c.wall_gap_m)
            for material in materials
        ]
        walls = np.zeros((len(rows), max(map(len, rows))), np.complex128)
        for i, row in enumerate(rows):
            walls[i, : len(row)] = row
        return walls

    def _scenes(
        self, mesh: trimesh.Trimesh, of_face: Int[np.ndarray, " n_faces"], slabs_reflect: bool | None
    ) -> tuple[PlanScene | StackScene | SpaceScene, Callable[[], SpaceScene]]:
        """Return the scene that the mesh is traced as, and a factory of the scene for points outside of it.

        `slabs_reflect` is what the scene says of `TracerConfig.floor_ceiling`, None for a mesh.
        """
        c = self.config
        plan = find_extruded(mesh, of_face, c.snap_m) if c.scene in ("auto", "plan") else None
        if plan is None and c.scene == "plan":
            raise SceneError(
                "The mesh is no extruded floor plan: its walls are not all upright from floor to ceiling. "
                "Trace it with scene='space'."
            )
        stack = None if plan is not None else find_stack(mesh, of_face, c.snap_m)
        if stack is None and c.scene == "storeys":
            raise SceneError(
                "The mesh is no storeys over each other: its walls are not all upright between the heights of two "
                "floors and ceilings or more. Trace it with scene='space'."
            )
        if c.floor_ceiling is not None:
            slabs_reflect = c.floor_ceiling
        elif slabs_reflect is None and not (plan is None and stack is None):
            slabs_reflect = False
        common: dict[str, Any] = {"snap_m": c.snap_m, "floor_ceiling": slabs_reflect}
        parts = mesh, of_face, self._face_wall, self._setting
        level_m = None if stack is None else stack.level_m
        in_space = cache(lambda: SpaceScene(*parts, **common, search=c.search, rays=c.rays, level_m=level_m))
        if plan is not None:
            return PlanScene(plan, self._setting, **common), in_space
        if stack is not None and c.scene != "space" and c.scattering is None:
            try:
                return StackScene(stack, *parts, **common), in_space
            except NoStackError as error:
                if c.scene == "storeys":
                    raise SceneError(
                        f"The storeys cannot be traced as such because {error}. Trace them with scene='space'."
                    ) from None
                logger.info(f"Storeys are traced in space, which takes longer, because {error}")
        elif c.scene == "auto":
            logger.info("The mesh is no extruded floor plan: it is traced in space, which takes longer.")
        return in_space(), in_space

    def trace(self, tx: ArrayLike, rx: ArrayLike, *, workers: int | None = None) -> Paths:
        """Paths of all links between transmitters and receivers.

        A point on a wall (within 1e-9 m, or what rounding moved its corners by) is on both sides of it, and has no
        reflection at it. Where faces of several materials lie on each other, the first material is met. A path shorter
        than the wavelength over 2 pi (1.7 mm at 28 GHz), where there is no far field yet, is as strong as at that
        length: no more arrives than was sent. A receiver where the transmitter is gets echoes only, as no direction
        leads there.

        Args:
            tx: Positions of transmitters [m], an array or lists of n_tx x 3 numbers.
            rx: Positions of receivers [m], n_rx x 3.
            workers: Threads that many links are traced in; None for one on each available core. The paths
                do not depend on it.

        Returns:
            Paths by transmitter, receiver and falling power.

        Raises:
            ValueError: If there are no points, or one is not finite, kilometres away, or with scene='plan' not
                between floor and ceiling, or there is no worker.
        """
        tx, rx, scene = to_positions(tx, "tx"), to_positions(rx, "rx"), self.scene
        for name, points in (("tx", tx), ("rx", rx)):
            far = np.abs(points - scene.origin).max()
            if far >= REACH_M:
                raise ValueError(
                    f"{name} has a position {far:g} m from the middle of the mesh, expected under {REACH_M:g} m."
                )
        if workers is not None and not (_whole(workers) and workers >= 1):
            raise ValueError(f"workers is {workers}, expected at least 1, or None for all cores.")
        for name, points in (("tx", tx), ("rx", rx)):
            if wrong := self.scene.misplaced(points - self.scene.origin):
                if self.config.scene != "auto":
                    raise ValueError(f"{name} has {wrong}")
                logger.info("Points in floors, walls or ceilings, or outside of them: traced in space")
                if self._curved is not None:
                    raise ValueError(f"Points lie below the floor or above the ceiling, and {NO_CURVES}")
                scene = self._in_space()
                break
        # Loops are compiled for each layout of arrays.
        tx_local, rx_local = (np.ascontiguousarray(points - scene.origin) for points in (tx, rx))
        tables = scene.tables(tx_local, rx_local, workers)
        if self._curved is not None:
            keep = self.config.max_paths * (1 if self._scattering is None else 2)
            tables = self._curved.added(tables, tx_local, rx_local, keep, workers)
        if self._scattering is not None:
            scattering = self._scattering if scene is self.scene else self._scattering_in_space()
            tables = scattering.added(tables, tx_local, rx_local, self.config.max_paths)
        return self._paths(tx, rx, tables, scene.origin)

    coverage = trace_coverage

    def reweigh(self, paths: Paths, materials: tuple[str | Material, ...]) -> Float[np.ndarray, " n"]:
        """Power gain of paths that this tracer found, with other materials in the place of its own, in their order.

        Raises:
            ValueError: If a material is unknown at this frequency, or their number is another one.
            SceneError: If the scene is no single floor plan, scatters, or has curved walls.
        """
        scene = self.scene
        if not isinstance(scene, PlanScene) or self._scattering is not None or self._curved is not None:
            raise SceneError(
                "Paths are reweighed in floor plans without scattering and curved walls only. Trace them again with a "
                "new Tracer."
            )
        if len(materials) <= self._of_face.max():
            raise ValueError(
                f"materials are {len(materials)}, expected {self._of_face.max() + 1}: one for each of the tracer's own."
            )
        faces = np.append(scene.extruded.wall_face, [scene.extruded.floor_face, scene.extruded.ceiling_face])
        setting = scene.setting._replace(walls=self._walls(materials)[self._of_face[faces]])
        point = paths.corners() - scene.origin
        return reweigh(scene.outline, setting, paths.order, paths.interaction, paths.primitive, point)

    def _rough(
        self, scene: PlanScene | StackScene | SpaceScene, materials: tuple[str | Material, ...]
    ) -> Scattering:
        """Scattering by walls as rough as their materials say, or else the configuration."""
        c = self.config
        share, alpha = np.zeros(len(materials)), np.zeros(len(materials), np.int64)
        for i, material in enumerate(materials):
            share[i], lobe = scattering_of(material, c.scattering or 0.0, c.scattering_lobe)
            alpha[i] = -1 if lobe is None else lobe
        if isinstance(scene, PlanScene):
            wall = self._of_face[scene.extruded.wall_face]
            return scattering_in_plan(scene, share[wall], alpha[wall], c.scattering_tile_m)
        assert isinstance(scene, SpaceScene)  # storeys are traced in space if they scatter
        wall = self._of_face[scene.space.surfaces.facet_face]
        return scattering_in_space(scene, share[wall], alpha[wall], c.scattering_tile_m)

    def _halves(self, mesh: trimesh.Trimesh) -> Bool[np.ndarray, " n_faces"]:
        """Which faces are one of the two faces of a wall, if paths may pass walls and these count once."""
        passes = self._face_wall[:, 1].real > 0
        if (
            self.config.wall_passage == "face"
            or not self.config.walls_passed(self.frequency_hz) * passes.any()
        ):
            return np.zeros(len(passes), bool)
        if self.config.max_transmissions is None:
            _report_passage(self.frequency_hz)
        return find_two_faced(mesh)

    def _setting(self, faces: Int[np.ndarray, " n"]) -> Setting:
        """Physics and limits of this tracer, for walls or facets that have some faces of the mesh."""
        config, half = self.config, self._face_half[faces]
        walls = config.walls_passed(self.frequency_hz)
        through = 2 * walls if half.any() else walls
        max_interactions = 2**62 if config.max_interactions is None else config.max_interactions
        vertical, horizontal, crossed = POLARISATIONS[config.polarisation]
        bent, side = config.diffraction_reflections, config.diffraction_side_reflections
        return Setting(
            walls=self._face_wall[faces],
            half=half,
            low_m=0.0,
            high_m=0.0,
            has_floor=False,
            has_ceiling=False,
            wavenumber=2 * np.pi * self.frequency_hz / speed_of_light,
            max_reflections=config.max_reflections,
            edge_reflections=bent if config.diffraction else -1,
            side_reflections=(bent if side is None else min(bent, side)) if config.diffraction else -1,
            max_walls=walls,
            max_through=through,
            max_interactions=max_interactions,
            max_met=max_interactions + through - walls,
            vertical=vertical,
            horizontal=horizontal,
            crossed=crossed,
            # Reflections that lose by scattering may change the order of the last ones, and chords of arcs drop out.
            keep=config.max_paths * (1 if config.scattering is None and not config.curved_walls else 2),
            bisector=config.diffraction_law == "bisector",
        )

    def _paths(
        self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"], rows: Rows, origin: Point
    ) -> Paths:
        tables = [table for row in rows for table, _ in row]
        owner = [np.repeat(np.arange(len(t.n_paths)) + first, t.n_paths) for row in rows for t, first in row]
        transmitter = [np.full(len(t.power), i) for i, row in enumerate(rows) for t, _ in row]

        def column(name: str) -> np.ndarray:
            return np.concatenate([getattr(table, name) for table in tables])

        order, point = column("order"), column("point")
        row = np.arange(len(order))
        out, back = point[row, 1] - point[row, 0], point[row, order] - point[row, order + 1]
        inner = point[:, 1:-1] + origin
        inner[np.arange(inner.shape[1]) >= order[:, None]] = np.nan
        return Paths(
            tx_position=tx,
            rx_position=rx,
            frequency_hz=self.frequency_hz,
            tx=np.concatenate(transmitter),
            rx=np.concatenate(owner),
            gain=column("gain"),
            power=column("power"),
            delay_s=column("length_m") / speed_of_light,
            aoa_az=np.arctan2(back[:, 1], back[:, 0]),
            aoa_el=np.arctan2(back[:, 2], np.hypot(back[:, 0], back[:, 1])),
            aod_az=np.arctan2(out[:, 1], out[:, 0]),
            aod_el=np.arctan2(out[:, 2], np.hypot(out[:, 0], out[:, 1])),
            order=order.astype(np.uint8),
            interaction=column("kind").astype(np.uint8),
            primitive=column("primitive"),
            point=inner,
        )


@cache
def _report_passage(frequency_hz: float) -> None:
    """Warn once, and not in each worker process, that paths pass walls by default."""
    if parent_process() is not None:
        return
    logger.warning(
        f"At {frequency_hz / 1e9:g} GHz paths pass up to {WALLS_PASSED} walls. Set max_transmissions to change that "
        "(robosim trace --max-transmissions, robosim episode --radio.tracer.max-transmissions)."
    )


@cache
def _report_half_space(material: str) -> None:
    """Say, once, that walls of a material have no thickness."""
    logger.warning(
        f"Walls of {material} have no thickness: they are half-spaces, which reflect and let nothing through. Set "
        f"wall_thickness_m (--wall-thickness 0.1), or take a wall of layers: {', '.join(WALLS)}."
    )
