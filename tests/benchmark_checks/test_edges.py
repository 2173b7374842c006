"""Laws of diffraction: the one that made the data is found."""

import numpy as np
import pytest
from scipy.constants import speed_of_light

from robosim.training.label_links import GAP_M, PLASTERBOARD_M
from tests.benchmarks import edges
from tests.benchmarks.edge_cases import STEP_DB, Cases, offset_db
from tests.benchmarks.edge_laws import Wedges, laws, published_faces
from wireless.em.fields import Wedge, diffract
from wireless.em.materials import wall_row
from wireless.paths import Interaction

K = 2 * np.pi * edges.FREQUENCY_HZ / speed_of_light


def wedges(count, seed=0):
    rng = np.random.default_rng(seed)
    n = rng.choice([1.25, 1.5], count)
    return Wedges(
        n=n,
        phi_source=rng.uniform(0.05, 0.95, count) * n * np.pi,
        phi=rng.uniform(0.05, 0.95, count) * n * np.pi,
        before_m=rng.uniform(1, 6, count),
        after_m=rng.uniform(1, 6, count),
    )


def faces():
    return published_faces(edges.FREQUENCY_HZ, "drywall", PLASTERBOARD_M, GAP_M)


@pytest.mark.parametrize("name", ["nearer face (default)", "bisector"])
def test_hypotheses_that_the_tracer_has_are_its_own(name):
    """The same power to 1e-7 as what the tracer's loop makes of a vertical field at a partition's edge."""
    some = wedges(60)
    power = laws(some, faces(), K)[name]
    wall = np.tile(wall_row("partition", edges.FREQUENCY_HZ), (2, 1))
    frame = np.eye(3)[[2, 0, 1]]
    for i in range(60):
        arrival = -np.array([np.cos(some.phi_source[i]), np.sin(some.phi_source[i]), 0])
        out = np.array([np.cos(some.phi[i]), np.sin(some.phi[i]), 0])
        field = np.zeros((2, 3), complex)
        field[:, 2] = 1
        ends = some.before_m[i], some.after_m[i]
        edge = Wedge(frame, some.n[i], wall, name == "bisector")
        diffract(field, arrival, out, edge, K, ends, np.zeros((4, 3)))
        assert abs(field[0, 2]) ** 2 == pytest.approx(power[i], rel=1e-7)


def cases_by(name, offset, count=400):
    """Diffractions as strong as a law has them, an offset, 1 dB of noise; links in sight whose receiver saturates."""
    some, rng = wedges(count), np.random.default_rng(1)
    powers = laws(some, faces(), K)
    received = rng.uniform(25, 35, count)
    more = 10 * np.log10(powers[name] / powers[edges.TRACED])
    far = np.full(50, 45.0)
    saturated = 0.5  # of each decibel, one half is received
    shape = {f: np.concatenate([getattr(some, f), np.full(50, np.nan)]) for f in Wedges.__dataclass_fields__}
    return Cases(
        kind=np.concatenate([np.full(count, float(Interaction.DIFFRACTION)), np.zeros(50)]),
        published_db=np.concatenate([
            received + np.clip(more, -15, 15) + offset + rng.normal(0, 1, count), far + saturated * offset
        ]),
        received_db=np.concatenate([received, far]),
        again_db=np.concatenate([received + rng.normal(0, 1, count), far + saturated * STEP_DB]),
        **shape,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["bisector", "Luebbers' own angles", "half-space"])
def test_the_law_that_made_the_data_is_found(name):
    """Median within 0.2 dB and the least spread of all laws, a normal one's (1.35 dB); the offset within 1e-9."""
    results = edges.judge(cases_by(name, offset=2.5))
    assert results.find("offset", "far links in line of sight", "median")["value"] == pytest.approx(
        2.5, abs=1e-6
    )
    found = {row["row"]: row for row in results.rows if (row["table"], row["name"]) == ("laws", "all")}
    spread = {law: np.ptp(row["spread"]) for law, row in found.items()}
    assert abs(found[name]["value"]) < 0.2
    assert min(spread, key=spread.get) == name and spread[name] == pytest.approx(1.35, abs=0.35)


def test_links_that_are_all_saturated_give_no_offset():
    some = cases_by("bisector", 1.0)
    far = some.select(some.kind == 0)
    with pytest.raises(ValueError, match="saturated"):
        offset_db(Cases(**{**vars(far), "again_db": far.received_db}))
    with pytest.raises(ValueError, match="far enough"):
        offset_db(far.select(far.kind > 0))
