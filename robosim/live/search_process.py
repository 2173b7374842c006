"""A search in a process of its own: it runs, waits, or makes single steps, which come through a pipe."""

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

from robosim.agent import check_weights
from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.drawing.plan_view import building_rings
from robosim.entrants import make_entrants
from robosim.episode import run_team
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.live.recordings import Recording
from robosim.plans.floorplan import FloorPlan
from robosim.recording.step_codec import encode_step
from robosim.step import Step
from robosim.support.processes import end_with_parent
from robosim.task.tasks import make_task
from slam.actions import Action
from wireless.support.counting import counted

#: Interval at which a waiting search checks its mode [s].
_POLL_S = 0.02
#: Modes of a search: wait, run, or take the actions of a person.
WAIT, RUN, MANUAL = 0, 1, 2
#: Number of true radio paths that are shown, the strongest ones.
MOST_RAYS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class SearchJob:
    """A search; start and target are drawn from the seed unless given."""

    plan: FloorPlan
    config: EpisodeConfig
    start: Float[np.ndarray, "3"] | None = None
    """First pose of the robot [m, rad]."""
    target: Float[np.ndarray, "2"] | None = None
    """Position of the target [m]."""


class SearchProcess:
    """A search in a process of its own."""

    def __init__(
        self, title: str, job: SearchJob, on_change: Callable[["SearchProcess"], None], mode: int = RUN
    ) -> None:
        """Start it in a mode.

        `on_change` is called from another thread when the search has begun, has made a step, or has ended.
        """
        context = multiprocessing.get_context("spawn")
        self.title, self._on_change = title, on_change
        self.recording: Recording | None = None
        self.error = ""
        self._gate = Gate(
            context.Value("i", mode), context.Value("d", 0.0), context.Semaphore(0), context.Value("i", -1)
        )
        self._receiver, sender = context.Pipe(duplex=False)
        arguments = (job, self._gate, sender, os.getpid())
        self._process = context.Process(target=_search, args=arguments, daemon=True)
        self._process.start()
        sender.close()
        self._reader = threading.Thread(target=self._read, name=f"search {title}", daemon=True)
        self._reader.start()

    @property
    def is_alive(self) -> bool:
        """Whether more steps can come."""
        return self._reader.is_alive()

    def set_mode(self, mode: int) -> None:
        """Set WAIT, RUN or MANUAL."""
        self._gate.mode.value = mode

    def set_pause(self, pause_s: float) -> None:
        """Set the least duration of a step [s]."""
        self._gate.pause_s.value = pause_s

    def step(self) -> None:
        """Make one step in mode WAIT."""
        self._gate.steps.release()

    def press(self, action: Action) -> None:
        """Set the next action in mode MANUAL, instead of one that still waits."""
        self._gate.key.value = int(action)

    def close(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join(5)
        self._reader.join(5)

    def _read(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                kind, content = self._receiver.recv()
                if kind == "begun":
                    names, rings, target, height_m = content
                    made = [Recording(self.title, rings, target, height_m, robot=name) for name in names]
                    first, *mates = made
                    first.mates, self.recording = mates, first
                elif kind == "failed":
                    self.error = content
                else:
                    assert self.recording is not None  # it has begun
                    if kind == "step":
                        number, row = content
                        self.recording.robots[number].add(row)
                    else:
                        for robot, ended in zip(self.recording.robots, content, strict=True):
                            robot.ended = ended
                self._on_change(self)
        if not self.error and (self.recording is None or not self.recording.ended):
            self.error = "the process of the search was killed"
            if self.recording is not None:
                self.recording.ended = "process killed"
        self._on_change(self)


@dataclass(eq=False)
class Gate:
    """Shared values that a search process reads."""

    mode: Any
    pause_s: Any
    steps: Any
    key: Any

    def wait(self, since: float) -> Action | None:
        """Wait for the next step after one at `since` [s, monotonic]; returns the action of a person."""
        while True:
            if self.mode.value == MANUAL:
                key = self.key.value
                if key >= 0:
                    self.key.value = -1
                    return Action(key)
            else:
                is_due = self.mode.value == RUN and monotonic() - since >= self.pause_s.value
                if is_due or self.steps.acquire(block=False):
                    return None
            sleep(_POLL_S if self.mode.value != RUN else min(_POLL_S, max(self.pause_s.value / 4, 0.001)))


def _search(job: SearchJob, gate: Gate, pipe: Connection, parent: int) -> None:
    """Main function of the process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # left to the parent
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with_parent(parent)
    logging.getLogger().setLevel(logging.ERROR)
    try:
        _run(job, gate, pipe)
    except BrokenPipeError:
        return
    except Exception as error:  # shown on the page
        with suppress(OSError):
            pipe.send(("failed", " ".join(str(error).split()) or type(error).__name__))


def _run(job: SearchJob, gate: Gate, pipe: Connection) -> None:
    config = job.config
    check_weights(config)
    building = make_building(job.plan, config=config.building)
    places = reach(building, *config.robots[0].hull_m)
    rng = np.random.default_rng([config.seed, 0])
    task = make_task(places, rng, start=job.start, target=job.target)
    entrants = make_entrants(building, places, task, config)
    since, last = monotonic(), -1

    def begin() -> None:
        names = list(entrants) if len(entrants) > 1 else [""]
        pipe.send(("begun", (names, building_rings(building), task.target, building.height_m)))

    def send(log: EpisodeLog, step: Step) -> Action | None:
        nonlocal since, last
        if last < 0:
            begin()
            last = 0
        paths = step.true.paths
        row = {**encode_step(step), "paths": paths and paths.strongest(MOST_RAYS)}
        pipe.send(("step", (list(entrants).index(log.robot), row)))
        if step.number < last:
            return None  # the first robot that decides has waited for all
        action, last = gate.wait(since), step.number + 1
        since = monotonic()
        return action

    logs = run_team(building, entrants, send).robots.values()
    if last < 0:
        begin()
    ends = [f"{log.ended} after {counted(log.steps, 'step')} and {log.path_length_m:.1f} m" for log in logs]
    pipe.send(("ended", ends))
