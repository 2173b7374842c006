"""The robot's radio: directions in its own frame, link states of the truth, the same cached."""

from dataclasses import fields

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.radio.link import RadioLink, RadioLinkConfig
from robosim.radio.measurement import Interpreter
from tests.plans import room, two_rooms
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer, TracerConfig

TARGET = np.array([5.2, 2.1])


@pytest.fixture(scope="module")
def building():
    return make_building(two_rooms(0.8))


@pytest.fixture(scope="module")
def radio(building):
    link = RadioLink(building)
    link.place(TARGET)
    return link


def test_a_building_is_traced_with_its_own_materials(building):
    """`Tracer(building)` gives what its mesh, materials and faces give one by one, bit by bit; others are errors."""
    config = TracerConfig(floor_ceiling=True)
    tx, rx = np.array([[*TARGET, 1.5]]), np.array([[1.0, 1.0, 1.5], [4.0, 0.6, 1.5]])
    of_face = building.face_material.astype(np.int64)
    apart = {"materials": building.materials, "face_material": of_face}
    alone = Tracer(building.mesh, **apart, config=config).trace(tx, rx)
    given = Tracer(building, frequency_hz=28e9, config=config).trace(tx, rx)
    assert len(given) > 10
    for column in fields(Paths):
        np.testing.assert_array_equal(getattr(given, column.name), getattr(alone, column.name))
    as_drywall = Tracer(building.mesh, frequency_hz=28e9, config=config).trace(tx, rx)
    assert not np.array_equal(given.power, as_drywall.power)
    with pytest.raises(ValueError, match="the scene has its own"):
        Tracer(building, materials=("brick",))


@pytest.mark.parametrize("yaw", [0.0, 2.0, -2.8])
def test_in_sight_the_strongest_path_comes_from_the_target(radio, yaw):
    """Through the door, or in the same room: within a degree of the bearing in the robot's frame, at any heading."""
    for x, y in ((4.0, 0.6), (2.0, 1.2)):
        measurement = radio.measure(np.array([x, y, yaw]), np.random.default_rng(1))
        bearing = np.arctan2(TARGET[1] - y, TARGET[0] - x)
        error = (measurement.aoa_rad[0, 0] + yaw - bearing + np.pi) % (2 * np.pi) - np.pi
        assert radio.state == LinkState.LOS
        assert abs(error) < np.deg2rad(1)
        assert radio.bearing == pytest.approx(bearing, abs=1e-9)


def test_next_to_the_door_all_comes_through_it(radio):
    """No line of sight, but one bend or reflection; the strongest path comes from between the door's corners."""
    pose = np.array([2.4, 0.4, 0.0])
    measurement = radio.measure(pose, np.random.default_rng(1))
    corners = np.array([[3.0, 1.1], [3.2, 1.1], [3.0, 1.9], [3.2, 1.9]])
    bearings = np.arctan2(corners[:, 1] - pose[1], corners[:, 0] - pose[0])
    assert radio.state == LinkState.FIRST_ORDER
    assert bearings.min() - 1e-9 <= radio.bearing <= bearings.max() + 1e-9
    assert np.abs(measurement.aoa_rad[0, 0] - radio.bearing) < np.deg2rad(2)


def test_the_gain_of_a_lone_path_is_that_of_free_space():
    """Friis: (lambda / 4 pi d)^2. In a room of 20 m the direct path stands out of the others; within 1 dB."""
    link = RadioLink(make_building(room(20.0, 20.0)))
    link.place(np.array([10.0, 10.0]))
    interpreter = Interpreter(link, "true")
    rng = np.random.default_rng(0)
    for angle in np.linspace(0.1, 6.2, 7):
        place = 10 + 3 * np.array([np.cos(angle), np.sin(angle)])
        pose = np.array([*place, 0.7])
        measurement = interpreter.interpret(link.measure(pose, rng), pose)
        friis_db = 20 * np.log10(299_792_458 / 28e9 / (4 * np.pi * 3))
        assert measurement.gain_db[0] == pytest.approx(friis_db, abs=1.0)
        assert measurement.state == LinkState.LOS
        assert measurement.aod_rad[0] == pytest.approx(
            (angle + np.pi) % (2 * np.pi) - np.pi, abs=np.deg2rad(2)
        )


def test_a_wrong_heading_turns_what_is_received(radio):
    """There is no compass: a heading wrong by 0.2 rad turns all arrivals in the map by as much."""
    interpreter, truth = Interpreter(radio, "true"), np.array([4.0, 0.6, 1.0])
    believed = np.array([4.0, 0.6, 1.2])
    measured = radio.measure(truth, np.random.default_rng(2))
    right, wrong = interpreter.interpret(measured, truth), interpreter.interpret(measured, believed)
    assert wrong.aoa_rad - right.aoa_rad == pytest.approx(0.2, abs=1e-9)
    assert np.array_equal(wrong.aod_rad, right.aod_rad)


def test_cached_radio_traces_a_building_once(building):
    """One table serves every place and every robot, until the transmitter is in another place."""
    cached = RadioLink(building, RadioLinkConfig(engine="cached"))
    cached.place(TARGET)
    cached.measure(np.array([3.95, 0.63, 0.4]), np.random.default_rng(3))
    table = cached.table
    other = cached.clone()
    other.place(TARGET)
    other.measure(np.array([2.4, 0.4, 0.4]), np.random.default_rng(3))
    assert other.table is table
    other.place(TARGET + 0.5)
    assert other.table is not table


def test_one_generator_gives_one_measurement(radio):
    pose = np.array([2.4, 0.4, 0.3])
    first, second, other = (radio.measure(pose, np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert np.array_equal(first.snr_db, second.snr_db)
    assert not np.array_equal(first.snr_db, other.snr_db)


def test_bad_settings_are_errors(building):
    with pytest.raises(
        ValueError, match=r"height_m is 2\.6, expected antennas between floor and ceiling, 0 to 2\.5"
    ):
        RadioLink(building, RadioLinkConfig(height_m=2.6))
    with pytest.raises(RuntimeError, match="Call measure first"):
        _ = RadioLink(building).state
