"""A search in a process of its own, which the page lets go on, step or wait.

The page does not wait for it: its steps come through a pipe.
"""

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from time import monotonic, sleep
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.drawing.plan_view import building_rings
from robosim.episode import EpisodeConfig, check_weights, run_episode
from robosim.episode_log import EpisodeLog
from robosim.live.recording import Recording
from robosim.plans.floorplan import FloorPlan
from robosim.recording.step_codec import encode_step
from robosim.step import Step
from robosim.support.processes import end_with_parent
from robosim.task.tasks import make_task
from slam.actions import Action
from wireless.support.counting import counted

#: How often a waiting search checks whether it may go on [s].
_POLL_S = 0.02
#: Modes of a search: wait, go on, or do the actions of a person.
WAIT, GO, BY_HAND = 0, 1, 2
#: True radio paths that are shown of a step, the strongest ones.
MOST_RAYS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchJob:
    """Where and how to search."""

    plan: FloorPlan
    """Where."""
    config: EpisodeConfig
    """How, with policy and seed."""
    start: Float[np.ndarray, "3"] | None = None
    """Pose of the robot at first; drawn from the seed if not given."""
    target: Float[np.ndarray, "2"] | None = None
    """Where the target stands; drawn from the seed if not given."""


class SearchProcess:
    """A search that runs, waits, or makes one step after another."""

    def __init__(
        self, title: str, job: SearchJob, on_change: Callable[["SearchProcess"], None], mode: int = GO
    ) -> None:
        """Start it.

        Args:
            title: Of its recording.
            job: Where and how to search.
            on_change: Called from another thread when the search has begun, has made a step, or has ended.
            mode: WAIT, GO or BY_HAND.
        """
        context = multiprocessing.get_context("spawn")
        self.title, self._on_change = title, on_change
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
        """Whether more steps may come."""
        return self._reader.is_alive()

    def set_mode(self, mode: int) -> None:
        """Let it go on, wait, or do what a person wants."""
        self._mode.value = mode

    def set_pause(self, pause_s: float) -> None:
        """Set the least time of a step [s]."""
        self._pause_s.value = pause_s

    def step(self) -> None:
        """Let it do one action while it waits."""
        self._steps.release()

    def press(self, action: Action) -> None:
        """Replace its next action; the last one pressed counts."""
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
                elif kind == "step":
                    assert self.recording is not None  # it has begun
                    self.recording.add(content)
                elif kind == "ended":
                    assert self.recording is not None
                    self.recording.ended = content
                else:
                    self.trouble = content
                self._on_change(self)
        if not self.trouble and (self.recording is None or not self.recording.ended):
            self.trouble = "the search was ended from outside"
            if self.recording is not None:
                self.recording.ended = "ended from outside"
        self._on_change(self)


@dataclass(eq=False)
class Gate:
    """Where a search waits until it may go on."""

    mode: Any
    pause_s: Any
    steps: Any
    keys: Any

    def wait(self, since: float) -> Action | None:
        """Wait until the search may go on; returns the action of a person who drives.

        Args:
            since: When the step before was let go [s, monotonic].
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
            sleep(_POLL_S if self.mode.value != GO else min(_POLL_S, max(self.pause_s.value / 4, 0.001)))


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
    since = monotonic()

    def begin() -> None:
        pipe.send(("begun", (building_rings(building), task.target, building.height_m)))

    def send(log: EpisodeLog, step: Step) -> Action | None:
        nonlocal since
        if not step.number:
            begin()
        paths = step.true.paths
        pipe.send(("step", {**encode_step(step), "paths": paths and paths.strongest(MOST_RAYS)}))
        action = gate.wait(since)
        since = monotonic()
        return action

    log, _ = run_episode(building, places, task, config, send)
    if not log.steps:
        begin()
    length_m = log.result()["path_length_m"]
    pipe.send(("ended", f"{log.ended} after {counted(log.steps, 'step')} and {length_m:.1f} m"))
