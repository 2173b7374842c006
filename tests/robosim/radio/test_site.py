"""Where radio is, behind one interface: a plan, one storey of several, and a scene."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.multi_storey import make_storeys
from robosim.plans.floorplan import UNKNOWN, FloorPlan
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from robosim.radio.receivers import receiver_grid
from robosim.radio.scene import RadioConfig, radio_site
from tests.plans import room, two_rooms
from wireless import CellState, Channel
from wireless.tracing.mitsuba_scene import read_mitsuba
from wireless.tracing.tracer import Tracer

HOUSE = StoreysPlan(
    name="house",
    storeys=(
        StoreyPlan(plan=room(), openings=(((1.0, 1.0), (3.0, 1.0), (3.0, 2.0), (1.0, 2.0)),)),
        StoreyPlan(plan=room()),
    ),
)
GROUND = """<scene version="2.1.0">
<bsdf type="itu-radio-material" id="m"><string name="type" value="concrete"/></bsdf>
<shape type="rectangle" id="ground"><transform name="to_world"><scale value="50"/></transform><ref id="m"/></shape>
</scene>"""
CONFIG = RadioConfig()


@pytest.fixture
def place(request, tmp_path):
    """A plan, the upper storey of a house, or a file, and the surfaces that the tracer gets."""
    file = tmp_path / "ground.xml"
    file.write_text(GROUND)
    return {
        "plan": lambda: (two_rooms(0.8), make_building(two_rooms(0.8))),
        "storey": lambda: (HOUSE.storey(1), make_storeys(HOUSE)),
        "scene": lambda: (file, read_mitsuba(file)),
    }[request.param]()


@pytest.mark.parametrize(
    ("place", "name", "height_m", "has_grid", "nearest"),
    [
        ("plan", "two rooms", 1.5, True, (0.01, 1.0, 1.5)),
        ("storey", "house_storey_1", 4.3, True, (0.01, 1.0, 4.3)),
        ("scene", "ground", 1.5, False, (-1.0, 1.0, 4.3)),
    ],
    indirect=["place"],
)
def test_radio_site_is_what_its_place_is(place, name, height_m, has_grid, nearest):
    """Paths are those of a tracer of the surfaces; places outside snap to free space where there are walls."""
    site, surfaces = radio_site(place[0], CONFIG), place[1]
    assert (site.name, site.height_m) == (name, pytest.approx(height_m))
    tx, rx = site.places(((1.0, 1.0),), "tx"), site.places(((2.0, 1.2), (2.5, 2.0, height_m - 0.4)), "rx")
    assert tx.tolist() == [[1.0, 1.0, site.height_m]]
    tracing = {} if has_grid else {"config": site.tracer.config}
    expected = Tracer(surfaces, frequency_hz=28e9, **tracing).trace(tx, rx)
    paths = site.trace(tx, rx)
    assert len(paths) > 1 and np.array_equal(paths.gain, expected.gain)
    assert site.nearest_free(tx[0]) == pytest.approx(tx[0])
    assert site.nearest_free(tx[0, :2]) == pytest.approx(tx[0, :2])
    assert site.nearest_free(np.array([-1.0, 1.0, nearest[2]])) == pytest.approx(nearest)
    if has_grid:
        level = receiver_grid(site.building, 0.5, 1.5).position
        assert np.array_equal(site.grid(0.5).position, level + np.array([0, 0, site.floor_m]))
        with pytest.raises(
            ValueError, match=rf"outside of the free space of {name}; the nearest .* \(0.01, 1.00\)"
        ):
            site.places(((-1.0, 1.0),), "tx")
    else:
        grid = site.grid(10, tx=tx)
        assert grid.shape == (10, 10) and grid.position[[0, -1]].tolist() == [[-45, -45, 1.5], [45, 45, 1.5]]


@pytest.mark.parametrize("place", ["plan", "storey", "scene"], indirect=True)
def test_coverage_of_a_site_is_that_of_its_links(place):
    """Gains and states are those of the same tracer to the same receivers, and the sum of the powers of the paths."""
    site = radio_site(place[0], CONFIG)
    tx, step_m = site.places(((1.0, 1.0), (2.0, 2.0)), "tx"), 10.0 if site.name == "ground" else 0.5
    grid, coverage = site.grid(step_m, tx=tx), site.coverage(tx, step_m)
    paths = site.trace(tx, grid.position)
    at = (slice(None), *grid.cell.T)
    assert np.array_equal(coverage.gain[at], Channel.from_paths(paths).power(coherent=False)[..., 0, 0])
    power = np.zeros(coverage.gain[at].shape)
    np.add.at(power, (paths.tx, paths.rx), paths.power)
    assert coverage.gain[at] == pytest.approx(power, rel=1e-12)
    assert np.array_equal(coverage.category[at], paths.link_category())
    assert np.array_equal(coverage.position[tuple(grid.cell.T)], grid.position)
    assert np.array_equal(coverage.state[at] == CellState.REACHED, paths.count() > 0)


def test_coverage_of_a_plan_separates_walls_and_the_outside():
    """Wall cells are bodies, unknown ones outside; bounds are for scenes."""
    plan = two_rooms(0.8)
    occupancy = plan.occupancy.copy()
    occupancy[:10] = UNKNOWN  # the lowest 0.5 m
    site = radio_site(FloorPlan(occupancy=occupancy, resolution_m=0.05, name="p"), CONFIG)
    tx = site.places(((1.0, 1.5),), "tx")
    state, x = site.coverage(tx, 0.25).state[0], (np.arange(0.125, 6.2, 0.25))
    assert (state[:2] == CellState.OUTSIDE).all() and state[2:].min() == CellState.IN_BODY
    wall = np.argmin(abs(x - 3.05))
    assert (state[3, wall - 2], state[3, wall]) == (CellState.REACHED, CellState.IN_BODY)
    with pytest.raises(ValueError, match="bounds are given for p, but they are for scenes"):
        site.grid(0.25, bounds_m=(0.5, 1.0, 2.0, 2.0))


def test_radio_site_knows_heights_and_names_of_storeys():
    """Between floor and ceiling of any storey, whichever the site is of."""
    site = radio_site(HOUSE.storey(0), CONFIG)
    with pytest.raises(ValueError, match=r"is 2.6 m, expected 0 to 2.5, 2.8 to 5.3 m"):
        site.places(((1.0, 1.0, 2.6),), "tx")
    with pytest.raises(ValueError, match="free space of house_storey_1"):
        site.places(((-1.0, 1.0, 4.0),), "tx")
