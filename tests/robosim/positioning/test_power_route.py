"""Beacons located from powers along a route: made ones in two rooms, damaged tables, the robot's own map."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from robosim.calibration.measured_powers import read_measured_powers
from robosim.cli import main
from robosim.logs.robot_log import RobotLog
from robosim.plans.files import write_ros
from robosim.plans.floorplan import OCCUPIED
from robosim.policies.sightlines import count_walls
from robosim.positioning.beacon_places import BeaconConfig, locate_beacon
from robosim.positioning.power_route import PowerRoute, map_route, read_power_route
from robosim.support.reading import FileError
from slam.poses import between, to_map
from tests.plans import two_rooms

BEACONS = {"hall": (0.6, 0.6), "7": (5.4, 2.4)}
HEAD = "beacon,time_s,x_m,y_m,heading_rad,power_dbm,beacon_x_m,beacon_y_m"


@pytest.fixture(scope="module")
def plan():
    return two_rooms(0.8)


def rows_in(plan, rng, n=120):
    """Readings on a route through both rooms: dipoles, 5 dB a wall, 2 dB of noise."""
    xy = np.concatenate(
        [rng.uniform((0.2, 0.2), (2.8, 2.8), (n, 2)), rng.uniform((3.4, 0.2), (6.0, 2.8), (n, 2))]
    )
    xy = xy[np.argsort(xy[:, 0])]
    rows = []
    for name, at in BEACONS.items():
        passed = count_walls(plan.occupancy == OCCUPIED, plan.to_cells(xy), plan.to_cells(np.array([at])))[
            :, 0
        ]
        level = np.hypot(*(xy - at).T)
        distance = np.hypot(level, 0.9)
        power = -48 - 20 * np.log10(distance) + 10 * np.log10((level / distance) ** 2 + 0.05)
        power += rng.normal(0, 2, len(xy)) - 5 * passed
        rows += [
            f"{name},{10 + k},{x},{y},{0.1 * k % 3},{p:.1f},{at[0]},{at[1]}"
            for k, ((x, y), p) in enumerate(zip(xy, power, strict=True))
        ]
    return rows


@pytest.fixture
def table(plan, tmp_path):
    path = tmp_path / "route.csv"
    path.write_text("\n".join([HEAD, *rows_in(plan, np.random.default_rng(1))]))
    return path


def test_walls_between_places_are_counted_once_however_thick():
    obstacle = np.zeros((10, 20), bool)
    obstacle[:, 5] = obstacle[:, 12:16] = True
    starts, ends = (
        np.array([[1.5, 5.5], [8.5, 5.5]]),
        np.array([[3.5, 1.5], [18.5, 5.5], [25.0, 9.0], [14.0, 5.0]]),
    )
    assert count_walls(obstacle, starts, ends).tolist() == [[0, 2, 2, 2], [1, 1, 1, 1]]


def test_beacons_are_located_in_a_plan(plan, table):
    powers = read_power_route(table, needs_time=False)
    assert powers.names == list(BEACONS)
    config = BeaconConfig(unresolved_m=0.0)
    for name, truth in BEACONS.items():
        found = locate_beacon(powers.readings(name), plan, 0.3, config)
        assert np.hypot(*(found.xy - truth)) < 0.5
        off = found.xy - truth
        assert off @ np.linalg.solve(found.covariance, off) < 9
        assert found.probability.sum() == pytest.approx(1)


def test_what_remains_unresolved_is_added_to_the_covariance(plan, table):
    readings = read_power_route(table, needs_time=False).readings("7")
    exact, rough = (locate_beacon(readings, plan, 0.3, BeaconConfig(unresolved_m=m)) for m in (0.0, 1.5))
    assert rough.covariance - exact.covariance == pytest.approx(1.5**2 * np.eye(2))


def test_shares_are_of_the_readings_of_a_beacon_in_the_order_of_time(table):
    lines = table.read_text().split("\n")
    table.write_text("\n".join([lines[0], *lines[:0:-1]]))
    powers = read_power_route(table, needs_time=True)
    first = powers.readings("hall", 0.25)
    assert len(first.xy) == 60
    assert first.xy[:, 0].max() < powers.readings("hall").xy[60:, 0].min() + 1e-9


def test_the_command_writes_places_with_errors(plan, table, tmp_path, capsys):
    write_ros(plan, tmp_path / "two.yaml")
    main(["locate", str(table), "--plan", str(tmp_path / "two.yaml"), "--out", str(tmp_path / "out")])
    steps = json.loads((tmp_path / "out" / "beacons.json").read_text())["beacons"]
    assert list(steps) == list(BEACONS)
    assert [step["share"] for step in steps["7"]] == [0.25, 0.5, 1.0]
    assert steps["7"][-1]["error_m"] == pytest.approx(
        np.hypot(*np.subtract(steps["7"][-1]["xy_m"], BEACONS["7"]))
    )
    assert (tmp_path / "out" / "beacons.png").stat().st_size > 10_000
    assert "Median error" in capsys.readouterr().out


def test_a_plan_in_another_frame_is_rejected(plan, table):
    readings = read_power_route(table, needs_time=False).readings("7")
    with pytest.raises(ValueError, match="in one frame"):
        locate_beacon(readings, replace(plan, origin=(40.0, 0.0, 0.0)), 0.3)


def test_without_a_plan_beacons_lie_around_the_route(table, tmp_path, capsys):
    main(["locate", str(table), "--out", str(tmp_path / "out")])
    steps = json.loads((tmp_path / "out" / "beacons.json").read_text())["beacons"]
    place, covariance = np.array(steps["hall"][-1]["xy_m"]), np.array(steps["hall"][-1]["covariance_m2"])
    off = place - BEACONS["hall"]
    assert off @ np.linalg.solve(covariance, off) < 9


def test_plan_and_log_exclude_each_other(table, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(
            ["locate", str(table), "--plan", "flat", "--map-from", str(table), "--out", str(tmp_path / "out")]
        )
    assert "both given" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("power_dbm", "rssi"), "column 'power_dbm' is missing"),
        (lambda text: text.replace("7,11,", ",11,"), "beacon is empty"),
        (lambda text: text.replace("hall,11,", "hall,soon,"), "time_s is 'soon'"),
        (lambda text: text.replace("hall,11,", "rare,11,"), "beacon 'rare' has 1 readings"),
        (lambda text: text.replace("0.6,0.6\n", "0.6,0.7\n", 1), "beacon 'hall' has more than one place"),
        (
            lambda text: text.replace(",0.5,-", ",190,-"),
            "heading_rad is '190', expected a number from -100 to 100",
        ),
        (lambda text: HEAD, "there is no reading"),
        (lambda text: text.replace("x_m", "x", 1), "column 'x_m' is missing"),
    ],
)
def test_damaged_tables_are_rejected(table, change, message):
    table.write_text(change(table.read_text()))
    with pytest.raises(FileError, match=message) as error:
        read_power_route(table, needs_time=False)
    assert str(table) in str(error.value)


def square_log(rng):
    """A robot drives around in a hall of 6 m x 4 m and scans its walls, with a pillar that breaks the symmetry."""
    times = np.arange(0, 40, 0.5)
    turn = 2 * np.pi * times / 40
    poses = np.column_stack([3 + 1.5 * np.cos(turn), 2 + 1.2 * np.sin(turn), turn + np.pi / 2])
    bearing = np.radians(np.arange(0, 360, 1.0))
    ranges = np.empty((len(times), len(bearing)))
    for k, (x, y, yaw) in enumerate(poses):
        dx, dy = np.cos(yaw + bearing), np.sin(yaw + bearing)
        with np.errstate(divide="ignore"):
            far = np.minimum(np.where(dx > 0, (6 - x) / dx, -x / dx), np.where(dy > 0, (4 - y) / dy, -y / dy))
        along = (3 - x) * dx + (2 - y) * dy
        aside = np.abs((3 - x) * dy - (2 - y) * dx)
        near = along - np.sqrt(np.maximum(0.3**2 - aside**2, 0))
        ranges[k] = np.where((aside < 0.3) & (along > 0), near, far) + rng.normal(0, 0.005, len(bearing))
    steps = [np.zeros(3), *(between(a, b) for a, b in pairwise(poses))]
    log = RobotLog(
        name="made",
        bearing_rad=bearing,
        range_m=ranges,
        displacement=np.array(steps),
        known=np.ones(len(times), bool),
        times=100 + times,
    )
    return log, poses


@pytest.mark.parametrize("has_positions", [True, False])
def test_a_map_of_the_robots_own_scans_comes_into_the_frame_of_the_readings(has_positions):
    log, poses = square_log(np.random.default_rng(2))
    frame = np.array([10.0, -4.0, 0.7])
    placed = np.column_stack([to_map(frame, poses[:, :2]), poses[:, 2] + 0.7])
    powers = PowerRoute(
        beacon=("a",) * len(poses),
        time_s=log.times,
        poses=placed if has_positions else np.full((len(poses), 3), np.nan),
        power_dbm=np.full(len(poses), -60.0),
        true_xy={},
    )
    plan, route = map_route(log, powers)
    pillar, middle = np.array([3.0, 2.0]), np.array([1.0, 2.0])
    if has_positions:
        pillar, middle = to_map(frame, pillar), to_map(frame, middle)
        assert route.poses == pytest.approx(placed)
    else:
        # The map begins at the first pose of the laser.
        start = poses[0]
        c, s = np.cos(start[2]), np.sin(start[2])
        pillar, middle = ((p - start[:2]) @ np.array([[c, -s], [s, c]]) for p in (pillar, middle))
        assert np.hypot(*route.poses[0, :2]) < 0.02
    passed = count_walls(
        plan.occupancy == OCCUPIED, plan.to_cells(route.poses[:1, :2]), plan.to_cells(np.array([middle]))
    )
    assert passed[0, 0] >= 1
    column, row = np.floor(plan.to_cells(pillar + np.array([0.0, 0.0]))).astype(int)
    assert (plan.occupancy[row - 7 : row + 8, column - 7 : column + 8] == OCCUPIED).any()


def test_clocks_that_do_not_agree_are_rejected():
    log, poses = square_log(np.random.default_rng(2))
    powers = PowerRoute(
        beacon=("a",), time_s=np.array([7.0]), poses=poses[:1], power_dbm=np.array([-60.0]), true_xy={}
    )
    with pytest.raises(ValueError, match="by one clock"):
        map_route(log, powers)


@pytest.mark.parametrize("value", ["100", "0", "-127", "127", "1", "-128", "-999", "inf"])
def test_read_power_route_rejects_powers_that_mean_not_received(table, value):
    lines = table.read_text().split("\n")
    words = lines[30].split(",")
    lines[30] = ",".join([*words[:5], value, *words[6:]])
    table.write_text("\n".join(lines))
    measured = table.with_name("measured_route.csv")
    measured.write_text("\n".join([f"{lines[0]},beacon_z_m", *(f"{line},1" for line in lines[1:])]))
    for read in (
        lambda: read_power_route(table, needs_time=False),
        lambda: read_measured_powers(measured, 1.5),
    ):
        with pytest.raises(
            FileError, match=rf"line 31: power_dbm is {value}, .* give --not-received {value}"
        ) as error:
            read()
        assert "route.csv" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("value", ["100", "0", "-127", ""])
def test_read_power_route_leaves_out_what_is_not_received(plan, tmp_path, value):
    """Two thirds of the readings replaced by a number that means nothing: the places are those without these rows."""
    rows = rows_in(plan, np.random.default_rng(1))
    lost = np.arange(len(rows)) % 3 > 0
    marked = [
        ",".join([*row.split(",")[:5], value, *row.split(",")[6:]]) if is_lost else row
        for row, is_lost in zip(rows, lost, strict=True)
    ]
    tables = {
        "marked": marked,
        "without": [row for row, is_lost in zip(rows, lost, strict=True) if not is_lost],
    }
    powers = {}
    for name, lines in tables.items():
        (tmp_path / name).write_text("\n".join([HEAD, *lines]))
        number = float(value) if value and name == "marked" else None
        powers[name] = read_power_route(tmp_path / name, needs_time=False, not_received=number)
    np.testing.assert_array_equal(powers["marked"].power_dbm, powers["without"].power_dbm)
    found = locate_beacon(powers["marked"].readings("7"), plan, 0.3)
    assert np.hypot(*(found.xy - BEACONS["7"])) < 1.0


def test_read_power_route_warns_of_a_power_far_below_the_others(plan, tmp_path, caplog):
    rows = rows_in(plan, np.random.default_rng(1))
    lines = [
        ",".join([*row.split(",")[:5], "-110", *row.split(",")[6:]]) if k % 3 else row
        for k, row in enumerate(rows)
    ]
    (tmp_path / "route.csv").write_text("\n".join([HEAD, *lines]))
    read_power_route(tmp_path / "route.csv", needs_time=False)
    assert "67 % of power_dbm are -110" in caplog.text and "--not-received -110" in caplog.text


def test_read_power_route_rejects_a_column_that_is_there_twice(table):
    text = table.read_text()
    table.write_text(text.replace(HEAD, HEAD.replace("time_s", "power_dbm"), 1))
    with pytest.raises(FileError, match="column 'power_dbm' is there twice"):
        read_power_route(table, needs_time=False)


def test_read_power_route_rejects_times_that_are_no_seconds(table):
    """Milliseconds and nanoseconds since 1970 are named, with the line."""
    for factor in (1e3, 1e9):
        lines = table.read_text().splitlines()
        row = lines[3].split(",")
        row[1] = f"{1.7e9 * factor:.0f}"
        bad = table.with_name(f"{factor:g}.csv")
        bad.write_text("\n".join([*lines[:3], ",".join(row), *lines[4:]]))
        with pytest.raises(FileError, match=r"line 4: time_s is 17\d+, expected seconds"):
            read_power_route(bad, needs_time=True)


def test_map_route_names_the_unit_of_another_clock(table):
    """Readings in milliseconds of a log in seconds: the message says so."""
    powers = read_power_route(table, needs_time=True)
    log = RobotLog(
        name="log",
        bearing_rad=np.array([-1.0, 0.0, 1.0]),
        range_m=np.ones((400, 3)),
        displacement=np.zeros((400, 3)),
        known=np.ones(400, bool),
        times=np.arange(0.0, 400.0),
    )
    with pytest.raises(
        ValueError, match=r"by one clock, in seconds: time_s of the readings is in milliseconds\."
    ):
        map_route(log, replace(powers, time_s=1e3 * powers.time_s))


def test_locate_rejects_beacons_outside_of_the_plan(plan, table, tmp_path, capsys):
    """A table in centimetres, or in another frame: one line with the beacon."""
    write_ros(plan, tmp_path / "plan" / "rooms.yaml")
    rows = table.read_text().replace(",5.4,2.4", ",540,240")
    table.write_text(rows)
    with pytest.raises(SystemExit):
        main(
            [
                "locate",
                str(table),
                "--plan",
                str(tmp_path / "plan" / "rooms.yaml"),
                "--out",
                str(tmp_path / "out"),
            ]
        )
    assert "beacon '7' is at (540, 240) m, outside of the plan" in " ".join(capsys.readouterr().err.split())
