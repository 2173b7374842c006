"""Tables of radio paths: exact where paths are images, near the tracer in other places, the same from a file."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.constants import speed_of_light

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.parts import CLASSIFIER
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.table import RadioTable
from robosim.radio.table_reader import MOST, read_paths
from robosim.support.reading import FileError
from tests.plans import two_rooms
from wireless.paths import Interaction
from wireless.tracing.tracer import Tracer

TX = np.array([1.3, 1.1, 1.5])


def turned(angle: np.ndarray) -> np.ndarray:
    """Angles in [0, pi]."""
    return np.abs((angle + np.pi) % (2 * np.pi) - np.pi)


@pytest.fixture(scope="module")
def room():
    """An empty room of 4 x 3 m."""
    return make_building(FloorPlan(occupancy=np.zeros((60, 80), np.uint8), resolution_m=0.05, name="room"))


@pytest.fixture(scope="module")
def rooms():
    return make_building(two_rooms(0.8))


def test_images_in_an_empty_room_are_exact(room):
    """Between nodes, single reflections of an empty room still come from the four mirror images of the transmitter."""
    table = RadioTable.trace(room, Tracer(room, frequency_hz=28e9), TX, 0.5)
    at = np.array([2.61, 1.87])
    paths = table.at(at)
    images = {tuple(np.round(p, 6)) for p in ([-1.3, 1.1], [6.7, 1.1], [1.3, -1.1], [1.3, 4.9])}
    single = paths.select((paths.order == 1) & (np.abs(paths.aoa_el) < 1e-6))
    assert len(single) == len(images)
    length = single.delay_s * speed_of_light
    source = at + length[:, None] * np.column_stack([np.cos(single.aoa_az), np.sin(single.aoa_az)])
    assert {tuple(p) for p in np.round(source, 6).tolist()} == images
    direct = paths.select(paths.order == 0)
    assert direct.aod_az[0] == pytest.approx(np.arctan2(*(at - TX[:2])[::-1]), abs=1e-9)


def test_departures_follow_the_mirrors(room):
    """Directions of departure are those of the tracer at the place itself, to 1e-6 rad, up to three reflections."""
    tracer = Tracer(room, frequency_hz=28e9)
    table = RadioTable.trace(room, tracer, TX, 0.5)
    at = np.array([2.61, 1.87, 1.5])
    found, true = table.at(at[:2]), tracer.trace(TX[None], at[None], workers=1)
    assert len(found) >= 5
    for i in range(len(found)):
        same = (turned(true.aoa_az - found.aoa_az[i]) < 1e-6) & (
            np.abs(true.delay_s - found.delay_s[i]) < 1e-13
        )
        assert turned(true.aod_az[same] - found.aod_az[i]).min() < 1e-6
        assert np.abs(true.aod_el[same] - found.aod_el[i]).min() < 1e-6


def test_between_nodes_a_table_is_near_the_tracer(rooms):
    """Over two rooms: link states in 95 %, strongest directions within 1 degree in 90 %, powers within 1 dB in 75 %."""
    tracer = Tracer(rooms, frequency_hz=28e9)
    table = RadioTable.trace(rooms, tracer, TX)
    places = reach(rooms, 0.18)
    rng = np.random.default_rng(0)
    centres = places.plan.centres(places.parts > 0)
    at = centres[rng.integers(len(centres), size=300)] + rng.uniform(-0.02, 0.02, (300, 2))
    true = tracer.trace(TX[None], np.column_stack([at, np.full(300, 1.5)]), workers=1)
    states, errors, gaps = [], [], []
    for i, place in enumerate(at):
        found, own = table.at(place), true.between(0, i)
        states.append(found.link_state()[0, 0] == true.link_state()[0, i])
        if len(found) and len(own):
            errors.append(turned(found.aoa_az[0] - own.aoa_az[0]))
            gaps.append(abs(found.power_db[0] - own.power_db[0]))
    assert np.mean(states) >= 0.95
    assert np.mean(np.degrees(errors) < 1) >= 0.9
    assert np.mean(np.array(gaps) < 1) >= 0.75


def test_no_node_behind_a_wall_counts(rooms):
    """Two places on either side of a wall of 0.1 m, 0.3 m apart: all nodes of each are in its own room."""
    table = RadioTable.trace(rooms, Tracer(rooms, frequency_hz=28e9), TX)
    wall = rooms.plan.to_map(np.argwhere(~rooms.plan.free)[:, ::-1] + 0.5)
    middle = np.median(wall[:, 0])
    for side in (-1, 1):
        node, weight = table.nodes_around(np.array([middle + 0.12 * side, 0.4]))
        x = table.paths.rx_position[node[node >= 0], 0]
        assert (np.sign(x - middle) == side).all()
        assert weight.sum() == pytest.approx(1.0)


def test_a_file_gives_the_same_table(rooms, tmp_path):
    table = RadioTable.trace(rooms, Tracer(rooms, frequency_hz=28e9), TX, 0.5)
    table.write(tmp_path / "table.parquet")
    again = RadioTable.read(tmp_path / "table.parquet", rooms)
    at = np.array([2.2, 0.7])
    first, second = table.at(at), again.at(at)
    assert again.step_m == 0.5
    assert np.array_equal(first.power, second.power)
    assert np.array_equal(first.aoa_az, second.aoa_az)
    first.write_parquet(tmp_path / "paths.parquet")
    with pytest.raises(FileError, match="step_m"):
        RadioTable.read(tmp_path / "paths.parquet", rooms)


def test_tables_are_stored_in_a_folder(rooms, tmp_path, monkeypatch):
    """A second process reads what the first one traced; another transmitter has another file."""
    pose, config = np.array([2.4, 0.4, 0.3]), RadioLinkConfig(engine="table", tables=tmp_path / "tables")
    measured = []
    for _ in range(2):
        link = RadioLink(rooms, config)
        link.place(TX[:2])
        measured.append(link.measure(pose, np.random.default_rng(1)))
        monkeypatch.setattr(RadioTable, "trace", None)  # not needed any more
    assert np.array_equal(measured[0].snr_db, measured[1].snr_db)
    assert len(list((tmp_path / "tables").iterdir())) == 1
    monkeypatch.undo()
    monkeypatch.setattr("robosim.radio.link._code_digest", lambda: "of a changed tracer")
    RadioLink(rooms, config).tables.of(TX)
    assert len(list((tmp_path / "tables").iterdir())) == 2


def test_reading_a_table_is_near_measuring(rooms):
    """Over 60 places, estimates by rule compared with those of the full receiver."""
    live = RadioLink(rooms)
    live.place(TX[:2])
    centres = reach(rooms, 0.18).plan.centres(reach(rooms, 0.18).parts > 0)
    rng = np.random.default_rng(4)
    counts, turns, gaps = [], [], []
    for _ in range(60):
        pose = np.array([*centres[rng.integers(len(centres))], rng.uniform(-np.pi, np.pi)])
        measured = live.measure(pose, rng)
        read = read_paths(live.paths, float(pose[2]), live.sounder, rng)
        counts.append(int(measured.count[0]) == int(read.count[0]))
        if measured.count[0] and read.count[0]:
            turns.append(np.degrees(turned(measured.aoa_rad[0, 0] - read.aoa_rad[0, 0])))
            gaps.append(abs(measured.snr_db[0, 0] - read.snr_db[0, 0]))
    assert np.mean(counts) >= 0.75
    assert np.mean(np.array(turns) < 2) >= 0.85
    assert np.mean(np.array(gaps) < 3) >= 0.8


def test_two_paths_that_cannot_be_separated_are_one(room):
    """Two equal paths from one direction read as one of twice the power, 3 dB more; from two directions as two."""
    link = RadioLink(room, RadioLinkConfig(engine="table"))
    link.place(TX[:2])
    link.measure(np.array([2.6, 1.9, 0.0]), np.random.default_rng(0))
    one = link.paths.select(link.paths.order == 0)
    both = one.select(np.array([0, 0]))
    alone, merged = (read_paths(paths, 0.0, link.sounder, None) for paths in (one, both))
    assert merged.count[0] == alone.count[0] == 1
    assert merged.snr_db[0, 0] - alone.snr_db[0, 0] == pytest.approx(10 * np.log10(2), abs=1e-9)
    apart = both.select(np.array([0, 1]))
    apart.aoa_az[1] += 0.5
    assert read_paths(apart, 0.0, link.sounder, None).count[0] == 2
    assert merged.snr_db.shape == (1, MOST)


def test_what_is_believed_of_a_link_is_what_its_nodes_say(rooms):
    """Probabilities sum to 1, and in sight of the transmitter line of sight is the likeliest."""
    link = RadioLink(rooms, RadioLinkConfig(engine="table"))
    link.place(TX[:2])
    link.measure(np.array([1.9, 0.7, 0.3]), np.random.default_rng(0))
    assert link.paths.interaction[0, 0] == Interaction.NONE
    probability = link.table_probability(CLASSIFIER.make("generated"))
    assert probability.sum() == pytest.approx(1.0)
    assert probability.argmax() == 1


@pytest.mark.parametrize("step", ["nan", "-1.0", "1e-9", "1e9", "x"])
def test_the_step_of_a_file_is_checked(rooms, tmp_path, step):
    """A step of 1e-9 m needed an index of 1e18 places."""
    table = RadioTable.trace(rooms, Tracer(rooms, frequency_hz=28e9), TX, 0.5).paths.to_table()
    table = table.replace_schema_metadata({**(table.schema.metadata or {}), "step_m": step})
    pq.write_table(table, tmp_path / "table.parquet")
    with pytest.raises(FileError, match=r"table\.parquet"):
        RadioTable.read(tmp_path / "table.parquet", rooms)


def test_a_table_of_another_building_is_rejected(rooms, tmp_path):
    table = RadioTable.trace(rooms, Tracer(rooms, frequency_hz=28e9), TX, 0.5)
    far = replace(table.paths, rx_position=table.paths.rx_position + 1000.0)
    replace(table, paths=far).write(tmp_path / "table.parquet")
    with pytest.raises(FileError, match="outside of the plan"):
        RadioTable.read(tmp_path / "table.parquet", rooms)


def test_at_a_node_paths_through_walls_have_their_delay(rooms):
    """Delay within walls is neither lost nor counted twice: at a node all delays are those of the tracer."""
    tracer = Tracer(rooms, frequency_hz=5.2e9)
    table = RadioTable.trace(rooms, tracer, TX, 0.5)
    passing = (table.paths.interaction == Interaction.TRANSMISSION).any(axis=1)
    node = table.paths.rx[passing][0]
    traced = table.paths.select(table.paths.rx == node)
    paths = table.at(table.paths.rx_position[node, :2])
    assert (paths.interaction == Interaction.TRANSMISSION).any()
    by_delay = np.sort(traced.delay_s)
    assert np.abs(by_delay[:, None] - paths.delay_s).min(axis=0).max() < 1e-15
