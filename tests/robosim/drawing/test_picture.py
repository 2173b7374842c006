"""The picture of a step: the second map shows what is guessed, the first does not."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.drawing import plan_view
from robosim.drawing.picture import LEGEND, STATE_COLOURS, Picture, Timeline
from robosim.drawing.plan_view import (
    ESTIMATE_ORANGE,
    HEIGHT,
    LINE_PX,
    PATH_PURPLE,
    TARGET_RED,
    TRUE_GREEN,
    WALL_BLUE,
    building_rings,
    draw_scale,
)
from robosim.episode_config import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.recording.replay import replay
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from slam.grid import GridFrame, MapEstimate
from tests.plans import two_rooms
from tests.steps import measurement, step
from wireless.paths import LinkState


def _estimate(odds: float) -> MapEstimate:
    """Nothing known but a wall; a square metre is guessed, wall included."""
    frame = GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.05, shape=(60, 60))
    guess, known = np.full((2, *frame.shape), 0.5, np.float32)
    guess[20:40, 20:40] = odds
    known[20:40, 20] = 0.9
    nothing = np.zeros(frame.shape, bool)
    return MapEstimate(
        frame=frame,
        obstacle_probability=known,
        explored=nothing,
        blocked=nothing,
        pose=np.array([0.3, 0.3, 0.0]),
        anticipated_probability=guess,
    )


@pytest.mark.parametrize("odds", [0.02, 0.98])
def test_guesses_stand_on_the_second_map_only(odds):
    """Maps differ where something is guessed: a guess of floor is bright and warm, one of an obstacle dark and cold."""
    estimate, plan = _estimate(odds), two_rooms(0.8)
    picture = Picture(building_rings(make_building(plan)), np.array([0.2, 0.2]), anticipates=True)
    image = picture.draw(step(pose=estimate.pose, map=estimate, goal=(0.1, 0.1)))
    assert image.shape[:2] == picture.size[::-1]
    width = (picture.size[0] - HEIGHT - LEGEND) // 2
    first, second = (image[20:HEIGHT, HEIGHT + k * width : HEIGHT + (k + 1) * width] for k in (0, 1))
    rows, columns = np.nonzero((first != second).any(axis=-1))
    assert (np.ptp(columns) + 1) / (np.ptp(rows) + 1) == pytest.approx(0.95, abs=0.04)
    inside = second[rows, columns].astype(int)
    assert (np.median(inside.sum(axis=1)) > 3 * 200) == (odds < 0.5)
    warmth = np.median(inside[:, 0] - inside[:, 2])
    assert warmth > 40 if odds < 0.5 else warmth < -20


def test_guesses_are_replayed(tmp_path):
    """An episode of six decisions with the learned mapper: the replay is its video, byte for byte."""
    config = EpisodeConfig(
        goal="explore", mapper="neural", simulator=SimulatorConfig(physics="kinematic"), max_steps=6
    )
    record_episode(two_rooms(0.8), config, tmp_path)
    video, _ = replay(tmp_path, tmp_path / "again")
    assert video.read_bytes() == (tmp_path / "episode.mp4").read_bytes()


def test_a_mapper_that_does_not_guess_has_one_map():
    rings = building_rings(make_building(read_plan("cottage")))
    one, two = (Picture(rings, np.zeros(2), anticipates=guess).size for guess in (False, True))
    assert two[0] - HEIGHT - LEGEND == 2 * (one[0] - HEIGHT - LEGEND)


def _pixels(image: np.ndarray, colour) -> int:
    return int((image == np.array(colour, np.uint8)).all(axis=-1).sum())


@pytest.mark.parametrize("px_per_m", [7.3, 20.0, 61.0, 240.0])
def test_the_scale_bar_is_as_long_as_it_says(px_per_m, monkeypatch):
    """Ends of the bar lie as many pixels apart as the length that is written takes, to half a pixel each."""
    written = []
    monkeypatch.setattr(plan_view, "write", lambda canvas, text, at, size=0.4: written.append(text))
    canvas = np.full((200, 400, 3), 255, np.uint8)
    draw_scale(canvas, px_per_m)
    (length,) = (float(text[:-2]) for text in written if text.endswith(" m"))
    dark = np.flatnonzero((canvas[200 - 12] < 60).all(axis=-1))
    bar = dark[: np.argmax(np.diff(dark) > 2) + 1] if (np.diff(dark) > 2).any() else dark
    assert np.ptp(bar) == pytest.approx(length * px_per_m, abs=3)
    assert length <= 0.3 * 400 / px_per_m < 2.6 * length


def test_who_only_explores_is_shown_no_target():
    """Neither the target nor its legend: no pixel of its colour on map and legend but that of a bump."""
    rings = building_rings(make_building(two_rooms(0.8)))
    found = {}
    for seeks in (True, False):
        image = Picture(rings, np.array([5.0, 2.0]) if seeks else None).draw(step(coverage=0.4))
        found[seeks] = _pixels(image[:, HEIGHT:-LEGEND], TARGET_RED), _pixels(image[:, -LEGEND:], TARGET_RED)
    assert found[False][0] == 0 < found[True][0]
    assert 0 < found[False][1] < found[True][1]


def test_the_legend_has_the_colours_of_what_is_drawn():
    """With radio and belief each colour of the map stands in the legend, and each link state's."""
    picture = Picture(building_rings(make_building(two_rooms(0.8))), np.array([5.0, 2.0]), anticipates=True)
    measured = measurement((1.0, 0.6, 0.0), LinkState.LOS, [0.3], [20.0])
    shown = step(measured=measured, state=LinkState.LOS, coverage=0.1)
    image = picture.draw(shown)
    names = [entry.text for entry in picture._entries(shown)]
    assert len(names) <= (image.shape[0] - 8) // LINE_PX, "every entry fits"
    for colour in (
        WALL_BLUE,
        TRUE_GREEN,
        ESTIMATE_ORANGE,
        PATH_PURPLE,
        *(STATE_COLOURS[state] for state in LinkState),
    ):
        assert _pixels(image[:, -LEGEND:], colour) > 10


def test_time_lines_show_what_was_measured():
    """Of 150 decisions the first 60 without a path: no SNR there, states in their colours, at twice the first span."""
    line = Timeline(474, 132, STATE_COLOURS)
    for i in range(150):
        is_reached = i >= 60
        line.add(
            30.0 if is_reached else np.nan,
            LinkState.LOS if is_reached else LinkState.OUTAGE,
            LinkState.FIRST_ORDER if is_reached else LinkState.OUTAGE,
            0.5,
        )
    image = line.draw()
    x = [74 + round(i * (474 - 74 - 12) / 200) for i in (30, 100, 180)]
    estimated, true = 132 - 18 - 36 + 7, 132 - 18 - 18 + 7
    assert [tuple(image[estimated, at]) for at in x[:2]] == [
        STATE_COLOURS[LinkState.OUTAGE], STATE_COLOURS[LinkState.LOS],
    ]  # fmt: skip
    assert tuple(image[true, x[1]]) == STATE_COLOURS[LinkState.FIRST_ORDER]
    assert tuple(image[estimated, x[2]]) == (255, 255, 255)
    blue = (image[8:70].astype(int) @ (-1, 0, 1)) > 60
    assert not blue[:, 74 : x[0]].any() and blue[:, x[1]].any() and not blue[:, x[2]].any()
    # 30 dB of -10 to 60: 4/7 of the height.
    assert np.flatnonzero(blue[:, x[1]]).mean() + 8 == pytest.approx(72 - 4 / 7 * 64, abs=1.5)
