"""The map of a robot, continued by what others have reported of theirs.

Robots report their maps in square tiles, of one byte per cell: whether it was seen, and how probable an obstacle is.
Where a robot has seen a cell itself, its own map counts, and where it has not, those of the others. Tiles are put on
the lattice of its own map, to the nearest cell.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple
from zlib import crc32

import numpy as np
from jaxtyping import Float, UInt8

from robosim.support.compiled import compiled
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull
from slam.poses import to_map, to_robot

#: Side of a tile [cells].
TILE = 64
#: Codes of cells: a bit for seen ones, and the obstacle probability in steps; the last stands for bumped obstacles.
_SEEN, _STEPS, _BUMPED, _UNKNOWN = 128, 126, 127, 63
#: Probability of each code.
_PROBABILITY = np.tile(np.append(np.linspace(0.0, 1.0, _STEPS + 1), 1.0), 2).astype(np.float32)
#: Half side of the surroundings of the robot that follow its own map at every decision [m].
_NEAR_M = 6.0


class Tile(NamedTuple):
    """A part of a map."""

    origin_xy: tuple[float, float]
    """Lower-left corner in `map` [m]."""
    codes: UInt8[np.ndarray, "ny nx"]
    """Its cells."""
    yaw_rad: float = 0.0
    """Turn of its rows against those of `map` [rad]."""

    def transformed(self, by: Float[np.ndarray, "3"]) -> "Tile":
        """The tile in the frame in which its frame lies at a pose."""
        x, y = to_map(by, np.array(self.origin_xy))
        return Tile((float(x), float(y)), self.codes, self.yaw_rad + float(by[2]))

    def upright(self, frame: GridFrame) -> "Tile":
        """The tile without its turn, on the lattice of a frame: each cell as the one at its centre."""
        cell_m, (ny, nx) = frame.resolution_m, self.codes.shape
        at = np.array([*self.origin_xy, self.yaw_rad])
        corners = to_map(at, cell_m * np.array([[0, 0], [nx, 0], [0, ny], [nx, ny]]))
        cells = frame.to_cells(corners)
        low = np.floor(cells.min(axis=0)).astype(int)
        columns, rows = np.ceil(cells.max(axis=0)).astype(int) - low
        grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) + low + 0.5
        ix, iy = np.moveaxis(np.floor(to_robot(at, frame.to_points(grid)) / cell_m).astype(int), -1, 0)
        is_inside = (ix >= 0) & (ix < nx) & (iy >= 0) & (iy < ny)
        codes = np.full((rows, columns), _UNKNOWN, np.uint8)
        codes[is_inside] = self.codes[iy[is_inside], ix[is_inside]]
        x, y = frame.to_points(low)
        return Tile((float(x), float(y)), codes)


def _codes_of(estimate: MapEstimate) -> UInt8[np.ndarray, "ny nx"]:
    codes = np.rint(np.asarray(estimate.obstacle_probability) * np.float32(_STEPS)).astype(np.uint8)
    codes[estimate.blocked] = _BUMPED
    codes[estimate.explored] |= _SEEN
    return codes


class TileChanges:
    """Finds the tiles of a map that have changed."""

    def __init__(self) -> None:
        self._sums: dict[tuple[int, int], int] = {}

    def of(self, estimate: MapEstimate) -> Iterator[tuple[tuple[int, int], Tile]]:
        """Row, column and content of each tile with seen cells that differs from that of the last call."""
        frame, codes = estimate.frame, _codes_of(estimate)
        # Tiles are counted from the origin of `map`, so that they stay where they are as the map grows.
        x, y = (round(value / frame.resolution_m) for value in frame.origin_xy)
        ny, nx = frame.shape
        for row in range(y // TILE, (y + ny - 1) // TILE + 1):
            for column in range(x // TILE, (x + nx - 1) // TILE + 1):
                rows = slice(max(row * TILE - y, 0), min((row + 1) * TILE - y, ny))
                columns = slice(max(column * TILE - x, 0), min((column + 1) * TILE - x, nx))
                if not estimate.explored[rows, columns].any():
                    continue
                block = np.ascontiguousarray(codes[rows, columns])
                if (total := crc32(block.tobytes())) != self._sums.get((row, column)):
                    self._sums[row, column] = total
                    yield (row, column), Tile(frame.window_frame(rows, columns).origin_xy, block)


class SharedMap:
    """Tiles of others on the lattice of a robot's own map."""

    def __init__(self, hull: Hull) -> None:
        self._hull = hull
        self._frame: GridFrame | None = None
        self._codes: dict[str, np.ndarray] = {}
        self._merged: MapEstimate | None = None

    def add(self, author: str, tile: Tile, own_map: MapEstimate) -> None:
        """Add or replace a tile of another robot."""
        is_turned = tile.yaw_rad != 0.0
        tile = tile.upright(own_map.frame) if is_turned else tile
        frame = self._cover(own_map, tile)
        codes = self._codes.setdefault(author, np.full(frame.shape, _UNKNOWN, np.uint8))
        column, row = np.rint(frame.to_cells(np.array(tile.origin_xy))).astype(int)
        ny, nx = tile.codes.shape
        # Neighbours of a turned tile lie within its upright bounds.
        is_its = tile.codes != _UNKNOWN if is_turned else True
        np.copyto(codes[row : row + ny, column : column + nx], tile.codes, where=is_its)
        self._merged = None

    def remove(self, author: str) -> None:
        """Remove all tiles of a robot."""
        self._codes.pop(author, None)
        self._merged = None

    def _cover(self, own_map: MapEstimate, tile: Tile | None = None) -> GridFrame:
        """Extend the lattice over the robot's own map and a tile; returns its frame."""
        old = self._frame or own_map.frame
        corners = [*own_map.frame.to_points(np.array([[0, 0], own_map.frame.shape[::-1]]))]
        if tile is not None:
            low = np.array(tile.origin_xy)
            corners += [low, low + np.array(tile.codes.shape[::-1]) * old.resolution_m]
        cells = np.rint(old.to_cells(np.array(corners))).astype(int)
        (left, below), (right, above) = -cells.min(axis=0), cells.max(axis=0) - old.shape[::-1]
        # In whole tiles, so that this is rare.
        pads = [max(0, -(-pad // TILE) * TILE) for pad in (int(left), int(right), int(below), int(above))]
        if any(pads):
            self._frame, sides = old.padded(*pads), ((pads[2], pads[3]), (pads[0], pads[1]))
            self._codes = {
                author: np.pad(codes, sides, constant_values=_UNKNOWN)
                for author, codes in self._codes.items()
            }
            self._merged = None
        elif self._frame is None:
            self._frame = old
        return self._frame or old

    def merge(self, own_map: MapEstimate) -> MapEstimate:
        """The robot's own map, continued by those of others; its own one, as long as nothing was received."""
        if not self._codes:
            return own_map
        frame = self._cover(own_map)
        column, row = np.rint(frame.to_cells(np.array(own_map.frame.origin_xy))).astype(int)
        ny, nx = own_map.frame.shape
        if self._merged is None:
            self._merged = self._begin(frame, own_map)
            near = (0, ny), (0, nx)
        else:
            cells = own_map.frame.to_cells(own_map.pose[:2])[::-1]
            reach = round(_NEAR_M / frame.resolution_m)
            near = (
                (max(int(cells[0]) - reach, 0), min(int(cells[0]) + reach, ny)),
                (max(int(cells[1]) - reach, 0), min(int(cells[1]) + reach, nx)),
            )
        (y0, y1), (x0, x1) = near
        self._stand(self._merged, own_map.pose)
        self._put(own_map, np.s_[y0:y1, x0:x1], np.s_[row + y0 : row + y1, column + x0 : column + x1])
        return replace(self._merged, pose=own_map.pose, moving=own_map.moving)

    def _stand(self, merged: MapEstimate, pose: Float[np.ndarray, "3"]) -> None:
        """Clear what was received under the hull: others may have mapped the robot itself as an obstacle."""
        rows, columns, under = merged.frame.under(pose, self._hull)
        for codes in (*self._codes.values(), self._others):
            codes[rows, columns][under] &= _SEEN
        for layer in (merged.obstacle_probability, merged.anticipated_probability):
            if layer is not None:
                layer[rows, columns][under] = 0

    def refresh(self) -> None:
        """Copy the whole of the robot's own map again at the next decision."""
        self._merged = None

    def _begin(self, frame: GridFrame, own_map: MapEstimate) -> MapEstimate:
        """The map by the others alone."""
        codes = np.full(frame.shape, _UNKNOWN, np.uint8)
        for layer in self._codes.values():
            is_news = (layer >= _SEEN) | ((codes == _UNKNOWN) & (layer != _UNKNOWN))
            np.copyto(codes, layer, where=is_news & (codes < _SEEN))
        self._others = codes
        probability = _PROBABILITY[codes]
        offset = None if own_map.surface_offset_m is None else np.zeros((*frame.shape, 2), np.float32)
        return MapEstimate(
            frame=frame,
            obstacle_probability=probability,
            explored=codes >= _SEEN,
            blocked=(codes & _BUMPED) == _BUMPED,
            pose=own_map.pose,
            surface_offset_m=offset,
            anticipated_probability=None if own_map.anticipated_probability is None else probability.copy(),
        )

    def _put(self, own_map: MapEstimate, window: tuple[slice, slice], at: tuple[slice, slice]) -> None:
        """Put a part of the robot's own map to its place."""
        merged = self._merged
        assert merged is not None
        guesses, guessed = own_map.anticipated_probability, merged.anticipated_probability
        offsets, offset = own_map.surface_offset_m, merged.surface_offset_m
        if guesses is None or guessed is None:
            guesses, guessed = own_map.obstacle_probability, merged.obstacle_probability
        _put(
            self._others[at],
            own_map.explored[window],
            own_map.blocked[window],
            (own_map.obstacle_probability[window], guesses[window]),
            merged.explored[at],
            merged.blocked[at],
            (merged.obstacle_probability[at], guessed[at]),
        )
        if offsets is not None and offset is not None:
            offset[at] = offsets[window]


@compiled
def _put(
    received: np.ndarray,
    own_seen: np.ndarray,
    own_blocked: np.ndarray,
    mine: tuple[np.ndarray, np.ndarray],
    seen: np.ndarray,
    blocked: np.ndarray,
    merged: tuple[np.ndarray, np.ndarray],
) -> None:
    """Replace received cells by a robot's own, but where only others have seen the floor, or know a cell.

    The last arguments hold obstacle probabilities and anticipated ones.
    """
    for y in range(received.shape[0]):
        for x in range(received.shape[1]):
            code, sees = received[y, x], own_seen[y, x]
            seen[y, x] = sees or code >= _SEEN
            blocked[y, x] = own_blocked[y, x] or code % _SEEN == _BUMPED
            if sees or code == _UNKNOWN or (code < _SEEN and mine[0][y, x] != 0.5):
                for k in range(2):
                    merged[k][y, x] = mine[k][y, x]
