"""Measured and traced paths: materials of a known room are found from its paths."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.constants import speed_of_light

from robosim.calibration.material_fit import EDGES, SPECULAR, Fit, residuals_db, tracer_of
from robosim.calibration.measured_paths import (
    COLUMNS,
    MatchConfig,
    MeasuredHall,
    match,
    read_measured_paths,
    trace_hall,
)
from robosim.cli import main
from robosim.plans.files import write_ros
from robosim.support.reading import FileError
from tests.plans import two_rooms

FREQUENCY_HZ = 60e9


def measured_in(plan, wall, noise_db=1.0, seed=0, range_db=35.0):
    """A table of what would be measured at 20 places of the first room, in the frames of both ends."""
    rng = np.random.default_rng(seed)
    tx = (*plan.to_map(np.array([20.0, 22.0])), 0.4)
    places = plan.to_map(rng.uniform((8, 8), (50, 50), (20, 2)))
    headings = rng.uniform(-np.pi, np.pi, 20)
    empty = np.array(
        [
            [i, *tx, *place, heading, 1.0, 0, 0]
            for i, (place, heading) in enumerate(zip(places, headings, strict=True))
        ]
    )
    hall = MeasuredHall(empty)
    paths = trace_hall(hall, tracer_of(plan, wall, FREQUENCY_HZ, EDGES), 1.5)
    loud = paths.select(paths.power_db > paths.power_db.max() - range_db)
    rows = np.column_stack([
        loud.rx,
        np.tile(tx, (len(loud), 1)),
        places[loud.rx],
        headings[loud.rx],
        loud.delay_s * speed_of_light + rng.normal(0, 0.05, len(loud)),
        loud.aod_az - tx[2] + rng.normal(0, np.radians(1), len(loud)),
        loud.aoa_az - headings[loud.rx] + rng.normal(0, np.radians(1), len(loud)),
    ])  # fmt: skip
    return MeasuredHall(rows, loud.power_db + 7.0 + rng.normal(0, noise_db, len(loud)))


@pytest.fixture(scope="module")
def plan():
    return two_rooms(0.8)


@pytest.fixture(scope="module")
def hall(plan):
    return measured_in(plan, "glass")


def test_what_was_traced_is_explained(plan, hall):
    """Nearly all paths and all power; a third of it by chance at most, as places lie near each other."""
    found = Fit(hall, FREQUENCY_HZ, MatchConfig()).explained(plan, "glass", EDGES)
    assert found.paths > 0.97 and found.power > 0.99
    assert found.by_chance < 0.2
    assert found.off_db < 1.5


def test_strengths_are_compared_if_a_bound_is_given(plan, hall):
    """Paths measured 9 dB stronger are the same by delay and directions, but not within 6 dB; the others stay."""
    stronger = replace(hall, power_db=hall.power_db + np.where(np.arange(len(hall.table)) % 7 == 3, 9.0, 0.0))
    paths = trace_hall(hall, tracer_of(plan, "glass", FREQUENCY_HZ, EDGES), 1.5)
    loose, close = (match(stronger, paths, MatchConfig(strength_db=bound)) for bound in (None, 6.0))
    is_raised = np.arange(len(hall.table)) % 7 == 3
    assert loose.explained.mean() > 0.97
    assert close.explained[~is_raised].mean() > 0.97 and close.explained[is_raised].mean() < 0.1
    assert (close.path[close.explained] >= 0).all() and close.by_chance < loose.by_chance


def test_each_kind_of_path_explains_its_own(plan):
    """Without reflections direct paths alone are explained, and they are direct; edges are marked."""
    hall = measured_in(plan, "glass", range_db=60.0)
    fit = Fit(hall, FREQUENCY_HZ, MatchConfig(range_db=80.0))
    direct = fit.match(plan, "glass", replace(SPECULAR, max_reflections=0))
    assert (direct.order[direct.explained] == 0).all()
    length = np.hypot(*(hall.table[:, 4:6] - hall.transmitter[:2]).T)
    assert (np.abs(hall.table[direct.explained, 7] - length[direct.explained]) < 0.3).all()
    all_of_them = fit.match(plan, "glass", EDGES)
    assert all_of_them.diffracted.sum() > 5
    off = residuals_db(hall, all_of_them)
    assert np.isnan(off[all_of_them.diffracted]).all() and np.isnan(off[all_of_them.order == 0]).all()


def test_the_material_is_found_again(plan, hall):
    """Of six materials the one that it was made with; at the other places it fits as well."""
    names = ("wood", "concrete", "glass", "metal", "partition", "ceiling_board")
    fit = Fit(hall, FREQUENCY_HZ, MatchConfig(), names).choose(plan, "wood")
    assert fit.wall == "glass"
    assert max(fit.after_db) < 1.6 and min(fit.before_db) > 3
    assert fit.tried["wood"] == fit.before_db[0]


def test_materials_of_colours_are_found_again(plan):
    """One wall of the room of metal, the others of wood: both, from the strengths alone."""
    of_wall = np.zeros(plan.shape, np.uint8)
    of_wall[:, : plan.shape[1] // 2][plan.occupancy[:, : plan.shape[1] // 2] == 1] = 1
    of_wall[plan.shape[0] // 2 :] = 0
    painted = replace(plan, material=of_wall, materials=("metal",))
    hall = measured_in(painted, "wood")
    start = replace(painted, materials=("concrete",))
    fit = Fit(hall, FREQUENCY_HZ, MatchConfig(), ("concrete", "wood", "metal")).choose(start, "concrete")
    assert (fit.wall, fit.colours) == ("wood", ("metal",))


def test_strengths_need_powers_and_direct_paths(plan, hall):
    """The error says what may be wrong."""
    matched = Fit(hall, FREQUENCY_HZ, MatchConfig()).match(plan, "glass")
    with pytest.raises(ValueError, match="no column power_db"):
        residuals_db(MeasuredHall(hall.table), matched)
    with pytest.raises(ValueError, match="are plan and table in one frame"):
        residuals_db(hall, replace(matched, order=np.full(len(matched.order), -1)))


def test_the_command_writes_what_it_found(plan, hall, tmp_path, capsys):
    """Table, picture and JSON; a table without powers is an error of one line."""
    write_ros(plan, tmp_path / "rooms.yaml")
    lines = [",".join((*COLUMNS, "power_db"))]
    lines += [
        ",".join(map(repr, (*row.tolist(), float(power))))
        for row, power in zip(hall.table, hall.power_db, strict=True)
    ]
    (tmp_path / "paths.csv").write_text("\n".join(lines))
    out = tmp_path / "out"
    main(f"calibrate-materials {tmp_path}/rooms.yaml {tmp_path}/paths.csv --out {out}".split())
    said = " ".join(capsys.readouterr().out.split())
    assert "Walls fit glass best" in said and "--material glass" in said
    assert {p.name for p in out.iterdir()} >= {"materials.json", "measured.png"}
    (tmp_path / "short.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines))
    with pytest.raises(SystemExit):
        main(f"calibrate-materials {tmp_path}/rooms.yaml {tmp_path}/short.csv --out {tmp_path}/b".split())
    assert "power_db" in capsys.readouterr().err


def test_read_measured_paths_rejects_ranges_shorter_than_the_straight_line(tmp_path):
    """A delay in nanoseconds instead of metres: the line, both lengths, and what to give."""
    path = tmp_path / "paths.csv"
    path.write_text("\n".join([",".join(COLUMNS), "0,0,0,0,6,8,0,10.2,0,0", "0,0,0,0,6,8,0,3.4,0,0"]))
    with pytest.raises(FileError, match=r"line 3: range_m is 3.4, but its ends are 10.0 m apart"):
        read_measured_paths(path)
    path.write_text("\n".join([",".join(COLUMNS), "0,0,0,0,6,8,0,9.7,0,0"]))  # errors of clocks are fine
    assert read_measured_paths(path).table[0, 7] == 9.7


@pytest.mark.parametrize(
    ("row", "wrong"),
    [
        ("1,0,0.5,0,6,8,0,11,0,0", "line 3: tx_y_m is another"),
        ("0,0,0,0,6,8,0.1,11,0,0", "line 3: rx_heading_rad is another"),
        ("1,0,0,0,6,8,0,11,0,-143.2", "line 3: aoa_rad is '-143.2', expected a number from -100 to 100"),
    ],
)
def test_read_measured_paths_rejects_ends_that_move_and_degrees(row, wrong, tmp_path):
    path = tmp_path / "paths.csv"
    path.write_text("\n".join([",".join(COLUMNS), "0,0,0,0,6,8,0,10.2,0,0", row]))
    with pytest.raises(FileError, match=wrong):
        read_measured_paths(path)
