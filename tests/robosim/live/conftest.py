"""Fixtures of tests of the page: a quick episode, a served page, and a browser."""

import ctypes
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from robosim.camera.model import CameraConfig
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.evaluate import evaluate
from robosim.evaluation.suite import Suite, SuiteTask
from robosim.plans.files import write_ros
from robosim.robot.robots import RobotConfig
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from tests.benchmarks.live import ALL_PIXELS
from tests.plans import two_rooms

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: WebGL without a graphics card, as root, without connections to other hosts.
BROWSER_OPTIONS = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
    "--disable-background-networking", "--disable-component-update",
)  # fmt: skip
#: Timeout of a browser without a graphics card on a busy machine [ms].
LONG_MS = 300_000
START, TARGET = np.array([0.7, 0.7, 0.0]), np.array([5.4, 2.3])


@pytest.fixture(scope="session")
def quick() -> EpisodeConfig:
    """An episode of a second."""
    simulator = SimulatorConfig(
        physics="kinematic", camera="embree", robot=RobotConfig(camera=CameraConfig(width=32, height=32))
    )
    return EpisodeConfig(goal="explore", mapper="classical", max_steps=12, seed=1, simulator=simulator)


@pytest.fixture(scope="session")
def recorded(quick, tmp_path_factory) -> Path:
    """The folder of such an episode."""
    folder = tmp_path_factory.mktemp("recorded")
    record_episode(two_rooms(0.8), quick, folder, start=START, target=TARGET, video=False)
    return folder


@pytest.fixture(scope="session")
def evaluated(quick, tmp_path_factory) -> Path:
    """Two tasks by two policies, of which only the oracle arrives."""
    folder = tmp_path_factory.mktemp("evaluated")
    write_ros(two_rooms(0.8), folder / "pair.yaml")
    tasks = tuple(
        SuiteTask(plan="pair", number=k, start=(0.7, 0.7, 0.0), target=target)
        for k, target in enumerate([(2.2, 0.7), (2.2, 1.5)])
    )
    suite = Suite(plans={"pair": folder / "pair.yaml"}, tasks=tasks, seed=0)
    evaluate(
        suite, folder / "out", config=replace(quick, max_steps=30), policies=("oracle", "visual"), repeats=1, workers=1,
        console=Console(quiet=True),
    )  # fmt: skip
    return folder / "out"


@pytest.fixture
def page() -> Iterator:
    """An empty page."""
    pytest.importorskip("viser", reason="needs viser: pip install -e '.[live]'")
    from robosim.live.page import Page

    with Page("127.0.0.1", 0, "robosim live") as served:
        yield served


@pytest.fixture
def explored(page):
    """A page with the tab `Radio` of two rooms."""
    page.explore(two_rooms(0.8))
    assert page.radio.settle(120)
    return page


@pytest.fixture(scope="session")
def chromium() -> Iterator:
    """A browser."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason="needs playwright: pip install -e '.[test]'"
    )
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("needs Chromium: apt-get install chromium")
    if sys.platform == "linux":
        try:
            ctypes.CDLL("libatomic.so.1")
        except OSError:
            pytest.skip("needs libatomic, which Playwright is linked to: apt-get install libatomic1")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=list(BROWSER_OPTIONS))
        yield browser
        browser.close()


@pytest.fixture
def window(chromium) -> Iterator[Callable]:
    """Opens windows of a size at an address; no error may be on any console at the end."""
    errors, contexts = [], []

    def open_window(url: str, width: int = 900, height: int = 560, *, offline: bool = False):
        context = chromium.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        context.set_offline(offline)
        contexts.append(context)
        context.set_default_timeout(LONG_MS)
        tab = context.new_page()
        tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(url if offline else url + ALL_PIXELS)
        return tab

    yield open_window
    for context in contexts:
        context.close()
    # Chromium reports a listener of viser at the first touch.
    assert [error for error in errors if "preventDefault inside passive event" not in error] == []
