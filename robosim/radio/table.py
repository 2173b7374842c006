"""Radio paths from one transmitter to a grid of places, traced once and interpolated.

Between the four nodes around a place, paths are identified by their source. A reflected path comes from the mirror
image of the transmitter, which is the same for all places that it reaches; a diffracted one comes from the mirror image
of the last edge. Direction and length at the place itself follow exactly (method of images). The gain beyond spreading
varies from node to node and is interpolated in dB. A path exists if nodes that have it make up at least half of the
bilinear weight; only nodes that are visible from the place count. Errors remain in gains, where they bend between two
nodes, and along edges of shadows, which may be off by half a step. `python -m tests.benchmarks environment` measures
both.

The file of a table is the Parquet file of its paths (`wireless.paths`), with the grid in its metadata.
Left out: phases are those of a node, not of the place; measurements draw phases again.
Reference: Fuschini et al., Ray tracing propagation modeling for future small-cell and indoor applications: a review of
current techniques, Radio Science 50(6), 2015 (images and ray interpolation).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Bool, Float, Int
from scipy.constants import speed_of_light

from robosim.building.building import Building
from robosim.building.extrusion import wall_segments
from robosim.camera.rendering.wall_rays import WallTiles, nearest_wall, wall_tiles
from robosim.radio.receivers import regular_grid
from robosim.support.checks import check_number
from robosim.support.compiled import compiled
from robosim.support.files import whole_file
from robosim.support.reading import FileError, reading
from wireless.paths import Interaction, Paths
from wireless.support.columns import parquet_table
from wireless.tracing.tracer import Tracer

#: Usual distance of nodes [m]; the grid of the reference's tables.
STEP_M = 0.15
#: Distances that nodes may have [m].
STEP_RANGE_M = 0.01, 100.0
#: Paths whose sources are nearer than this are one [m].
_SAME_SOURCE_M = 0.01
#: Files are no larger [bytes].
_MOST_BYTES = 10_000_000_000
_REMEDY = "Delete it: it is traced again when it is needed."


@dataclass(frozen=True, kw_only=True, eq=False)
class RadioTable:
    """Paths from one transmitter to the nodes of a grid."""

    building: Building
    """Where."""
    paths: Paths
    """From one transmitter to all nodes."""
    step_m: float
    """Distance between neighbouring nodes [m]."""

    @classmethod
    def trace(
        cls, building: Building, tracer: Tracer, place: Float[np.ndarray, "3"], step_m: float = STEP_M
    ) -> "RadioTable":
        """Trace all nodes, as high as the place of the transmitter [m]; a few tenths of a millisecond each."""
        grid = regular_grid(building, step_m, float(place[2]))
        return cls(
            building=building, paths=tracer.trace(place[None], grid.position, workers=1), step_m=step_m
        )

    def at(self, xy: Float[np.ndarray, "2"]) -> Paths | None:
        """Paths at a place [m], of one link; None where no node is visible, as in a niche next to the grid."""
        nodes = self.nodes_around(xy)
        if nodes is None:
            return None
        node, weight = nodes
        ref, level = _common(self._first, self._key, self._level, node, weight)
        rx = np.array([[xy[0], xy[1], self.paths.tx_position[0, 2]]])
        toward = self._source[ref] - rx
        gap = np.linalg.norm(toward, axis=1)
        length = np.maximum(gap + self._rest[ref], 1e-3)
        power = np.exp(level) / length**2
        order = np.argsort(-power, kind="stable")
        ref, toward, gap, length, power = ref[order], toward[order], gap[order], length[order], power[order]
        paths = self.paths.select(ref)
        unit = toward / np.maximum(gap, 1e-9)[:, None]
        depart = -np.einsum("nij,nj->ni", self._mirror[ref], unit)
        fixed = self._bent[ref]
        return replace(
            paths,
            rx_position=rx,
            rx=np.zeros(len(ref), paths.rx.dtype),
            gain=paths.gain * np.sqrt(power / np.maximum(paths.power, 1e-300))[:, None, None],
            power=power,
            delay_s=(length + self._within_walls[ref]) / speed_of_light,
            aoa_az=np.arctan2(unit[:, 1], unit[:, 0]),
            aoa_el=np.arcsin(np.clip(unit[:, 2], -1, 1)),
            aod_az=np.where(fixed, paths.aod_az, np.arctan2(depart[:, 1], depart[:, 0])),
            aod_el=np.where(fixed, paths.aod_el, np.arcsin(np.clip(depart[:, 2], -1, 1))),
        )

    def nodes_around(
        self, xy: Float[np.ndarray, "2"]
    ) -> tuple[Int[np.ndarray, "4"], Float[np.ndarray, "4"]] | None:
        """The four nodes around a place, -1 for missing and invisible ones, and their weights, of sum 1."""
        # Paths and link states are computed at the same place, one after the other.
        key = np.asarray(xy, float).tobytes()
        if key not in self._last:
            self._last.clear()
            self._last[key] = self._nodes_around(xy)
        return self._last[key]

    def _nodes_around(
        self, xy: Float[np.ndarray, "2"]
    ) -> tuple[Int[np.ndarray, "4"], Float[np.ndarray, "4"]] | None:
        plan = self.building.plan
        column, row = plan.to_cells(np.asarray(xy, float)) * (plan.resolution_m / self.step_m) - 0.5
        node, weight = _around(
            self._index,
            self.paths.rx_position,
            self._walls,
            float(xy[0]),
            float(xy[1]),
            float(column),
            float(row),
        )
        total = weight.sum()
        return (node, weight / total) if total > 0 else None

    def links(self) -> Iterator[Paths]:
        """Paths to each node."""
        for start, end in pairwise(self._first.tolist()):
            yield self.paths.select(np.arange(start, end))

    def write(self, path: Path) -> None:
        """Write to a Parquet file."""
        table = self.paths.to_table()
        table = table.replace_schema_metadata({**(table.schema.metadata or {}), "step_m": repr(self.step_m)})
        with whole_file(path) as partial:
            pq.write_table(table, partial, compression="zstd")

    @classmethod
    def read(cls, path: Path, building: Building) -> "RadioTable":
        """Read a file of `write`, for the building in which it was traced; FileError if it is damaged, or no table."""
        with reading(path, "a table of radio paths", _REMEDY, most_bytes=_MOST_BYTES) as file:
            table = parquet_table(file)
            step = (table.schema.metadata or {}).get(b"step_m")
            if step is None:
                raise FileError("its metadata lack step_m")
            step_m = float(step)
            check_number("step_m", step_m, *STEP_RANGE_M, "m between nodes")
            paths, plan = Paths.from_table(table), building.plan
            cell = plan.to_cells(paths.rx_position[:, :2])
            if not ((cell >= 0) & (cell <= plan.shape[::-1])).all():
                raise FileError("its nodes lie outside of the plan, expected a table of this building")
            return cls(building=building, paths=paths, step_m=step_m)

    @cached_property
    def _last(self) -> dict[bytes, tuple[Int[np.ndarray, "4"], Float[np.ndarray, "4"]] | None]:
        """Nodes around the last place."""
        return {}

    @cached_property
    def _walls(self) -> WallTiles:
        """Walls at the height of the antennas."""
        return wall_tiles(wall_segments(self.building.free_at(float(self.paths.tx_position[0, 2]))))

    @cached_property
    def _index(self) -> Int[np.ndarray, "rows columns"]:
        """Number of the node at each place of the grid, -1 for none."""
        plan = self.building.plan
        cell = plan.to_cells(self.paths.rx_position[:, :2]) * (plan.resolution_m / self.step_m) - 0.5
        column, row = np.rint(cell).astype(int).T
        index = np.full((row.max() + 1, column.max() + 1), -1)
        index[row, column] = np.arange(len(row))
        return index

    @cached_property
    def _first(self) -> Int[np.ndarray, " n1"]:
        """Where each node's paths begin."""
        return np.searchsorted(self.paths.rx, np.arange(len(self.paths.rx_position) + 1))

    @cached_property
    def _level(self) -> Float[np.ndarray, " n"]:
        """Logarithm of the gain beyond spreading, with length."""
        length = self.paths.delay_s * speed_of_light - self._within_walls
        return np.log(np.maximum(self.paths.power, 1e-300) * length**2)

    @cached_property
    def _bent(self) -> Bool[np.ndarray, " n"]:
        """Paths that were diffracted or scattered: they depart in one direction, wherever they arrive."""
        kinds = self.paths.interaction
        return ((kinds == Interaction.DIFFRACTION) | (kinds == Interaction.SCATTERING)).any(axis=1)

    def _legs(self) -> tuple[Float[np.ndarray, "n m1 3"], Float[np.ndarray, "n m1"]]:
        """Unit vectors and lengths of the legs of each path [m]; missing legs have length 0."""
        paths = self.paths
        m = paths.interaction.shape[1]
        points = np.repeat(paths.rx_position[paths.rx][:, None], m + 2, axis=1)
        points[:, 0] = paths.tx_position[paths.tx]
        there = np.arange(m) < paths.order[:, None]
        points[:, 1:-1][there] = paths.point[there]
        legs = np.diff(points, axis=1)
        length = np.linalg.norm(legs, axis=2)
        return legs / np.maximum(length, 1e-12)[..., None], length

    @cached_property
    def _after(self) -> Float[np.ndarray, " n"]:
        """Length of each path after its last edge, or all of it [m]."""
        _, length = self._legs()
        kinds = self.paths.interaction
        bends = (kinds == Interaction.DIFFRACTION) | (kinds == Interaction.SCATTERING)
        last = np.where(bends.any(axis=1), bends.shape[1] - bends[:, ::-1].argmax(axis=1), 0)
        return np.where(np.arange(length.shape[1]) >= last[:, None], length, 0.0).sum(axis=1)

    @cached_property
    def _source(self) -> Float[np.ndarray, "n 3"]:
        """Where each path seems to come from [m]."""
        paths = self.paths
        flat = np.cos(paths.aoa_el)
        unit = np.column_stack(
            [flat * np.cos(paths.aoa_az), flat * np.sin(paths.aoa_az), np.sin(paths.aoa_el)]
        )
        return paths.rx_position[paths.rx] + self._after[:, None] * unit

    @cached_property
    def _rest(self) -> Float[np.ndarray, " n"]:
        """Length of each path up to its source [m]."""
        length = self.paths.delay_s * speed_of_light - self._within_walls
        return np.maximum(length - self._after, 0.0)

    @cached_property
    def _within_walls(self) -> Float[np.ndarray, " n"]:
        """Delay of the walls that each path passes, as a length beyond that of its legs [m]."""
        passes = (self.paths.interaction == Interaction.TRANSMISSION).any(axis=1)
        legs_m = self._legs()[1].sum(axis=1)
        return np.where(passes, self.paths.delay_s * speed_of_light - legs_m, 0.0)

    @cached_property
    def _mirror(self) -> Float[np.ndarray, "n 3 3"]:
        """Matrices from the direction of arrival of each path to that of departure: all its mirrors."""
        unit, length = self._legs()
        product = np.broadcast_to(np.eye(3), (len(self.paths), 3, 3)).copy()
        for k in range(self.paths.interaction.shape[1]):
            mirrors = (self.paths.interaction[:, k] == Interaction.REFLECTION) & (length[:, k + 1] > 0)
            normal = unit[mirrors, k] - unit[mirrors, k + 1]
            normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
            mirror = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]
            product[mirrors] = product[mirrors] @ mirror
        return product

    @cached_property
    def _key(self) -> Int[np.ndarray, " n"]:
        """Equal numbers for paths with the same source and interactions."""
        # Shifted by an odd part of the step: walls on round coordinates have images on round ones, where rounding
        # would part equal sources.
        place = np.floor(np.column_stack([self._source, self._rest]) / _SAME_SOURCE_M + 0.3719)
        columns = np.column_stack([place.astype(np.int64), self.paths.digits])
        _, key = np.unique(columns, axis=0, return_inverse=True)
        return key.reshape(-1)


@compiled
def _around(
    index: np.ndarray, position: np.ndarray, walls: WallTiles, x: float, y: float, column: float, row: float
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes around a place with nothing between, and their bilinear weights."""
    node, weight = np.full(4, -1), np.zeros(4)
    j, i = int(np.floor(column)), int(np.floor(row))
    across, up = column - j, row - i
    for k in range(4):
        right, above = k % 2, k // 2
        if not (0 <= i + above < index.shape[0] and 0 <= j + right < index.shape[1]):
            continue
        candidate = index[i + above, j + right]
        if candidate < 0:
            continue
        dx, dy = position[candidate, 0] - x, position[candidate, 1] - y
        meets, _ = nearest_wall(walls, x, y, dx, dy, 1.0)
        if meets <= 1.0:
            continue
        node[k] = candidate
        # Never 0: next to walls a node at the far side may be the only one.
        weight[k] = max((across if right else 1 - across) * (up if above else 1 - up), 1e-9)
    return node, weight


@compiled
def _common(
    first: np.ndarray, key: np.ndarray, level: np.ndarray, node: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Paths that at least half of the weight has: a single row each, of the heaviest node, and their mean level."""
    n_max = 0
    for k in range(4):
        if node[k] >= 0:
            n_max += first[node[k] + 1] - first[node[k]]
    ref, keys = np.empty(n_max, np.int64), np.empty(n_max, np.int64)
    total, mean = np.zeros(n_max), np.zeros(n_max)
    count = 0
    for k in np.argsort(-weight):
        if node[k] < 0:
            continue
        for path in range(first[node[k]], first[node[k] + 1]):
            place = 0
            while place < count and keys[place] != key[path]:
                place += 1
            if place == count:
                ref[count], keys[count] = path, key[path]
                count += 1
            total[place] += weight[k]
            mean[place] += weight[k] * level[path]
    common = np.flatnonzero(total[:count] >= 0.5)
    return ref[common], mean[common] / total[common]
