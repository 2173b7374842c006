"""The page in a browser: drags, searches, replays, exports; also on a phone."""

import io
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from robosim.live.recordings import read_evaluation
from robosim.live.search_panel import BY_HAND
from robosim.live.server import COVERED, SOFTWARE_NOTICE
from tests.benchmarks.live import pixel_of
from tests.plans import room

LONG_S = 300.0
OPEN = "Open a picture, a mesh, .json or .npy"


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.05)


def choose(tab, label: str, option: str) -> None:
    """Take an option of a list."""
    tab.locator(f"xpath=//*[normalize-space(text())='{label}']/following::input[1]").first.click()
    tab.get_by_role("option", name=option, exact=True).first.click()


def press(tab, label: str) -> None:
    tab.get_by_role("button", name=label, exact=True).first.click()


def open_file(tab, button, path: Path) -> None:
    """Open a file by a button; a click is lost where the panel is drawn again at that moment."""
    from playwright.sync_api import TimeoutError  # may not be installed

    for attempt in range(10):
        try:
            with tab.expect_file_chooser(timeout=30_000) as chosen:
                button.click()
            chosen.value.set_files(path)
            return
        except TimeoutError:
            assert attempt < 9, "no click opens the list of files"


def camera_of(page, tab):
    """The camera of a window, once it has been turned to the plan."""

    # Identified by its height: windows connect in any order, and again on a busy machine.
    def turned() -> list:
        cameras = [client.camera for client in page.server.get_clients().values()]
        of_tab = [one for one in cameras if one.image_height == tab.viewport_size["height"]]
        return [one for one in of_tab if one.position[2] > 4]

    wait_for(lambda: len(turned()) > 0, "the window's camera to look from above")
    return turned()[-1]


def drag(page, tab, by: tuple[float, float]) -> None:
    """Drag the transmitter by some pixels."""
    before = page.radio.places["transmitter"]
    rest_s = 0.3
    while np.array_equal(page.radio.places["transmitter"], before):
        assert rest_s < LONG_S, "the page does not react to the pointer"
        x, y = pixel_of(camera_of(page, tab), np.array([*before, page.radio.model.config.height_m]))
        tab.mouse.move(x, y)
        # The page checks at intervals what is under the pointer.
        time.sleep(rest_s)
        tab.mouse.down()
        for share in np.linspace(0, 1, 5):
            tab.mouse.move(x + share * by[0], y + share * by[1])
            time.sleep(0.2 * rest_s)
        tab.mouse.up()
        time.sleep(rest_s)
        rest_s *= 2


def _strongest_db(model, transmitter, robot):
    """Power gain of the strongest path between two places [dB]."""
    tx, rx = (model.antenna(place[:2])[None] for place in (transmitter, robot))
    return model.trace(tx, rx).power_db[0]


def test_the_transmitter_is_dragged_and_the_paths_follow(explored, window):
    """The list of paths is that of the new place."""
    tab = window(explored.url)
    paths = tab.get_by_text("the strongest first")
    paths.wait_for()
    tab.get_by_text("of the strongest estimated path").wait_for()
    table = tab.locator("table").filter(has_text="power [dBm]").first
    before, place = table.inner_text(), explored.radio.places["transmitter"]
    drag(explored, tab, (-60, 40))
    wait_for(lambda: table.inner_text() != before, "another list of paths")
    assert np.hypot(*(explored.radio.places["transmitter"] - place)) > 0.3
    assert explored.radio.settle(LONG_S)
    model, places = explored.radio.model, explored.radio.places
    expected = _strongest_db(model, places["transmitter"], places["robot"]) + model.config.tx_power_dbm
    wait_for(lambda: f"{expected:.1f}" in table.inner_text(), "the power at the new place")


def test_two_windows_drag_and_see_the_same(explored, window):
    first, second = window(explored.url), window(explored.url, 1000, 640)
    for tab in (first, second):
        tab.get_by_text("the strongest first").wait_for()
    before = first.locator("table").first.inner_text()
    drag(explored, second, (-40, 30))
    wait_for(lambda: first.locator("table").first.inner_text() != before, "the other window's drag")
    second.close()
    explored.radio.move("transmitter", np.array([1.0, 1.0]))
    assert explored.radio.settle(LONG_S)
    tables = first.locator("table").first
    power = _strongest_db(explored.radio.model, np.array([1.0, 1.0]), explored.radio.places["robot"]) + 23.0
    wait_for(lambda: f"{power:.1f}" in tables.inner_text(), "the first window")


def test_a_plan_is_opened_and_a_bad_one_reported(explored, window, tmp_path):
    tab = window(explored.url)
    tab.get_by_text("Open a plan").click()
    damaged = tmp_path / "damaged.npy"
    damaged.write_bytes(b"nothing")
    chooser = tab.get_by_role("button", name=OPEN)
    open_file(tab, chooser, damaged)
    message = tab.get_by_text("damaged.npy: ")
    message.last.wait_for()
    assert message.count() == 2, "at the head of the panel and next to the button"
    button, line = chooser.bounding_box(), message.last.bounding_box()
    assert 0 < line["y"] - button["y"] < 3 * button["height"]
    assert explored.radio.model.plan.name == "two rooms", "nothing is lost"
    np.save(tmp_path / "hall.npy", room(5.0, 4.0).occupancy)
    open_file(tab, chooser, tmp_path / "hall.npy")
    wait_for(lambda: explored.radio.model.plan.name == "hall", "the plan")
    assert explored.radio.model.building.free.area == pytest.approx(20.0, abs=0.1)


def test_warnings_of_a_reader_are_shown(explored, window, tmp_path):
    """A box with its faces outwards is read as a room inside out, which is a warning."""
    trimesh.creation.box((4, 3, 2.5)).export(tmp_path / "box.stl")
    tab = window(explored.url)
    tab.get_by_text("Open a plan").click()
    open_file(tab, tab.get_by_role("button", name=OPEN), tmp_path / "box.stl")
    tab.get_by_text("inside out; its surface is turned over").last.wait_for()
    assert explored.radio.model.plan.name == "box"


def test_a_search_runs_in_the_page_though_a_window_is_closed(explored, quick, window):
    """It continues to its end when the window is closed."""
    searches = explored.search(quick)
    tab = window(explored.url)
    press(tab, "Search")
    press(tab, "Start")
    tab.get_by_text("coverage").wait_for()
    tab.close()
    wait_for(
        lambda: searches.searches and not any(one.is_alive for one in searches.searches),
        "the end of the search",
    )
    recording = searches.searches[0].recording
    assert searches.searches[0].error == "" and len(recording) == 12
    again = window(explored.url)
    again.get_by_text(recording.ended).wait_for()


def test_a_stopped_search_shows_it(explored, quick, window):
    """No step comes with its end: it waits for a key."""
    searches = explored.search(quick)
    tab = window(explored.url)
    press(tab, "Search")
    choose(tab, "policy", BY_HAND)
    press(tab, "Start")
    tab.get_by_text("coverage").wait_for()
    count = len(searches.searches[0].recording)
    tab.keyboard.press("i")
    wait_for(lambda: len(searches.searches[0].recording) > count, "the decision of the key")
    press(tab, "Stop")
    tab.get_by_text("stopped by you").wait_for()


def test_start_and_target_are_set_by_clicks(explored, quick, window):
    """The search begins, and its target stands, within 5 cm of the clicks."""
    searches = explored.search(quick)
    tab = window(explored.url)
    press(tab, "Search")
    camera = camera_of(explored, tab)
    places = {"start": np.array([1.0, 1.0]), "target": np.array([5.0, 2.0])}
    for what, place in places.items():
        press(tab, f"set {what}")
        tab.get_by_text("Click on the floor at").wait_for()
        tab.mouse.click(*pixel_of(camera, np.array([*place, 0.0])))
        wait_for(lambda what=what: what in searches.places, f"the {what}")
        assert searches.places[what] == pytest.approx(place, abs=0.05)
    press(tab, "Start")
    wait_for(
        lambda: searches.searches and not any(one.is_alive for one in searches.searches),
        "the end of the search",
    )
    recording = searches.searches[0].recording
    assert searches.searches[0].error == ""
    assert recording.target == pytest.approx(searches.places["target"])
    pose = recording[0].true.pose
    assert pose[:2] == pytest.approx(searches.places["start"])
    assert pose[2] == pytest.approx(np.arctan2(1.0, 4.0), abs=0.03), "it looks to the target"


def middle_of(tab) -> np.ndarray:
    """Brightness of the middle of a window, below the plan's title: rows by columns, 0 to 255."""
    picture = np.array(Image.open(io.BytesIO(tab.screenshot())).convert("L"))
    return picture[int(0.44 * len(picture)) : int(0.66 * len(picture))]


def test_an_episode_is_scrubbed_and_exported(page, recorded, window, tmp_path):
    """The slider's number selects the last step; the saved file plays without a network."""
    page.replay(recorded)
    tab = window(page.url)
    tab.get_by_text("coverage").wait_for()
    number = tab.locator(
        "xpath=//*[normalize-space(text())='decision']/following::input[@type='text'][1]"
    ).first
    number.fill("11")
    number.press("Enter")
    tab.get_by_text("ended").wait_for()
    with tab.expect_download() as saved:
        press(tab, "Save as a standalone page (.html)")
    saved.value.save_as(tmp_path / "saved.html")
    tab.close()
    file = window(f"file://{tmp_path}/saved.html", offline=True)
    file.get_by_text("explore, two rooms").first.wait_for()
    file.locator("canvas").first.wait_for()
    file.get_by_text("anticipated obstacle").wait_for()
    slider = file.locator("input").first
    wait_for(lambda: float(slider.input_value()) > 0.5, "the film to go on")
    file.set_viewport_size({"width": 390, "height": 844})
    file.reload()
    file.locator("canvas").first.wait_for()
    wait_for(lambda: (middle_of(file)[:, 8:-8] < 128).any(), "the walls on a phone")
    assert (middle_of(file)[:, [*range(4), *range(-4, 0)]] > 250).all(), "nothing is cut off at its sides"


def test_each_row_of_an_evaluation_opens_its_episode(page, evaluated, window):
    """The first, a failure if there is one, is open from the beginning; a click on a row opens that row's."""
    searches = read_evaluation(evaluated)
    page.replay(evaluated)
    tab = window(page.url)
    rows = tab.locator("table").filter(has_text="x fastest").locator("tr")
    wide, content = tab.locator("div.wide").first.evaluate("table => [table.clientWidth, table.scrollWidth]")
    assert content <= wide, "all columns are seen"
    for k in (1, len(searches), 2):
        rows.nth(k).click()
        row = searches[k - 1].row
        tab.get_by_text(f"{row['policy']}, {row['plan']}, task {row['task']}", exact=True).wait_for()
        assert rows.nth(k).inner_text().split() == [
            str(row["plan"]), str(row["task"]), str(row["policy"]), "yes" if row["arrived"] else "no",
            *rows.nth(k).inner_text().split()[4:],
        ]  # fmt: skip


def sees_all(page, tab, right: float, bottom: float) -> bool:
    """Whether all corners of the building, up to its walls' tops, lie left of and above some pixels."""
    walls = page.radio.building
    camera = camera_of(page, tab)
    places = [
        pixel_of(camera, np.array([x, y, z]))
        for x in (walls.low[0], walls.high[0])
        for y in (walls.low[1], walls.high[1])
        for z in (0.0, walls.height_m)
    ]
    return all(0 < x < right and 0 < y < bottom for x, y in places)


def test_all_of_the_plan_is_in_view_next_to_the_panel(explored, window):
    """The panel appears after the view was set; then the window changes its size."""
    tab = window(explored.url, 1280, 720)
    tab.get_by_text("the strongest first").wait_for()
    space = tab.locator("canvas[data-engine]")
    for width, height in ((1280, 720), (1000, 720)):
        tab.set_viewport_size({"width": width, "height": height})
        wait_for(lambda width=width: space.bounding_box()["width"] < width - 300, "the panel")
        wait_for(
            lambda height=height: sees_all(explored, tab, space.bounding_box()["width"], height),
            "all of the plan",
        )
        camera = camera_of(explored, tab)
        walls = explored.radio.building
        left = pixel_of(camera, np.array([walls.low[0], walls.low[1], walls.height_m]))[0]
        assert left < 0.1 * space.bounding_box()["width"], "it is as large as it can be"


def test_a_turned_view_stays_when_the_window_changes_its_size(explored, window):
    tab = window(explored.url)
    tab.get_by_text("the strongest first").wait_for()
    press(tab, "View over the robot's shoulder")
    clients = explored.server.get_clients().values()
    wait_for(lambda: all(one.camera.position[2] < 2.5 for one in clients), "the eye at the robot's shoulder")
    before = next(iter(clients)).camera.position
    tab.set_viewport_size({"width": 1200, "height": 500})
    wait_for(lambda: all(one.camera.image_height == 500 for one in clients), "another shape")
    time.sleep(1.0)
    assert next(iter(clients)).camera.position == pytest.approx(before, abs=1e-3)


@pytest.mark.parametrize("deep_m", [3.0, 9.0])
def test_it_can_be_used_on_a_phone(page, window, deep_m):
    """Wide and deep plans are above the panel, which is as wide as the window, so that no table is cut off."""
    page.explore(room(6.2, deep_m))
    tab = window(page.url, 390, 844)
    tab.get_by_text("the strongest first").wait_for()
    tab.get_by_text("of the strongest estimated path").wait_for()
    box = tab.get_by_text("robosim live").first.bounding_box()
    assert box is not None and box["x"] >= 0 and box["y"] > 844 * (1 - COVERED)
    wait_for(lambda: sees_all(page, tab, 390, 844 * (1 - COVERED)), "all of the plan above the panel")
    tables = tab.locator("div.wide")
    assert tables.count() == 3
    for k in range(3):
        wide, content = tables.nth(k).evaluate("table => [table.clientWidth, table.scrollWidth]")
        assert content <= wide


#: Drops a file of a name and a content onto the page.
DROP = """([name, content]) => {
    const held = new DataTransfer();
    held.items.add(new File([Uint8Array.from(content)], name));
    for (const kind of ['dragenter', 'dragover', 'drop'])
        document.querySelector('canvas[data-engine]').dispatchEvent(
            new DragEvent(kind, {dataTransfer: held, bubbles: true, cancelable: true}));
}"""


def test_a_dropped_file_is_opened(explored, window):
    """A plan is shown; a bad file is reported, and the page stays."""
    tab = window(explored.url)
    tab.get_by_text("the strongest first").wait_for()
    tab.evaluate(DROP, ["damaged.npy", list(b"nothing")])
    tab.get_by_text("damaged.npy: ").first.wait_for()
    content = io.BytesIO()
    np.save(content, room(5.0, 4.0).occupancy)
    tab.evaluate(DROP, ["hall.npy", list(content.getvalue())])
    wait_for(lambda: explored.radio.model.plan.name == "hall", "the plan")
    assert explored.radio.settle(LONG_S)


def test_the_head_shows_plan_and_assumptions(explored, quick, window):
    """Before and after a drop, also in later windows; errors are shown in each tab."""
    explored.search(quick)
    tab = window(explored.url)
    tab.get_by_text("two rooms: 18.2 m² of floor, cells of 0.05 m. Assumed: ceiling at 2.5 m").wait_for()
    wait_for(lambda: tab.title() == "robosim live: two rooms", "the title")
    content = io.BytesIO()
    np.save(content, room(5.0, 4.0).occupancy)
    tab.evaluate(DROP, ["hall.npy", list(content.getvalue())])
    tab.get_by_text("hall: 20.0 m² of floor").wait_for()
    tab.get_by_text(
        "Assumed: 0.05 m per pixel (set it under 'Open a plan', and open hall.npy again)"
    ).wait_for()
    wait_for(lambda: tab.title() == "robosim live: hall", "the title")
    assert not tab.get_by_text("two rooms").is_visible()
    later = window(explored.url)
    wait_for(lambda: later.title() == "robosim live: hall", "the title")
    later.get_by_text("Uploading undefined").first.wait_for(state="attached")
    assert later.get_by_text("Uploading undefined").filter(visible=True).count() == 0
    later.evaluate(DROP, ["notes.docx", list(b"hello")])
    later.get_by_text("notes.docx: expected one file that refers to no other").first.wait_for()
    press(later, "Search")
    later.get_by_text("start and target").wait_for()
    assert later.get_by_text("notes.docx: expected one file").first.is_visible()
    later.evaluate(DROP, ["hall.npy", list(content.getvalue())])
    later.get_by_text("Files can be opened under Radio").wait_for()
    assert explored.radio.model.plan.name == "hall"


def test_a_drop_without_an_upload_button_is_answered(page, recorded, window):
    page.replay(recorded)
    tab = window(page.url)
    tab.get_by_text("coverage").wait_for()
    tab.evaluate(DROP, ["hall.npy", [1, 2, 3]])
    tab.get_by_text("Files can be opened under Radio").wait_for()


def test_there_is_no_antialiasing_without_a_graphics_card(explored, window):
    """This browser draws by software: one line says so, and takes no clicks."""
    tab = window(explored.url)
    tab.get_by_text("the strongest first").wait_for()
    line = tab.get_by_text(SOFTWARE_NOTICE)
    line.wait_for()
    assert line.evaluate("one => getComputedStyle(one).pointerEvents") == "none"
    script = "() => document.querySelector('canvas[data-engine]').getContext('webgl2').getContextAttributes().antialias"
    assert tab.evaluate(script) is False
    assert not tab.get_by_text("Software WebGL rendering detected").is_visible()
