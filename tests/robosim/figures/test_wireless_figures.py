"""All figures of radio from one small plan, and the page that shows them."""

import re

import numpy as np
import pytest
from PIL import Image

from robosim.cli import main
from robosim.drawing.gallery import Picture, write_index
from robosim.figures import wireless as wireless_figures
from robosim.support.files import write_files
from tests.plans import two_rooms
from wireless import LinkState
from wireless.linkstate.classifier import LinkStateClassifier
from wireless.linkstate.learning.networks import NETWORKS, weights_of


@pytest.fixture(scope="module")
def untrained(tmp_path_factory):
    """A classifier that uses what our estimates have."""
    inputs = ("aoa", "aod", "snr", "delay")
    network = weights_of(NETWORKS["reference"](inputs))
    folder = tmp_path_factory.mktemp("weights")
    write_files(folder, LinkStateClassifier([network], model="reference", inputs=inputs).files("untrained"))
    return folder / "untrained.safetensors"


def test_every_picture_is_made_and_shown(untrained, tmp_path, capsys, monkeypatch):
    """The page shows each PNG in the folder once, in colour, and says what is missing."""
    monkeypatch.setattr("robosim.plans.files.find_plans", lambda names: list(names))
    monkeypatch.setattr("robosim.commands.figures.read", lambda name: two_rooms(0.8))
    main(
        f"figures wireless rooms --links 60 --grid 0.5 --classifier {untrained} --out {tmp_path}/out".split()
    )
    page = (tmp_path / "out" / "index.html").read_text()
    shown = re.findall(r'<img src="([^"]+)"', page)
    made = sorted(path.name for path in (tmp_path / "out").glob("*.png"))
    assert sorted(shown) == made
    assert {
        "arrays.png",
        "link-los.png",
        "link-nlos.png",
        "aoa-error.png",
        "confusion.png",
        "states.png",
    } <= set(made)
    for name in made:
        pixels = np.asarray(Image.open(tmp_path / "out" / name).convert("RGB"))
        assert min(pixels.shape[:2]) > 300 and np.ptp(pixels, axis=2).max() > 100
    assert "No curves of training" in page
    assert "index.html" in capsys.readouterr().out.replace("\n", "")


def test_classifiers_that_need_what_is_not_estimated_are_passed_over(untrained):
    """Heights of peaks are those of the published receiver: a classifier that goes by them tells nothing here."""
    assert wireless_figures.find_classifier("public") is None
    assert wireless_figures.find_classifier(str(untrained)).inputs == ("aoa", "aod", "snr", "delay")
    with pytest.raises(ValueError, match="classifier is 'best'"):
        wireless_figures.find_classifier("best")


def test_the_transmitter_drawn_has_receivers_in_most_states():
    """Four states evenly beat two evenly, and these beat one with a few of another."""
    state = np.array([[1] * 8, [1] * 7 + [2], [0, 1, 2, 3] * 2, [1, 2] * 4], np.uint8)
    assert wireless_figures.most_mixed(state) == 2
    assert wireless_figures.most_mixed(state[[0, 1, 3]]) == 2
    assert wireless_figures.most_mixed(state[:2]) == 1
    assert LinkState(state[2, 2]) is LinkState.FIRST_ORDER


def test_captions_are_text_not_markup(tmp_path):
    """Words with < and & come out as they were written."""
    page = write_index(tmp_path, "a & b", [Picture(name="p.png", title="t", caption="r < 1 & so")], ["n > 0"])
    text = page.read_text()
    assert "r &lt; 1 &amp; so" in text and "<h1>a &amp; b</h1>" in text and "<p>n &gt; 0</p>" in text
