"""Agreement with published labels, counted in a building whose labels are known."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh

from robosim.training.label_links import TRACER, published_mesh, published_paths
from tests.benchmarks import labels
from tests.benchmarks.harness import Options, ratio_interval
from tests.benchmarks.label_rules import DEFAULT_RULE, RULES, Rule, add_halves, paths_by_rule
from tests.benchmarks.labels import received_azimuth
from tests.benchmarks.results import Results
from wireless.formats.mmwrobotnav_measurements import link_states, read_measurements
from wireless.paths import LinkState
from wireless.tracing.tracer import Tracer

LISTS = ("aoaAzResult", "aodAzResult", "snrResult", "peakFracResult")
HEADER = ",lineIndex,rxPos_1,rxPos_2,rxPosInd_1,rxPosInd_2,linkState," + ",".join(
    f"{name}_{i}" for name in LISTS for i in range(1, 6)
)
TX = (0.5, -0.5)


def receivers(free):
    """Row, column, x and y of receivers as published: for the middle cells of blocks, a cell lower."""
    rows, columns = np.nonzero(free[1::3, 1::3])
    return [
        (r + 1, c + 1, 0.05 * (3 * c + 1), -0.05 * (3 * r + 2)) for r, c in zip(rows, columns, strict=True)
    ]


@pytest.fixture
def published(tmp_path):
    """A room and an arm round its corner, labelled by GEOS.

    Line of sight if the segment is in the room, first order if a convex corner sees both ends or the wall in the
    north or west reflects. The rest, round the corner, is of higher order.
    """
    grid = np.zeros((45, 60), int)
    grid[3:42, 3:24] = 1
    grid[3:15, 24:57] = 1
    outline = [(3, 3), (56, 3), (56, 14), (24, 14), (23, 15), (23, 41), (3, 41)]
    room = shapely.Polygon(np.array(outline) * (0.05, -0.05)).buffer(1e-9)
    edges = [(1.2, -0.7), (1.15, -0.75)]

    def sees(a, b):
        return room.covers(shapely.LineString([a, b]))

    plans, data = tmp_path / "plans", tmp_path / "data" / "Ell"
    plans.mkdir()
    data.mkdir(parents=True)
    np.savetxt(plans / "Ell.glb_topdownmap.out", grid, fmt="%d", delimiter=",")
    (data / "Ell_tx_pos.csv").write_text(f",x,y,z\n0,{TX[0]},{TX[1]},1.5\n1,{TX[0]},{-1.8},1.5\n")
    for number in (1, 2):
        lines = [HEADER]
        for r, c, x, y in receivers(grid):
            ty = TX[1] if number == 1 else -1.8
            azimuth = np.degrees(np.arctan2(ty - y, TX[0] - x))
            state = 1 if sees((TX[0], ty), (x, y)) else 3
            # Mirrored at the walls in the north, y = -0.15, and west, x = 0.15, the receiver is seen through these.
            up, down = -0.15 - ty, -0.15 - y
            north = TX[0] + (x - TX[0]) * up / (up + down), -0.15
            west = 0.15, ty + (y - ty) * (TX[0] - 0.15) / (TX[0] + x - 0.3)
            if state == 3 and any(
                sees((TX[0], ty), via) and sees(via, (x, y)) for via in [*edges, north, west]
            ):
                state = 2
            lines.append(f"0,0,{x:.2f},{y:.2f},{r},{c},{state}," + ",".join([f"{azimuth}"] * 5 + ["0"] * 15))
        (data / f"Ell_Tx_{number}_beam_search.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def test_links_are_counted_as_labelled_by_geos(published):
    """All links in the clear agree, and after five labels are spoilt exactly five disagree.

    Their estimates point at the transmitter, so that all links in sight are within 5 degrees. A wrong frame, cell or
    shift of the receivers breaks dozens. A second run measures only the transmitter whose data changed.
    """
    options = Options(out=published / "out")
    results = labels.main(published / "data", published / "plans", options=options)
    clear = results.find("agreement", "all", "in the clear")
    assert clear["value"] == 100 and clear["cases"] > 200
    assert results.find("agreement", "all", "line of sight: direction within 5°")["value"] == 100
    assert len(list((options.out / "units").glob("*"))) == 2
    spoilt = labels.compare(published / "data", published / "plans" / "Ell.glb_topdownmap.out", "Ell", 1)
    middle = np.flatnonzero(spoilt["clear"])[:5]
    spoilt["published"] = spoilt["published"].copy()
    spoilt["published"][middle] = LinkState.OUTAGE
    again = Results()
    labels.summarise("all", [spoilt], again)
    counted = again.find("agreement", "all", "in the clear")
    assert counted["value"] == pytest.approx(100 * (1 - 5 / counted["cases"]), rel=1e-5)


def test_the_default_rule_selects_the_paths_that_label_links_traces(published):
    """Another rule gives the states that a tracer with its interactions gives."""
    plan = published / "plans" / "Ell.glb_topdownmap.out"
    measured = read_measurements(published / "data", "Ell", 1)
    rx = np.column_stack([measured.rx_position, np.full(len(measured.rx_position), measured.tx_position[2])])
    tracer = labels.prepared(plan)[1]
    paths, states = paths_by_rule(measured.tx_position, rx, measured.rx_cell, tracer)
    expected = published_paths(measured.tx_position, rx, measured.rx_cell, tracer)
    assert (link_states(paths) == link_states(expected)).all() and len(paths) == len(expected)
    assert (states[RULES.index(DEFAULT_RULE)] == link_states(expected)[0]).all()
    few = replace(
        TRACER,
        max_reflections=1,
        diffraction_reflections=0,
        diffraction_side_reflections=0,
        max_transmissions=0,
    )
    building = labels.prepared(plan)[0]
    narrow = Tracer(published_mesh(building.plan, building.height_m), config=few)
    expected = published_paths(measured.tx_position, rx, measured.rx_cell, narrow)
    assert (states[RULES.index(Rule(1, 0, 0, True))] == link_states(expected)[0]).all()


def test_add_halves_judges_buildings_by_the_rule_of_the_other_half():
    """The first half prefers one rule, the second another: both are judged where they were not chosen."""
    results = Results()
    same = {name: np.zeros(len(RULES), int) for name in "abcd"}
    for name, (first, second) in {"a": (90, 50), "b": (60, 80), "c": (95, 50), "d": (60, 80)}.items():
        same[name][:2] = first, second
    add_halves(results, same, dict.fromkeys("abcd", 100))
    cross = results.find("rules", "each building by the rule of the other half", "other half")
    assert cross["value"] == pytest.approx((60 + 60 + 50 + 50) / 4) and cross["cases"] == 400
    assert cross["spread"] == [50, 60]


def test_a_receiver_off_its_grid_is_named_with_its_transmitter(published):
    path = published / "data" / "Ell" / "Ell_Tx_1_beam_search.csv"
    lines = path.read_text().splitlines()
    words = lines[8].split(",")
    words[2] = f"{float(words[2]) + 0.01:.2f}"
    lines[8] = ",".join(words)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"Ell 1: a receiver is 0.01 m off"):
        labels.compare(published / "data", published / "plans" / "Ell.glb_topdownmap.out", "Ell", 1)


def test_two_weak_paths_in_one_beam_beat_a_strong_one():
    """Power 2 + 2 at 3 degrees apart against 3 in another direction: the strongest path is not the best beam."""
    wall = [(-9.0, 9.0, 0.0), (9.0, 9.0, 0.0), (9.0, 9.0, 3.0), (-9.0, 9.0, 3.0)]
    mesh = trimesh.Trimesh(wall, [(0, 1, 2), (0, 2, 3)], process=False)
    one = Tracer(mesh).trace(np.array([[0.0, 0.0, 1.0]]), np.array([[2.0, 0.0, 1.0]]))
    azimuth = np.radians([90.0, 10.0, 13.0])
    paths = replace(
        one.select(np.zeros(len(one), bool)),
        **{
            name: np.repeat(getattr(one, name)[:1], 3, axis=0)
            for name in (
                "tx",
                "rx",
                "gain",
                "aoa_el",
                "aod_az",
                "aod_el",
                "order",
                "interaction",
                "primitive",
                "point",
            )
        },
        delay_s=np.full(3, 1e-8),
        power=np.array([3.0, 2.0, 2.0]),
        aoa_az=azimuth,
    )
    assert np.degrees(received_azimuth(paths)) == pytest.approx([11.5], abs=1.0)
    apart = replace(paths, delay_s=np.array([1e-8, 1e-8, 3e-8]))
    assert np.degrees(received_azimuth(apart)) == pytest.approx([90.0], abs=1.0)


def test_ratio_interval_is_as_wide_as_homes_differ():
    """Homes of 10 and 1000 links that all agree alike leave no doubt; two that contradict each other leave all."""
    assert ratio_interval(np.array([5, 500, 50]), np.array([10, 1000, 100])) == (0.5, (0.5, 0.5))
    assert ratio_interval(np.array([0, 100]), np.array([100, 100])) == (0.5, (0.0, 1.0))
    assert ratio_interval(np.array([3]), np.array([4])) == (0.75, None)
    rng = np.random.default_rng(1)
    _, (low, high) = ratio_interval(rng.binomial(1000, 0.7, 400), np.full(400, 1000))
    assert high - low == pytest.approx(2 * 1.96 * (0.7 * 0.3 / 4e5) ** 0.5, rel=0.2)
