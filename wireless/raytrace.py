"""Radio paths between points in a building: line of sight, reflections, diffraction, by exact geometry.

    paths = Tracer(mesh, frequency_hz=28e9).trace(tx, rx)

A mesh that was extruded from a floor plan is traced as one: views through its exact outline in double
precision (`wireless.beams`), joined and weighed per link (`wireless.links`). All of the building's own work
(outline, corners, triangulation) is done once, when the tracer is made. Any other mesh is refused so far.

Left out: transmission through walls, more than one diffraction on a path, scattering by rough walls.
"""

import logging
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.constants import speed_of_light

from wireless.extruded import find_extruded
from wireless.links import Setting, Table, Views, trace_links, views_of
from wireless.materials import permittivity
from wireless.paths import Paths
from wireless.plan import Locator, make_plan

logger = logging.getLogger(__name__)

#: Receivers traced at once: bounds memory (about 15 kB each in a building of 1000 corners).
CHUNK = 2048
#: Weights of theta to theta, phi to phi and the crossed gains in a path's power.
POLARISATIONS = {"vertical": (1.0, 0.0, 0.0), "horizontal": (0.0, 1.0, 0.0), "both": (0.5, 0.5, 0.5)}


class SceneError(ValueError):
    """A mesh that cannot be traced."""


@dataclass(frozen=True, kw_only=True)
class TracerConfig:
    """Which paths are looked for, and how many are kept."""

    max_reflections: int = 3
    """Most reflections on a path without diffraction."""
    diffraction: bool = True
    """Whether edges diffract."""
    diffraction_reflections: int = 1
    """Most reflections, before and after together, on a path with diffraction."""
    floor_ceiling: bool = False
    """Whether floor and ceiling reflect; these reflections count like those of walls."""
    max_paths: int = 25
    """Most paths of a link; the strongest are kept."""
    polarisation: Literal["vertical", "horizontal", "both"] = "vertical"
    """Antennas' polarisation, for a path's power; both takes the mean over both at the transmitter."""
    snap_m: float = 1e-6
    """Ends of walls closer than this are one [m]."""

    def __post_init__(self) -> None:
        for name, low in (("max_reflections", 0), ("diffraction_reflections", 0), ("max_paths", 1)):
            if getattr(self, name) < low:
                raise ValueError(f"{name} is {getattr(self, name)}, expected at least {low}.")
        if self.polarisation not in POLARISATIONS:
            raise ValueError(
                f"polarisation is {self.polarisation!r}, expected one of {', '.join(POLARISATIONS)}."
            )
        if not 1e-9 <= self.snap_m <= 1e-2:
            raise ValueError(
                f"snap_m is {self.snap_m}, expected 1e-9 to 1e-2 m, well below any wall's length."
            )


class Tracer:
    """A building made ready for tracing.

    Args:
        mesh: Walls (and floor and ceiling) as triangles [m], z up. Which way they face does not matter.
        materials: Radio materials, by the names of `wireless.materials`.
        face_material: What each face is made of, index into materials; None if all are of the first.
        frequency_hz: Carrier frequency.
        config: Which paths to look for; None for the defaults.

    Raises:
        ValueError: If a material is unknown at this frequency, or face_material does not fit.
        SceneError: If the mesh is empty or not finite.
    """

    def __init__(
        self,
        mesh: trimesh.Trimesh,
        *,
        materials: tuple[str, ...] = ("drywall",),
        face_material: Int[np.ndarray, "n_faces"] | None = None,
        frequency_hz: float = 28e9,
        config: TracerConfig | None = None,
    ):
        self.config = config or TracerConfig()
        self.frequency_hz = float(frequency_hz)
        n_faces = len(mesh.faces)
        if n_faces == 0 or not np.isfinite(mesh.vertices).all():
            raise SceneError(f"The mesh has {n_faces} faces and must have some, with finite vertices.")
        of_face = (
            np.zeros(n_faces, np.int64) if face_material is None else np.asarray(face_material, np.int64)
        )
        if of_face.shape != (n_faces,) or of_face.min() < 0 or of_face.max() >= len(materials):
            raise ValueError(
                f"face_material has shape {of_face.shape} and values {of_face.min()} to {of_face.max()}, "
                f"expected ({n_faces},) and indices into {len(materials)} materials."
            )
        eps = np.array([permittivity(name, self.frequency_hz) for name in materials])
        scene = find_extruded(mesh, of_face, self.config.snap_m)
        if scene is None:
            raise SceneError(
                "The mesh is no extruded floor plan: its walls are not all upright from floor to ceiling."
            )
        self.scene = scene
        self.plan = make_plan(scene.walls, self.config.snap_m)
        self._locate = Locator(self.plan, 2 * self.config.snap_m)
        self._setting = self._make_setting(eps[of_face])
        logger.info(
            "%d walls, %d corners, %d triangles",
            len(scene.walls),
            len(self.plan.corner_vertex),
            len(self.plan.tri_vertex),
        )

    def trace(self, tx: Float[np.ndarray, "n_tx 3"], rx: Float[np.ndarray, "n_rx 3"]) -> Paths:
        """Paths of all links between transmitters and receivers.

        Args:
            tx: Positions of transmitters [m].
            rx: Positions of receivers [m].

        Returns:
            Paths by transmitter, receiver and falling power.

        Raises:
            ValueError: If a point is not finite, or neither between floor and ceiling.
        """
        tx, rx = np.atleast_2d(np.asarray(tx, float)), np.atleast_2d(np.asarray(rx, float))
        for name, points in (("tx", tx), ("rx", rx)):
            z = points[:, 2]
            if not np.all((z >= self.scene.low_m) & (z <= self.scene.high_m)):
                raise ValueError(
                    f"{name} has heights from {z.min()} to {z.max()} m, expected {self.scene.low_m} to "
                    f"{self.scene.high_m} m, between floor and ceiling."
                )
        origin = np.append(self.plan.origin, 0.0)
        tx_start, tx_triangle = self._locate((tx - origin)[:, :2])
        rows: list[list[tuple[Table, int]]] = [[] for _ in tx]
        for first in range(0, len(rx), CHUNK):
            some = rx[first : first + CHUNK] - origin
            start, triangle = self._locate(some[:, :2])
            views = self._views(some, start, triangle)
            target_start, target_list = _by_triangle(start, triangle, len(self.plan.tri_vertex))
            for i, one in enumerate(tx - origin):
                around = tx_triangle[tx_start[i] : tx_start[i + 1]]
                table = trace_links(
                    self.plan, self._setting, one, around, some, target_start, target_list, views
                )
                rows[i].append((_packed(table), first))
        return self._paths(tx, rx, rows)

    def _views(
        self, rx: Float[np.ndarray, "r 3"], start: Int[np.ndarray, "r1"], triangle: Int[np.ndarray, "s"]
    ) -> Views:
        return views_of(self.plan, rx[:, :2].copy(), start, triangle, self._setting.edge_reflections)

    def _make_setting(self, face_eps: np.ndarray) -> Setting:
        scene, config = self.scene, self.config
        faces = np.append(scene.wall_face, [scene.floor_face, scene.ceiling_face])
        vertical, horizontal, crossed = POLARISATIONS[config.polarisation]
        return Setting(
            wall_eps=face_eps[faces],
            low_m=scene.low_m,
            high_m=scene.high_m,
            has_floor=config.floor_ceiling and scene.floor_face >= 0,
            has_ceiling=config.floor_ceiling and scene.ceiling_face >= 0,
            wavenumber=2 * np.pi * self.frequency_hz / speed_of_light,
            max_reflections=config.max_reflections,
            edge_reflections=config.diffraction_reflections if config.diffraction else -1,
            vertical=vertical,
            horizontal=horizontal,
            crossed=crossed,
            keep=config.max_paths,
        )

    def _paths(
        self,
        tx: Float[np.ndarray, "n_tx 3"],
        rx: Float[np.ndarray, "n_rx 3"],
        rows: list[list[tuple[Table, int]]],
    ) -> Paths:
        tables = [table for row in rows for table, _ in row]
        owner = [np.repeat(np.arange(len(t.found)) + first, t.found) for row in rows for t, first in row]
        sender = [np.full(len(t.power), i) for i, row in enumerate(rows) for t, _ in row]

        def column(name: str) -> np.ndarray:
            return np.concatenate([getattr(table, name) for table in tables])

        order, point = column("order"), column("point")
        row = np.arange(len(order))
        out, back = point[row, 1] - point[row, 0], point[row, order] - point[row, order + 1]
        inner = point[:, 1:-1] + np.append(self.plan.origin, 0.0)
        inner[np.arange(inner.shape[1]) >= order[:, None]] = np.nan
        return Paths(
            tx_position=tx,
            rx_position=rx,
            frequency_hz=self.frequency_hz,
            tx=np.concatenate(sender),
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
            thing=column("thing"),
            point=inner,
        )


def _by_triangle(
    start: Int[np.ndarray, "r1"], triangle: Int[np.ndarray, "s"], n_triangles: int
) -> tuple[Int[np.ndarray, "t1"], Int[np.ndarray, "s"]]:
    """Points of each triangle, from the triangles of each point."""
    point = np.repeat(np.arange(len(start) - 1), np.diff(start))
    order = np.argsort(triangle, kind="stable")
    return np.searchsorted(triangle[order], np.arange(n_triangles + 1)), point[order]


def _packed(table: Table) -> Table:
    """The same without the rows that no path fills."""
    keep = len(table.power) // max(1, len(table.found))
    used = (np.arange(keep) < table.found[:, None]).ravel()
    return Table(table.found, *(column[used] for column in table[1:]))
