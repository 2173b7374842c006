"""Beams that hit nothing, in the words of all drivers, and scans that cannot be."""

import numpy as np
import pytest

from robosim.logs.bag import read_bag
from robosim.logs.log_files import read_log
from robosim.logs.log_mapping import map_log
from robosim.support.reading import FileError

pytest.importorskip("rosbags")
from slam.poses import between
from tests.robosim.logs.made_bags import laser_scan
from tests.robosim.logs.rounds import BEARING, POSES, RANGES, TIMES, recording, write_round

MOST_M = 3.0
BEYOND = RANGES > MOST_M


def bag_of(tmp_path, ranges, range_max=MOST_M, bearing=BEARING, **more):
    """A bag of the round with other ranges."""
    rows = recording(scans=False)
    rows += [
        ("/scan", t, laser_scan(t, bearing, one, range_max=range_max, **more))
        for t, one in zip(TIMES, ranges, strict=True)
    ]
    return write_round(tmp_path / "run", rows)


@pytest.mark.parametrize(
    "nothing",
    [MOST_M, MOST_M * (1 - 1e-7), MOST_M - 1e-3, 0.99 * MOST_M, MOST_M + 1, np.inf, np.nan, 0.0, -1.0, 0.05],
)
def test_read_bag_knows_beams_that_hit_nothing(nothing, tmp_path):
    report = {}
    log = read_bag(bag_of(tmp_path, np.where(BEYOND, nothing, RANGES)), report=report)
    off = np.isfinite(log.range_m) & BEYOND
    assert not off.any()
    seen = ~BEYOND & (RANGES < 0.98 * MOST_M)
    assert np.allclose(log.range_m[seen], RANGES[seen], atol=1e-5)
    assert report["share_without_return"] == pytest.approx(BEYOND.mean(), abs=0.01)
    expected = [between(POSES[0], pose) for pose in POSES]
    assert np.allclose(map_log(log).poses[:, :2], np.array(expected)[:, :2], atol=0.05)


def test_read_bag_knows_a_limit_far_below_range_max(tmp_path, caplog):
    """Drivers state a range_max that is not that of the sensor."""
    log = read_bag(bag_of(tmp_path, np.where(BEYOND, MOST_M, RANGES), range_max=30.0))
    assert np.isinf(log.range_m[BEYOND]).all()
    assert np.isfinite(log.range_m[RANGES < 0.98 * MOST_M]).all()
    assert "% of the beams end at 3 m" in caplog.text


def test_beams_at_range_max_do_not_count_as_those_below_it(tmp_path, caplog):
    half = np.arange(len(BEARING)) % 2 == 0
    ranges = np.where(BEYOND, np.where(half, MOST_M, 0.99 * MOST_M), RANGES)
    assert np.isinf(read_bag(bag_of(tmp_path, ranges)).range_m[BEYOND]).all()
    share = (BEYOND & ~half).mean()
    assert f"{100 * share:.0f} % of the beams end at 2.97 m, below range_max" in caplog.text


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_read_bag_believes_the_end_wall_of_a_corridor(noise_m, tmp_path):
    """The wall is 18 m away from a robot that stands: beams within 5 degrees have equal ranges up to a thousandth."""
    cos, sin = np.cos(BEARING), np.abs(np.sin(BEARING))
    corridor = np.minimum(np.where(cos > 0, 18, 2) / np.maximum(np.abs(cos), 1e-9), 1 / np.maximum(sin, 1e-9))
    ranges = corridor + np.random.default_rng(0).normal(0, 1, RANGES.shape) * noise_m
    assert np.isfinite(read_bag(bag_of(tmp_path, ranges, range_max=30.0)).range_m).all()


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_read_bag_believes_a_room_that_ends_near_range_max(noise_m, tmp_path):
    """Few beams end within a thousandth of the longest range, as by chance."""
    ranges = RANGES + np.random.default_rng(0).normal(0, 1, RANGES.shape) * noise_m
    log = read_bag(bag_of(tmp_path, ranges, range_max=float(ranges.max()) + 1e-3))
    assert np.isfinite(log.range_m).all()


def test_read_bag_believes_a_standing_robot_with_few_beams(tmp_path):
    """Every scan has the same longest beam."""
    rows = recording(scans=False)
    ranges = RANGES[0, ::24]
    rows += [
        ("/scan", t, laser_scan(t, BEARING[::24], ranges, range_max=float(ranges.max()) + 1e-3))
        for t in TIMES
    ]
    assert np.isfinite(read_bag(write_round(tmp_path / "run", rows)).range_m).all()


@pytest.mark.parametrize(("angle_max", "is_noted"), [(57.3, True), (np.nan, True), (None, False)])
def test_read_bag_notes_an_end_of_beams_that_contradicts_their_steps(angle_max, is_noted, tmp_path):
    rows, report = recording(), {}
    for topic, _, scan in rows:
        if topic == "/scan" and angle_max is not None:
            scan.angle_max = angle_max
    read_bag(write_round(tmp_path / "run", rows), report=report)
    assert any("angle_max of /scan" in note for note in report["assumed"]) == is_noted


def test_read_bag_leaves_impossible_times_of_beams_out(tmp_path):
    """Scans of 0.7 s cannot follow each other after 0.2 s; --beam-seconds still gives the times."""
    report, path = {}, bag_of(tmp_path, RANGES, range_max=30.0, step_s=2e-3)
    assert read_bag(path, report=report).beam_s is None
    assert any("time_increment of /scan makes scans of 0.718 s" in note for note in report["assumed"])
    log = read_log(path, beam_seconds=(0.0, 0.1))
    assert log.beam_s is not None and log.beam_s[-1] == 0.1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"angle_increment": np.nan}, "angle_increment nan"),
        ({"angle_increment": 0.0}, "angle_increment 0 and 360 beams, expected a turn of beams at most"),
        ({"angle_increment": 1.0}, "angle_increment 1 "),
        ({"angle_increment": -np.inf}, "angle_increment -inf"),
        ({"angle_min": np.nan}, "angle_min nan"),
        ({"time_increment": np.nan}, "time_increment nan"),
        ({"time_increment": -1e-4}, "time_increment -0.0001 and 360 beams"),
        ({"time_increment": 1.0}, "time_increment 1 and 360 beams, expected 10 s for all beams at most"),
        ({"angle_increment": 1e-9}, "angle_increment 1e-09 and 360 beams"),
        ({"range_max": 0.0}, "range_max 0 "),
        ({"range_max": 2.0, "range_min": 5.0}, "range_min 5 and 360 beams, expected metres below range_max"),
        ({"range_min": np.nan}, "range_min nan"),
        ({"range_max": np.nan}, "range_max nan"),
        ({"range_max": -1.0}, "range_max -1 "),
        ({"ranges": np.full(360, -1, np.float32)}, "none of the 14400 beams of /scan hits anything"),
        ({"ranges": np.full(360, np.nan, np.float32)}, "none of the 14400 beams of /scan hits anything"),
        ({"ranges": np.zeros(0, np.float32)}, "scans of /scan have one beam or none"),
    ],
)
def test_read_bag_rejects_impossible_scans(changes, message, tmp_path):
    rows = recording()
    for topic, _, one in rows:
        for name, value in changes.items() if topic == "/scan" else ():
            setattr(one, name, value)
    with pytest.raises(FileError, match=message) as caught:
        read_bag(write_round(tmp_path / "run", rows))
    assert str(tmp_path) in str(caught.value) and "\n" not in str(caught.value)
