"""Moments of a search, and recordings of them: as they come from one that runs, or from what an episode has left.

A moment is packed as soon as it is kept: some 10 kB rather than some 300 kB, so that a thousand of them fit anywhere.
"""

import math
import pickle
import threading
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.drawing.snapshot import Snapshot
from slam.poses import wrap
from wireless.paths import LinkState, Paths


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """One decision of a search; what its log does not tell is None."""

    snapshot: Snapshot
    """What was sensed and decided."""
    paths: Paths | None = None
    """True radio paths."""
    probability: Float[np.ndarray, "4"] | None = None
    """Of each link state."""
    true_state: LinkState | None = None
    """The true link state."""
    coverage: float | None = None
    """Part of the reachable floor seen, 0 to 1."""
    snr_db: float = math.nan
    """Of the strongest estimated path [dB]; NaN if there is none."""
    believed_state: LinkState | None = None
    """The link state that the robot takes to be most probable."""
    seeks_target: bool = True
    """Whether the target is looked for."""

    @classmethod
    def of(cls, snapshot: Snapshot, **more: Any) -> "Moment":
        """A decision with what its snapshot tells of radio and coverage."""
        arrivals = snapshot.arrivals
        more.setdefault("true_state", snapshot.true_state)
        more.setdefault("coverage", None if math.isnan(snapshot.coverage) else snapshot.coverage)
        if arrivals is not None:
            more["believed_state"] = arrivals.state
            if len(arrivals.snr_db):
                more["snr_db"] = float(arrivals.snr_db[0])
        return cls(snapshot=snapshot, **more)

    @property
    def has_picture(self) -> bool:
        """Whether the camera's picture is known: of an evaluation's episodes it is not kept."""
        return min(self.snapshot.rgb.shape[:2]) > 1

    @property
    def position_error_m(self) -> float:
        """Of the estimated position [m]; NaN without one."""
        estimate = self.snapshot.estimate
        return float("nan") if estimate is None else float(np.hypot(*(estimate - self.snapshot.pose)[:2]))

    @property
    def heading_error_deg(self) -> float:
        """Of the estimated heading [degrees]; NaN without one."""
        estimate = self.snapshot.estimate
        return (
            float("nan")
            if estimate is None
            else float(np.degrees(wrap(float((estimate - self.snapshot.pose)[2]))))
        )


@dataclass(eq=False)
class Recording:
    """A search as far as it has come."""

    title: str
    """What it is called."""
    rings: Sequence[Float[np.ndarray, "_ 2"]]
    """Outlines of the building's free space [m]."""
    target: Float[np.ndarray, "2"]
    """Where the target is [m]."""
    height_m: float = 2.5
    """Height of the walls."""
    ended: str = ""
    """How it ended; empty while it runs."""
    _packed: list[bytes] = field(default_factory=list)
    _rows: list[tuple[float, ...]] = field(default_factory=list)
    _way: list[tuple[float, ...]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __len__(self) -> int:
        with self._lock:
            return len(self._packed)

    def __getitem__(self, i: int) -> Moment:
        with self._lock:
            packed = self._packed[i]
        moment: Moment = pickle.loads(zlib.decompress(packed))  # our own, packed in this very process
        return moment

    def add(self, moment: Moment) -> None:
        """Keep a moment."""
        packed = zlib.compress(pickle.dumps(moment), 1)
        estimate = moment.snapshot.estimate
        known = np.full(2, np.nan) if estimate is None else estimate[:2]
        states = [float("nan") if s is None else float(s) for s in (moment.believed_state, moment.true_state)]
        row = (moment.snr_db, *states, 100 * moment.position_error_m)
        with self._lock:
            self._packed.append(packed)
            self._rows.append(row)
            self._way.append((*moment.snapshot.pose[:2], *known))

    def time_lines(self) -> Float[np.ndarray, "n 4"]:
        """SNR [dB], believed and true link state, error of the position [cm] at each decision; NaN where unknown."""
        with self._lock:
            return np.array(self._rows, float).reshape(-1, 4)

    def ways(self, count: int) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
        """True and estimated places of the first decisions [m].

        Args:
            count: How many.
        """
        with self._lock:
            way = np.array(self._way[:count], float).reshape(-1, 4)
        return way[:, :2], way[:, 2:]
