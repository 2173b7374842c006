"""What is kept of an episode of an evaluation: one compressed NumPy file.

It holds the scores as a row of the table, times, both trajectories, the goals and why they were taken, what the radio
measured, the walls, and the map that the robot had built in the end: enough to draw the episode without running it
again and without its floor plan, in some 30 kB.
"""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from robosim.episode import Decision
from robosim.evaluation.rows import check_row, is_number, name_of
from robosim.policies.reason import UNTOLD, GoalKind, Reason, decisions_along
from robosim.support.arrays_in import FAR, Array, parts, ragged, read_npz
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_json
from robosim.task.record import EpisodeLog
from slam.grid import MapEstimate
from wireless.paths import LinkState

_WHAT, _REMEDY = "an episode of `robosim evaluate`", "Delete it to run it again."
#: What the file of an episode must hold.
_EXPECTED = {
    "head": Array("U", ""), "poses": Array("f", "n 3", FAR), "estimates": Array("f", "n 3", FAR),
    "goals": Array("f", "m 2", FAR), "coverage": Array("f", "n", FAR), "links": Array("f", "k 4"),
    "built": Array("u1", "ny nx"), "built_frame": Array("f", "3", FAR), "ring": Array("f", "corners 2", FAR),
    "ring_count": Array("i", "rings"), "goal_kind": Array("U", "m"), "because": Array("U", "m"),
    "mass": Array("f", "m"), "decisions": Array("f", "m"),
}  # fmt: skip
#: Arrays that are handed on as they are, and those that episodes of version 0.1 lack.
_AS_READ = ("poses", "estimates", "goals", "coverage", "links", "built", "built_frame")
_LATER = ("ring", "ring_count", "goal_kind", "because", "mass", "decisions")


@dataclass(frozen=True)
class Head:
    """What tables tell of an episode."""

    row: dict[str, Any]
    """Identity and scores: the same for the same seed."""
    timing: dict[str, float]
    """Seconds by stage, and in all."""
    made_by: str
    """Digest of code and versions."""


@dataclass(frozen=True, eq=False)
class Episode:
    """What is kept of an episode."""

    head: Head
    poses: Float[np.ndarray, "n 3"]
    """True poses."""
    estimates: Float[np.ndarray, "n 3"]
    """Estimated poses."""
    goals: Float[np.ndarray, "m 2"]
    """Where the robot wanted to be at each decision."""
    reasons: list[Reason]
    """Why, at each decision."""
    decisions: Float[np.ndarray, " m"]
    """What the way to the goal would have taken at each decision; NaN if there was none."""
    coverage: Float[np.ndarray, " n"]
    """Part of the reachable floor seen, at each pose."""
    links: Float[np.ndarray, "k 4"]
    """True state, believed state, SNR [dB] and error of the angle of arrival [rad] at each decision."""
    built: UInt8[np.ndarray, "ny nx"]
    """The built map: 0 unknown, 1 free, 2 obstacle."""
    built_frame: Float[np.ndarray, "3"]
    """Origin x, y and resolution [m] of the built map."""
    rings: list[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space, and of what stands in it [m]; none in files of version 0.1."""


@dataclass(frozen=True)
class Decided:
    """What was decided in an episode, one entry a decision."""

    goals: list[np.ndarray] = field(default_factory=list)
    """Where to go [m]."""
    reasons: list[Reason] = field(default_factory=list)
    """Why."""
    decisions: list[float] = field(default_factory=list)
    """What the way there would take; NaN if there is none."""

    def add(self, decision: Decision) -> None:
        """Append a decision."""
        path, yaw = decision.plan.path, float(decision.estimate.pose[2])
        self.goals.append(np.array(decision.goal, float))
        self.reasons.append(decision.reason)
        self.decisions.append(decisions_along(path, yaw) if len(path) else float("nan"))


def read_head(path: Path) -> Head:
    """Read what tables tell of an episode.

    Raises:
        FileError: If the file is no episode, or damaged, or another than its name says.
    """
    with reading(path, _WHAT, _REMEDY) as file:
        return _head(read_npz(file, {"head": _EXPECTED["head"]}), path)


def read_episode(path: Path) -> Episode:
    """Read all that is kept of an episode.

    Raises:
        FileError: As `read_head` does.
    """
    with reading(path, _WHAT, _REMEDY) as file:
        arrays = read_npz(file, _EXPECTED, optional=_LATER)
        head = _head(arrays, path)
        moments = len(arrays["poses"])
        if not moments or max(len(arrays["goals"]), len(arrays["links"])) > moments:
            raise ValueError(f"it has {moments} poses, but {len(arrays['goals'])} goals")
        if not np.isin(arrays["links"][:, :2], list(LinkState)).all():
            raise ValueError("a link state is none")
        if arrays["built"].max(initial=0) > 2:
            raise ValueError(f"a cell of the map is {arrays['built'].max()}, expected 0, 1 or 2")
        count = len(arrays["goals"])
        return Episode(
            head=head,
            reasons=_reasons(arrays) if "goal_kind" in arrays else [UNTOLD] * count,
            decisions=arrays.get("decisions", np.full(count, np.nan)),
            rings=parts(arrays, "ring") if "ring" in arrays else [],
            **{name: arrays[name] for name in _AS_READ},
        )


def _reasons(arrays: Mapping[str, np.ndarray]) -> list[Reason]:
    if strange := set(arrays["goal_kind"].tolist()) - set(GoalKind):
        raise ValueError(f"a kind of goal is {min(strange)[:80]!r}")
    told = (arrays[name].tolist() for name in ("goal_kind", "because", "mass"))
    return [
        Reason(kind=GoalKind(kind), because=because, mass=mass)
        for kind, because, mass in zip(*told, strict=True)
    ]


def _head(arrays: Mapping[str, np.ndarray], path: Path) -> Head:
    told = check_object(parse_json(str(arrays["head"]).encode()), ("row", "timing", "made_by"))
    row, timing = check_object(told["row"]), check_object(told["timing"])
    check_row(row)
    if not all(map(is_number, timing.values())):
        raise ValueError("a time is no number")
    if name_of(row) != f"{path.parent.name}/{path.stem}":
        raise ValueError(f"it is the episode {name_of(row)[:80]}, not that of its name")
    return Head(row, timing, str(told["made_by"]))


def to_bytes(
    head: Head,
    log: EpisodeLog,
    decided: Decided,
    rings: Sequence[Float[np.ndarray, "_ 2"]],
    estimate: MapEstimate,
) -> bytes:
    """The content of an episode's file.

    Args:
        head: What tables tell of it.
        log: What happened.
        decided: What was decided.
        rings: Outlines of the building, of `robosim.drawing.picture.building_rings` [m].
        estimate: The map in the end.
    """
    built, frame = _built(estimate)
    links = [[link.state, link.believed, link.snr_db, link.aoa_error_rad] for link in log.links]
    arrays: dict[str, Any] = dict(
        head=np.array(json.dumps(asdict(head))),
        poses=np.array(log.poses, np.float32),
        estimates=np.array(log.estimates, np.float32),
        goals=np.array(decided.goals, np.float32).reshape(-1, 2),
        goal_kind=np.array([reason.kind.value for reason in decided.reasons], np.str_),
        because=np.array([reason.because for reason in decided.reasons], np.str_),
        mass=np.array([reason.mass for reason in decided.reasons], np.float32),
        decisions=np.array(decided.decisions, np.float32),
        coverage=np.array(log.coverage, np.float32),
        links=np.array(links, np.float32).reshape(-1, 4),
        built=built,
        built_frame=frame,
        **ragged("ring", [np.asarray(ring, np.float32) for ring in rings], (0, 2)),
    )
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _built(estimate: MapEstimate) -> tuple[UInt8[np.ndarray, "ny nx"], Float[np.ndarray, "3"]]:
    """The built map as one number a cell, cut to what was explored, and where it lies."""
    kind = np.zeros(estimate.obstacle.shape, np.uint8)
    kind[estimate.explored] = 1
    kind[estimate.obstacle | estimate.blocked] = 2
    rows, columns = (np.flatnonzero((kind > 0).any(axis)) for axis in (1, 0))
    frame = estimate.frame
    if not len(rows):
        return kind[:0, :0], np.array([*frame.origin_xy, frame.resolution_m])
    corner = frame.origin_xy + np.array([columns[0], rows[0]]) * frame.resolution_m
    cut = kind[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return cut, np.array([*corner, frame.resolution_m])
