"""The file of an episode: all that was recorded comes back, and damage is named."""

import json
import struct
import zlib

import numpy as np
import pytest

from robosim.layers import TOP_LEVEL, Layer
from robosim.policies.reason import GoalKind, Reason
from robosim.recording.episode_file import EPISODE, EpisodeWriter, Head, read_episode, read_head
from robosim.recording.replay import replay
from robosim.support.reading import FileError
from slam.grid import GridFrame
from tests.steps import measurement, step, unknown_map
from wireless.paths import LinkState

ROW = {"plan": "pair", "policy": "fused", "ended": "arrived", "target": [5.0, 2.4]}
RINGS = [np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]), np.array([[1.0, 1.0], [1.5, 1.0]])]


def test_the_file_agrees_with_the_other_files(recorded):
    """True and estimated poses as in the trajectories, to the nanometre they are written with; all arrivals."""
    episode = read_episode(recorded)
    result, steps = json.loads((recorded / "result.json").read_text()), list(episode.steps())
    assert len(steps) == len(episode) == result["steps"]
    for name, poses in (("trajectory", episode.poses), ("estimate", episode.estimates)):
        np.testing.assert_allclose(poses[:, :2], np.loadtxt(recorded / f"{name}.tum")[:, 1:3], atol=1e-9)
    assert {name: result[name] for name in episode.head.row if name != "policy"} == {
        name: value for name, value in episode.head.row.items() if name != "policy"
    }
    assert 0 < steps[-1].belief_layer.values.max() <= TOP_LEVEL
    assert steps[-1].map_layer.values.any()
    errors = []
    for one in steps:
        measured, true = one.estimated.measurement, one.true
        assert len(measured.aoa_rad) == len(measured.snr_db) and measured.probability.sum() == pytest.approx(
            1
        )
        assert true.link_state == measured.state, "link states were the true ones"
        errors.append(abs(measured.aoa_rad[0] - true.aoa_rad))
    assert np.median(errors) < np.radians(5)


def test_each_decision_has_its_reason(recorded):
    """Each decision of `fused` has a reason in words; the path to the goal takes at least its straight length."""
    kinds = set()
    for one in read_episode(recorded).steps():
        reason, path = one.decided.reason, one.decided.path
        assert reason.because and reason.kind is not GoalKind.OTHER
        kinds.add(reason.kind)
        assert one.actions_to_goal >= np.hypot(*(path[-1] - path[0])) / 0.25 - 1e-9
        assert 0 < one.true.coverage <= 1
    assert kinds & {GoalKind.LOOK, GoalKind.ARRIVAL}


def _random_step(i, origin, shape, belief, state):
    rng = np.random.default_rng(i)
    frame = GridFrame(origin_xy=origin, resolution_m=0.05, shape=shape)
    around = GridFrame(origin_xy=(-1.0, -1.0), resolution_m=0.2, shape=(7, 7))
    n, estimate = int(rng.integers(0, 4)), rng.normal(size=3)
    measured = None if state is None else measurement(estimate, state, rng.normal(size=n), rng.normal(size=n))
    return step(
        i,
        pose=rng.normal(size=3),
        estimate=estimate,
        map=Layer(frame, rng.integers(0, 20, shape, dtype=np.uint8)),
        belief=None if belief is None else Layer(around, np.full((7, 7), belief, np.uint8)),
        measured=measured,
        rgb=rng.integers(0, 256, (5, 6, 3), dtype=np.uint8),
        depth=rng.integers(0, 65000, (5, 6)).astype(np.float32) / np.float32(1000),
        goal=rng.normal(size=2),
        path=rng.normal(size=(n, 2)),
        reason=Reason(GoalKind.LOOK, f"because of {i}, %", float(n)),
        state=state,
    )


def _same(a, b) -> bool:
    if hasattr(a, "__dataclass_fields__") or isinstance(a, Reason):
        names = a._fields if isinstance(a, Reason) else a.__dataclass_fields__
        return all(callable(getattr(a, name)) or _same(getattr(a, name), getattr(b, name)) for name in names)
    if isinstance(a, (np.ndarray, float)):
        return np.array_equal(a, b, equal_nan=True)
    return a == b


def _written(folder, steps, *, pictures=True):
    writer = EpisodeWriter(RINGS, pictures=pictures)
    for one in steps:
        writer.add(one)
    end = np.array([5.0, 2.3, 0.1])
    (folder / EPISODE).write_bytes(
        writer.content(
            Head(row=ROW, seeks_target=True), end, 0.5, unknown_map(end), np.arange(len(steps) + 1.0)
        )
    )
    return read_episode(folder)


def test_what_is_written_reads_the_same(tmp_path):
    """Random steps, bit-identical: of a map that grows on all sides, with and without radio, paths and belief."""
    cell = 0.05
    steps = [
        _random_step(0, (0.0, 0.0), (4, 5), None, None),
        _random_step(1, (-3 * cell, -2 * cell), (9, 12), 0, LinkState.OUTAGE),
        _random_step(2, (-3 * cell, -2 * cell), (9, 12), 0, LinkState.LOS),
        _random_step(3, (-4 * cell, -2 * cell), (70, 140), 9, LinkState.HIGHER_ORDER),
    ]
    episode = _written(tmp_path, steps)
    assert all(np.array_equal(a, b) for a, b in zip(episode.rings, RINGS, strict=True))
    assert episode.head == read_head(tmp_path / EPISODE) == Head(row=ROW, seeks_target=True)
    for written, read in zip(steps, episode.steps(), strict=True):
        for group in ("number", "sensed", "decided", "true", "estimated", "map_layer", "belief_layer"):
            assert _same(getattr(written, group), getattr(read, group)), group
    np.testing.assert_array_equal(episode.poses[-1], [5.0, 2.3, 0.1])


def test_without_pictures_the_map_is_that_in_the_end(tmp_path):
    """Neither camera nor belief, and of each measurement the strongest path."""
    measured = measurement((1, 1, 0), LinkState.LOS, (0.1, 0.2), (30.0, 10.0))
    step_ = _random_step(0, (0.0, 0.0), (4, 5), 3, None)
    episode = _written(tmp_path, [step_, step(1, measured=measured)], pictures=False)
    assert not episode.has_pictures and not episode.anticipates()
    first, second = episode.steps()
    assert not first.sensed.rgb.size and first.decided.belief is None and not first.map_layer.values.any()
    assert second.estimated.measurement.aoa_rad.tolist() == [0.1]
    assert episode.link_states.tolist() == [-1, LinkState.LOS]
    assert episode.snr_db.tolist() == [-np.inf, 30.0]
    assert _same(first.decided.path, step_.decided.path)


def test_an_episode_of_an_earlier_version_is_named(recorded, tmp_path):
    np.savez(tmp_path / EPISODE, head=np.array(json.dumps({"row": {}, "timing": {}, "made_by": ""})))
    with pytest.raises(FileError, match=r"not of version 0\.3 .*\)\. Delete it and run the episode again"):
        read_episode(tmp_path)


def test_mistakes_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"episode\.npz: no such file, expected a recorded episode"):
        read_episode(tmp_path)
    (tmp_path / EPISODE).write_bytes(b"half of a fi")
    with pytest.raises(ValueError, match=r"episode\.npz: not readable as a recorded episode"):
        read_episode(tmp_path)


def _damaged(recorded, folder, **changes):
    """The recorded episode with some of its arrays changed, each by a function."""
    with np.load(recorded / EPISODE) as file:
        arrays = {name: file[name] for name in file.files}
    for name, change in changes.items():
        arrays[name] = change(arrays[name].copy())
    np.savez(folder / EPISODE, **arrays)
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
        ({"time_s": lambda a: a[::-1]}, "times do not increase"),
        ({"goal": _one((3, 1), 3e6)}, "a goal lies more than 100000 m from the target"),
        ({"path": lambda a: a + 2e5}, "a path lies more than"),
        ({"true_state": _one(2, 9)}, "a link state is 9"),
        ({"action": _one(2, 9)}, "an action is 9"),
        ({"goal_kind": _one(2, "whim")}, "a kind of goal is 'whim'"),
        ({"map_frame": _one((5, 3), 1e6)}, "a map has an impossible place or size"),
        ({"map_frame": _one((5, 2), 1e-9)}, "a map has an impossible place or size"),
        ({"belief_frame": _one((-1, 2), np.nan)}, "a map has an impossible place or size"),
        ({"map_frame": lambda a: a * np.nan}, "no map in the end"),
        ({"rgb_count": _one(0, -1)}, "the lengths of rgb do not sum up"),
        ({"rgb_count": lambda a: np.full_like(a, 2**62)}, "the lengths of rgb do not sum up"),
        ({"map_count": lambda a: a[:-1]}, "map_count has shape"),
        ({"map_corner": lambda a: a + 10_000}, "lies outside of the map"),
        ({"map": lambda a: a.astype(float)}, "map is float64"),
        ({"rgb": _forged_size}, "bomb"),
        ({"rgb": lambda a: a[::-1]}, "of unknown format"),
        ({"depth": _one(slice(50, 90), 0)}, "episode.npz"),
        ({"ring_count": lambda a: a[:0], "ring": lambda a: a[:0]}, "no outline"),
        ({"arrival": _one((0, 2), np.inf)}, "arrival goes from"),
    ],
)
def test_damage_is_found_before_anything_is_drawn(recorded, tmp_path, changes, words):
    """One line that names the file, and no film that ends where the damage begins."""
    folder = _damaged(recorded, tmp_path, **changes)
    with pytest.raises(FileError) as error:
        replay(folder, tmp_path)
    assert words in str(error.value)
    assert str(folder / EPISODE) in str(error.value) and "\n" not in str(error.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == [EPISODE]
