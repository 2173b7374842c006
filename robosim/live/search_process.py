"""A search in a process of its own, which is told when to go on.

Neither does the page wait for it, nor it for the page: what it decides comes by a pipe, and it goes on when it is let.
"""

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from time import monotonic, sleep
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.drawing.picture import building_rings
from robosim.episode import Decision, EpisodeConfig, check_weights, run_episode
from robosim.live.moments import Moment, Recording
from robosim.plans.floorplan import FloorPlan
from robosim.run import snapshot_of, status_line
from robosim.support.processes import end_with_parent
from robosim.task.record import EpisodeLog
from robosim.task.tasks import make_task
from slam.actions import Action
from wireless.support.counting import counted

#: How often a search that waits looks whether it may go on [s].
_LOOK_S = 0.02
#: What a search is let do.
WAIT, GO, BY_HAND = 0, 1, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchJob:
    """What is searched, and how."""

    plan: FloorPlan
    """Where."""
    config: EpisodeConfig
    """How, with policy and seed."""
    start: Float[np.ndarray, "3"] | None = None
    """Pose of the robot at first; drawn from the seed if not given."""
    target: Float[np.ndarray, "2"] | None = None
    """Where the target stands; drawn from the seed if not given."""


class SearchProcess:
    """A search that runs, waits, or goes step by step."""

    def __init__(
        self, title: str, job: SearchJob, told: Callable[["SearchProcess"], None], mode: int = GO
    ) -> None:
        """Start it.

        Args:
            title: Of its recording.
            job: What is searched.
            told: Called from another thread when the search has begun, has decided something, or has ended.
            mode: WAIT, GO or BY_HAND.
        """
        context = multiprocessing.get_context("spawn")
        self.title, self._told = title, told
        self.recording: Recording | None = None
        self.trouble = ""
        self._mode = context.Value("i", mode)
        self._pause_s = context.Value("d", 0.0)
        self._steps = context.Semaphore(0)
        self._keys = context.Value("i", -1)
        self._here, there = context.Pipe(duplex=False)
        gate = Gate(self._mode, self._pause_s, self._steps, self._keys)
        self._process = context.Process(target=_search, args=(job, gate, there, os.getpid()), daemon=True)
        self._process.start()
        there.close()
        self._reader = threading.Thread(target=self._read, name=f"search {title}", daemon=True)
        self._reader.start()

    @property
    def alive(self) -> bool:
        """Whether it may decide more."""
        return self._reader.is_alive()

    def set_mode(self, mode: int) -> None:
        """Let it go on, wait, or obey."""
        self._mode.value = mode

    def set_pause(self, pause_s: float) -> None:
        """Have it take at least so long for a decision [s]."""
        self._pause_s.value = pause_s

    def step(self) -> None:
        """Let it do one action more while it waits."""
        self._steps.release()

    def press(self, action: Action) -> None:
        """Have it do an action of one's own in place of its own next one; the last one pressed counts."""
        self._keys.value = int(action)

    def close(self) -> None:
        """End it at once."""
        self._process.kill()
        self._process.join(5)
        self._reader.join(5)

    def _read(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                kind, content = self._here.recv()
                if kind == "begun":
                    rings, target, height_m = content
                    self.recording = Recording(self.title, rings, target, height_m)
                elif kind == "moment":
                    assert self.recording is not None  # it has begun
                    self.recording.add(content)
                elif kind == "ended":
                    assert self.recording is not None
                    self.recording.ended = content
                else:
                    self.trouble = content
                self._told(self)
        if not self.trouble and (self.recording is None or not self.recording.ended):
            self.trouble = "the search was ended from outside"
            if self.recording is not None:
                self.recording.ended = "ended from outside"
        self._told(self)


@dataclass(eq=False)
class Gate:
    """Where a search waits for leave to go on."""

    mode: Any
    pause_s: Any
    steps: Any
    keys: Any

    def wait(self, since: float) -> Action | None:
        """Wait for leave; returns what is to be done instead, when a person drives.

        Args:
            since: When the decision before was let go [s, monotonic].
        """
        while True:
            if self.mode.value == BY_HAND:
                key = self.keys.value
                if key >= 0:
                    self.keys.value = -1
                    return Action(key)
            else:
                due = self.mode.value == GO and monotonic() - since >= self.pause_s.value
                if due or self.steps.acquire(block=False):
                    return None
            sleep(_LOOK_S if self.mode.value != GO else min(_LOOK_S, max(self.pause_s.value / 4, 0.001)))


def _search(job: SearchJob, gate: Gate, pipe: Connection, parent: int) -> None:
    """What the process does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # left to the parent
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with_parent(parent)
    logging.getLogger().setLevel(logging.ERROR)
    try:
        _run(job, gate, pipe)
    except BrokenPipeError:
        return
    except Exception as error:  # told in the page
        with suppress(OSError):
            pipe.send(("failed", " ".join(str(error).split()) or type(error).__name__))


def _run(job: SearchJob, gate: Gate, pipe: Connection) -> None:
    config = job.config
    check_weights(config)
    building = make_building(job.plan, config=config.building)
    places = reach(building, *config.simulator.robot.hull_m)
    rng = np.random.default_rng([config.seed, 0])
    task = make_task(places, rng, start=job.start, target=job.target)
    rings = building_rings(building)
    pipe.send(("begun", (rings, task.target, building.height_m)))
    since = monotonic()

    def look(log: EpisodeLog, decision: Decision) -> Action | None:
        nonlocal since
        pipe.send(("moment", moment_of(log, decision)))
        asked = gate.wait(since)
        since = monotonic()
        return asked

    log, _ = run_episode(building, places, task, config, look)
    score = log.result()
    told = f"{log.ended} after {counted(log.steps, 'step')} and {score['path_length_m']:.1f} m"
    pipe.send(("ended", told))


def moment_of(log: EpisodeLog, decision: Decision) -> Moment:
    """What is shown of a decision."""
    measurement = decision.situation.measurement
    snapshot = snapshot_of(log, decision, status_line(log, decision))
    return Moment.of(
        replace(snapshot, text=f"step {log.steps}: {snapshot.text}"),
        paths=decision.paths,
        probability=None if measurement is None else measurement.probability,
        seeks_target=log.seeks_target,
    )
