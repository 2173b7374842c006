"""The picture of a moment: the second map shows what is guessed, the first does not."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.drawing.picture import HEIGHT, Picture, building_rings
from robosim.drawing.snapshot import GUESS, GUESS_LEVELS, OBSTACLE, UNKNOWN, Snapshot, built_layer
from robosim.episode import EpisodeConfig
from robosim.plans.files import read_plan
from robosim.recording.replay import replay
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from slam.grid import GridFrame, MapEstimate
from tests.plans import two_rooms


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


def test_a_guess_is_kept_where_nothing_is_known():
    """Probabilities 0.02 and 0.98 fall into the first and last level; what is known stays what it is."""
    for odds, level in ((0.02, 0), (0.98, GUESS_LEVELS - 1)):
        values = built_layer(_estimate(odds)).values
        assert set(np.unique(values)) == {UNKNOWN, OBSTACLE, GUESS + level}
        assert (values == OBSTACLE).sum() == 20
        assert (values == GUESS + level).sum() == 20 * 19


@pytest.mark.parametrize("odds", [0.02, 0.98])
def test_guesses_stand_on_the_second_map_only(odds):
    """Maps differ where something is guessed: a guess of floor is bright and warm, one of an obstacle dark and cold."""
    estimate, plan = _estimate(odds), two_rooms(0.8)
    picture = Picture(building_rings(make_building(plan)), np.array([0.2, 0.2]), anticipates=True)
    image = picture.draw(
        Snapshot(
            rgb=np.zeros((8, 8, 3), np.uint8),
            depth_mm=np.ones((8, 8), np.uint16),
            pose=estimate.pose,
            estimate=estimate.pose,
            built=built_layer(estimate),
        )
    )
    assert image.shape[:2] == picture.size[::-1]
    width = (picture.size[0] - HEIGHT) // 2
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
    assert two[0] - HEIGHT == 2 * (one[0] - HEIGHT)
