"""The published radio data: files as they are, files that are damaged, and the rule of the labels."""

import itertools

import numpy as np
import pytest
import shapely

from wireless.formats.mmwrobotnav_measurements import (
    FileError,
    find_measurements,
    link_states,
    read_measurements,
    read_tx_positions,
)
from wireless.paths import LinkState
from wireless.tracing.tracer import Tracer, TracerConfig

LISTS = [
    f"{name}_{i}"
    for name in ("aoaAzResult", "aodAzResult", "snrResult", "peakFracResult")
    for i in range(1, 6)
]
HEADER = ",lineIndex,rxPos_1,rxPos_2,rxPosInd_1,rxPosInd_2,linkState," + ",".join(LISTS)


def row(x, y, state, first=0.0):
    """One line of a file, with angles, ratios and fractions that count up from `first`."""
    return f"0,7,{x},{y},3,4,{state}," + ",".join(str(first + i) for i in range(20))


@pytest.fixture
def data(tmp_path):
    """Folder of one building with two transmitters, the second one measured."""
    folder = tmp_path / "Attic"
    folder.mkdir()
    (folder / "Attic_tx_pos.csv").write_text(",x,y,z\n0,1.0,-2.0,1.5\n1,3.5,-4.25,1.5\n")
    lines = [HEADER, row(1.5, -2.45, 3), row(1.65, -2.45, 0, 40.0)]
    (folder / "Attic_Tx_2_beam_search.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_a_file_is_read_as_it_is_written(data):
    """Every column, by hand: positions and cells as given, angles from degrees; the second transmitter's place."""
    assert find_measurements(str(data)) == [("Attic", 2)]
    links = read_measurements(str(data), "Attic", 2)
    np.testing.assert_array_equal(links.tx_position, [3.5, -4.25, 1.5])
    np.testing.assert_array_equal(links.rx_position, [[1.5, -2.45], [1.65, -2.45]])
    np.testing.assert_array_equal(links.rx_cell, [[3, 4], [3, 4]])
    assert links.state.tolist() == [LinkState.HIGHER_ORDER, LinkState.OUTAGE]
    np.testing.assert_allclose(np.degrees(links.aoa_az[1]), [40, 41, 42, 43, 44])
    np.testing.assert_allclose(np.degrees(links.aod_az[0]), [5, 6, 7, 8, 9])
    np.testing.assert_array_equal(links.snr_db[0], [10, 11, 12, 13, 14])
    np.testing.assert_array_equal(links.peak_fraction[0], [15, 16, 17, 18, 19])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("linkState", "state", "column linkState is missing"),
        ("1.65,-2.45", "wall,-2.45", "column rxPos_1 is string, expected double"),
        ("1.65,-2.45", "nan,-2.45", "column rxPos_1 is empty in row 2"),
        (",3,4,0,", ",3,4,5,", "linkState of row 2 is 5"),
    ],
)
def test_damage_is_named_with_file_and_place(data, old, new, message):
    """A damaged file says which one, where and what was expected, rather than failing far away."""
    path = data / "Attic" / "Attic_Tx_2_beam_search.csv"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileError, match=message) as error:
        read_measurements(data, "Attic", 2)
    assert str(path) in str(error.value)


def test_what_is_missing_is_named(data, tmp_path):
    """An empty folder, an empty file, a transmitter that is not there and a file that is not there."""
    with pytest.raises(FileError, match="one folder per building"):
        find_measurements(data / "Attic")
    with pytest.raises(FileError, match="there is no transmitter 3, but 2"):
        read_measurements(data, "Attic", 3)
    with pytest.raises(FileError, match=r"Attic_Tx_1_beam_search\.csv: no such file"):
        read_measurements(data, "Attic", 1)
    empty = tmp_path / "empty.csv"
    empty.write_text(",x,y,z\n")
    with pytest.raises(FileError, match="no rows"):
        read_tx_positions(empty)


def test_a_wall_between_keeps_line_of_sight_and_raises_the_rest(extruded):
    """A closed room and a screen outside: inside LOS; round the screen first order; both, higher order."""
    screen = [[(2.0, -30.0), (2.0, 0.0)]]
    room = [(-30.0, 3.0), (30.0, 3.0), (30.0, 20.0), (-30.0, 20.0)]
    sheet = [*itertools.pairwise([*room, room[0]])]
    tracer = Tracer(
        extruded(screen + sheet),
        config=TracerConfig(max_transmissions=1, wall_thickness_m=0.1, max_reflections=0),
    )
    tx = np.array([[0.0, -2.0, 1.5]])
    rx = np.array(
        [
            [0.0, 1.0, 1.5],
            [0.0, 5.0, 1.5],
            [1.0, 5.0, 1.5],
            [4.0, -4.0, 1.5],
            [5.0, 3.5, 1.5],
            [9.0, 3.5, 1.5],
        ]
    )
    segments = shapely.linestrings([[tx[0, :2], point[:2]] for point in rx])
    walls = shapely.MultiLineString(screen + sheet)
    crossed = shapely.get_num_geometries(shapely.intersection(segments, walls)) * ~shapely.is_empty(
        shapely.intersection(segments, walls)
    )
    state = link_states(tracer.trace(tx, rx))[0]
    np.testing.assert_array_equal(crossed, [0, 1, 1, 1, 1, 2])
    expected = [
        LinkState.LOS,
        LinkState.LOS,
        LinkState.LOS,
        LinkState.LOS,
        LinkState.LOS,
        LinkState.HIGHER_ORDER,
    ]
    assert state.tolist() == expected
    opaque = Tracer(extruded(screen + sheet), config=TracerConfig(max_reflections=0))
    expected = [LinkState.LOS, LinkState.OUTAGE, LinkState.OUTAGE, LinkState.FIRST_ORDER, LinkState.OUTAGE]
    assert link_states(opaque.trace(tx, rx))[0].tolist() == [*expected, LinkState.OUTAGE]


def test_the_published_files_hold_what_is_said_of_them(shared):
    """18 buildings of 10 transmitters; of Hominy 1351 links each, 40 % of all of them line of sight (0.4034)."""
    data = shared / "data" / "mmwrobotnav"
    units = find_measurements(data)
    assert len(units) == 180
    hominy = [read_measurements(data, *unit) for unit in units if unit[0] == "Hominy"]
    assert [len(one.state) for one in hominy] == [1351] * 10
    los = np.mean([one.state == LinkState.LOS for one in hominy])
    assert los == pytest.approx(0.403405, abs=1e-6)
