"""Every example of the gallery runs, is short, and draws something."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted((ROOT / "docs" / "gallery").glob("plot_*.py"))
#: Lines of code that an example may have, its text and empty lines not counted.
MOST_LINES = 40

#: Shows figures by saving them.
_SHOW = """
import runpy, sys
import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt
plt.show = lambda *args, **kwargs: None
runpy.run_path(sys.argv[1], run_name="__main__")
for number in plt.get_fignums():
    plt.figure(number).savefig(f"{sys.argv[2]}/{number}.png", dpi=50)
"""


def test_there_are_examples() -> None:
    """At least ten."""
    assert len(EXAMPLES) >= 10


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_length(path: Path) -> None:
    """Short enough to be read at a glance."""
    source = path.read_text("utf-8")
    header = ast.parse(source).body[0].end_lineno
    assert len([line for line in source.splitlines()[header:] if line.strip()]) <= MOST_LINES


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_runs(path: Path, tmp_path: Path) -> None:
    """It ends without error and without a warning on the terminal, and its picture is not empty."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c", _SHOW, str(path), str(tmp_path)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    pictures = list(tmp_path.glob("*.png"))
    assert pictures
    for picture in pictures:
        assert np.asarray(Image.open(picture).convert("L")).std() > 5, picture.name
