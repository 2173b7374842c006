"""Records the clip of the README: a transmitter is dragged through a flat, then a robot searches for it.

    python -m scripts.live_clip --out assets/live.webp

Playwright drives Chromium on the page of `robosim live`. Each frame is a screenshot after drawing has finished, so
the clip does not depend on the speed of the machine. Needs the extra `live`, Playwright and Chromium (`make test`
installs the latter two), and some minutes.
"""

import argparse
import io
import math
import shutil
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Page as Tab
from playwright.sync_api import sync_playwright

from robosim.episode import EpisodeConfig
from robosim.live.page import Page
from robosim.plans.files import read_plan
from robosim.support.files import whole_file
from tests.benchmarks.live import ALL_PIXELS, BROWSERS, SOFTWARE, pixel_of

PLAN, SEED, POLICY = "flat", 4, "fused"
WIDTH, HEIGHT = 1040, 585
#: Corners of the transmitter's trajectory, and position of the robot [m].
TRAJECTORY, ROBOT = (
    np.array([[7.0, 7.0], [9.6, 7.2], [11.0, 9.2], [9.4, 9.6], [7.4, 8.2]]),
    np.array([11.0, 6.6]),
)
#: Duration of the drag, of the search, and of the last frame of each [ms].
DRAG_MS, SEARCH_MS, LAST_MS = 4000, 6000, 1800
#: Timeout for a browser without a graphics card on a busy machine [ms].
LONG_MS = 300_000
LONG_S = LONG_MS / 1000
#: Screenshots show no pointer: a ring replaces it.
POINTER = """() => { const ring = document.createElement('div');
  ring.style.cssText = 'position:fixed;width:22px;height:22px;margin:-13px;border:3px solid #222;border-radius:50%;' +
    'pointer-events:none;z-index:9999;left:-99px';
  document.body.append(ring);
  window.addEventListener('pointermove', e => { ring.style.left = e.clientX + 'px'; ring.style.top = e.clientY + 'px' },
    true); }"""


@dataclass
class Film:
    """Frames and their durations."""

    tab: Tab
    frames: list[Image.Image] = field(default_factory=list)
    shown_ms: list[int] = field(default_factory=list)

    def take(self, shown_ms: int) -> None:
        """Take a picture of the window."""
        content = self.tab.screenshot(timeout=LONG_MS, type="jpeg", quality=95)
        self.frames.append(Image.open(io.BytesIO(content)).convert("RGB"))
        self.shown_ms.append(shown_ms)
        print(f"frame {len(self.frames)}", end="\r", flush=True)

    def save(self, path: Path, width: int, quality: int) -> None:
        """Write an animated WebP that repeats."""
        size = width, round(width * HEIGHT / WIDTH)
        first, *rest = [frame.resize(size, Image.Resampling.LANCZOS) for frame in self.frames]
        with whole_file(path) as partial:
            first.save(
                partial, "WEBP", save_all=True, append_images=rest, duration=self.shown_ms, loop=0, quality=quality,
                method=6, minimize_size=True,
            )  # fmt: skip


def drag(page: Page, film: Film, count: int) -> None:
    """Drag the transmitter through the flat with the pointer, then colour the floor by its power."""
    radio, tab = page.radio, film.tab
    assert radio is not None
    camera = list(page.server.get_clients().values())[-1].camera
    radio.move("robot", ROBOT)
    radio.move("transmitter", TRAJECTORY[0])
    assert radio.settle(LONG_S)
    wait(lambda: camera.position[2] > 4, "the camera")
    drawn(tab)
    grip(page, tab)
    film.take(600)
    share = np.linspace(0, len(TRAJECTORY) - 1, count)
    for x, y in zip(
        *(np.interp(share, np.arange(len(TRAJECTORY)), TRAJECTORY[:, k]) for k in (0, 1)), strict=True
    ):
        follow(page, tab, np.array([x, y]))
        assert radio.settle(LONG_S)
        drawn(tab)
        film.take(DRAG_MS // count)
    tab.mouse.up()
    tab.mouse.move(20, HEIGHT - 20)
    radio.show_floor("received power")
    assert radio.settle(LONG_S)
    drawn(tab)
    film.take(LAST_MS)
    radio.show_floor("off")


def grip(page: Page, tab: Tab) -> None:
    """Grip the transmitter; retry while the window has not drawn it at its position yet."""
    radio = page.radio
    assert radio is not None
    camera, height = list(page.server.get_clients().values())[-1].camera, radio.model.config.height_m
    for rest_s in (1.0, 2.0, 4.0, 8.0, 16.0):
        before = radio.places["transmitter"]
        x, y = pixel_of(camera, np.array([*before, height]))
        tab.mouse.move(x, y)
        time.sleep(rest_s)
        tab.mouse.down()
        tab.mouse.move(x + 6, y)
        time.sleep(rest_s)
        if not np.array_equal(radio.places["transmitter"], before):
            return
        tab.mouse.up()
        tab.get_by_role("button", name="View from above", exact=True).click()
        drawn(tab)
    raise TimeoutError("the page does not react to the pointer")


def follow(page: Page, tab: Tab, at: np.ndarray) -> None:
    """Move the pointer until the transmitter follows: a busy window may skip a move."""
    radio = page.radio
    assert radio is not None
    camera, free = list(page.server.get_clients().values())[-1].camera, radio.model.nearest_free(at)
    x, y = pixel_of(camera, np.array([*at, radio.model.config.height_m]))
    end = time.monotonic() + LONG_S
    while True:
        for shift in (0.0, 2.0):
            tab.mouse.move(x + shift, y)
            time.sleep(0.4)
        # From a wall, the free places on both sides may be equally near.
        if min(math.dist(radio.places["transmitter"], near) for near in (free, at)) < 0.3:
            return
        if time.monotonic() > end:
            raise TimeoutError(f"the drag to {at} did not finish")


def search(page: Page, film: Film, config: EpisodeConfig, count: int) -> None:
    """Run a search, and show its decisions one after another."""
    tab, searches = film.tab, page.search(config)
    tab.get_by_role("button", name="Search", exact=True).first.click()
    tab.get_by_role("button", name="Start", exact=True).first.click()
    wait(lambda: bool(searches.searches) and not any(one.is_alive for one in searches.searches), "the search")
    recording = searches.searches[0].recording
    assert recording is not None and recording.ended.startswith("arrived"), searches.searches[0].error
    number = tab.locator(
        "xpath=//*[normalize-space(text())='decision']/following::input[@type='text'][1]"
    ).first
    last = len(recording) - 1
    searches.player.play(False)  # each decision stays until its screenshot
    for i in np.unique(np.linspace(0, last, count).round().astype(int)).tolist():
        number.fill(str(i))
        number.press("Enter")
        wait(lambda i=i: searches.player.shown == i, f"decision {i}")
        drawn(tab)
        film.take(LAST_MS if i == last else SEARCH_MS // count)


def wait(condition: Any, what: str) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + LONG_S
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"timeout: {what}")
        time.sleep(0.02)


def drawn(tab: Tab) -> None:
    """Wait until the window has drawn all updates: three frames and a margin."""
    tab.evaluate(
        "() => new Promise(done => { let left = 3; const next = () => --left ? requestAnimationFrame(next) : done(); "
        "requestAnimationFrame(next); })"
    )
    time.sleep(0.15)


def main() -> None:
    """Record the clip."""
    parser = argparse.ArgumentParser(description="Record the clip of the README from the live page.")
    parser.add_argument("--out", type=Path, default=Path("assets/live.webp"))
    parser.add_argument("--width", type=int, default=960, help="of the clip [pixels]")
    parser.add_argument("--quality", type=int, default=62, help="of its frames, 0 to 100")
    parser.add_argument("--drag", type=int, default=40, help="frames of the drag")
    parser.add_argument("--search", type=int, default=60, help="frames of the search")
    parser.add_argument("--picture", type=Path, help="file for one frame of the drag as a PNG")
    options = parser.parse_args()
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit("Chromium is not installed: apt-get install chromium")
    config = replace(EpisodeConfig(), goal=POLICY, seed=SEED, max_steps=400)
    with Page("127.0.0.1", 0, "robosim live") as page, sync_playwright() as driver:
        page.explore(read_plan(PLAN)).settle(LONG_S)
        chromium = driver.chromium.launch(executable_path=browser, args=list(SOFTWARE))
        tab = chromium.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        tab.set_default_timeout(LONG_MS)
        tab.goto(page.url + ALL_PIXELS)
        tab.get_by_text("of the strongest estimated path").wait_for()
        tab.evaluate(POINTER)
        time.sleep(5.0)  # the initial scene
        film = Film(tab)
        drag(page, film, options.drag)
        if options.picture:
            film.frames[options.drag // 2].save(options.picture, optimize=True)
        film.save(options.out, options.width, options.quality)
        search(page, film, config, options.search)
        film.save(options.out, options.width, options.quality)
        chromium.close()
    size = options.out.stat().st_size / 1e6
    print(f"Wrote {len(film.frames)} frames, {size:.2f} MB, to {options.out}")


if __name__ == "__main__":
    main()
