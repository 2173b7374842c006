"""Grids of links traced piece by piece: the same as in one go, whatever happens in between."""

import fcntl
import os
import signal
import subprocess
import sys
from dataclasses import fields

import numpy as np
import pytest

from wireless import Paths, Tracer, TracerConfig, dataset
from wireless.dataset import mesh_digest, read_transmitter, trace_grid
from wireless.run_folder import DatasetError

WALLS = [(0, 0), (6, 0), (6, 4), (0, 4)], [(2, 1), (3, 1), (3, 2)]
TX = np.array([[1.0, 1.4, 1.5], [4.0, 3.1, 1.2], [5.5, 0.6, 1.5]])
X, Y = np.meshgrid(np.arange(0.3, 6, 0.55), np.arange(0.3, 4, 0.55))
RX = np.column_stack([X.ravel(), Y.ravel(), np.full(X.size, 1.5)])

#: What the killed process runs: after some units it hangs, as if at work on the next one.
SCRIPT = """
import sys, time
import numpy as np, trimesh
from wireless import Tracer, dataset
dataset.UNIT_RX = 16
case = np.load(sys.argv[1])
tracer = Tracer(trimesh.Trimesh(case["vertices"], case["faces"], process=False))
def report(done, total):
    print(done, flush=True)
    if done >= 100:
        time.sleep(60)
dataset.trace_grid(tracer, case["tx"], case["rx"], sys.argv[2], report=report, workers=1)
"""


@pytest.fixture(autouse=True, scope="module")
def small_units():
    """Some units of receivers, the last one smaller, for each of three transmitters."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataset, "UNIT_RX", 16)
        yield


@pytest.fixture(scope="module")
def mesh(extruded, ring):
    return extruded(np.concatenate([ring(*loop) for loop in WALLS]))


@pytest.fixture(scope="module")
def tracer(mesh):
    return Tracer(mesh)


@pytest.fixture(scope="module")
def whole(tracer, tmp_path_factory):
    """The file of a run that nothing disturbs."""
    return trace_grid(tracer, TX, RX, tmp_path_factory.mktemp("whole")).read_bytes()


def same(a: Paths, b: Paths) -> bool:
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name == "point")
        for f in fields(Paths)
    )


def test_units_joined_are_the_paths_traced_at_once(tracer, tmp_path):
    """All columns bit for bit, in the same order, though no unit knew of the others' receivers."""
    assert len(RX) % 16
    path = trace_grid(tracer, TX, RX, tmp_path)
    at_once = tracer.trace(TX, RX)
    assert same(Paths.read_parquet(path), at_once)
    assert not (tmp_path / "units").exists()
    for i in range(3):
        assert same(read_transmitter(path, i), at_once.select(at_once.tx == i))


def test_an_interrupted_run_goes_on_to_the_same_bytes(tracer, tmp_path, whole):
    """Stopped after any number of units, the second run traces only what is missing."""
    for stop_at in (1, 100, 3 * len(RX)):

        def stop(done, total, stop_at=stop_at):
            if done >= stop_at:
                raise KeyboardInterrupt

        folder = tmp_path / str(stop_at)
        with pytest.raises(KeyboardInterrupt):
            trace_grid(tracer, TX, RX, folder, report=stop, workers=1)
        told = []
        path = trace_grid(tracer, TX, RX, folder, report=lambda *done, told=told: told.append(done))
        assert told[0][0] >= stop_at
        assert told[-1] == (3 * len(RX), 3 * len(RX))
        assert path.read_bytes() == whole


def test_a_killed_process_loses_no_unit(mesh, tracer, tmp_path, whole):
    """SIGKILL leaves whole units and perhaps one half-written file, which is not taken for one."""
    case, folder = tmp_path / "case.npz", tmp_path / "run"
    np.savez(case, vertices=mesh.vertices, faces=mesh.faces, tx=TX, rx=RX)
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, case, folder],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    done = 0
    while done < 100:
        done = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert not (folder / "paths.parquet").exists()
    (folder / "units" / ".tx0002_rx0000096.partial.parquet").write_bytes(b"PAR1 cut off")
    told = []
    path = trace_grid(tracer, TX, RX, folder, report=lambda *done: told.append(done))
    assert told[0] == (done, 3 * len(RX))
    assert path.read_bytes() == whole


def test_a_finished_folder_is_not_traced_again(tracer, tmp_path, whole):
    path = trace_grid(tracer, TX, RX, tmp_path)
    told = []
    trace_grid(tracer, TX, RX, tmp_path, report=lambda *done: told.append(done))
    assert told == [(3 * len(RX), 3 * len(RX))]
    assert path.read_bytes() == whole


def test_paths_of_other_settings_are_not_mixed(mesh, tracer, tmp_path):
    """What differs is named with both values: receivers, order of reflections, anything said of the scene."""
    trace_grid(
        tracer,
        TX,
        RX,
        tmp_path,
        about={"plan": "a", "mesh": mesh_digest(mesh, ("drywall",), 0 * mesh.faces[:, 0])},
    )
    other = Tracer(mesh, config=TracerConfig(max_reflections=1))
    with pytest.raises(DatasetError, match=r"max_reflections 3 there, 1 now"):
        trace_grid(other, TX, RX, tmp_path, about={"plan": "a"})
    with pytest.raises(DatasetError, match=r"plan a there, b now"):
        trace_grid(tracer, TX, RX, tmp_path, about={"plan": "b"})
    with pytest.raises(DatasetError, match=r"receivers_sha256"):
        trace_grid(tracer, TX, RX + 0.01, tmp_path, about={"plan": "a"})
    (tmp_path / "settings.json").write_text("{")
    with pytest.raises(DatasetError, match=r"no readable settings\.json"):
        trace_grid(tracer, TX, RX, tmp_path)


def test_settings_that_came_to_nothing_do_not_bind(tracer, tmp_path):
    """A height above the ceiling fails before any unit is written: the corrected run may use the folder."""
    with pytest.raises(ValueError, match="heights"):
        trace_grid(tracer, TX, RX + np.array([0, 0, 9]), tmp_path)
    assert trace_grid(tracer, TX[:1], RX[:20], tmp_path).exists()


def test_two_processes_do_not_share_a_folder(tracer, tmp_path):
    with (tmp_path / ".lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(DatasetError, match="Another process"):
            trace_grid(tracer, TX, RX, tmp_path)


def test_no_receivers_are_a_mistake(tracer, tmp_path):
    with pytest.raises(ValueError, match="3 transmitters and 0 receivers"):
        trace_grid(tracer, TX, RX[:0], tmp_path)


def test_links_without_paths_are_kept(extruded, ring, tmp_path):
    """A transmitter in a sealed box: no path at all, and still all receivers in the file."""
    mesh = extruded(np.concatenate([ring(*WALLS[0]), ring((1, 1), (2, 1), (2, 2), (1, 2))]))
    tx = np.array([[1.5, 1.5, 1.5]])
    rx = RX[(np.abs(RX[:, :2] - 1.5) > 0.5).any(axis=1)]
    path = trace_grid(Tracer(mesh), tx, rx, tmp_path)
    for paths in (Paths.read_parquet(path), read_transmitter(path, 0)):
        assert len(paths) == 0
        assert paths.count().shape == (1, len(rx))


def test_a_digest_changes_with_the_building(mesh):
    """A wall moved by a nanometre, another material, another face of it: each has its own digest."""
    moved = mesh.copy()
    moved.vertices[0, 0] += 1e-9
    of_face = np.zeros(len(mesh.faces), int)
    digests = {
        mesh_digest(mesh, ("drywall",), of_face),
        mesh_digest(moved, ("drywall",), of_face),
        mesh_digest(mesh, ("concrete",), of_face),
        mesh_digest(mesh, ("drywall",), of_face + 1),
    }
    assert len(digests) == 4
    assert mesh_digest(mesh.copy(), ("drywall",), of_face) in digests
