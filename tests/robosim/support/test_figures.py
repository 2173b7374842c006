"""Figures in files: their formats, their resolution, and that nothing drawn is cut off."""

import matplotlib
import pytest
from matplotlib.figure import Figure
from PIL import Image

from robosim.support.figures import save_figure


def figure(label: str = "x [m]") -> Figure:
    made = Figure(figsize=(3, 2))
    axes = made.subplots()
    axes.plot([0, 1], label="line")
    axes.set_ylabel(label)
    return made


def test_png_alone_of_200_dots_per_inch(tmp_path):
    save_figure(figure(), tmp_path / "a.png")
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.info["dpi"] == pytest.approx((200, 200), abs=0.1)


@pytest.mark.parametrize(("kind", "begins"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_another_format_next_to_it_the_same_bytes_each_time(kind, begins, tmp_path):
    with matplotlib.rc_context({"savefig.format": kind}):
        for folder in ("one", "two"):
            save_figure(figure(), tmp_path / folder / "a.png")
    contents = [(tmp_path / folder / f"a.{kind}").read_bytes() for folder in ("one", "two")]
    assert contents[0].startswith(begins) and contents[0] == contents[1]
    assert sorted(path.name for path in (tmp_path / "one").iterdir()) == sorted(["a.png", f"a.{kind}"])


def test_no_label_is_clipped(tmp_path):
    """A figure of 3 inches whose label has eight lines, which the layout leaves no room for: its rim is white."""
    save_figure(figure("\n".join(["sideways [mm]"] * 8)), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        grey = picture.convert("L")
        assert grey.width > 3 * 200
        assert min(grey.crop((0, 0, 5, grey.height)).tobytes()) == 255
