"""Evaluation on a dask cluster: the same results, though a worker dies. Needs the extra `cluster`."""

import os
import signal
import threading
import time

import pytest
from rich.console import Console

from robosim.episode_config import EpisodeConfig
from robosim.evaluation.evaluate import evaluate
from robosim.evaluation.suite import Suite, SuiteTask
from robosim.plans.files import write_ros
from robosim.simulator import SimulatorConfig
from tests.plans import two_rooms

distributed = pytest.importorskip("distributed", reason="needs the extra cluster")


@pytest.mark.filterwarnings("ignore")  # of the cluster: its messages about a killed worker
def test_a_worker_killed_in_the_middle_changes_no_result(tmp_path):
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

    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        with distributed.Client(cluster) as client:
            processes = list(client.run(os.getpid).values())
        killed = []

        def kill_one() -> None:
            while len(list((tmp_path / "cluster" / "episodes").rglob("*.npz"))) < 2:
                time.sleep(0.02)
            os.kill(processes[0], signal.SIGKILL)
            killed.append(len(list((tmp_path / "cluster" / "episodes").rglob("*.npz"))))

        killer = threading.Thread(target=kill_one, daemon=True)
        killer.start()
        with_cluster = run("cluster", cluster.scheduler_address)
        killer.join()
    assert killed[0] < 6
    assert with_cluster == run("here", None)
