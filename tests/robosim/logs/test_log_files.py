"""Logs of robots: all formats give the same trajectory, and damaged files are errors with their name."""

import gzip
import json
import math
from itertools import pairwise

import numpy as np
import pytest
from evo.tools import file_interface

from robosim.cli import main
from robosim.logs.carmen import CarmenReader
from robosim.logs.log_files import read_log
from robosim.logs.log_mapping import LogConfig, make_log_plan, map_log
from robosim.logs.robot_log import BagTopics
from robosim.logs.trajectory_scores import align_trajectory, compare_trajectories, count_filled_cells
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, OCCUPIED
from robosim.support.reading import FileError
from slam.poses import between, compose
from tests.robot_logs import BEAMS, ROUTE, Drive
from tests.slam.beams import along

DRIVE = Drive()


@pytest.mark.parametrize("packed", [False, True], ids=["plain", "packed"])
def test_a_raw_log_has_odometry_and_no_reference(tmp_path, packed):
    path = tmp_path / "room.log.gz"
    path.write_bytes(gzip.compress(DRIVE.raw().encode()) if packed else DRIVE.raw().encode())
    log = read_log(path)
    assert log.name == "room"
    assert log.reference is None
    assert log.range_m.shape == (len(ROUTE), BEAMS)
    found = DRIVE.odometry
    steps = [between(a, b) for a, b in pairwise(found)]
    np.testing.assert_allclose(log.displacement[1:], steps, atol=1e-5)
    np.testing.assert_allclose(log.bearing_rad, np.radians(np.arange(-90, 91)), atol=1e-9)


def test_read_log_warns_of_options_of_bags(tmp_path, caplog):
    path = tmp_path / "room.log"
    path.write_text(DRIVE.raw())
    read_log(path, topics=BagTopics(frame="base_link"))
    assert "room.log: is no bag, and does not use --frame base_link." in caplog.text
    assert "--slice-m" not in caplog.text


def test_a_corrected_log_has_both(tmp_path):
    path = tmp_path / "room.log"
    path.write_text(DRIVE.corrected())
    log = read_log(path)
    assert log.reference is not None
    np.testing.assert_allclose(log.reference, ROUTE, atol=1e-5)
    steps = [between(a, b) for a, b in pairwise(DRIVE.odometry)]
    np.testing.assert_allclose(log.displacement[1:], steps, atol=1e-4)
    assert log.known[1:].all()


def test_the_newer_lines_are_read(tmp_path):
    """A laser that sits ahead of the robot is no reference; its own steps are read."""
    path = tmp_path / "room.clf"
    path.write_text(DRIVE.newer())
    log = read_log(path)
    assert log.reference is None
    lasers = [compose(pose, np.array([0.1, 0.0, 0.0])) for pose in DRIVE.odometry]
    np.testing.assert_allclose(log.displacement[1:], [between(a, b) for a, b in pairwise(lasers)], atol=1e-5)


def test_a_trajectory_with_scans_is_a_log_too(tmp_path):
    log = read_log(*DRIVE.write_tum(tmp_path))
    steps = [between(a, b) for a, b in pairwise(DRIVE.odometry)]
    np.testing.assert_allclose(log.displacement[1:], steps, atol=1e-6)
    with pytest.raises(ValueError, match="give the scans"):
        read_log(tmp_path / "odometry.tum")


@pytest.mark.parametrize(
    ("content", "wrong"),
    [
        (b"", "the file is empty"),
        (b"ODOM 0 0 0 0 0 0 0 h 0", "0 scans in it"),
        (b"PK\x03\x04 an archive", "`robosim replay` plays an episode"),
        (b"\x1f\x8b broken", "not readable as a robot's log"),
        (b"FLASER 4 1 2 3 4 0 0 0 0 0\n" * 2, "line 1 breaks off"),
        (b"FLASER many 1 2\n", "line 1 has"),
        (b"FLASER 3 1 2 3 0 0 0 0 0 nan 0 h 0\n" * 2, "line 1 breaks off"),
        (
            b"FLASER 3 1 2 3 0 0 0 0 0 0 0 h 0\nFLASER 4 1 2 3 4 0 0 0 0 0 0 0 h 0\n",
            "another number of beams",
        ),
    ],
)
def test_a_damaged_log_is_an_error_with_its_name(tmp_path, content, wrong):
    path = tmp_path / "damaged.log"
    path.write_bytes(content)
    with pytest.raises(FileError, match=wrong) as raised:
        read_log(path)
    assert "damaged.log" in str(raised.value)


def _scans(poses, times, laser=None):
    rows = []
    for k, (pose, time) in enumerate(zip(poses, times, strict=True)):
        first = pose if laser is None else laser[k]
        rows.append(
            " ".join(["FLASER 3 1 2 3", *(f"{v:g}" for v in [*first, *pose]), f"{time:g} h {time:g}"])
        )
    return "\n".join(rows) + "\n"


def test_a_line_that_was_cut_off_at_the_end_is_left_out(tmp_path):
    """A recording that was interrupted; the same line inside of the log is damage."""
    path = tmp_path / "cut.log"
    whole = _scans([(0, 0, 0), (1, 0, 0)], [1, 2])
    path.write_text(whole + "FLASER 3 1 2")
    assert read_log(path).range_m.shape == (2, 3)
    path.write_text(whole + "FLASER 3 1 2\n" + whole)
    with pytest.raises(FileError, match="line 3 breaks off"):
        read_log(path)


def test_odometry_that_was_reset_is_unknown(tmp_path):
    """From 40 m back to 0 between two scans, in the scans' own lines and in ODOM lines next to corrected poses."""
    path = tmp_path / "reset.log"
    path.write_text(_scans([(39, 0, 0), (40, 0, 0), (0, 0, 0), (1, 0, 0)], [1, 2, 3, 4]))
    log = read_log(path)
    assert log.known.tolist() == [True, True, False, True]
    np.testing.assert_allclose(log.displacement[:, 0], [0, 1, 0, 1])
    lines = []
    for k, scan in enumerate(_scans([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [1, 2, 3]).splitlines()):
        end = 90 if k == 1 else k + 1
        lines += [scan, f"ODOM {k} 0 0 0 0 0 0 h 0", f"ODOM {end} 0 0 0 0 0 0 h 0"]
    path.write_text("\n".join(lines) + "\n")
    log = read_log(path)
    assert log.known.tolist() == [False, True, False]
    np.testing.assert_allclose(log.displacement[:, 0], [0, 1, 0])


def test_a_few_times_out_of_order_leave_the_others(tmp_path):
    """One that repeats and one that goes back; where most do so, scans are counted instead."""
    path = tmp_path / "times.log"
    poses = [(k, 0, 0) for k in range(30)]
    times = np.arange(100.0, 130.0)
    times[10], times[20] = times[9], times[18]
    path.write_text(_scans(poses, times))
    found = read_log(path).times
    assert (np.diff(found) > 0).all()
    np.testing.assert_allclose(np.delete(found, [10, 20]), np.delete(times, [10, 20]))
    np.testing.assert_allclose(found[[10, 20]], found[[9, 19]], atol=1e-5)
    path.write_text(_scans(poses, np.full(30, 7.0)))
    np.testing.assert_array_equal(read_log(path).times, np.arange(30))


def test_a_pose_that_is_constant_is_no_reference(tmp_path):
    path = tmp_path / "zeros.log"
    poses = [(k, 0, 0) for k in range(5)]
    path.write_text(_scans(poses, range(5), laser=[(0, 0, 0)] * 5))
    log = read_log(path)
    assert log.reference is None
    np.testing.assert_allclose(log.displacement[1:, 0], 1.0)


def test_the_trajectory_and_the_map_are_found(tmp_path):
    """A room from drifting odometry: 3 cm and 0.5 degrees between places, walls where they stand, floor where it is."""
    path = tmp_path / "room.log"
    path.write_text(DRIVE.corrected())
    log = read_log(path)
    mapped = map_log(log)
    assert log.reference is not None
    scores, odometry = (
        compare_trajectories(mapped.poses, log.reference),
        compare_trajectories(log.odometry(), log.reference),
    )
    assert scores["rpe_m"] < 0.03 < odometry["rpe_m"]
    assert scores["rpe_deg"] < 0.5 < odometry["rpe_deg"]
    assert count_filled_cells(log, mapped.poses) < count_filled_cells(log, log.odometry())
    plan = make_log_plan(log, align_trajectory(mapped.poses, log.reference), 0.05, 25.0)

    def cell(x: float, y: float) -> int:
        ix, iy = ((np.array([x, y]) - plan.origin[:2]) / plan.resolution_m).astype(int)
        around = plan.occupancy[iy - 1 : iy + 2, ix - 1 : ix + 2]
        return OCCUPIED if (around == OCCUPIED).any() else FREE if (around == FREE).all() else -1

    assert cell(8.0, 3.0) == cell(4.0, 0.0) == cell(3.0, 2.7) == OCCUPIED
    assert cell(5.0, 3.0) == cell(1.5, 4.0) == FREE


def test_errors_are_those_of_evo(tmp_path):
    """Absolute and relative errors of the drift, as evo counts them."""
    from evo.core import metrics, sync

    path = tmp_path / "room.log"
    path.write_text(DRIVE.corrected())
    main(["slam", str(path), "--out", str(tmp_path / "out")])
    truth, drift = (
        file_interface.read_tum_trajectory_file(tmp_path / "out" / f"{name}.tum")
        for name in ("reference", "odometry")
    )
    truth, drift = sync.associate_trajectories(truth, drift)
    drift.align(truth)
    judge = metrics.APE(metrics.PoseRelation.translation_part)
    judge.process_data((truth, drift))
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    found = result["trajectories"]["odometry"]
    assert found["ate_m"] == pytest.approx(judge.get_statistic(metrics.StatisticsType.rmse), rel=1e-4)
    assert result["trajectories"]["graph"]["ate_m"] < 0.03
    for name in ("map.png", "trajectories.png", "trajectory.tum", "matching.tum", "map.pgm"):
        assert (tmp_path / "out" / name).stat().st_size > 500
    assert (read_plan(tmp_path / "out" / "map.yaml").occupancy == FREE).sum() * 0.05**2 > 30


def test_a_real_building_comes_out_as_published(shared):
    """The first 150 scans of a public log: its published poses within 6 cm and 0.6 degrees over 1 to 5 m."""
    from dataclasses import replace

    log = read_log(shared / "data" / "robot-logs" / "freiburg-101-corrected.log.gz")
    assert log.reference is not None
    first = slice(0, 150)
    part = replace(
        log,
        range_m=log.range_m[first],
        displacement=log.displacement[first],
        known=log.known[first],
        times=log.times[first],
        reference=log.reference[first],
    )
    assert part.reference is not None
    scores = compare_trajectories(map_log(part).poses, part.reference)
    assert scores["rpe_m"] < 0.06
    assert scores["rpe_deg"] < 0.6


@pytest.mark.parametrize(
    ("name", "rpe_m", "rpe_deg"),
    # The last has no odometry between most of its scans, which lie up to 3 m apart: a corridor comes out too short.
    [("fhw", 0.1, 0.9), ("csail", 0.08, 1.2), ("orebro", 0.3, 1.2)],
)
def test_whole_buildings_come_out_as_published(shared, name, rpe_m, rpe_deg):
    """Published poses between places 1 to 5 m apart, and walls no thicker than with published poses."""
    log = read_log(shared / "data" / "robot-logs" / f"{name}-corrected.log.gz")
    assert log.reference is not None
    poses = map_log(log).poses
    scores = compare_trajectories(poses, log.reference)
    assert scores["rpe_m"] < rpe_m
    assert scores["rpe_deg"] < rpe_deg
    assert count_filled_cells(log, poses) < 1.02 * count_filled_cells(log, log.reference)


def test_scans_of_other_bearings_are_named_by_their_line(tmp_path):
    """Bearings that differ from line to line are not those of the first: in a table of scans and in a log."""
    odometry, scans = DRIVE.write_tum(tmp_path)
    lines = scans.read_text().splitlines()
    words = lines[7].split()
    words[1] = str(float(words[1]) + 0.02)
    scans.write_text("\n".join([*lines[:7], " ".join(words), *lines[8:]]))
    with pytest.raises(FileError, match=r"scans\.txt.*line 8 has bearings"):
        read_log(odometry, scans)
    path = tmp_path / "room.clf"
    rows = DRIVE.newer().splitlines()
    words = rows[4].split()
    words[4 - 2] = "-1.5"
    path.write_text("\n".join([*rows[:4], " ".join(words), *rows[5:]]) + "\n")
    with pytest.raises(FileError, match=r"room\.clf.*line 5 has bearings"):
        read_log(path)


@pytest.mark.parametrize(
    ("row", "column", "word", "said"),
    [
        (4, 0, "nan", "line 5 has the time nan"),
        (4, 0, "3.0", "line 5 has the time 3 s, after 3 s"),
        (2, 0, "9", "line 4 has the time"),
        (5, 2, "nan", "line 6 has bearings"),
        (6, 9, "far", "line 7: .*far"),
    ],
)
def test_tables_of_scans_name_the_line(tmp_path, row, column, word, said):
    odometry, scans = DRIVE.write_tum(tmp_path)
    lines = [line.split() for line in scans.read_text().splitlines()]
    lines[row][column] = word
    scans.write_text("\n".join(map(" ".join, lines)))
    with pytest.raises(FileError, match=said):
        read_log(odometry, scans)


def test_beams_of_tables_hit_nothing_or_are_not_measured(tmp_path):
    odometry, scans = DRIVE.write_tum(tmp_path)
    lines = [line.split() for line in scans.read_text().splitlines()]
    for words in lines:
        words[3:5] = "nan", "inf"
    scans.write_text("\n".join(map(" ".join, lines)))
    log = read_log(odometry, scans)
    assert np.isnan(log.range_m[:, 0]).all() and (log.range_m[:, 1] == np.inf).all()


@pytest.mark.parametrize("is_table", [False, True], ids=["carmen", "table"])
def test_longest_ranges_that_many_beams_share_hit_nothing(is_table, tmp_path, caplog):
    """A SICK laser with a limit of 8 m gives one of several codes at it; 0 is not measured."""
    drive, rng = Drive(), np.random.default_rng(0)
    fan = drive.fan
    reach = np.array([fan(pose) for pose in drive.route])
    drive.fan = lambda pose: [
        0.0 if k == 0 else float(rng.choice([8.183, 8.187, 8.191])) if value > 4 else value
        for k, value in enumerate(fan(pose))
    ]
    path = tmp_path / "room.log"
    path.write_text(drive.raw())
    log = read_log(*drive.write_tum(tmp_path)) if is_table else read_log(path)
    assert np.isnan(log.range_m[:, 0]).all()
    assert (np.isinf(log.range_m[:, 1:]) == (reach[:, 1:] > 4)).all()
    assert "% of the beams end at 8.191 m: they hit nothing" in caplog.text


@pytest.mark.parametrize(("count", "is_stated"), [(180, True), (361, True), (401, False), (541, False)])
def test_read_carmen_warns_of_beams_without_angles(count, is_stated, tmp_path, caplog):
    """Lasers of FLASER lines see half a turn; other numbers of beams are those of lasers that see more or less."""
    path = tmp_path / "room.log"
    path.write_text(Drive(count=count).raw())
    read_log(path)
    assert (f"those of {count} beams count as over 180 degrees" not in caplog.text) == is_stated
    path.write_text("# FLASER n ranges\n" + Drive(count=count).newer())
    caplog.clear()
    read_log(path)
    assert "FLASER" not in caplog.text


def test_bearings_make_one_turn_at_most(tmp_path):
    """Those of a whole turn that ends at 0 begin at 0; those of more than a turn are an error."""
    odometry, scans = DRIVE.write_tum(tmp_path)
    lines = [line.split() for line in scans.read_text().splitlines()]
    turned = [[time, "-6.2", "0", *ranges] for time, _, _, *ranges in lines]
    scans.write_text("\n".join(map(" ".join, turned)))
    assert read_log(odometry, scans).bearing_rad[[0, -1]] == pytest.approx([2 * np.pi - 6.2, 2 * np.pi])
    longer = [[time, "-3.2", "3.2", *ranges] for time, _, _, *ranges in lines]
    scans.write_text("\n".join(map(" ".join, longer)))
    with pytest.raises(
        FileError, match=r"line 1 has bearings from -3.2 to 3.2, expected .* of one turn at most"
    ):
        read_log(odometry, scans)


@pytest.mark.parametrize("step", ["0", "-0.01"])
def test_beams_that_do_not_rise_are_errors(tmp_path, step):
    path = tmp_path / "room.clf"
    words = DRIVE.newer().splitlines()[0].split()
    words[4] = step
    path.write_text(" ".join(words) + "\n" + " ".join(words) + "\n")
    with pytest.raises(FileError, match=r"line 1 has .* rad between beams"):
        read_log(path)


@pytest.mark.parametrize("name", ["drive.dat", "drive", "drive.log", "drive.txt"])
def test_what_a_log_is_shows_its_content(tmp_path, name):
    trajectory, scans = DRIVE.write_tum(tmp_path)
    named = tmp_path / "other" / name
    named.parent.mkdir()
    named.write_bytes(trajectory.read_bytes())
    assert read_log(named, scans).times == pytest.approx(read_log(trajectory, scans).times)
    with pytest.raises(ValueError, match="is a trajectory"):
        read_log(named)


@pytest.mark.parametrize("head", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
@pytest.mark.parametrize("name", ["drive.bag", "drive.mcap", "drive.tum", "drive.log"])
def test_damaged_bags_are_named_as_bags(tmp_path, head, name):
    path = tmp_path / name
    path.write_bytes(head + bytes(100))
    scans = DRIVE.write_tum(tmp_path)[1] if name.endswith("tum") else None
    with pytest.raises(FileError) as error:
        read_log(path, scans)
    assert f"{path}: " in str(error.value) and " bag" in str(error.value)


@pytest.mark.parametrize("places", [(0, 1, 3000, 3001), (0, 1000, 2000, 3000), tuple(range(0, 12_000, 40))])
def test_maps_of_kilometres_are_errors_before_they_are_made(tmp_path, places):
    """Poses that are too far apart for scans to have anything in common, or for the map: at once."""
    odometry, scans = tmp_path / "far.tum", tmp_path / "scans.txt"
    odometry.write_text("\n".join(f"{k} {x} {x} 0 0 0 0 1" for k, x in enumerate(places)))
    scans.write_text("\n".join(f"{k} -1 1 3 3 3 3" for k in range(len(places))))
    log = read_log(odometry, scans)
    with pytest.raises(ValueError, match=r"far\.tum: .*(nothing in common|more than 36000000)"):
        map_log(log, LogConfig(range_m=30))


def test_map_log_rejects_scans_that_hit_nothing(tmp_path):
    drive = DRIVE.raw().splitlines()
    lines = [
        " ".join([*words[:2], *["81.91"] * int(words[1]), *words[2 + int(words[1]) :]])
        if words[0] == "FLASER"
        else " ".join(words)
        for words in map(str.split, drive)
    ]
    path = tmp_path / "empty.log"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match="none of its beams hits anything within --range-m, 25 m"):
        map_log(read_log(path))


def test_loops_of_few_beams_are_less_certain():
    """Submaps of scans at 6 degrees bend: fits of them are five times as uncertain as at 1 degree."""
    dense, sparse = (LogConfig().tracker(True, math.radians(step_deg)) for step_deg in (1.0, 6.0))
    assert sparse.submap_error == 5 * dense.submap_error
    # A single fit still places one submap well enough for scans to be matched to both.
    assert sparse.submap_error * 2 * sparse.match.sigma_m < sparse.together_m


def test_a_map_of_few_beams_has_its_walls(tmp_path):
    """With 25 beams of 7.5 degrees, 80 % of the room's outline is occupied to 10 cm, and its floor is free."""
    route = along([(1, 1), (5, 1), (5, 5), (1, 5), (1, 1.5)], step_m=0.2)
    path = tmp_path / "few.log"
    path.write_text(Drive(route, 25).corrected())
    log = read_log(path)
    plan = make_log_plan(log, np.array(route), 0.05, 25.0)
    side = np.arange(0.2, 5.8, 0.1)
    outline = np.concatenate([np.column_stack([np.full(len(side), x), side]) for x in (0.0, 8.0)])
    outline = outline[(outline[:, 0] < 4) | (outline[:, 1] > 1.5)]
    column, row = plan.to_cells(outline).astype(int).T
    near = [
        plan.occupancy[max(y - 2, 0) : y + 3, max(x - 2, 0) : x + 3] == OCCUPIED
        for x, y in zip(column, row, strict=True)
    ]
    assert np.mean([cells.any() for cells in near]) > 0.8
    column, row = plan.to_cells(np.array(route)[:, :2]).astype(int).T
    assert (plan.occupancy[row, column] == FREE).all()


def test_read_log_takes_a_reader_of_its_caller(tmp_path):
    """An object with the methods of `LogReader`, for a format that no shipped reader knows."""
    path = tmp_path / "drive.own"
    path.write_text("carmen, but shifted")
    (tmp_path / "room.clf").write_text(DRIVE.newer())

    class Own(CarmenReader):
        def read(self, path, scans, topics):
            return super().read(path.with_name("room.clf"), scans, topics)

    assert read_log(path, reader=Own()).name == "room"
    with pytest.raises(ValueError, match="Did you mean 'carmen'"):
        read_log(path, reader="carmn")
