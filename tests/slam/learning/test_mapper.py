"""The learned mapper: what it is shown, its network, its scores, its training, and its files."""

import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from robosim.training.policy_weights import Checkpoint
from slam.learning.map_module import MapModule
from slam.learning.mapper import Frames, Recipe, classical_scores, coded, train
from slam.networks.features import (
    BELIEF,
    CLEARANCE,
    IN_VIEW,
    PLACE_LEFT,
    POINTS,
    SURFACE,
    Features,
)
from slam.networks.files import files_of, load_mapper
from slam.networks.map_network import OBSTACLE, MapPredictor, NetworkConfig
from slam.networks.scores import PatchScores
from slam.sensing.projection import CameraModel, scan_from_depth
from tests.slam.rooms import Room

SMALL = NetworkConfig(widths=(4, 6))
UNKNOWN = np.full((64, 64), 0.5, np.float32)
X, Y = np.meshgrid((np.arange(64) + 0.5) * 0.05, (np.arange(64) + 0.5) * 0.05 - 1.6)


def test_clearance_is_the_distance_to_the_wall():
    """Facing a wall 2.13 m away: (2.13 - x) / 0.1 m in view, cut off at 1, to 1 cm; 0 outside of the view."""
    room = Room(high_xy=(2.13, 5.0), low_xy=(-3.0, -5.0))
    shown = Features().of(room.depth(np.zeros(3), size=128), UNKNOWN)
    view = np.abs(Y) < X - 0.05
    np.testing.assert_allclose(shown[CLEARANCE][view], np.clip((2.13 - X[view]) / 0.1, -1, 1), atol=0.1)
    assert (shown[[CLEARANCE, SURFACE, IN_VIEW]][:, np.abs(Y) > X + 0.05] == 0).all()
    assert shown[SURFACE][view].all() and shown[IN_VIEW][view].all()


def test_points_lie_on_the_wall():
    """The mean of the points' places, weighed, is the wall at 2.13 m to 5 mm, for all its rows in view."""
    shown = Features().of(
        Room(high_xy=(2.13, 5.0), low_xy=(-3.0, -5.0)).depth(np.zeros(3), size=128), UNKNOWN
    )
    points = shown[POINTS][4:-4]
    assert points.sum(axis=1).min() > 0.5
    assert np.abs((points * X[4:-4]).sum(axis=1) / points.sum(axis=1) - 2.13).max() < 0.005


def test_what_is_shown_has_no_handedness():
    """A mirrored image and map give mirrored channels, but for the sign of the place to the left."""
    rng = np.random.default_rng(0)
    depth = Room().depth(np.array([0.3, -0.4, 0.5]), size=128)
    belief = rng.random((64, 64)).astype(np.float32)
    shown, mirrored = Features().of(depth, belief), Features().of(depth[:, ::-1].copy(), belief[::-1].copy())
    mirrored = mirrored[:, ::-1].copy()
    mirrored[PLACE_LEFT] *= -1
    assert (np.abs(shown - mirrored) > 1e-3).mean(axis=(1, 2)).max() < 0.02


@pytest.mark.parametrize("wild", [0.0, np.nan, np.inf, -1.0])
def test_blindness_shows_nothing(wild):
    """No measurement: no view, no surface, no points, and all finite."""
    shown = Features().of(np.full((128, 128), wild, np.float32), UNKNOWN)
    assert np.isfinite(shown).all()
    assert (shown[[CLEARANCE, SURFACE, IN_VIEW, POINTS, BELIEF]] == 0).all()


def test_a_predictor_says_what_its_network_says():
    """Merging normalisation into convolutions changes nothing but rounding (1e-4)."""
    torch.manual_seed(0)
    module = MapModule()
    with torch.no_grad():
        for _ in range(3):
            module(torch.randn(4, 7, 64, 64))
    module.eval()
    depth = Room().depth(np.array([0.3, -0.4, 0.5]), size=128)
    predicted = MapPredictor(module.network()).predict(scan_from_depth(depth, CameraModel()), UNKNOWN)
    with torch.no_grad():
        expected = module(torch.from_numpy(Features().of(depth, UNKNOWN))[None])[0, OBSTACLE].numpy()
    np.testing.assert_allclose(predicted.obstacle, expected, atol=1e-4)
    assert 200_000 < module.network().parameters < 1_000_000


def test_a_prediction_is_the_same_after_any_copying():
    """The same bits from a predictor that went to another process and back as text, and from one in a new thread."""
    torch.manual_seed(0)
    predictor = MapPredictor(MapModule().network())
    scan = scan_from_depth(Room().depth(np.array([0.3, -0.4, 0.5]), size=128), CameraModel())
    first = predictor.predict(scan, UNKNOWN)
    with ThreadPoolExecutor(2) as pool:
        others = [*pool.map(lambda one: one.predict(scan, UNKNOWN), [predictor] * 4)]
    others.append(pickle.loads(pickle.dumps(predictor)).predict(scan, UNKNOWN))
    for other in others:
        np.testing.assert_array_equal(first.obstacle, other.obstacle)
        np.testing.assert_array_equal(first.seen, other.seen)


def test_scores_count_cells():
    """Four cells by hand: predicted 0.9, 0.8, 0.2, 0.4, true 1, 0, 0, 1, all seen.

    Overlap 1 of 3; squares .01 + .64 + .04 + .36 = 1.05 / 4; gaps .1 + .8 + .2 + .6 = 1.7 / 4 with a bin each.
    """
    scores = PatchScores()
    predicted = np.array([[0.9, 0.8], [0.2, 0.4]])
    true = np.array([[True, False], [False, True]])
    all_cells = np.ones((2, 2), bool)
    scores.add(predicted, true, all_cells, all_cells)
    got = scores.result()
    assert got["iou_seen"] == pytest.approx(1 / 3)
    assert got["brier_seen"] == pytest.approx(1.05 / 4)
    assert got["calibration_error_seen"] == pytest.approx(1.7 / 4)
    assert np.isnan(got["iou_hidden"])
    scores.add(predicted, true, ~all_cells, all_cells)
    assert scores.result()["iou_hidden"] == pytest.approx(1 / 3)
    assert scores.result()["iou_hidden_floor"] == pytest.approx(1 / 3)


def easy_frames(n: int, seed: int) -> Frames:
    """Frames in which obstacles are where the map believes them, and seen where there is a view."""
    rng = np.random.default_rng(seed)
    belief = rng.random((n, 8, 8)) < 0.5
    view = rng.random((n, 8, 8)) < 0.5
    features = np.zeros((n, 7, 8, 8), np.float32)
    features[:, BELIEF], features[:, IN_VIEW] = np.where(belief, 1, -1), view
    return Frames(features=coded(features), obstacle=belief, seen=view, matters=np.ones_like(view))


def test_training_learns_what_can_be_learnt(tmp_path):
    """Copying the map: from chance (0.33) to above 0.95 within 120 batches; the classical score is 1."""
    recipe = Recipe(network=SMALL, steps=120, every=40, batch=16, forget=0.0, rate=1e-2)
    network, curve = train(easy_frames(200, 0), easy_frames(40, 1), recipe, Checkpoint(tmp_path / "state.pt"))
    assert curve[-1]["iou_seen"] > 0.95
    assert [row["step"] for row in curve] == [40, 80, 120]
    assert network.parameters > 0
    assert classical_scores(easy_frames(40, 1))["iou_seen"] == 1.0


def test_interrupted_training_ends_the_same(tmp_path):
    """Stopped after the first checkpoint and taken up again: the same weights as in one go, to float32 rounding."""
    recipe = Recipe(network=SMALL, steps=20, every=10, batch=8)
    frames, held = easy_frames(60, 0), easy_frames(20, 1)
    whole, _ = train(frames, held, recipe, Checkpoint(tmp_path / "whole.pt"))

    def stop(step: int) -> None:
        if step == 13:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(frames, held, recipe, Checkpoint(tmp_path / "parts.pt"), stop)
    parts, curve = train(frames, held, recipe, Checkpoint(tmp_path / "parts.pt"))
    assert len(curve) == 2
    for name, value in whole.weights.items():
        np.testing.assert_allclose(parts.weights[name], value, rtol=1e-4, atol=1e-5)


def test_weights_come_back(tmp_path):
    """Saved and loaded: the same answers; without the card, or damaged, a sentence."""
    network = MapModule(SMALL).network()
    for name, content in files_of(network, {"about": "a test"}, "m").items():
        (tmp_path / name).write_bytes(content)
    loaded, card = load_mapper(str(tmp_path / "m.safetensors"))
    x = np.random.default_rng(0).normal(size=(1, 7, 64, 64)).astype(np.float32)
    np.testing.assert_array_equal(loaded(x), network(x))
    assert card["about"] == "a test"
    (tmp_path / "m.safetensors").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="not readable as weights of a mapper"):
        load_mapper(tmp_path / "m.safetensors")
