"""`labels`: what it counts, against a building whose labels are known, and that it goes on."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from rich.console import Console

from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.published import label_links
from robosim.published.label_links import received_azimuth
from robosim.published.label_walls import published_walls
from tests.benchmarks import labels
from wireless.estimation.public import PublicReceiver
from wireless.formats.mmwrobotnav_measurements import link_states, read_measurements
from wireless.paths import LinkState
from wireless.sounding.sounder import Rays
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


def bench(published, out, workers=1):
    """Run on the made-up data; result and what was shown."""
    screen = io.StringIO()
    console = Console(file=screen, width=200)
    result = labels.run(
        published / "data", published / "plans", workers=workers, out=published / out, console=console
    )
    return result, screen.getvalue()


def test_links_are_counted_as_labelled_by_geos(published):
    """All links in the clear agree, and after five labels are spoilt exactly five disagree.

    Their estimates point at the transmitter, so that all LOS links are within 5 degrees; first-order ones need
    not be. A wrong frame, cell or shift of the receivers breaks dozens.
    """
    result, shown = bench(published, "out")
    total = result["total"]
    n = total["clear_links"]
    assert total["clear"] == 1.0
    assert total["aoa_LOS"]["strongest"] == 1.0
    assert total["links"] > n > 200
    assert total["confusion_clear"][2, 2] > 5
    path = published / "data" / "Ell" / "Ell_Tx_1_beam_search.csv"
    lines = path.read_text().splitlines()
    middle = [i for i, line in enumerate(lines) if line.startswith("0,0,0.8") and ",1," in line][3:8]
    for i in middle:
        words = lines[i].split(",")
        lines[i] = ",".join([*words[:6], "0", *words[7:]])
    path.write_text("\n".join(lines) + "\n")
    spoilt, shown = bench(published, "out")
    assert spoilt["total"]["clear"] == pytest.approx(1 - 5 / n, abs=1e-12)
    assert spoilt["total"]["confusion_clear"][0, 1] == 5
    last = shown.strip().splitlines()[-1]
    assert f"{100 * (1 - 5 / n):.2f} %" in last and f"of the {n} " in last


def test_a_receiver_off_its_grid_is_named_with_its_transmitter(published):
    path = published / "data" / "Ell" / "Ell_Tx_1_beam_search.csv"
    lines = path.read_text().splitlines()
    words = lines[8].split(",")
    words[2] = f"{float(words[2]) + 0.01:.2f}"
    lines[8] = ",".join(words)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"Ell 1: a receiver is 0.01 m off"):
        bench(published, "out")


def test_a_run_goes_on_where_it_was_killed(published, monkeypatch, in_process):
    """With one unit kept only the other is traced; the result is the one of a run without a break.

    Two workers give the same file as one, byte for byte.
    """
    bench(published, "whole", workers=2)
    traced = []
    work = label_links.compare
    monkeypatch.setattr(
        labels, "compare", lambda measured, plan: traced.append(measured.number) or work(measured, plan)
    )
    bench(published, "broken")
    assert traced == [1, 2]
    next((published / "broken" / "units").glob("Ell-2-*")).unlink()
    bench(published, "broken")
    assert traced == [1, 2, 2]
    texts = [(published / out / "labels.json").read_bytes() for out in ("whole", "broken")]
    assert texts[0] == texts[1]
    assert json.loads(texts[0])["total"]["clear"] == 1.0
    assert (published / "whole" / "Ell.png").stat().st_size > 10_000
    assert not list((published / "whole").rglob("*partial*"))


def test_two_weak_paths_in_one_beam_beat_a_strong_one():
    """Power 2 + 2 at 3 degrees apart against 3 elsewhere: the strongest path is not what a beam hears loudest."""
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


def test_the_slanted_piece_below_a_tip_of_one_cell_is_open_and_no_other():
    """A tip of one cell in a wall that recedes by one: the piece below it is left out, upside down none is.

    Mirrored the piece is open only below tips that are two cells wide. By hand in steps: straight ones, and the slants
    to and from the tip, one of them open. A rule blind to the tip's length opened rooms that are shut.
    """
    slant = 0.05 * np.sqrt(2)

    def length(free):  # the north first
        ends = published_walls(plan_of(free[::-1]))
        pieces = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        assert pieces.min() == pytest.approx(0.05)
        return pieces.sum()

    one, two = tip(reach=1), tip(reach=2)
    assert length(one) == pytest.approx(0.05 * 24 + slant)
    for closed in (one[::-1], one[:, ::-1]):
        assert length(closed) == pytest.approx(0.05 * 24 + 2 * slant)
    for closed in (two, two[::-1], two[:, ::-1]):
        assert length(closed) == pytest.approx(0.05 * 26 + 2 * slant)
    wide = tip(reach=1, width=2)
    for opened in (wide, wide[:, ::-1]):
        assert length(opened) == pytest.approx(0.05 * 24 + slant)
    wider, longer = tip(reach=1, width=3), tip(reach=2, width=2)
    for closed in (wider, wider[:, ::-1]):
        assert length(closed) == pytest.approx(0.05 * 24 + 2 * slant)
    for closed in (longer, longer[:, ::-1]):
        assert length(closed) == pytest.approx(0.05 * 26 + 2 * slant)


def tip(reach, width=1):
    """Free cells, the north first, with a tip to the west where the wall recedes by one cell."""
    free = np.zeros((14, 14), bool)
    free[3:7, 6:12] = True
    free[7 : 7 + width, 5 - reach : 12] = True
    free[7 + width : 11, 5:12] = True
    return free


def plan_of(free):
    """Floor plan with walls through cell centres."""
    occupancy = np.where(free, FREE, OCCUPIED).astype(np.uint8)
    return FloorPlan(
        occupancy=occupancy, resolution_m=0.05, origin=(0.0, 0.0, 0.0), name="Tip", wall_line="cell_centre"
    )


def test_real_labels_agree(shared, tmp_path):
    """The smallest published building, one transmitter: 97 % of all links and 98 % of those in the clear."""
    data, plans = tmp_path / "data" / "Hominy", shared / "maps" / "gibson" / "train"
    data.mkdir(parents=True)
    for name in ("Hominy_tx_pos.csv", "Hominy_Tx_8_beam_search.csv"):
        (data / name).write_bytes((shared / "data" / "mmwrobotnav" / "Hominy" / name).read_bytes())
    console = Console(file=io.StringIO())
    total = labels.run(data.parent, plans, workers=1, out=tmp_path, console=console)["total"]
    assert total["links"] == 1351
    assert total["all"] > 0.965
    assert total["clear"] > 0.975
    assert total["aoa_LOS"]["strongest"] > 0.94


def test_paths_are_as_strong_as_published(shared):
    """A published transmitter traced and received again: medians of the strongest SNR agree within 3 dB in each state.

    Measured 0.2, 1.8 and 0.9 dB, link by link where states agree. With walls that reflect as half-spaces and pass
    what a layer of 0.1 m does, links of higher order are 10 dB too weak.
    """
    measured = read_measurements(shared / "data" / "mmwrobotnav", "Hominy", 1)
    some = np.arange(0, len(measured.state), 3)
    place = measured.rx_position[some]
    rx = np.column_stack([place, np.full(len(place), measured.tx_position[2])])
    plan = shared / "maps" / "gibson" / "train" / "Hominy.glb_topdownmap.out"
    tracer = label_links.prepared(plan)[1]
    paths = label_links.published_paths(measured.tx_position, rx, measured.rx_cell[some], tracer)
    state = link_states(paths)[0]
    snr_db = PublicReceiver().receive(Rays.from_paths(paths), np.random.default_rng(0))[2].max(axis=1)
    for one in (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER):
        both = (state == one) & (measured.state[some] == one)
        assert both.sum() > 40
        off = snr_db[both] - measured.snr_db[some][both].max(axis=1)
        assert abs(np.median(off)) < 3, one
