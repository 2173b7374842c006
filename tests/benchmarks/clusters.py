"""Sweeps on a dask cluster: memory of every process over time, the scheduler's load, transfer, and streaming to PyTorch.

A scheduler, workers and the command run as processes of their own, as they do on several machines. One worker is killed
in between; the tables are compared byte for byte with those of one process.
"""

import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from tyro.conf import OmitArgPrefixes

from robosim.support.workers import Workers
from tests.benchmarks.harness import DEFAULT, Options, console
from tests.benchmarks.results import Results

#: The cheapest links: lines of sight between dipoles, so that time goes to moving tables rather than to physics.
CHEAP = "--estimator pca --max-reflections 0 --no-diffraction --transmitter tag --receiver tag --grid 0.15"
#: Receivers of a generated home at that step, on average.
_RECEIVERS = 2900


class Memory:
    """Resident memory of processes [MB], sampled each second, with those that they start."""

    def __init__(self, processes: dict[str, int]) -> None:
        self._processes, self._start = processes, time.monotonic()
        self.curves: dict[str, list[tuple[float, float]]] = {name: [] for name in processes}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._sample, daemon=True)

    def __enter__(self) -> "Memory":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _sample(self) -> None:
        while not self._stop.wait(1.0):
            for name, number in self._processes.items():
                try:
                    process = psutil.Process(number)
                    sizes = [child.memory_info().rss for child in (process, *process.children(recursive=True))]
                except psutil.Error:
                    continue
                self.curves[name].append((time.monotonic() - self._start, max(sizes) / 1e6))

    def peaks(self, name: str) -> tuple[float, float]:
        """Largest memory in the second quarter of the time, and in the last one."""
        sizes = np.array([size for _, size in self.curves[name]])
        quarters = np.array_split(sizes, 4)
        return float(quarters[1].max()), float(quarters[3].max())


@contextmanager
def cluster(folder: Path, workers: int, *options: str) -> Iterator[tuple[str, dict[str, int]]]:
    """A scheduler and workers; its address, and their process numbers by name."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    log = (folder / "cluster.log").open("w")
    quiet: dict[str, Any] = {"stdout": log, "stderr": log, "env": {**os.environ, "OMP_NUM_THREADS": "1"}}
    common = ("--scheduler-file", str(file))
    with ExitStack() as stack:
        def start(*words: str) -> int:
            process = subprocess.Popen([sys.executable, "-m", "dask", *words, *common], **quiet)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            return process.pid

        started = {"scheduler": start("scheduler", "--port", "0", "--no-dashboard")}
        for number in range(workers):
            started[f"worker {number + 1}"] = start(
                "worker", "--no-dashboard", "--local-directory", str(folder), *(options or ("--nthreads", "1"))
            )
        from distributed import Client

        with Client(scheduler_file=str(file)) as client:
            client.wait_for_workers(workers)
            address = client.scheduler.address
        yield address, started


def digest(folder: Path) -> str:
    """A digest of all tables of a data set, by name."""
    whole = hashlib.sha256()
    for file in sorted((folder / "links").glob("*.parquet")):
        whole.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return whole.hexdigest()


def make(out: Path, homes: int, tx: int, *work: str) -> subprocess.Popen[str]:
    """The command that makes a data set of cheap links."""
    words = f"dataset --generated {homes} --tx-per-plan {tx} {CHEAP} --out {out} --quiet".split()
    return subprocess.Popen([sys.executable, "-m", "robosim", *words, *work], text=True)


def measure_memory(folder: Path, homes: int, tx: int, *, is_killed: bool) -> tuple[Memory, float]:
    """Memory while two workers make a data set, and its time [s]; one worker is killed at half of it."""
    out, begin = folder / f"links-{homes}-{tx}", time.monotonic()
    with cluster(folder, 2) as (address, processes):
        command = make(out, homes, tx, "--cluster", address)
        with Memory({**processes, "command": command.pid}) as memory:
            while command.poll() is None:
                time.sleep(0.5)
                if is_killed and len(list((out / "links").glob("*.parquet"))) > homes * tx / 2:
                    (victim,) = psutil.Process(processes["worker 1"]).children(recursive=True)[-1:]
                    os.kill(victim.pid, signal.SIGKILL)
                    console.print(f"killed a worker after {time.monotonic() - begin:.0f} s")
                    is_killed = False
        assert command.returncode == 0
    return memory, time.monotonic() - begin
