"""Every example of the gallery runs, is short, and draws a picture."""

import ast
import os
import runpy
import warnings
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from PIL import Image

from tests.docs.conftest import Ended

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "docs" / "gallery").glob("plot_*.py"))
#: Maximum number of lines of an example, without its text and empty lines.
MOST_LINES = 40


def _show(example: Path, folder: Path) -> None:
    """Run an example that shows its figures by saving them."""
    warnings.filterwarnings("error", category=DeprecationWarning, module="__main__")
    plt.show = lambda *args, **kwargs: None
    runpy.run_path(str(example), run_name="__main__")
    for number in plt.get_fignums():
        plt.figure(number).savefig(folder / f"{number}.png", dpi=50)


def test_there_are_examples() -> None:
    """At least ten."""
    assert len(EXAMPLES) >= 10


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_length(path: Path) -> None:
    """Short enough to read at a glance."""
    source = path.read_text("utf-8")
    header = ast.parse(source).body[0].end_lineno
    assert len([line for line in source.splitlines()[header:] if line.strip()]) <= MOST_LINES


@pytest.mark.skipif(os.environ.get("GALLERY") == "0", reason="GALLERY=0: `make docs` runs the examples")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_runs(path: Path, tmp_path: Path, separate_process: Callable[..., Ended]) -> None:
    """It ends without an error or warning, and its picture is not empty."""
    ended = separate_process(_show, path, tmp_path, folder=tmp_path)
    assert ended.status == 0, ended.output[-3000:]
    pictures = list(tmp_path.glob("*.png"))
    assert pictures
    for picture in pictures:
        assert np.asarray(Image.open(picture).convert("L")).std() > 5, picture.name
