"""Sweeps on a dask cluster: the same results though a worker dies, and nothing is left. Needs the extra `cluster`."""

import os
import signal
import threading
import time

import pytest
from rich.console import Console

from robosim.datasets.link_units import LinkSetConfig
from robosim.datasets.links import make_dataset
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.evaluate import evaluate
from robosim.evaluation.suite import Suite, SuiteTask
from robosim.plans.files import write_ros
from robosim.simulator import SimulatorConfig
from robosim.support.workers import Workers
from tests.plans import two_rooms

dask = pytest.importorskip("dask", reason="needs the extra cluster")
distributed = pytest.importorskip("distributed", reason="needs the extra cluster")


@pytest.fixture
def cluster():
    """A scheduler in this process, and two workers."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        yield cluster


@pytest.fixture
def kill_one(cluster):
    """A function that kills a worker as soon as a folder has two files of a kind."""
    with distributed.Client(cluster) as client:
        victim = next(iter(client.run(os.getpid).values()))
    killers = []

    def kill_when(folder, pattern):
        def kill() -> None:
            while len(list(folder.rglob(pattern))) < 2:
                time.sleep(0.01)
            os.kill(victim, signal.SIGKILL)

        killers.append(threading.Thread(target=kill, daemon=True))
        killers[-1].start()

    yield kill_when
    for killer in killers:
        killer.join(timeout=60)
        assert not killer.is_alive()


@pytest.mark.filterwarnings("ignore")  # of the cluster: its messages about a killed worker
def test_a_worker_killed_in_the_middle_changes_no_result(tmp_path, cluster, kill_one):
    """Two processes, one killed after the second of six episodes: all six, the same bytes as without a cluster."""
    file = tmp_path / "plans" / "pair.yaml"
    write_ros(two_rooms(0.8), file)
    ends = [(0.5 + 0.3 * i, 2.5) for i in range(3)]
    tasks = (
        SuiteTask(plan="pair", number=i, start=(1.0, 0.5, 0.0), target=end) for i, end in enumerate(ends)
    )
    suite = Suite(plans={"pair": file}, tasks=tuple(tasks))
    config = EpisodeConfig(simulator=SimulatorConfig(physics="kinematic"), mapper="classical", max_steps=10)

    def run(name: str, address: str | None) -> bytes:
        out, console = tmp_path / name, Console(quiet=True)
        evaluate(
            suite,
            out,
            config=config,
            policies=["explore"],
            repeats=1,
            workers=1,
            console=console,
            cluster=address,
        )
        return (out / "episodes.parquet").read_bytes()

    kill_one(tmp_path / "cluster" / "episodes", "*.npz")
    assert run("cluster", cluster.scheduler_address) == run("here", None)


@pytest.mark.filterwarnings("ignore")
def test_a_data_set_is_the_same_of_one_process_two_and_a_cluster(tmp_path, cluster, kill_one):
    """Ten tables and the manifest, byte for byte; a worker of the cluster is killed after the second table."""
    config = LinkSetConfig(tx_per_plan=10, grid_m=0.5, estimator="pca")

    def made(name: str, **work: int | str) -> dict[str, bytes]:
        make_dataset([lambda: two_rooms(0.8)], config, tmp_path / name, **work)
        files = (path for path in (tmp_path / name).rglob("*") if path.is_file())
        return {path.relative_to(tmp_path / name).as_posix(): path.read_bytes() for path in files}

    kill_one(tmp_path / "cluster", "*.parquet")
    on_cluster = made("cluster", cluster=cluster.scheduler_address)
    assert len(on_cluster) == 12
    assert on_cluster == made("one", workers=1) == made("two", workers=2)


def test_a_scheduler_holds_no_more_than_running_calls(cluster):
    """Two for each worker, of a hundred, whatever the caller has received; none after an error."""
    peak = 0
    with Workers(1, cluster.scheduler_address) as pool:
        for number, result in pool.run(bytes, ((n,) for n in range(100))):
            assert result == bytes(number)
            peak = max(peak, len(cluster.scheduler.tasks))
    assert 2 <= peak <= 5
    with pytest.raises(ZeroDivisionError), Workers(1, cluster.scheduler_address) as pool:
        list(pool.run(divmod, ((1, n) for n in range(9, -1, -1))))
    end = time.monotonic() + 60
    while cluster.scheduler.tasks and time.monotonic() < end:
        time.sleep(0.05)
    assert not cluster.scheduler.tasks


def nap(number):
    time.sleep(0.2)
    return number


@pytest.mark.filterwarnings("ignore")
def test_a_lost_scheduler_is_an_error_of_one_line(cluster):
    """With its address; finished calls have been handed over."""
    done = []
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "2s"}),
        pytest.raises(
            ChildProcessError, match=r"the dask scheduler at tcp.* does not answer \(.*same command"
        ),
        Workers(1, cluster.scheduler_address) as pool,
    ):
        for _, number in pool.run(nap, ((n,) for n in range(20))):
            done.append(number)
            if len(done) == 3:
                cluster.close()
    assert 3 <= len(done) < 20
