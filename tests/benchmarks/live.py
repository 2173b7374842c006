"""How fast the page follows: from a move of a handle to its rays, and decisions a second of a search that is watched.

A handle moves some twenty times a second along a circle, as in a drag in a browser, and each move is timed until its
rays and its list of paths are handed to the network; one reader takes all that is sent. Where Playwright and Chromium
are installed, the same is timed in a browser: from the pointer's event to the change of the list, one move at a time,
and to the end of the first frame with the new rays. Without a graphics card a browser draws on the same cores.
Decisions of a search are counted from the first to the last, in a process of its own, without a page and with one.
"""

import math
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from tyro.conf import OmitArgPrefixes, Positional

from robosim.episode_config import EpisodeConfig
from robosim.live.page import Page
from robosim.live.search_process import RUN, SearchJob, SearchProcess
from robosim.plans.floorplan import FloorPlan
from tests.benchmarks.harness import DEFAULT, Options, plans_of
from tests.benchmarks.results import Results

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: Time between moves, as in a browser [s]; radius of the circle that is dragged along [m].
_EVERY_S, _RADIUS_M = 0.05, 1.0
_SETTLE_S = 120.0
#: Moves that are timed one by one in a browser, the rest after them [s], and how many rests a slow one is given.
_ALONE, _REST_S, _MOST_RESTS = 40, 1.0, 5
SOFTWARE = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
#: viser takes fewer pixels where drawing is slow; a place in its space is another one in the window then.
ALL_PIXELS = "?fixedDpr=1"
#: Notes when the pointer last moved, when the text of the page changed after it, and when the frame was drawn in which
#: lines were handed to the graphics after that. Reading a pixel waits for the whole frame.
_TIMER = """() => {
  window.dragged = window.changed = window.drawn = 0;
  window.addEventListener('pointermove', () => {
    window.dragged = performance.now(); window.changed = window.drawn = 0;
  }, true);
  new MutationObserver(() => { if (window.dragged && !window.changed) window.changed = performance.now(); })
    .observe(document.body, {subtree: true, childList: true, characterData: true});
  const gl = document.querySelector('canvas[data-engine]').getContext('webgl2');
  const hand = gl.bufferData, pixel = new Uint8Array(4);
  let waits = false;
  gl.bufferData = function (...given) {
    if (window.changed && !window.drawn && !waits) {
      waits = true;
      queueMicrotask(() => {
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        window.drawn = performance.now(); waits = false;
      });
    }
    return hand.apply(this, given);
  };
}"""


def main(
    plans: Positional[tuple[str, ...]] = ("office",),
    *,
    moves: int = 200,
    decisions: int = 60,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """The page of `robosim live`: how soon rays follow a drag, and what watching costs a search.

    Needs the extra `live`; with Playwright and Chromium drags are timed in a browser too.

    Args:
        plans: Floor plans.
        moves: Moves of the transmitter in each case.
        decisions: Decisions of a search.
        options: Of every benchmark.
    """
    results = Results()
    for plan in plans_of(plans):
        measure(plan, EpisodeConfig(seed=options.seed, max_steps=decisions), moves, results)
    return options.finish("live", results)


def measure(plan: FloorPlan, config: EpisodeConfig, moves: int, results: Results) -> None:
    """Delays of drags on one plan, and decisions a second of a search, alone and watched."""

    def add(name: str, delays_s: Float[np.ndarray, " n"]) -> None:
        for words, share in (("median", 50), ("95 %", 95), ("largest", 100)):
            delay = 1e3 * np.percentile(delays_s, share)
            results.add("drags", f"{plan.name}, {name}", words, delay, "ms", digits=0, cases=len(delays_s))

    with Page("127.0.0.1", 0, "bench") as page, reader(page):
        radio = page.explore(plan)
        searches = page.search(config)
        radio.settle(_SETTLE_S)
        add("nothing else goes on", _drag(page, moves))
        radio.show_floor("received power")
        add("the floor is coloured", _drag(page, moves))
        radio.show_floor("off")
        searches.start()
        watched = searches.searches[0]
        wait(lambda: watched.recording is not None and len(watched.recording) > 1)
        add("a search runs", _drag(page, moves))
        searches.stop()
        page.show("Radio")
        for name, delays_s in _in_browser(page, radio.settle):
            add(name, delays_s)
    results.add("searches", plan.name, "alone", _decisions_per_s(plan, config), "decisions/s", digits=1)
    with Page("127.0.0.1", 0, "bench") as page, reader(page):
        page.explore(plan).settle(_SETTLE_S)
        searches = page.search(config)
        page.show("Search")
        searches.start()
        results.add("searches", plan.name, "watched", _rate(searches.searches[0]), "decisions/s", digits=1)


def _drag(page: Page, moves: int) -> Float[np.ndarray, " n"]:
    """Seconds from each move that was followed to what it shows; the transmitter is then back where it was."""
    radio = page.radio
    assert radio is not None
    start = radio.places["transmitter"]
    radio.delays_s.clear()
    for k in range(moves):
        turn = 2 * math.pi * k / 40
        radio.move("transmitter", start + _RADIUS_M * np.array([math.cos(turn) - 1, math.sin(turn)]))
        time.sleep(_EVERY_S)
    radio.settle(_SETTLE_S)
    delays_s = np.array(radio.delays_s)
    # Part of a circle would end where the next case starts, and soon where no path leads.
    radio.move("transmitter", start)
    radio.settle(_SETTLE_S)
    return delays_s


def _decisions_per_s(plan: FloorPlan, config: EpisodeConfig) -> float:
    search = SearchProcess("alone", SearchJob(plan=plan, config=config), lambda one: None, RUN)
    try:
        return _rate(search)
    finally:
        search.close()


def _rate(search: SearchProcess) -> float:
    """Decisions a second, from the first to the last."""
    wait(lambda: not search.is_alive or (search.recording is not None and len(search.recording) > 0))
    begin, first = time.perf_counter(), len(search.recording or ())
    wait(lambda: not search.is_alive)
    if search.error or search.recording is None:
        raise ValueError(f"the search did not end: {search.error}")
    return (len(search.recording) - first) / (time.perf_counter() - begin)


def wait(condition: Callable[[], bool]) -> None:
    while not condition():
        time.sleep(0.005)


@contextmanager
def reader(page: Page) -> Iterator[None]:
    """Somebody who takes all that the page sends, and shows nothing."""
    import viser
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    connection = connect(
        f"ws://127.0.0.1:{page.server.get_port()}",
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        max_size=None,
    )

    def read() -> None:
        with suppress(ConnectionClosed):
            while True:
                connection.recv()

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    try:
        yield
    finally:
        connection.close()
        thread.join(5)


def _in_browser(page: Page, settle: Callable[[float], bool]) -> list[tuple[str, Float[np.ndarray, " n"]]]:
    """Delays in a browser, of moves one by one; none where there is no browser."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return []
    if found is None:
        return []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=list(SOFTWARE))
        tab = browser.new_page(viewport={"width": 1280, "height": 720})
        tab.goto(page.url + ALL_PIXELS)
        tab.get_by_text("the strongest first").wait_for()
        settle(_SETTLE_S)
        time.sleep(5.0)  # all that is sent at first
        listed, drawn = _timed_moves(page, tab)
        browser.close()
    return [("in a browser that draws by software: the list", listed), ("in that browser: the rays", drawn)]


def _timed_moves(page: Page, tab: "Tab") -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Seconds from the pointer's events to the new list, and to the new rays, of moves that were followed in time."""
    radio = page.radio
    assert radio is not None
    camera = list(page.server.get_clients().values())[-1].camera
    x, y = pixel_of(camera, np.array([*radio.places["transmitter"], radio.model.config.height_m]))
    tab.evaluate(_TIMER)
    tab.mouse.move(x, y)
    time.sleep(_REST_S)
    tab.mouse.down()
    listed, drawn = [], []
    for k in range(_ALONE):
        tab.mouse.move(x + 20 * math.sin(k), y + 15 * math.cos(k))
        dragged = changed = seen = 0.0
        # Slow ones are waited for, or the slowest would be left out.
        for _ in range(_MOST_RESTS):
            time.sleep(_REST_S)
            dragged, changed, seen = tab.evaluate("[window.dragged, window.changed, window.drawn]")
            if changed and seen:
                break
        if changed and seen:
            listed.append((changed - dragged) / 1e3)
            drawn.append((seen - dragged) / 1e3)
    tab.mouse.up()
    return np.array(listed), np.array(drawn)


def pixel_of(camera: Any, place: Float[np.ndarray, "3"]) -> tuple[float, float]:
    """Where a window's camera shows a place [pixels from the left and the top].

    Args:
        camera: Of a window of the page: it looks along z, x to the right and y down.
        place: In `map` [m].
    """
    w, x, y, z = camera.wxyz
    rotation = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    seen = rotation.T @ (place - camera.position)
    focal = camera.image_height / 2 / math.tan(camera.fov / 2)
    across, down = focal * seen[:2] / seen[2]
    return float(camera.image_width / 2 + across), float(camera.image_height / 2 + down)
