"""How fast the page follows: from a move of a handle to its rays, and decisions a second of a search that is watched.

A handle is moved some twenty times a second along a circle, as a browser tells of a drag, and each move is timed until
its rays and its list of paths are handed to the network; one reader takes all that is sent. Where Playwright and
Chromium are there, the same is timed in a browser: from the pointer's event to the change of the list, one move at a
time, and to the end of the first frame that has the new rays, whose last pixel is waited for. Without a graphics card a
browser draws on the same cores, which is told beside the numbers.

A search's decisions are counted from the first to the last, in a process of its own, without a page and with one.
"""

import math
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from rich.table import Table

from robosim.building.building import BuildingConfig
from robosim.episode import EpisodeConfig
from robosim.live.link_model import LinkSettings
from robosim.live.page import Page
from robosim.live.search_process import GO, SearchJob, SearchProcess
from robosim.plans.floorplan import FloorPlan
from robosim.support.files import write_json

if TYPE_CHECKING:
    from playwright.sync_api import Page as Tab

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: As a browser tells of a drag [s]; radius of the circle that is dragged along [m].
_EVERY_S, _RADIUS_M = 0.05, 1.0
_SETTLE_S = 120.0
#: Moves that are timed one by one in a browser, the rest after them [s], and how many rests a slow one is given.
_ALONE, _REST_S, _MOST_RESTS = 40, 1.0, 5
SOFTWARE = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
#: viser takes fewer pixels where drawing is slow; a place in its space is another one in the window then.
ALL_PIXELS = "?fixedDpr=1"
#: Tells when the pointer last moved, when the text of the page changed after it, and when the frame was drawn in which
#: lines were handed to the graphics after that: rays are, anew at each move. Reading a pixel waits for the whole frame.
_TIMER = """() => {
  window.moved = window.changed = window.drawn = 0;
  window.addEventListener('pointermove', () => {
    window.moved = performance.now(); window.changed = window.drawn = 0;
  }, true);
  new MutationObserver(() => { if (window.moved && !window.changed) window.changed = performance.now(); })
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


def run(
    plans: Sequence[FloorPlan], *, out: Path, moves: int = 200, decisions: int = 60, seed: int = 0
) -> Table:
    """Time drags and searches; write `live.json`, and return a table.

    Args:
        plans: Where.
        out: Folder for the file.
        moves: Of a handle, in each case.
        decisions: Of a search.
        seed: Of the search.
    """
    rows = [
        row for plan in plans for row in _measured(plan, EpisodeConfig(seed=seed, max_steps=decisions), moves)
    ]
    write_json(out / "live.json", {"rows": rows, "cores": len(os.sched_getaffinity(0)), "moves": moves})
    return _table(rows)


def _measured(plan: FloorPlan, config: EpisodeConfig, moves: int) -> list[dict[str, Any]]:
    """All that is told of a plan."""
    rows = []
    with Page("127.0.0.1", 0, "bench") as page, _reader(page):
        radio = page.explore(plan, BuildingConfig(), LinkSettings())
        searches = page.search(config, BuildingConfig())
        radio.settle(_SETTLE_S)
        rows.append(_row(plan, "drag", _drag(page, moves)))
        radio.show_floor("received power")
        rows.append(_row(plan, "drag, floor coloured", _drag(page, moves)))
        radio.show_floor("off")
        searches.start()
        watched = searches.searches[0]
        _wait(lambda: watched.recording is not None and len(watched.recording) > 1)
        rows.append(_row(plan, "drag, a search running", _drag(page, moves)))
        searches.stop()
        page.show("Radio")
        rows += [_row(plan, name, delays) for name, delays in _in_browser(page, radio.settle)]
    alone = _decisions_per_s(plan, config)
    with Page("127.0.0.1", 0, "bench") as page, _reader(page):
        page.explore(plan, BuildingConfig(), LinkSettings()).settle(_SETTLE_S)
        searches = page.search(config, BuildingConfig())
        page.show("Search")
        searches.start()
        shown = _rate(searches.searches[0])
        fps = searches.player.fps
    rows.append(
        {"plan": plan.name, "what": "search", "alone_per_s": alone, "watched_per_s": shown, "fps": fps}
    )
    return rows


def _row(plan: FloorPlan, what: str, delays_s: Float[np.ndarray, " n"]) -> dict[str, Any]:
    median, most, worst = 1e3 * np.percentile(delays_s, [50, 95, 100])
    return {
        "plan": plan.name,
        "what": what,
        "n": len(delays_s),
        "median_ms": median,
        "p95_ms": most,
        "max_ms": worst,
    }


def _drag(page: Page, moves: int) -> Float[np.ndarray, " n"]:
    """Seconds from each move that was followed to what it shows."""
    radio = page.radio
    assert radio is not None
    middle = radio.places["transmitter"]
    radio.delays_s.clear()
    for k in range(moves):
        turn = 2 * math.pi * k / 40
        radio.move("transmitter", middle + _RADIUS_M * np.array([math.cos(turn) - 1, math.sin(turn)]))
        time.sleep(_EVERY_S)
    radio.settle(_SETTLE_S)
    return np.array(radio.delays_s)


def _decisions_per_s(plan: FloorPlan, config: EpisodeConfig) -> float:
    search = SearchProcess("alone", SearchJob(plan=plan, config=config), lambda one: None, GO)
    try:
        return _rate(search)
    finally:
        search.close()


def _rate(search: SearchProcess) -> float:
    """Decisions a second, from the first to the last."""
    _wait(lambda: not search.alive or (search.recording is not None and len(search.recording) > 0))
    begin, first = time.perf_counter(), len(search.recording or ())
    _wait(lambda: not search.alive)
    if search.trouble or search.recording is None:
        raise ValueError(f"the search did not end: {search.trouble}")
    return (len(search.recording) - first) / (time.perf_counter() - begin)


def _wait(condition: Callable[[], bool]) -> None:
    while not condition():
        time.sleep(0.005)


@contextmanager
def _reader(page: Page) -> Iterator[None]:
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
    return [("drag in a browser that draws by software: list", listed), ("its rays drawn", drawn)]


def _timed_moves(page: Page, tab: "Tab") -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Seconds from the pointer's events to the new list, and to the new rays, of moves that were followed in time."""
    radio = page.radio
    assert radio is not None
    camera = list(page.server.get_clients().values())[-1].camera
    x, y = pixel_of(camera, np.array([*radio.places["transmitter"], radio.model.settings.height_m]))
    tab.evaluate(_TIMER)
    tab.mouse.move(x, y)
    time.sleep(_REST_S)
    tab.mouse.down()
    listed, drawn = [], []
    for k in range(_ALONE):
        tab.mouse.move(x + 20 * math.sin(k), y + 15 * math.cos(k))
        moved = changed = seen = 0.0
        # Slow ones are waited for, or the slowest would be left out.
        for _ in range(_MOST_RESTS):
            time.sleep(_REST_S)
            moved, changed, seen = tab.evaluate("[window.moved, window.changed, window.drawn]")
            if changed and seen:
                break
        if changed and seen:
            listed.append((changed - moved) / 1e3)
            drawn.append((seen - moved) / 1e3)
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


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    heads = (
        "moves",
        "median [ms]",
        "95 % [ms]",
        "most [ms]",
        "alone [1/s]",
        "watched [1/s]",
        "pictures [1/s]",
    )
    table = Table("plan", "what", *heads)
    for row in rows:
        if row["what"] == "search":
            cells = [""] * 4 + [f"{row[name]:.1f}" for name in ("alone_per_s", "watched_per_s", "fps")]
        else:
            cells = [str(row["n"]), *(f"{row[name]:.0f}" for name in ("median_ms", "p95_ms", "max_ms"))] + [
                ""
            ] * 3
        table.add_row(row["plan"], row["what"], *cells)
    return table
