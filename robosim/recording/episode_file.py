"""File of a recorded episode: one NumPy archive, written at the end of `robosim episode` and of `robosim evaluate`.

It holds result, walls and all steps, so that an episode can be drawn without running it again and without its floor
plan: some 12 kB per step with pictures, some 200 bytes without. A column of entries of any length is one array of all
entries and their lengths. Without pictures, the final map is the only one.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from jaxtyping import Float, Int

from robosim.layers import GUESS, Layer, layer_of_map
from robosim.plans.floorplan import MAX_CELLS, RESOLUTIONS_M
from robosim.policies.reason import GoalKind, Reason
from robosim.recording.step_codec import (
    FIXED,
    NO_BYTES,
    NO_RADIO,
    OPTIONAL,
    RAGGED,
    TEXTS,
    decode_belief,
    decode_camera,
    decode_map,
    decode_step,
    encode_map,
    encode_step,
    encode_without_pictures,
)
from robosim.step import Step
from robosim.support.arrays_in import FAR, Array, parts, ragged, read_npz
from robosim.support.checks import shown
from robosim.support.files import npz_bytes
from robosim.support.reading import FileError, naming, reading
from robosim.support.text_in import check_object, parse_json
from robosim.team.team_config import MOST, robot_names
from slam.actions import Action
from slam.grid import MapEstimate
from slam.poses import Pose
from wireless.paths import LinkState

#: Name of the file in the folder of an episode.
EPISODE = "episode.npz"
#: Number of this format, from version 0.3 of robosim.
_FORMAT = 3
_WHAT, _REMEDY = "a recorded episode", "Delete it and run the episode again."
#: Simulated time of each pose [s].
TIMES = "time_s"
#: Columns with an additional entry for the end of the episode.
_TO_THE_END = ("pose", "estimate", "coverage", "map_frame", "map_corner", "map")
#: Integer columns of fixed length.
_INTEGERS = ("action", "true_state")
#: Columns with NaN for missing values.
_MAY_LACK = ("map_frame", "belief_frame", "mass", "true_aoa_rad", "state_probability", "coverage", "arrival")
#: Largest distance of positions from the target, which can be drawn in whole pixels, and smallest building [m].
_FARTHEST_M, _NARROWEST_M = 1e5, 0.01


@dataclass(frozen=True, kw_only=True)
class Head:
    """Result of an episode."""

    row: dict[str, Any]
    """Identity (plan, policy, seed ...) and scores: the same for the same seed."""
    seeks_target: bool
    """Whether the target was searched for."""
    timing: dict[str, float] = field(default_factory=dict)
    """Wall-clock time by stage, and in all [s]."""
    made_by: str = ""
    """Digest of code and versions."""


class EpisodeWriter:
    """Collects the steps of an episode."""

    def __init__(self, rings: Sequence[Float[np.ndarray, "_ 2"]], *, pictures: bool = True) -> None:
        """Begin without steps; outlines of the building are from `robosim.drawing.plan_view.building_rings` [m].

        Without pictures, camera, map and belief of the steps are not recorded.
        """
        self._rings, self._pictures = rings, pictures
        self._rows: list[dict[str, Any]] = []
        self._map: Layer | None = None
        self._belief = NO_BYTES

    def add(self, step: Step) -> None:
        """Append a step."""
        if not self._pictures:
            self._rows.append(encode_without_pictures(step))
            return
        row = encode_step(step, self._map)
        self._map, belief = step.map_layer, row["belief"]
        if np.array_equal(belief, self._belief):
            row["belief"] = NO_BYTES
        self._belief = belief
        self._rows.append(row)

    def content(
        self, head: Head, pose: Pose, coverage: float, end: MapEstimate, times: Float[np.ndarray, " m"]
    ) -> bytes:
        """Content of the file, with the final true pose, coverage and map, and the simulated times of all poses [s]."""
        last = {"pose": pose, "estimate": end.pose, "coverage": coverage}
        last |= encode_map(layer_of_map(end), self._map)
        rows = {name: [row[name] for row in self._rows] for name in (*FIXED, *TEXTS, *RAGGED)}
        for name in _TO_THE_END:
            rows[name].append(last[name])
        arrays: dict[str, Any] = {"head": np.array(json.dumps({"format": _FORMAT, **vars(head)}))}
        arrays |= ragged("ring", [np.asarray(ring, float) for ring in self._rings], (0, 2))
        for name, shape in FIXED.items():
            arrays[name] = np.array(rows[name], np.int8 if name in _INTEGERS else float).reshape(-1, *shape)
        for name in TEXTS:
            arrays[name] = np.array(rows[name], np.str_)
        for name, shape in RAGGED.items():
            if name not in OPTIONAL or any(map(len, rows[name])):
                arrays |= ragged(name, rows[name], shape)
        arrays[TIMES] = times
        return npz_bytes(arrays)


def robots_of_team(folder: Path) -> list[str]:
    """Names of the robots whose episodes are in folders of their own; none where the folder holds one episode."""
    if (folder / EPISODE).is_file():
        return []
    return [name for name in robot_names(MOST) if (folder / name / EPISODE).is_file()]


@dataclass(frozen=True, eq=False)
class RecordedEpisode:
    """An episode as read from its file, with n + 1 poses for n decisions."""

    path: Path
    head: Head
    rings: list[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space and of furniture [m]."""
    columns: Mapping[str, Any]
    """An entry per step, and one at the end for poses, coverage and map; entries of any length as lists."""

    def __len__(self) -> int:
        """Number of decisions."""
        return len(self.columns["goal"])

    @property
    def target(self) -> Float[np.ndarray, "2"]:
        """Position of the target [m]."""
        return np.array(self.head.row["target"], float)

    @property
    def poses(self) -> Float[np.ndarray, "n_poses 3"]:
        """True poses."""
        return self.columns["pose"]

    @property
    def estimates(self) -> Float[np.ndarray, "n_poses 3"]:
        """Estimated poses."""
        return self.columns["estimate"]

    @property
    def times(self) -> Float[np.ndarray, " n_poses"]:
        """Simulated time of each pose [s]."""
        return self.columns[TIMES]

    @property
    def goals(self) -> Float[np.ndarray, "n 2"]:
        """Goal of each decision [m]."""
        return self.columns["goal"]

    @property
    def reasons(self) -> list[Reason]:
        """Reason of each decision."""
        names = ("goal_kind", "because", "mass")
        return [
            Reason(GoalKind(kind), because, mass)
            for kind, because, mass in zip(*(self.columns[name].tolist() for name in names), strict=True)
        ]

    @property
    def link_states(self) -> Int[np.ndarray, " n"]:
        """Most probable link state at each decision, as estimated; -1 without a radio."""
        probability = self.columns["state_probability"]
        known = ~np.isnan(probability).any(axis=1)
        return np.where(known, np.argmax(np.nan_to_num(probability), axis=1), NO_RADIO)

    @property
    def snr_db(self) -> Float[np.ndarray, " n"]:
        """SNR of the strongest estimated path at each decision [dB]; -inf if there is none."""
        return np.array([column[0, 2] if len(column) else -np.inf for column in self.columns["arrival"]])

    @property
    def has_pictures(self) -> bool:
        """Whether camera, map and belief of each step are recorded."""
        return any(len(column) for column in self.columns["rgb"])

    def anticipates(self) -> bool:
        """Whether the mapper anticipated unseen cells; unpacks all steps.

        Raises:
            FileError: If the picture or the map of one is damaged.
        """
        return bool(max((int(step.map_layer.values.max()) for step in self.steps()), default=0) >= GUESS)

    def steps(self) -> Iterator[Step]:
        """All steps in their order; FileError if the picture or the map of one is damaged."""
        for i, (row, map_, belief) in enumerate(self._rows()):
            with naming(self.path, _WHAT, _REMEDY):
                step = decode_step(i, row, map_, belief)
            yield step

    def rows(self) -> Iterator[dict[str, Any]]:
        """All steps as rows that can be decoded independently, each with its whole map and belief.

        Raises:
            FileError: If the picture or the map of one is damaged.
        """
        columns: dict[str, Any] = {}
        previous, belief = None, NO_BYTES
        for row, map_, _ in self._rows():
            with naming(self.path, _WHAT, _REMEDY):
                decode_camera(row)
            if map_ is not previous:
                columns, previous = encode_map(map_, None), map_
            belief = row["belief"] if len(row["belief"]) else belief
            yield {**row, **columns, "belief": belief}

    def _rows(self) -> Iterator[tuple[dict[str, Any], Layer, Layer | None]]:
        """Row, map and belief of each step; without pictures the map is the final one."""
        map_ = belief = None
        for i in range(len(self)):
            with naming(self.path, _WHAT, _REMEDY):
                row = self._row(i)
                if not (i or self.has_pictures):
                    map_ = decode_map(self._row(len(self)), None)
                map_, belief = decode_map(row, map_), decode_belief(row, belief)
                if map_ is None:
                    raise ValueError(f"step {i} has no map")
            yield row, map_, belief

    def _row(self, i: int) -> dict[str, Any]:
        return {name: column[i] for name, column in self.columns.items() if i < len(column)}


def _expected() -> dict[str, Array]:
    """Types and shapes of the arrays in the file: n decisions, m = n + 1 poses."""
    expected = {"ring": Array("f", "corners 2", FAR), "ring_count": Array("i", "rings")}
    for name, shape in FIXED.items():
        axes = " ".join(["m" if name in _TO_THE_END else "n", *map(str, shape)])
        expected[name] = Array("i" if name in _INTEGERS else "f", axes, None if name in _MAY_LACK else FAR)
    expected |= {name: Array("U", "n") for name in TEXTS} | {TIMES: Array("f", "m", FAR)}
    for name, shape in RAGGED.items():
        axes = " ".join([f"{name}s", *map(str, shape[1:])])
        limit = None if name in _MAY_LACK else FAR
        expected[name] = Array("f", axes, limit) if len(shape) > 1 else Array("u1", axes)
        expected[f"{name}_count"] = Array("i", "m" if name in _TO_THE_END else "n")
    return expected


def read_head(path: Path, check: Callable[[Head], None] = lambda head: None) -> Head:
    """Read the result of an episode; `check` may raise a ValueError of a few words.

    Raises:
        FileError: If the file is no episode, damaged, or of an earlier version.
    """
    with reading(path, _WHAT, _REMEDY) as file:
        return _head(file, check)


def read_episode(path: Path, check: Callable[[Head], None] = lambda head: None) -> RecordedEpisode:
    """Read an episode from its file or folder; pictures are unpacked later, one by one.

    Raises:
        FileError: As `read_head` does.
    """
    path = Path(path)
    if path.is_dir():
        path = path / EPISODE
    with reading(path, _WHAT, _REMEDY) as file:
        head = _head(file, check)
        file.seek(0)
        optional = {f"{name}{end}" for name in OPTIONAL for end in ("", "_count")}
        arrays = read_npz(file, _expected(), optional=optional)
        columns: dict[str, Any] = {name: arrays[name] for name in (*FIXED, *TEXTS, TIMES)}
        columns |= {
            name: parts(arrays, name) for name in RAGGED if name in arrays and f"{name}_count" in arrays
        }
        episode = RecordedEpisode(path, head, parts(arrays, "ring"), columns)
        _check(episode)
        return episode


def read_team(folder: Path) -> dict[str, RecordedEpisode]:
    """Read the episodes of a team's robots by name, or that of a single robot, whose name is empty.

    Raises:
        FileError: As `read_head` does, or if they are of several runs, or not of all robots.
    """
    names = robots_of_team(folder)
    if not names:
        return {"": read_episode(folder)}
    first = read_head(folder / names[0] / EPISODE).row

    def check(head: Head) -> None:
        for key in ("plan", "policy", "seed", "target", "robots", "run"):
            if head.row.get(key) != first.get(key):
                raise ValueError(f"of another run than {names[0]}: {key} is {shown(head.row.get(key))}")

    episodes = {name: read_episode(folder / name, check) for name in names}
    size = first.get("robots", len(names))
    if size != len(names) or tuple(names) != robot_names(len(names)):
        raise FileError(
            f"{folder}: it has episodes of {', '.join(names)}, expected those of {shown(size)} robots from robot1 on. "
            "Run the episode again, or give the folder of one robot."
        )
    for name, episode in episodes.items():
        if (robot := episode.head.row.get("robot", name)) != name:
            raise FileError(f"{episode.path}: the episode of {shown(robot)}. Run the episode again.")
    return episodes


def _head(file: IO[bytes], check: Callable[[Head], None]) -> Head:
    content = parse_json(str(read_npz(file, {"head": Array("U", "")})["head"]).encode())
    if check_object(content, ("row", "timing")).get("format") != _FORMAT:
        raise ValueError("not of version 0.3 of robosim or later")
    row, timing = check_object(content["row"], ("plan", "policy", "ended", "target")), content["timing"]
    target = row["target"]
    if not (isinstance(target, list) and len(target) == 2 and all(map(_is_number, target))):
        raise ValueError(f"the target is {str(target)[:80]!r}")
    if not all(map(_is_number, check_object(timing).values())):
        raise ValueError("a time is not a number")
    head = Head(
        row=row,
        seeks_target=content.get("seeks_target") is True,
        timing=timing,
        made_by=str(content.get("made_by")),
    )
    check(head)
    return head


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= FAR


def _check(episode: RecordedEpisode) -> None:
    """Raise a ValueError for values that no episode has and that cannot be drawn."""
    corners = np.vstack([np.zeros((0, 2)), *episode.rings])
    if not len(corners) or np.ptp(corners, axis=0).min() < _NARROWEST_M:
        raise ValueError("no outline of a building")
    if np.abs(corners - episode.target).max() > _FARTHEST_M:
        raise ValueError(f"a wall lies more than {_FARTHEST_M:g} m from the target")
    columns = episode.columns
    if len(columns["pose"]) != len(episode) + 1:
        raise ValueError(f"it has {len(columns['pose'])} poses, but {len(episode)} goals")
    if (np.diff(episode.times, prepend=0.0) < 0).any():
        raise ValueError("times do not increase")
    for name in ("pose", "estimate", "goal", "path", "bodies"):
        points_of_steps = columns.get(name, []) if name in RAGGED else [columns[name]]
        if any(
            np.abs(points[:, :2] - episode.target).max(initial=0) > _FARTHEST_M for points in points_of_steps
        ):
            raise ValueError(f"a {name} lies more than {_FARTHEST_M:g} m from the target")
    # Directions and delays are NaN where the radio does not resolve them, or the policy does not use them.
    arrivals = np.vstack([np.zeros((0, 5)), *columns["arrival"]])
    arrivals[:, [0, 1, 4]] = np.nan_to_num(arrivals[:, [0, 1, 4]], posinf=np.inf, neginf=-np.inf)
    if not (np.abs(arrivals) <= FAR).all():
        low, high = arrivals.min(), arrivals.max()
        raise ValueError(f"arrival goes from {low:g} to {high:g}, expected at most {FAR:g}")
    for frames in (columns["map_frame"], columns["belief_frame"]):
        frames = frames[~np.isnan(frames).all(axis=1)]
        low, high = RESOLUTIONS_M
        good = (np.abs(frames) <= FAR).all(axis=1) & (frames[:, 2] >= low) & (frames[:, 2] <= high)
        good &= (frames[:, 3:] >= 1).all(axis=1) & (frames[:, 3:].prod(axis=1) <= MAX_CELLS)
        if not good.all():
            raise ValueError(f"a map has an impossible place or size: {frames[np.argmin(good)]}")
    if np.isnan(columns["map_frame"][-1]).all():
        raise ValueError("no map in the end")
    if not np.isin(columns["true_state"], [NO_RADIO, *LinkState]).all():
        raise ValueError(f"a link state is {columns['true_state'].max()}")
    if not np.isin(columns["action"], list(Action)).all():
        raise ValueError(f"an action is {columns['action'].max()}")
    if strange := set(columns["goal_kind"].tolist()) - set(GoalKind):
        raise ValueError(f"a kind of goal is {min(strange)[:80]!r}")
