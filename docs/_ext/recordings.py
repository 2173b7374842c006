"""Searches that pages show as they were recorded: run, and saved as pages of their own, when the site is built."""

import tempfile
from dataclasses import replace
from pathlib import Path

from sphinx.application import Sphinx

from robosim.episode_config import EpisodeConfig
from robosim.live.page_export import export
from robosim.live.recordings import read_recording
from robosim.plans.files import read_plan
from robosim.run import record_episode

#: By the name of the file: plan, policy and seed of what is shown side by side.
RECORDINGS = {
    "search": [("office", "fused", 2)],
    "two-policies": [("flat", "fused", 4), ("flat", "explore", 4)],
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / "_static" / "recordings"
    folder.mkdir(parents=True, exist_ok=True)
    for name, searches in RECORDINGS.items():
        file = folder / f"{name}.html"
        if file.exists():
            continue
        with tempfile.TemporaryDirectory() as work:
            recordings = []
            for k, (plan, goal, seed) in enumerate(searches):
                config = replace(EpisodeConfig(), goal=goal, seed=seed, max_steps=300)
                record_episode(read_plan(plan), config, Path(work) / str(k), video=False)
                recordings.append(read_recording(Path(work) / str(k)))
            export(recordings, file)
