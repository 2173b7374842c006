"""Several storeys on the page."""

import numpy as np
import pytest

from robosim.live.link_model import LinkModel
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from robosim.radio.scene import RadioConfig
from tests.plans import room

pytest.importorskip("viser", reason="needs viser: pip install -e '.[live]'")
STAIRS = ((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0))


@pytest.fixture(scope="module")
def plan() -> StoreysPlan:
    """Two rooms of 6 m by 4 m over each other; an opening of 2 m by 2 m in the slab of 0.25 m between them."""
    lower = StoreyPlan(plan=room(6.0, 4.0), openings=(STAIRS,), height_m=2.6, slab_m=0.25)
    return StoreysPlan(name="house", storeys=(lower, StoreyPlan(plan=room(6.0, 4.0), height_m=3.0)))


def test_places_are_on_their_storeys(plan):
    model = LinkModel(plan, RadioConfig(height_m=1.5))
    assert [model.antenna(np.ones(2), k)[2] for k in (0, 1)] == [1.5, 4.35]
    x, y, z = model.first_place(0)
    assert 0.9 < x < 3.1 and 0.9 < y < 3.1 and z == 1.5, "below the opening"
    assert model.antenna(np.array([9.0, 2.0]), 1) == pytest.approx((5.95, 2.0, 4.35))


def test_the_path_through_the_opening_is_direct(plan):
    """From below the opening to above it, the direct path is as long as the distance."""
    model = LinkModel(plan, RadioConfig(height_m=1.5))
    tx, rx = model.antenna(np.array([2.0, 2.0])), model.antenna(np.array([2.4, 2.2]), 1)
    paths = model.trace(tx[None], rx[None])
    assert paths.order[0] == 0
    assert paths.delay_s[0] * 299_792_458 == pytest.approx(np.linalg.norm(rx - tx), rel=1e-9)


def test_antennas_that_do_not_fit_are_rejected(plan):
    with pytest.raises(
        ValueError, match=r"expected antennas between floor and ceiling of each storey, 0 to 2.6 m"
    ):
        LinkModel(plan, RadioConfig(height_m=2.8))


def test_handles_change_their_storey(page, plan):
    """The list of paths and the handle follow."""
    panel = page.explore(plan)
    assert panel.settle(60)
    assert panel.storey == {"transmitter": 0, "robot": 1}
    before = panel._paths.content
    assert "dBm" in before
    panel.move("robot", np.array([2.2, 2.1]), 0)
    assert panel.settle(60)
    assert panel._paths.content != before
    assert panel._view.handles["robot"].position == pytest.approx((2.2, 2.1, 1.5))
    panel.move("transmitter", np.array([2.0, 2.0]), 1)
    assert panel.settle(60)
    assert panel.places["transmitter"] == pytest.approx([2.0, 2.0])
    assert panel._view.handles["transmitter"].position == pytest.approx((2.0, 2.0, 4.35))
    assert [one.height_m for one in panel.buildings] == [2.6, 3.0]
