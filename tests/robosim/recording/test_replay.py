"""The log of an episode, and what is drawn from it."""

import json
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from robosim.drawing.picture import LEGEND
from robosim.drawing.snapshot import TOP_LEVEL, Arrivals, Layer, Snapshot
from robosim.episode import EpisodeConfig
from robosim.policies.reason import GoalKind, Reason
from robosim.recording import replay as replaying
from robosim.recording.decision_log import _LATER, DECISIONS, DecisionWriter, read_decisions
from robosim.recording.replay import replay
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from robosim.support.reading import FileError
from slam.grid import GridFrame
from tests.plans import two_rooms
from wireless.paths import LinkState

STEPS = 24


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """An episode with radio, camera and a belief."""
    folder = tmp_path_factory.mktemp("episode")
    config = EpisodeConfig(
        goal="fused",
        link_states="true",
        seed=2,
        simulator=SimulatorConfig(physics="kinematic"),
        max_steps=STEPS,
    )
    start, target = np.array([1.0, 0.6, 2.0]), np.array([5.0, 2.4])
    record_episode(two_rooms(0.8), config, folder, start=start, target=target)
    return folder


def test_a_replay_is_the_video_of_the_episode(recorded, tmp_path):
    """Byte for byte: the same frames into the same encoder. A pixel that the log does not hold changes it."""
    video, sheet = replay(recorded, tmp_path)
    assert video.read_bytes() == (recorded / "episode.mp4").read_bytes()
    with Image.open(sheet) as picture:
        width, height = picture.size
    assert width <= 2400 and (width - LEGEND) % 2 == 0 and height % 6 == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["replay.mp4", "sheet.png"]


def test_the_log_tells_what_the_other_files_tell(recorded):
    """True and estimated poses as in the trajectories, to the nanometre they are written with; all arrivals."""
    log = read_decisions(recorded)
    snapshots = list(log.snapshots())
    assert len(snapshots) == len(log) == json.loads((recorded / "result.json").read_text())["steps"]
    for name, poses in (
        ("trajectory", [m.pose for m in snapshots]),
        ("estimate", [m.estimate for m in snapshots]),
    ):
        kept = np.loadtxt(recorded / f"{name}.tum")[: len(snapshots)]
        np.testing.assert_allclose(np.array(poses)[:, :2], kept[:, 1:3], atol=1e-9)
    assert all(
        m.arrivals is not None and len(m.arrivals.aoa_rad) == len(m.arrivals.snr_db) for m in snapshots
    )
    assert 0 < snapshots[-1].belief.values.max() <= TOP_LEVEL
    assert snapshots[-1].built.values.any()
    np.testing.assert_array_equal(log.target, [5.0, 2.4])


def test_the_log_tells_why(recorded):
    """Each decision of `fused` has a reason in words; the way to the goal takes at least its straight length."""
    kinds = set()
    for m in read_decisions(recorded).snapshots():
        assert m.reason.because and m.reason.kind is not GoalKind.OTHER
        kinds.add(m.reason.kind)
        assert m.decisions >= np.hypot(*(m.path[-1] - m.path[0])) / 0.25 - 1e-9
        assert m.true_state is not None and 0 < m.coverage <= 1
    assert kinds & {GoalKind.LOOK, GoalKind.ARRIVAL}


def test_nothing_is_simulated_by_a_replay(recorded, tmp_path, monkeypatch):
    """Neither camera, physics nor radio is made, and no plan is read: only the log is there."""
    alone = tmp_path / "alone"
    alone.mkdir()
    (alone / DECISIONS).write_bytes((recorded / DECISIONS).read_bytes())
    for name in ("robosim.simulator.Simulator", "robosim.simulator.make_camera", "robosim.run.make_building"):
        monkeypatch.setattr(name, None)
    assert all(path.is_file() for path in replay(alone, alone, frames=1))


def test_the_sheet_shows_first_and_last(recorded, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(replaying, "_tiled", lambda frames: drawn.extend(frames) or frames[0])
    replay(recorded, tmp_path, frames=2)
    assert len(drawn) == 2
    assert not np.array_equal(drawn[0], drawn[1])


def _moment(origin, shape, belief, state, text) -> Snapshot:
    rng = np.random.default_rng(len(text))
    frame = GridFrame(origin_xy=origin, resolution_m=0.05, shape=shape)
    around = GridFrame(origin_xy=(-1.0, -1.0), resolution_m=0.2, shape=(7, 7))
    n = rng.integers(0, 4)
    return Snapshot(
        rgb=rng.integers(0, 256, (5, 6, 3), dtype=np.uint8),
        depth_mm=rng.integers(0, 65536, (5, 6), dtype=np.uint16),
        pose=rng.normal(size=3),
        estimate=rng.normal(size=3),
        built=Layer(frame, rng.integers(0, 4, shape, dtype=np.uint8)),
        goal=rng.normal(size=2),
        path=rng.normal(size=(n, 2)),
        arrivals=None if state is None else Arrivals(rng.normal(size=n), rng.normal(size=n), state),
        belief=None if belief is None else Layer(around, np.full((7, 7), belief, np.uint8)),
        text=text,
        reason=Reason(kind=GoalKind.LOOK, because=f"because of {text}", mass=float(n)),
        decisions=float(n),
        coverage=0.25,
        true_state=state,
    )


def _same(a, b) -> bool:
    if isinstance(a, (Layer, Arrivals)):
        return all(_same(getattr(a, name), getattr(b, name)) for name in vars(a))
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b


def test_what_is_written_reads_the_same(tmp_path):
    """Random snapshots, to the bit: of a map that grows on all sides, with and without radio, paths and belief."""
    cell = 0.05
    snapshots = [
        _moment((0.0, 0.0), (4, 5), None, None, "a"),
        _moment((-3 * cell, -2 * cell), (9, 12), 0, LinkState.OUTAGE, "bb"),
        _moment((-3 * cell, -2 * cell), (9, 12), 0, LinkState.LOS, "ccc, %"),
        _moment((-4 * cell, -2 * cell), (15, 40), 9, LinkState.HIGHER_ORDER, ""),
    ]
    rings = [np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]), np.array([[1.0, 1.0], [1.5, 1.0]])]
    writer = DecisionWriter(rings, np.array([1.0, 2.0]))
    for snapshot in snapshots:
        writer.add(snapshot)
    writer.save(tmp_path / DECISIONS)
    log = read_decisions(tmp_path)
    assert all(np.array_equal(a, b) for a, b in zip(log.rings, rings, strict=True))
    for written, read in zip(snapshots, log.snapshots(), strict=True):
        for name in vars(written):
            assert _same(getattr(written, name), getattr(read, name)), name


def test_a_log_of_version_0_1_is_drawn(recorded, tmp_path):
    """Without what came later: no reasons, no true states, no coverage."""
    with np.load(recorded / DECISIONS) as file:
        arrays = {name: file[name] for name in file.files if name not in _LATER}
    np.savez(tmp_path / DECISIONS, **arrays)
    log = read_decisions(tmp_path)
    assert log.seeks_target and {m.reason.kind for m in log.snapshots()} == {GoalKind.OTHER}
    assert all(path.is_file() for path in replay(tmp_path, tmp_path, frames=1))


def test_mistakes_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"decisions\.npz: no such file, expected the log of an episode"):
        replay(tmp_path, tmp_path)
    (tmp_path / DECISIONS).write_bytes(b"half of a fi")
    with pytest.raises(ValueError, match=r"decisions\.npz: not readable as the log of an episode"):
        replay(tmp_path, tmp_path)
    DecisionWriter([np.array([[0.0, 0], [6, 0], [6, 3]])], np.zeros(2)).save(tmp_path / DECISIONS)
    with pytest.raises(ValueError, match="without a decision to draw"):
        replay(tmp_path, tmp_path)


def _damaged(recorded, folder, **changes):
    """The recorded log with some of its arrays changed, each by a function."""
    with np.load(recorded / DECISIONS) as file:
        arrays = {name: file[name] for name in file.files}
    for name, change in changes.items():
        arrays[name] = change(arrays[name].copy())
    np.savez(folder / DECISIONS, **arrays)
    return folder


def _one(place, value):
    def change(array):
        array[place] = value
        return array

    return change


def _forged_size(pictures):
    """The first picture declared a hundred thousand pixels wide, its check sum right."""
    pictures[16:24] = np.frombuffer(struct.pack(">II", 100_000, 100_000), np.uint8)
    pictures[29:33] = np.frombuffer(struct.pack(">I", zlib.crc32(pictures[12:29].tobytes())), np.uint8)
    return pictures


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"pose": _one((3, 0), np.nan)}, "pose goes from nan"),
        ({"goal": _one((3, 1), 3e6)}, "a goal lies more than 100000 m from the target"),
        ({"path": lambda a: a + 2e5}, "a path lies more than"),
        ({"state": _one(2, 9)}, "a link state is 9"),
        ({"true_state": _one(2, 9)}, "a link state is 9"),
        ({"goal_kind": _one(2, "whim")}, "a kind of goal is 'whim'"),
        ({"map_frame": _one((5, 3), 1e6)}, "a map lies and is as no map"),
        ({"map_frame": _one((5, 2), 1e-9)}, "a map lies and is as no map"),
        ({"belief_frame": _one((-1, 2), np.nan)}, "a map lies and is as no map"),
        ({"rgb_count": _one(0, -1)}, "the lengths of rgb do not sum up"),
        ({"rgb_count": lambda a: np.full_like(a, 2**62)}, "the lengths of rgb do not sum up"),
        ({"cell_count": lambda a: a[:-1]}, "cell_count has shape"),
        ({"cell": lambda a: a + 10_000_000}, "out of bounds"),
        ({"value": lambda a: a.astype(float)}, "value is float64"),
        ({"rgb": _forged_size}, "bomb"),
        ({"rgb": lambda a: a[::-1]}, "of unknown format"),
        ({"depth": _one(slice(50, 90), 0)}, "decisions.npz"),
        ({"ring_count": lambda a: a[:0], "ring": lambda a: a[:0]}, "no outline"),
        ({"snr_db": _one(0, np.inf)}, "snr_db goes from"),
    ],
)
def test_damage_is_found_before_anything_is_drawn(recorded, tmp_path, changes, words):
    """One line that names the log, and no film that ends where the damage begins."""
    folder = _damaged(recorded, tmp_path, **changes)
    with pytest.raises(FileError) as error:
        replay(folder, tmp_path)
    assert words in str(error.value)
    assert str(folder / DECISIONS) in str(error.value) and "\n" not in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == [DECISIONS]
