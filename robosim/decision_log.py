"""The log of an episode: every decision's snapshot in one file, so that it can be drawn without running it again.

One NumPy archive, written whole at the episode's end: camera pictures as PNG, of the map the cells that changed, the
belief when it changed, all else as columns; some 15 kB a decision. What varies in length is kept as one array and the
lengths. Walls and target are in it too: no floor plan is needed to draw it.
"""

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.snapshot import GUESS, Arrivals, Layer, Snapshot
from robosim.support.files import npz_bytes, write_whole
from slam.grid import GridFrame
from wireless.paths import LinkState

DECISIONS = "decisions.npz"
_NO_RADIO = -1


class DecisionWriter:
    """Collects snapshots."""

    def __init__(self, rings: Sequence[Float[np.ndarray, "_ 2"]], target: Float[np.ndarray, "2"]) -> None:
        """Begin a log.

        Args:
            rings: Outlines of the building's free space [m].
            target: Where the target is [m].
        """
        self._scene = {**_ragged("ring", rings, (0, 2)), "target": np.asarray(target, float)}
        self._rows: list[dict[str, Any]] = []
        self._built: Layer | None = None
        self._belief: Layer | None = None

    def add(self, snapshot: Snapshot) -> None:
        """Append a decision.

        Raises:
            ValueError: If map, estimated pose or goal are missing.
        """
        built, estimate, goal = snapshot.built, snapshot.estimate, snapshot.goal
        if built is None or estimate is None or goal is None:
            raise ValueError("A log is of decisions: expected a map, an estimated pose and a goal.")
        heard, belief = snapshot.arrivals, snapshot.belief
        new_belief = belief is not None and (
            self._belief is None or not np.array_equal(belief.values, self._belief.values)
        )
        cells, values = _changes(self._built, built)
        self._rows.append(
            {
                "pose": np.array(snapshot.pose),
                "estimate": np.array(estimate),
                "goal": np.array(goal, float),
                "text": snapshot.text,
                "rgb": _png(np.ascontiguousarray(snapshot.rgb[..., ::-1])),
                "depth": _png(snapshot.depth_mm),
                "path": np.zeros((0, 2)) if snapshot.path is None else np.array(snapshot.path, float),
                "aoa_rad": np.zeros(0) if heard is None else np.array(heard.aoa_rad, float),
                "snr_db": np.zeros(0) if heard is None else np.array(heard.snr_db, float),
                "state": _NO_RADIO if heard is None else int(heard.state),
                "cell": cells,
                "value": values,
                "map_frame": _packed(built.frame),
                "belief": _png(belief.values) if belief is not None and new_belief else np.zeros(0, np.uint8),
                "belief_frame": np.full(5, np.nan) if belief is None else _packed(belief.frame),
            }
        )
        self._built, self._belief = Layer(built.frame, built.values.copy()), belief

    def save(self, path: Path) -> None:
        """Write the file; one without decisions is written too."""
        columns: dict[str, Any] = dict(self._scene)
        for name, shape in _COLUMNS.items():
            columns[name] = np.array([row[name] for row in self._rows]).reshape(-1, *shape)
        columns["text"] = np.array([row["text"] for row in self._rows], np.str_)
        for name, shape in _RAGGED.items():
            columns |= _ragged(name, [row[name] for row in self._rows], shape)
        write_whole(path, npz_bytes(columns))


#: Columns of fixed length, with the shape of an entry.
_COLUMNS = {
    "pose": (3,), "estimate": (3,), "goal": (2,), "state": (), "map_frame": (5,), "belief_frame": (5,),
}  # fmt: skip
#: Columns of entries of any length, with the shape of an empty one.
_RAGGED: dict[str, tuple[int, ...]] = {
    "rgb": (0,), "depth": (0,), "path": (0, 2), "aoa_rad": (0,), "snr_db": (0,), "cell": (0,), "value": (0,),
    "belief": (0,),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class DecisionLog:
    """The log of an episode, as read back."""

    rings: list[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space [m]."""
    target: Float[np.ndarray, "2"]
    """Where the target is [m]."""
    columns: dict[str, Any]
    """What was written, entries of any length as lists."""

    def __len__(self) -> int:
        return len(self.columns["pose"])

    @property
    def anticipates(self) -> bool:
        """Whether the mapper guessed what it had not seen."""
        return any(bool((values >= GUESS).any()) for values in self.columns["value"])

    def snapshots(self) -> Iterator[Snapshot]:
        """All decisions in their order."""
        built: Layer | None = None
        belief: Layer | None = None
        for i in range(len(self)):
            row = {name: column[i] for name, column in self.columns.items()}
            built = _changed(built, _unpacked(row["map_frame"]), row["cell"], row["value"])
            if len(row["belief"]):
                belief = Layer(_unpacked(row["belief_frame"]), _image(row["belief"], cv2.IMREAD_GRAYSCALE))
            heard = None
            if row["state"] != _NO_RADIO:
                heard = Arrivals(row["aoa_rad"], row["snr_db"], LinkState(int(row["state"])))
            yield Snapshot(
                rgb=np.ascontiguousarray(_image(row["rgb"], cv2.IMREAD_COLOR)[..., ::-1]),
                depth_mm=_image(row["depth"], cv2.IMREAD_UNCHANGED),
                pose=row["pose"],
                estimate=row["estimate"],
                built=built,
                goal=row["goal"],
                path=row["path"],
                arrivals=heard,
                belief=belief,
                text=str(row["text"]),
            )


def read_decisions(folder: Path) -> DecisionLog:
    """The log in the folder of an episode.

    Raises:
        ValueError: If there is none, or it is damaged; the message names the file and the fix.
    """
    path = Path(folder) / DECISIONS
    try:
        with np.load(path, allow_pickle=False) as file:
            ring = _parts(file, "ring")
            columns: dict[str, Any] = {name: file[name] for name in (*_COLUMNS, "text")}
            columns |= {name: _parts(file, name) for name in _RAGGED}
            return DecisionLog(ring, file["target"], columns)
    except FileNotFoundError as error:
        raise ValueError(f"{path}: not there. Expected a folder of `robosim episode`.") from error
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(
            f"{path}: no log of an episode, or damaged ({error}). Run the episode again."
        ) from error


def _ragged(name: str, parts: Sequence[np.ndarray], empty: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Arrays of any length as one, and their lengths."""
    joined = np.concatenate(parts) if len(parts) else np.zeros(empty)
    return {name: joined, f"{name}_count": np.array([len(part) for part in parts], np.int64)}


def _parts(file: Any, name: str) -> list[np.ndarray]:
    return np.split(file[name], np.cumsum(file[f"{name}_count"])[:-1]) if len(file[f"{name}_count"]) else []


def _packed(frame: GridFrame) -> Float[np.ndarray, "5"]:
    return np.array([*frame.origin_xy, frame.resolution_m, *frame.shape])


def _unpacked(packed: Float[np.ndarray, "5"]) -> GridFrame:
    x, y, cell_m, rows, columns = packed.tolist()
    return GridFrame(origin_xy=(x, y), resolution_m=cell_m, shape=(int(rows), int(columns)))


def _onto(old: Layer | None, frame: GridFrame) -> UInt8[np.ndarray, "ny nx"]:
    """A layer's values on a frame of the same lattice that holds it, 0 beyond it."""
    values = np.zeros(frame.shape, np.uint8)
    if old is not None:
        corner = np.subtract(old.frame.origin_xy, frame.origin_xy) / frame.resolution_m
        ix, iy = np.rint(corner).astype(int)
        rows, columns = old.values.shape
        values[iy : iy + rows, ix : ix + columns] = old.values
    return values


def _changes(old: Layer | None, new: Layer) -> tuple[np.ndarray, np.ndarray]:
    """Flat numbers of the cells that changed, and what they are now."""
    cells = np.flatnonzero(new.values != _onto(old, new.frame)).astype(np.uint32)
    return cells, new.values.ravel()[cells]


def _changed(old: Layer | None, frame: GridFrame, cells: np.ndarray, values: np.ndarray) -> Layer:
    grid = _onto(old, frame)
    grid.ravel()[cells.astype(np.int64)] = values
    return Layer(frame, grid)


def _png(image: np.ndarray) -> UInt8[np.ndarray, "n"]:
    return np.asarray(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 4])[1], np.uint8).ravel()


def _image(data: UInt8[np.ndarray, "n"], how: int) -> np.ndarray:
    image = cv2.imdecode(np.ascontiguousarray(data), how)
    if image is None:
        raise ValueError("a picture is damaged")
    return np.asarray(image)
