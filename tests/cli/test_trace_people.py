"""`robosim trace` among people: losses at both ends of a link, resumed runs, and mistakes."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy.special import fresnel

from robosim.cli import main
from robosim.drawing.plan_view import BODY_YELLOW
from wireless import Paths
from wireless.motion.blockage import block
from wireless.motion.bodies import people

#: Radius and height of a person of a crowd, carrier's wavelength, and height of both terminals [m].
RADIUS_M, HEIGHT_M, WAVELENGTH_M, AT_M = 0.17, 1.7, 299792458 / 28e9, 1.5

FAST = ["--max-reflections", "1", "--no-diffraction", "--no-plots", "--workers", "1"]


def crowd_of(folder, *places, at_s=0.0):
    rows = [f"{at_s},p{k},{x},{y}" for k, (x, y) in enumerate(places)]
    file = folder / "crowd.csv"
    file.write_text("\n".join(["time,id,x,y", *rows]) + "\n")
    return file


def traced(plan_file, out, *words):
    main(["trace", str(plan_file), *map(str, words), *FAST, "--out", str(out)])
    return Paths.read_parquet(out / "paths.parquet")


def screen_db(d1, d2):
    """Loss by the screen of a person on the level line of sight, from Fresnel integrals over its opening."""

    def share(h):
        v = np.sign(h) * 2 * np.sqrt((np.hypot(d1, h) - d1 + np.hypot(d2, h) - d2) / WAVELENGTH_M)
        sine, cosine = fresnel(v)
        return 0.5 + 0.5 * (1 + 1j) * (cosine - 1j * sine)

    width = share(RADIUS_M) - share(-RADIUS_M)
    height = share(HEIGHT_M - AT_M) - share(-AT_M)
    return -20 * np.log10(abs(1 - width * height))


@pytest.mark.parametrize("x", [0.9, 2.2])
def test_trace_link_loses_the_same_behind_a_person_in_both_directions(x, plan_file, tmp_path):
    """A person 0.4 m from the transmitter, or 0.3 m from the receiver."""
    words = ["--mover", crowd_of(tmp_path, (x, 1.0))]
    loss_db = []
    for number, (tx, rx) in enumerate((("0.5,1", "2.5,1"), ("2.5,1", "0.5,1"))):
        ends = ["--tx", tx, "--rx", rx]
        free = traced(plan_file, tmp_path / f"free{number}", *ends)
        among = traced(plan_file, tmp_path / f"among{number}", *ends, *words)
        expected = block(free, people([(x, 1.0)], radius_m=RADIUS_M))[0]
        np.testing.assert_array_equal(among.power, expected.power)
        direct = [paths.power_db[paths.order == 0] for paths in (free, among)]
        loss_db.append(float((direct[0] - direct[1]).item()))
    expected_db = screen_db(x - 0.5, 2.5 - x)
    assert expected_db > 10
    np.testing.assert_allclose(loss_db, expected_db, atol=0.01)


def test_trace_of_a_grid_among_people_resumes_with_them_only(plan_file, tmp_path, fails):
    """Each path has the loss by the people of the result; drawn from another seed they have other places."""
    words = ["--tx", "0.5,1", "--grid", "0.5"]
    free, plain, out = (tmp_path / name for name in ("free", "plain", "among"))
    before = traced(plan_file, free, *words)
    traced(plan_file, plain, *words, "--people", "0", "--mover", "none")
    for name in ("paths.parquet", "settings.json", "coverage.parquet", "two rooms_Tx_1.csv"):
        assert (plain / name).read_bytes() == (free / name).read_bytes()
    among = traced(plan_file, out, *words, "--people", "4", "--seed", "3")
    bodies = json.loads((out / "trace.json").read_text())["bodies"]
    assert len(bodies["position"]) == 4
    expected = block(before, people(bodies["position"], radius_m=RADIUS_M))[0]
    np.testing.assert_array_equal(among.power, expected.power)
    assert (among.power.sum() < before.power.sum()) and len(among) == len(before)
    content = (out / "paths.parquet").read_bytes()
    traced(plan_file, out, *words, "--people", "4", "--seed", "3")
    for others in (["--people", "4", "--seed", "4"], ["--people", "3", "--seed", "3"], []):
        message = fails("trace", plan_file, *words, *others, *FAST, "--out", out)
        assert "results of other settings" in message and "bodies" in message
    assert (out / "paths.parquet").read_bytes() == content


def share_of_people(picture):
    """Share of a picture's pixels that have the colour of people, which nothing else has."""
    with Image.open(picture) as image:
        return (np.asarray(image.convert("RGB")) == BODY_YELLOW).all(axis=2).mean()


def test_trace_draws_people_in_all_pictures(plan_file, tmp_path):
    """Circles of their size: 3 of a radius of 0.17 m on a page that shows some 6.6 m by 3.2 m and its margins."""
    crowd = crowd_of(tmp_path, (0.5, 0.5), (4.0, 0.5), (5.5, 2.5))
    plain, among = tmp_path / "plain", tmp_path / "among"
    for out, words in ((plain, []), (among, ["--mover", str(crowd)])):
        ends = [
            "--tx",
            "1,1",
            "--grid",
            "0.8",
            "--max-reflections",
            "1",
            "--no-diffraction",
            "--workers",
            "1",
        ]
        main(["trace", str(plan_file), *ends, *words, "--out", str(out)])
    names = [f"{name}_tx1.png" for name in ("power", "state", "aoa", "rays", "overview")] + ["coverage.png"]
    for name in names:
        assert share_of_people(plain / name) < 1e-4 < share_of_people(among / name), name
    circles = 3 * np.pi * RADIUS_M**2 / (6.6 * 3.2)
    assert circles / 4 < share_of_people(among / "power_tx1.png") < circles


@pytest.mark.parametrize("storeys", [1, 2])
def test_trace_draws_people_around_a_link(storeys, plan_file, tmp_path):
    """From above, or in three dimensions, where people are left out who are far from the link."""
    plan = tmp_path / "house.yaml"
    plan.write_text(f"storeys:\n- plan: {plan_file}\n- plan: {plan_file}\n")
    place, crowd = plan_file if storeys == 1 else plan, crowd_of(tmp_path, (2.5, 1.5))
    for out, words in (("plain", []), ("among", ["--mover", str(crowd)])):
        main(["trace", str(place), "--tx", "1,1", "--rx", "2,2", *words, "--out", str(tmp_path / out)])
    pictures = [tmp_path / out / "rays_tx1.png" for out in ("plain", "among")]
    assert share_of_people(pictures[0]) < 1e-5 < 2e-4 < share_of_people(pictures[1])
    far = ["--mover", str(crowd_of(tmp_path, (5.9, 2.5))), "--out", str(tmp_path / "far")]
    main(
        [
            "trace",
            str(place),
            "--tx",
            "1,1",
            "--rx",
            "2,2",
            "--max-reflections",
            "0",
            "--no-diffraction",
            *far,
        ]
    )
    assert (share_of_people(tmp_path / "far" / "rays_tx1.png") > 1e-5) == (storeys == 1)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--people 1001 --grid 1", "people is 1001, expected a whole number from 0 to 1000 people"),
        ("--people 500 --grid 1", "people is 500, expected at most"),
        ("--seed 2 --grid 1", "seed is 2, which places people. Give --people 5"),
        ("--people 2 --along drive.tum", "people or mover is given with along"),
    ],
)
def test_trace_rejects_people_that_cannot_be(words, message, plan_file, tmp_path, fails):
    assert message in fails("trace", plan_file, "--tx", "1,1", *words.split(), "--out", tmp_path / "out")


def test_trace_rejects_a_crowd_that_comes_later(plan_file, tmp_path, fails):
    late = crowd_of(tmp_path, (1.0, 1.0), at_s=4.0)
    message = fails(
        "trace", plan_file, "--tx", "1,1", "--rx", "2,1", "--mover", late, "--out", tmp_path / "o"
    )
    assert "no body of it is there at time 0" in message
