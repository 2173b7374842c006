"""Cameras timed against each other: each in a process of its own, all in one run, taking turns.

Processes are apart since each camera chooses what OpenGL runs on for its whole process. They take turns of a
fraction of a second, so that whatever else the machine is doing hits all of them; the ratio of two is formed turn
by turn, and the median of the ratios counts. On a busy machine look at the processor time.

What counts is the rate that a camera keeps up. All take some 1200 pictures before, about as many as an episode
does: stock pyrender on OSMesa compiles its shaders for each one, and takes longer still once llvmpipe holds as many
as it can (1024), from when on it throws some away for each new one.
"""

import multiprocessing
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from robosim.camera.model import CameraConfig
from robosim.camera.rendering.gl_systems import OpenGLError, missing
from robosim.support.processes import ctrl_c_held_back, end_with_parent
from tests.benchmarks.peers import PEERS

_START_S = 120.0
# Slow cameras, which do not change as they go, need not take all the pictures of the warm-up.
_WARM_UP_S = 10.0


@dataclass(frozen=True, eq=False)
class Heat:
    """What is to be drawn: the same for all."""

    mesh: trimesh.Trimesh
    poses: Float[np.ndarray, "n 4 4"]
    """Poses T_map_camera."""
    config: CameraConfig

    def save(self, path: Path) -> None:
        """Write it where other processes can read it."""
        visual: Any = self.mesh.visual
        np.savez(
            path,
            vertices=self.mesh.vertices,
            faces=self.mesh.faces,
            colours=visual.vertex_colors,
            poses=self.poses,
        )

    @classmethod
    def load(cls, path: Path, config: CameraConfig) -> "Heat":
        """Read what `save` wrote."""
        with np.load(path) as saved:
            mesh = trimesh.Trimesh(
                saved["vertices"], saved["faces"], vertex_colors=saved["colours"], process=False
            )
            return cls(mesh, saved["poses"], config)


class Runner:
    """One camera in a process of its own."""

    def __init__(self, name: str, heat_file: Path, config: CameraConfig, warm_up: int) -> None:
        """Start the process, which takes so many pictures at first; `ready` tells when it has."""
        self.name = name
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, name, str(heat_file), config, warm_up), daemon=True
        )
        with ctrl_c_held_back():
            self._process.start()
        theirs.close()

    def ready(self) -> Float[np.ndarray, "n h w"] | str:
        """Wait for the depth of all poses [m]; or the reason why there is none."""
        try:
            return self._pipe.recv() if self._pipe.poll(_START_S) else f"no picture within {_START_S:.0f} s"
        except EOFError:
            return "the process died"

    def turn(self, least_s: float) -> tuple[float, float]:
        """Seconds per picture by the clock and of processor time, going through the poses for some time."""
        self._pipe.send(least_s)
        return self._pipe.recv()

    def stop(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.join()
        self._pipe.close()


def _serve(pipe: Connection, name: str, heat_file: str, config: CameraConfig, warm_up: int) -> None:
    """Take pictures on demand, until the process is ended from outside."""
    end_with_parent(os.getppid())
    peer = PEERS[name]
    os.environ.pop("LP_NUM_THREADS", None)  # may have been set for this project's own cameras
    os.environ.update(peer.environment)
    try:
        heat = Heat.load(Path(heat_file), config)
        shot = peer.make(heat.mesh, config)
        depth = np.stack([shot(T) for T in heat.poses])
        begin, taken = time.perf_counter(), 0
        while taken < warm_up and time.perf_counter() - begin < _WARM_UP_S:
            shot(heat.poses[taken % len(heat.poses)])
            taken += 1
        told: Any = depth
    except Exception as error:  # whatever a library raises is the result
        told = f"{type(error).__name__}: {error}".strip().splitlines()[0]
    with suppress(EOFError, OSError):  # whoever asks may be gone
        pipe.send(told)
        if isinstance(told, str):
            return
        while True:
            least_s = pipe.recv()
            first, begin, cpu_begin = taken, time.perf_counter(), time.process_time()
            while taken == first or time.perf_counter() - begin < least_s:
                shot(heat.poses[taken % len(heat.poses)])
                taken += 1
            count = taken - first
            pipe.send(((time.perf_counter() - begin) / count, (time.process_time() - cpu_begin) / count))


@dataclass(frozen=True, eq=False)
class Result:
    """How one camera did."""

    name: str
    seconds: Float[np.ndarray, " n_turns"]
    """Seconds per picture, turn by turn; empty if it could not take any."""
    cpu_s: Float[np.ndarray, " n_turns"]
    """Processor time per picture, of all its threads; the same as `seconds` if nothing else runs."""
    depth: Any = None
    """Depth of all poses [m]."""
    trouble: str = ""
    """Why it could not."""


def race(
    heat: Heat, names: Sequence[str], folder: Path, *, warm_up: int, turns: int, turn_s: float
) -> list[Result]:
    """Let cameras take pictures in turns.

    Args:
        heat: What is drawn.
        names: Keys of `tests.benchmarks.peers.PEERS`.
        folder: Where processes can leave files for each other.
        warm_up: Pictures that each takes before its time counts.
        turns: How often each has its turn.
        turn_s: How long a turn lasts, about [s].
    """
    heat_file = folder / "heat.npz"
    heat.save(heat_file)
    runners: list[Runner] = []
    try:
        answers: dict[str, Any] = {name: str(lack) for name in names if (lack := _lack(name))}
        runners = [Runner(name, heat_file, heat.config, warm_up) for name in names if name not in answers]
        answers |= {runner.name: runner.ready() for runner in runners}
        able = [runner for runner in runners if not isinstance(answers[runner.name], str)]
        times: dict[str, list[tuple[float, float]]] = {runner.name: [] for runner in able}
        for _ in range(turns):
            for runner in able:
                times[runner.name].append(runner.turn(turn_s))
    finally:
        for runner in runners:
            runner.stop()
    return [
        Result(name, np.empty(0), np.empty(0), trouble=str(answers[name]))
        if isinstance(answers[name], str)
        else Result(name, np.array(times[name])[:, 0], np.array(times[name])[:, 1], answers[name])
        for name in names
    ]


def _lack(name: str) -> OpenGLError | None:
    """Why a camera has nothing to draw on, if so."""
    system = PEERS[name].system
    return missing(system) if system else None
