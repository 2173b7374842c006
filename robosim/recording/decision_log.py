"""The log of an episode: every decision's snapshot in one file, so that it can be drawn without running it again.

One NumPy archive, written whole at the episode's end: camera pictures as PNG, of the map the cells that changed, the
belief when it changed, all else as columns; some 15 kB a decision. What varies in length is kept as one array and the
lengths. Walls and target are in it too: no floor plan is needed to draw it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.drawing.snapshot import GUESS, Arrivals, Layer, Snapshot
from robosim.plans.floorplan import MAX_CELLS, RESOLUTIONS_M
from robosim.policies.reason import UNTOLD, GoalKind, Reason
from robosim.support.arrays_in import FAR, Array, parts, ragged, read_npz
from robosim.support.files import npz_bytes, write_whole
from robosim.support.images_in import opened_image
from robosim.support.reading import naming, reading
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
        self._scene = {**ragged("ring", rings, (0, 2)), "target": np.asarray(target, float)}
        #: Whether the target is looked for; a robot that only explores knows of none.
        self.seeks_target = True
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
        arrivals, belief = snapshot.arrivals, snapshot.belief
        new_belief = belief is not None and (
            self._belief is None or not np.array_equal(belief.values, self._belief.values)
        )
        cells, values = _changes(self._built, built)
        reason = snapshot.reason or UNTOLD
        self._rows.append(
            {
                "pose": np.array(snapshot.pose),
                "estimate": np.array(estimate),
                "goal": np.array(goal, float),
                "text": snapshot.text,
                "goal_kind": reason.kind.value,
                "because": reason.because,
                "mass": reason.mass,
                "decisions": snapshot.decisions,
                "coverage": snapshot.coverage,
                "true_state": _NO_RADIO if snapshot.true_state is None else int(snapshot.true_state),
                "rgb": _png(np.ascontiguousarray(snapshot.rgb[..., ::-1])),
                "depth": _png(snapshot.depth_mm),
                "path": np.zeros((0, 2)) if snapshot.path is None else np.array(snapshot.path, float),
                "aoa_rad": np.zeros(0) if arrivals is None else np.array(arrivals.aoa_rad, float),
                "snr_db": np.zeros(0) if arrivals is None else np.array(arrivals.snr_db, float),
                "state": _NO_RADIO if arrivals is None else int(arrivals.state),
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
        columns: dict[str, Any] = {**self._scene, "seeks_target": np.array(self.seeks_target)}
        for name, shape in _COLUMNS.items():
            columns[name] = np.array([row[name] for row in self._rows]).reshape(-1, *shape)
        for name in _TEXTS:
            columns[name] = np.array([row[name] for row in self._rows], np.str_)
        for name, shape in _RAGGED.items():
            columns |= ragged(name, [row[name] for row in self._rows], shape)
        write_whole(path, npz_bytes(columns))


#: Columns of fixed length, with the shape of an entry.
_COLUMNS = {
    "pose": (3,), "estimate": (3,), "goal": (2,), "state": (), "true_state": (), "map_frame": (5,),
    "belief_frame": (5,), "mass": (), "decisions": (), "coverage": (),
}  # fmt: skip
#: Columns of text.
_TEXTS = ("text", "goal_kind", "because")
#: Columns of entries of any length, with the shape of an empty one.
_RAGGED: dict[str, tuple[int, ...]] = {
    "rgb": (0,), "depth": (0,), "path": (0, 2), "aoa_rad": (0,), "snr_db": (0,), "cell": (0,), "value": (0,),
    "belief": (0,),
}  # fmt: skip


#: What the file must hold, beside the lengths; empty columns are written as floating-point numbers.
_EXPECTED = {
    "ring": Array("f", "corners 2", FAR), "ring_count": Array("i", "rings"), "target": Array("f", "2", FAR),
    "pose": Array("f", "n 3", FAR), "estimate": Array("f", "n 3", FAR), "goal": Array("f", "n 2", FAR),
    "state": Array("i", "n"), "map_frame": Array("f", "n 5", FAR), "belief_frame": Array("f", "n 5"),
    "true_state": Array("i", "n"), "mass": Array("f", "n"), "decisions": Array("f", "n"), "coverage": Array("f", "n"),
    "seeks_target": Array("b", ""), **{name: Array("U", "n") for name in _TEXTS},
    "rgb": Array("u1", "a"), "depth": Array("u1", "b"), "belief": Array("u1", "c"),
    "path": Array("f", "d 2", FAR), "aoa_rad": Array("f", "e", FAR), "snr_db": Array("f", "e", FAR),
    "cell": Array("u", "g"), "value": Array("u1", "g"), **{f"{name}_count": Array("i", "n") for name in _RAGGED},
}  # fmt: skip
#: Of these, what logs of version 0.1 lack.
_LATER = ("seeks_target", "true_state", "goal_kind", "because", "mass", "decisions", "coverage")
_WHAT, _REMEDY = "the log of an episode", "Give a folder of `robosim episode`, or run the episode again."
#: Pixels of a picture; and how far from the target anything is [m], or it could not be drawn in whole pixels.
_MOST_PIXELS, _FARTHEST_M, _NARROWEST_M = 4096**2, 1e5, 0.01


@dataclass(frozen=True, eq=False)
class DecisionLog:
    """The log of an episode, as read back."""

    rings: list[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space [m]."""
    target: Float[np.ndarray, "2"]
    """Where the target is [m]."""
    seeks_target: bool
    """Whether it was looked for."""
    columns: dict[str, Any]
    """What was written, entries of any length as lists."""
    path: Path
    """The file."""

    def __len__(self) -> int:
        return len(self.columns["pose"])

    @property
    def anticipates(self) -> bool:
        """Whether the mapper guessed what it had not seen."""
        return any(bool((values >= GUESS).any()) for values in self.columns["value"])

    def check_pictures(self) -> None:
        """Unpack all of them once, so that a damaged one is found before anything is drawn.

        Raises:
            FileError: If one is damaged.
        """
        for _ in self.snapshots():
            pass

    def snapshots(self) -> Iterator[Snapshot]:
        """All decisions in their order.

        Raises:
            FileError: If the picture or the map of one is damaged.
        """
        snapshot = None
        for i in range(len(self)):
            with naming(self.path, _WHAT, _REMEDY):
                snapshot = self._snapshot(i, snapshot)
            yield snapshot

    def _snapshot(self, i: int, before: Snapshot | None) -> Snapshot:
        """Decision i, which says of map and belief only what has changed."""
        row = {name: column[i] for name, column in self.columns.items()}
        belief = None if before is None else before.belief
        if len(row["belief"]):
            belief = Layer(_unpacked(row["belief_frame"]), _image(row["belief"], "L"))
            if belief.values.shape != belief.frame.shape:
                raise ValueError(f"the belief of decision {i} is no picture of its frame")
        arrivals = None
        if row["state"] != _NO_RADIO:
            arrivals = Arrivals(row["aoa_rad"], row["snr_db"], LinkState(int(row["state"])))
            if len(arrivals.aoa_rad) != len(arrivals.snr_db):
                raise ValueError(f"decision {i} has other numbers of angles and SNRs")
        rgb, depth = _image(row["rgb"], "RGB"), _image(row["depth"], "I;16")
        if rgb.shape[:2] != depth.shape:
            raise ValueError(f"picture and depth of decision {i} are of different sizes")
        built = None if before is None else before.built
        return Snapshot(
            rgb=rgb,
            depth_mm=depth,
            pose=row["pose"],
            estimate=row["estimate"],
            built=_changed(built, _unpacked(row["map_frame"]), row["cell"], row["value"]),
            goal=row["goal"],
            path=row["path"],
            arrivals=arrivals,
            belief=belief,
            text=str(row["text"]),
            reason=Reason(
                kind=GoalKind(str(row["goal_kind"])), because=str(row["because"]), mass=float(row["mass"])
            ),
            decisions=float(row["decisions"]),
            coverage=float(row["coverage"]),
            true_state=None if row["true_state"] == _NO_RADIO else LinkState(int(row["true_state"])),
        )


def read_decisions(folder: Path) -> DecisionLog:
    """The log in the folder of an episode.

    Raises:
        FileError: If there is none, or it is damaged; the message names the file and the fix.
    """
    path = Path(folder) / DECISIONS
    with reading(path, _WHAT, _REMEDY) as file:
        arrays = _completed(read_npz(file, _EXPECTED, optional=_LATER))
        columns: dict[str, Any] = {name: arrays[name] for name in (*_COLUMNS, *_TEXTS)}
        columns |= {name: parts(arrays, name) for name in _RAGGED}
        log = DecisionLog(
            parts(arrays, "ring"), arrays["target"], bool(arrays["seeks_target"]), columns, path
        )
        _check(log)
        return log


def _completed(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of a log, with those that it lacks if it is of version 0.1: nothing was told then."""
    count = len(arrays["pose"])
    nothing = {
        "seeks_target": np.array(True),
        "true_state": np.full(count, _NO_RADIO),
        "goal_kind": np.full(count, UNTOLD.kind.value),
        "because": np.full(count, ""),
        **{name: np.full(count, np.nan) for name in ("mass", "decisions", "coverage")},
    }
    return {**nothing, **arrays}


def _check(log: DecisionLog) -> None:
    """Refuse what no episode has and nothing can draw."""
    corners = np.vstack([np.zeros((0, 2)), *log.rings])
    if not len(corners) or np.ptp(corners, axis=0).min() < _NARROWEST_M:
        raise ValueError("no outline of a building")
    if np.abs(corners - log.target).max() > _FARTHEST_M:
        raise ValueError(f"a wall lies more than {_FARTHEST_M:g} m from the target")
    columns = log.columns
    for name in ("pose", "estimate", "goal", "path"):
        some = columns[name] if name == "path" else [columns[name]]
        if any(np.abs(part[:, :2] - log.target).max(initial=0) > _FARTHEST_M for part in some):
            raise ValueError(f"a {name} lies more than {_FARTHEST_M:g} m from the target")
    has_belief = ~np.isnan(columns["belief_frame"]).all(axis=1)
    for frames in (columns["map_frame"], columns["belief_frame"][has_belief]):
        low, high = RESOLUTIONS_M
        good = (np.abs(frames) <= FAR).all(axis=1) & (frames[:, 2] >= low) & (frames[:, 2] <= high)
        good &= (frames[:, 3:] >= 1).all(axis=1) & (frames[:, 3:].prod(axis=1) <= MAX_CELLS)
        if not good.all():
            raise ValueError(f"a map lies and is as no map: {frames[np.argmin(good)]}")
    for name in ("state", "true_state"):
        if not np.isin(columns[name], [_NO_RADIO, *LinkState]).all():
            raise ValueError(f"a link state is {columns[name].max()}")
    if strange := set(columns["goal_kind"].tolist()) - set(GoalKind):
        raise ValueError(f"a kind of goal is {min(strange)[:80]!r}")


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


def _png(image: np.ndarray) -> UInt8[np.ndarray, " n"]:
    return np.asarray(cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 4])[1], np.uint8).ravel()


def _image(data: UInt8[np.ndarray, " n"], mode: str) -> np.ndarray:
    with opened_image(data.tobytes(), _MOST_PIXELS, ("PNG",)) as image:
        if image.mode != mode:
            raise ValueError(f"a picture has pixels of kind {image.mode}, expected {mode}")
        return np.asarray(image)
