"""Odometry at its own times, and scans that are corrected for the motion between their beams."""

import logging
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from robosim.cli import main
from robosim.logs.beam_times import OdometryTrack, corrected_beams, relative
from robosim.logs.log_files import read_log
from robosim.logs.log_mapping import map_log
from robosim.logs.robot_log import RobotLog
from robosim.logs.trajectory_scores import align_trajectory, compare_trajectories, ends_of_beams
from slam.poses import between, compose, to_map, wrap
from tests.robosim.logs.skewed_logs import (
    BEAMS,
    BEARING,
    TURN_S,
    swept_ranges,
    true_poses,
    write_skewed,
    write_skewed_carmen,
)
from tests.robot_logs import ROOM
from tests.slam.beams import rectangle

#: A room without anything in it [m].
WALLS = rectangle(0.0, 0.0, 8.0, 6.0)


def _from_wall_m(points, walls=WALLS) -> np.ndarray:
    """Distance of points to the nearest wall [m]."""
    segments = np.array(walls, float)
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    share = ((points[:, None] - start) * along).sum(axis=-1) / (along**2).sum(axis=-1)
    foot = start + np.clip(share, 0, 1)[..., None] * along
    return np.hypot(*(points[:, None] - foot).T).min(axis=0)


def _errors(log: RobotLog, truth: np.ndarray) -> tuple[float, float, float]:
    """Of the mapped log: root mean square of the place [mm] and heading [deg], 90th percentile off the walls [mm]."""
    found = map_log(log)
    placed = align_trajectory(found.poses, truth)
    off = placed - truth
    wall = _from_wall_m(ends_of_beams(found.log, placed), ROOM)
    place_m, turn_rad = np.hypot(*off[:, :2].T), wrap(off[:, 2])
    return (
        1e3 * float(np.sqrt((place_m**2).mean())),
        math.degrees(float(np.sqrt((turn_rad**2).mean()))),
        1e3 * float(np.percentile(wall, 90)),
    )


@pytest.mark.parametrize(("first_s", "last_s"), [(0.0, 0.1), (0.1, 0.0), (-0.5, 0.0), (-0.05, 0.05)])
def test_a_scan_of_a_turning_robot_comes_out_as_the_room(first_s, last_s):
    """Beams from exact poses end on the walls to 1e-9 m, as from one pose; uncorrected they lie 0.2 m off at least."""
    times = np.linspace(first_s, last_s, BEAMS)
    start, poses = true_poses(np.zeros(1))[0], true_poses(times)
    reach = swept_ranges(WALLS, poses, BEARING)
    bearing, ranges = corrected_beams(BEARING, reach, relative(start, poses))
    some = np.isfinite(ranges)
    ends = ranges[some, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])[some]
    assert (np.diff(bearing) >= 0).all() and np.abs(bearing).max() <= math.pi
    assert some.sum() > 0.7 * BEAMS
    assert _from_wall_m(to_map(start, ends)).max() < 1e-9
    raw = reach[:, None] * np.column_stack([np.cos(BEARING), np.sin(BEARING)])
    assert _from_wall_m(to_map(start, raw)).max() > 0.2
    # From the one pose, each beam reaches the same distance as one measured from there.
    again = swept_ranges(WALLS, np.tile(start, (some.sum(), 1)), bearing[some])
    np.testing.assert_allclose(ranges[some], again, atol=1e-9)


def test_odometry_at_50_hz_corrects_a_scan_to_the_error_of_its_interpolation():
    """Chords of arcs: a turn that accelerates by 2.2 rad/s2 errs by 2.2 / 8 x 0.02^2 rad, 1 mm at 8 m."""
    track = OdometryTrack(
        times=np.arange(-1, 1, 0.02) + 0.007, poses=true_poses(np.arange(-1, 1, 0.02) + 0.007)
    )
    late = np.linspace(0, TURN_S, BEAMS)
    poses = track.at(np.append(0.0, late))
    motion = relative(poses[0], poses[1:])
    bearing, ranges = corrected_beams(BEARING, swept_ranges(WALLS, true_poses(late), BEARING), motion)
    some = np.isfinite(ranges)
    ends = ranges[some, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])[some]
    assert _from_wall_m(to_map(true_poses(np.zeros(1))[0], ends)).max() < 2e-3


def test_what_a_turn_sees_again_and_what_hits_nothing():
    """A robot that turns with the lidar sees its first directions twice; a beam without a hit turns only."""
    motion = np.column_stack([np.zeros((BEAMS, 2)), np.linspace(0, 0.2, BEAMS)])
    ranges = np.full(BEAMS, 2.0)
    ranges[10], ranges[20] = np.inf, np.nan
    bearing, found = corrected_beams(BEARING, ranges, motion)
    again = int((BEARING + motion[:, 2] >= math.pi).sum())
    assert again > 5
    assert np.isnan(found).sum() == again + 1 and np.isnan(found[-again - 1 :]).all()
    (nothing,) = np.flatnonzero(np.isinf(found))
    assert bearing[nothing] == pytest.approx(BEARING[10] + motion[10, 2])


def test_poses_between_readings_turn_by_the_smaller_angle():
    """The middle in place and across the angle of pi; in a gap and at a restart the motion is unknown."""
    times = np.array([0.0, 1, 2, 3, 12, 13])
    yaw = np.array([0.0, 3.0, -3.0, -3.0, -3.0, -3.0])
    track = OdometryTrack(times=times, poses=np.column_stack([times, 2 * times, yaw]))
    found = track.at(np.array([0.25, 1.5]))
    np.testing.assert_allclose(found[:, :2], [[0.25, 0.5], [1.5, 3.0]])
    np.testing.assert_allclose(wrap(found[:, 2]), [0.75, -math.pi], atol=1e-12)
    start, end = np.array([0.5, 2.5, 2.5, 4.0, 12.0, 3.0]), np.array([2.5, 3.0, 3.1, 5.0, 12.5, 12.0])
    assert track.is_known(start, end).tolist() == [True, True, False, False, True, False]


def test_scans_of_a_turning_lidar_are_corrected_by_odometry(tmp_path):
    """A second scan a tenth of a second, up to 1.6 rad/s: 1 mm and 0.1 degrees, 23 mm and 2.8 without correction."""
    odometry, scans, truth = write_skewed(tmp_path, 120)
    place_mm, turn_deg, wall_mm = _errors(read_log(odometry, scans, beam_seconds=(0.0, TURN_S)), truth)
    assert place_mm < 2 and turn_deg < 0.1 and wall_mm < 10
    place_mm, turn_deg, wall_mm = _errors(read_log(odometry, scans), truth)
    assert place_mm > 10 and turn_deg > 1 and wall_mm > 50


def test_without_odometry_the_scans_themselves_give_the_motion(tmp_path):
    """Odometry that never changes: 10 mm and 0.5 degrees."""
    path, truth = write_skewed_carmen(tmp_path, 120, still=True)
    log = read_log(path, beam_seconds=(TURN_S / 4, 3 * TURN_S / 4))
    assert not log.known[1:].any()
    place_mm, turn_deg, _ = _errors(log, truth)
    raw_mm, raw_deg, _ = _errors(replace(log, beam_s=None), truth)
    assert place_mm < 0.5 * raw_mm and turn_deg < 0.3 * raw_deg


def test_odometry_lines_of_a_log_correct_its_scans(tmp_path):
    """ODOM lines at 50 Hz between scans at 10 Hz, of a base whose laser lies aside: their poses are the laser's."""
    path, truth = write_skewed_carmen(tmp_path, 80)
    log = read_log(path, beam_seconds=(TURN_S / 4, 3 * TURN_S / 4))
    assert log.track is not None and len(log.track.times) > 4 * len(log.times)
    # Readings and scans lie on one trajectory: that of the laser.
    steps = np.array([between(a, b) for a, b in zip(log.track.poses[:-1], log.track.poses[1:], strict=True)])
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < 0.03
    place_mm, turn_deg, _ = _errors(log, truth)
    assert place_mm < 3 and turn_deg < 0.2


def _edit(path, change) -> None:
    rows = np.loadtxt(path)
    np.savetxt(path, change(rows), fmt="%.9f")


def _without(first: int, last: int):
    return lambda rows: np.delete(rows, slice(first, last), axis=0)


def _restarted(rows):
    later = rows[90:]
    poses = np.column_stack([later[:, 1:3], 2 * np.arctan2(later[:, 6], later[:, 7])])
    x, y, yaw = relative(poses[0], poses).T
    later[:, 1], later[:, 2], later[:, 6], later[:, 7] = x, y, np.sin(yaw / 2), np.cos(yaw / 2)
    return rows


def _jumped(rows):
    """A filter that corrects its pose at once, to a place where it did not begin."""
    poses = np.column_stack([rows[90:, 1:3], 2 * np.arctan2(rows[90:, 6], rows[90:, 7])])
    x, y, yaw = np.array([compose(np.array([2.0, 1.0, 0.5]), pose) for pose in poses]).T
    rows[90:, 1], rows[90:, 2], rows[90:, 6], rows[90:, 7] = x, y, np.sin(yaw / 2), np.cos(yaw / 2)
    return rows


def test_restarts_are_no_motion_of_a_fast_robot():
    """Steps of 1 m at 20 m/s are motion, and so are those of odometry in millimetres, which its reader rejects."""
    for step_m in (1.0, 10.0):
        poses = np.column_stack([step_m * np.arange(50.0), np.zeros(50), np.zeros(50)])
        assert not OdometryTrack(times=0.05 * np.arange(50), poses=poses).restarts().any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_jumped, r"odometry\.tum: at 101\.787.* odometry restarts or jumps \(1 such"),
        (_without(60, 110), r"odometry\.tum: at 102\.187.* the reading 1\.02 s before is the last \(1 such"),
        (_restarted, r"odometry\.tum: at 101\.787.* odometry restarts"),
    ],
)
def test_gaps_and_restarts_are_warnings_with_their_time(tmp_path, caplog, change, said):
    """The motion is unknown there, and the map comes out nevertheless; of a reference, errors are wrong there."""
    odometry, scans, truth = write_skewed(tmp_path, 60)
    whole = odometry.with_name("whole.tum")
    whole.write_bytes(odometry.read_bytes())
    _edit(odometry, change)
    with caplog.at_level(logging.WARNING, "robosim"):
        read_log(whole, scans, reference=odometry)
    assert re.search(said + ".* errors against it are wrong", caplog.text)
    caplog.clear()
    with caplog.at_level(logging.WARNING, "robosim"):
        log = read_log(odometry, scans, beam_seconds=(0.0, TURN_S))
    (record,) = [r.getMessage() for r in caplog.records if "odometry.tum" in r.getMessage()]
    assert re.search(said, record)
    assert 0 < (~log.known).sum() < 15
    assert compare_trajectories(map_log(log).poses, truth)["ate_m"] < 0.02


def test_times_of_beams_that_cannot_be_are_errors(tmp_path):
    odometry, scans, _ = write_skewed(tmp_path, 10)
    with pytest.raises(
        ValueError, match=r"odometry\.tum: --beam-seconds 0 0\.5 makes scans of 0\.5 s.*after 0\.1 s"
    ):
        read_log(odometry, scans, beam_seconds=(0.0, 0.5))
    for wrong in (math.nan, math.inf, 100.0):
        with pytest.raises(
            ValueError, match=r"odometry\.tum: --beam-seconds 0 .*expected times of 10 s at most"
        ):
            read_log(odometry, scans, beam_seconds=(0.0, wrong))
    path = tmp_path / "times.log"
    path.write_text("FLASER 3 1 2 3 0 0 0 1 0 0 7 h 7\nFLASER 3 1 2 3 1 0 0 2 0 0 7 h 7\n")
    with pytest.raises(ValueError, match=r"times\.log: its scans have no times.*Leave --beam-seconds away"):
        read_log(path, beam_seconds=(0.0, 0.1))


def test_the_command_corrects_scans(tmp_path):
    odometry, scans, _ = write_skewed(tmp_path, 30)
    out = tmp_path / "out"
    main(
        ["slam", str(odometry), "--scans", str(scans), "--beam-seconds", "0", "0.1", "--out", str(out)],
    )
    assert (out / "map.pgm").stat().st_size > 500
