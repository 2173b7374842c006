"""Sweeps on a dask cluster: memory of each process over time, scheduling, transfer, and streaming to PyTorch.

Scheduler, workers and the command run as processes of their own, as they do on several machines. One worker is killed
when half of the data set is made; all tables are compared byte for byte with those of one process.
"""

import hashlib
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import psutil  # type: ignore[import-untyped]
from tyro.conf import OmitArgPrefixes

from robosim.support.workers import Workers
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.results import Results, read_results

#: The cheapest links, lines of sight between dipoles, so that time goes to tables rather than to physics.
CHEAP = "--estimator pca --max-reflections 0 --no-diffraction --transmitter tag --receiver tag"
#: Links of the extrapolation, machines, and cores of each.
LINKS, MACHINES, CORES = 1e9, 50, 16
#: Result of a task when transfer is measured [bytes].
_RESULT = 1_000_000


class Run(NamedTuple):
    """A data set that was made on a cluster."""

    curves: dict[str, list[tuple[float, float]]]
    """Seconds, and resident memory [MB], of each process."""
    seconds: float
    rows: int
    folder: Path


def main(
    *,
    homes: int = 350,
    tx_per_plan: int = 10,
    grid: float = 0.15,
    tasks: int = 100_000,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Memory, scheduling, transfer and streaming of a large data set, and what they make of a billion links.

    Args:
        homes: Generated homes.
        tx_per_plan: Transmitters in each.
        grid: Step between receivers [m].
        tasks: Trivial tasks that load the scheduler.
        options: Of every benchmark.
    """
    results = Results()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = make_on_cluster(folder, homes, tx_per_plan, grid)
        add_run(
            results, made, homes, digest(made.folder) == digest(make_alone(folder, homes, tx_per_plan, grid))
        )
        add_streams(results, made.folder)
        add_load(results, folder, tasks)
        add_extrapolation(results, bytes_a_link(folder), made)
    return options.finish("clusters", results)


@contextmanager
def cluster(folder: Path, workers: int, *options: str) -> Iterator[tuple[str, dict[str, int]]]:
    """A scheduler and workers; its address, and their process numbers by name."""
    file = folder / "scheduler.json"
    file.unlink(missing_ok=True)
    with ExitStack() as stack:
        log = stack.enter_context((folder / "cluster.log").open("w"))

        def start(*words: str) -> int:
            command = [sys.executable, "-m", "dask", *words, "--no-dashboard", "--scheduler-file", str(file)]
            one_thread = {**os.environ, "OMP_NUM_THREADS": "1"}
            process = subprocess.Popen(command, stdout=log, stderr=log, env=one_thread)
            stack.callback(process.wait)
            stack.callback(process.terminate)
            return process.pid

        started = {"scheduler": start("scheduler", "--port", "0")}
        words = options or ("--nthreads", "1")
        for number in range(workers):
            started[f"worker {number + 1}"] = start("worker", "--local-directory", str(folder), *words)
        from distributed import Client

        with Client(scheduler_file=str(file)) as client:
            client.wait_for_workers(workers)
            address = client.scheduler.address
        yield address, started


@contextmanager
def memory(processes: dict[str, int]) -> Iterator[dict[str, list[tuple[float, float]]]]:
    """Resident memory [MB] of processes over time [s], sampled each second; of those that they start, the largest."""
    curves: dict[str, list[tuple[float, float]]] = {name: [] for name in processes}
    begin, stop = time.monotonic(), threading.Event()

    def sample() -> None:
        while not stop.wait(1.0):
            for name, number in processes.items():
                try:
                    process = psutil.Process(number)
                    family = (process, *process.children(recursive=True))
                    size = max(member.memory_info().rss for member in family) / 1e6
                except psutil.Error:
                    continue
                curves[name].append((time.monotonic() - begin, size))

    thread = threading.Thread(target=sample, daemon=True)
    thread.start()
    try:
        yield curves
    finally:
        stop.set()
        thread.join()


def make(out: Path, homes: int, tx: int, grid: float, *work: str) -> subprocess.Popen[bytes]:
    """The command that makes a data set of cheap links."""
    words = f"dataset --generated {homes} --tx-per-plan {tx} --grid {grid} {CHEAP} --out {out} --quiet"
    return subprocess.Popen([sys.executable, "-m", "robosim", *words.split(), *work])


def make_alone(folder: Path, homes: int, tx: int, grid: float) -> Path:
    """Make the data set with one process; returns its folder."""
    out = folder / "alone"
    if make(out, homes, tx, grid, "--workers", "1").wait():
        raise ValueError("the data set could not be made by one process")
    return out


def make_on_cluster(folder: Path, homes: int, tx: int, grid: float) -> Run:
    """Make a data set with two workers, of which one is killed when half of it is made."""
    out, begin, is_killed = folder / "links", time.monotonic(), False
    with cluster(folder, 2) as (address, processes):
        command = make(out, homes, tx, grid, "--cluster", address)
        with memory({**processes, "command": command.pid}) as curves:
            while command.poll() is None:
                time.sleep(0.2)
                if not is_killed and len(list((out / "links").glob("*.parquet"))) > homes * tx / 2:
                    victim = psutil.Process(processes["worker 1"]).children(recursive=True)[-1]
                    os.kill(victim.pid, signal.SIGKILL)
                    is_killed = True
        if command.returncode or not is_killed:
            raise ValueError("the data set could not be made, or before a worker could be killed")
    seconds = time.monotonic() - begin
    return Run(curves, seconds, sum(_rows(file) for file in (out / "links").glob("*.parquet")), out)


def _rows(file: Path) -> int:
    import pyarrow.parquet as pq

    return int(pq.read_metadata(file).num_rows)


def digest(folder: Path) -> str:
    """A digest of all tables of a data set, and of its manifest."""
    whole = hashlib.sha256()
    for file in [*sorted((folder / "links").glob("*.parquet")), folder / "manifest.json"]:
        whole.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
    return whole.hexdigest()


def add_run(results: Results, made: Run, homes: int, is_equal: bool) -> None:
    """Add what the data set took, and the memory of each process."""
    files = list((made.folder / "links").glob("*.parquet"))
    size = sum(file.stat().st_size for file in files)
    row = f"{homes} homes, one worker killed"
    results.add("data set", row, "links", made.rows, digits=0)
    results.add("data set", row, "tables", len(files), digits=0)
    results.add("data set", row, "time", made.seconds / 60, "min", digits=1)
    results.add("data set", row, "bytes a link", size / made.rows, digits=0)
    results.add("data set", row, "tables equal to one process", 100 * is_equal, "%", digits=0)
    for name, curve in made.curves.items():
        # Until the tenth of the time libraries are imported; a process that was killed starts again.
        steady = [(at, megabytes) for at, megabytes in curve if at > 0.1 * made.seconds]
        halves = [[m for at, m in steady if (at > 0.5 * made.seconds) == late] for late in (False, True)]
        for half, sizes in zip(("first half, largest", "second half, largest"), halves, strict=True):
            results.add("memory", name, half, max(sizes, default=math.nan), "MB", digits=0)


def add_load(results: Results, folder: Path, tasks: int) -> None:
    """Add the load of trivial tasks, and of results of a megabyte, on scheduler and command."""
    for row, count, size in ((f"{tasks} trivial tasks", tasks, 0), ("results of 1 MB", tasks // 50, _RESULT)):
        with cluster(folder, 1, "--nthreads", "16", "--no-nanny") as (address, processes):
            scheduler = psutil.Process(processes["scheduler"])
            before, begin = sum(scheduler.cpu_times()[:2]), time.monotonic()
            first_mb, used = scheduler.memory_info().rss / 1e6, time.process_time()
            with memory(processes) as curves, Workers(1, address) as pool:
                for _ in pool.run(bytes, ((size,) for _ in range(count))):
                    pass
            seconds = time.monotonic() - begin
            results.add("load", row, "tasks a second", count / seconds, digits=0)
            cpu_s = sum(scheduler.cpu_times()[:2]) - before
            results.add("load", row, "scheduler's CPU", 1e3 * cpu_s / count, "ms", digits=2)
            results.add(
                "load", row, "command's CPU", 1e3 * (time.process_time() - used) / count, "ms", digits=2
            )
            peak = max(megabytes for _, megabytes in curves["scheduler"] or [(0, first_mb)])
            results.add("load", row, "scheduler's memory, first", first_mb, "MB", digits=0)
            results.add("load", row, "scheduler's memory, largest", peak, "MB", digits=0)


def add_streams(results: Results, folder: Path) -> None:
    """Add rate and memory of an epoch of `LinkDataset`, in order and shuffled."""
    for row, seed, workers in (
        ("in order", None, 0),
        ("shuffled", 0, 0),
        ("shuffled, 2 workers", 0, 2),
    ):
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            links, seconds, more_mb = pool.submit(_stream, folder, seed, workers).result()
        results.add("stream", row, "links", links, digits=0)
        results.add("stream", row, "links a second", links / seconds, digits=0)
        results.add("stream", row, "memory, largest of a process", more_mb, "MB", digits=0)


def _stream(folder: Path, seed: int | None, workers: int) -> tuple[int, float, float]:
    """Links of an epoch, its time [s], and the most memory that it adds to a process [MB]."""
    from torch.utils.data import DataLoader

    from robosim import LinkDataset

    me, links = psutil.Process(), 0
    before, begin = me.memory_info().rss / 1e6, time.monotonic()
    data = LinkDataset(folder, seed=seed)
    loader = DataLoader(data, batch_size=None, num_workers=workers)
    with memory({"stream": me.pid}) as curves:
        for batch in loader:
            links += len(batch["state"])
    peak_mb = max((megabytes for _, megabytes in curves["stream"]), default=math.nan)
    return links, time.monotonic() - begin, peak_mb - before


def bytes_a_link(folder: Path) -> float:
    """Size of the tables of a link with default options."""
    out = folder / "default"
    words = f"dataset --generated 4 --tx-per-plan 1 --estimator pca --out {out} --quiet".split()
    subprocess.run([sys.executable, "-m", "robosim", *words], check=True)
    files = list((out / "links").glob("*.parquet"))
    return sum(file.stat().st_size for file in files) / sum(map(_rows, files))


def add_extrapolation(results: Results, link_bytes: float, made: Run) -> None:
    """Add hours of a billion links of default size on fifty machines, each from one measured rate."""

    def value(source: Results, table: str, row: str, name: str) -> float:
        (entry,) = [r for r in source.rows if (r["table"], r["row"], r["name"]) == (table, row, name)]
        return float(entry["value"])

    rates, loads = read_results("dataset"), [r["row"] for r in results.rows if r["table"] == "load"]
    trivial, large = dict.fromkeys(loads)
    units = LINKS / made.rows * len(list((made.folder / "links").glob("*.parquet")))
    results.add("size", "a billion links", "bytes a link", link_bytes, digits=0)
    megabytes = LINKS * link_bytes / 1e6
    results.add("size", "a billion links", "tables", units, digits=0)
    results.add("size", "a billion links", "all tables", megabytes / 1e3, "GB", digits=0)
    for estimator in ("sage", "pca"):
        rate = value(rates, "data sets", estimator, "links a second and core")
        hours = LINKS / rate / MACHINES / CORES / 3600
        results.add(
            "billion", f"tracing and estimation, {estimator}, all cores", "time", hours, "h", digits=2
        )
    for row, count, load in (("one result after the other", units, trivial), ("transfer", megabytes, large)):
        hours = count / value(results, "load", load, "tasks a second") / 3600
        results.add("billion", f"{row}, by the command", "time", hours, "h", digits=2)
    for process in ("scheduler", "command"):
        hours = units * value(results, "load", trivial, f"{process}'s CPU") / 3.6e6
        results.add("billion", f"scheduling, CPU of the {process}", "time", hours, "h", digits=2)
