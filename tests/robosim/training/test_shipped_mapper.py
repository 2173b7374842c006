"""The shipped mapper against the classical map, in homes that it was not trained on, and in an episode."""

import shutil

import numpy as np
import pytest
from rich.console import Console
from torch_modules import module_of

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.depth_noise import DepthNoise
from robosim.datasets.collect import CollectConfig, collect, collect_home, home_building
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.navigation import make_navigator
from robosim.plans.files import read_plan
from robosim.robot.robots import RobotConfig
from robosim.simulator import SimulatorConfig
from robosim.support.installation import shipped_network
from robosim.support.run_folder import FolderError
from robosim.task.tasks import make_task
from robosim.training.mapper import read_frames, train_mapper
from slam.learning.mapper import Recipe, classical_scores, validate
from slam.networks.files import load_mapper

QUIET = Console(quiet=True)


def test_it_beats_the_classical_map_in_new_homes(tmp_path):
    """Three homes of another seed, 25 frames each, sensor noise on.

    Bounds: IoU of obstacles in view above 0.8 and above the classical map's; hidden obstacles 0.1 above; calibration
    within 0.02 in view.
    """
    network, card = load_mapper(shipped_network("mapper"))
    frames = read_frames(
        collect(CollectConfig(homes=3, steps=25, seed=77), tmp_path, workers=1, console=QUIET)
    )
    learned, classical = validate(module_of(network), frames), classical_scores(frames)
    assert learned["iou_seen"] > max(0.8, classical["iou_seen"] + 0.02)
    assert learned["iou_hidden"] > classical["iou_hidden"] + 0.1
    assert learned["calibration_error_seen"] < 0.02
    assert card["parameters"] < 1_000_000
    assert shipped_network("mapper").stat().st_size < 5_000_000


def test_an_episode_with_it():
    """Sixty decisions: finite maps, anticipation beyond what was observed, a pose within 0.2 m, and the same again."""
    building = make_building(read_plan("flat"))
    places = reach(building, 0.1)
    task = make_task(places, np.random.default_rng(0))
    config = EpisodeConfig(
        goal="explore",
        mapper="neural",
        max_steps=60,
        simulator=SimulatorConfig(physics="kinematic", robot=RobotConfig(depth_noise=DepthNoise(level=1.0))),
    )
    log, estimate = run_episode(building, places, task, config)
    assert estimate.anticipated_probability is not None
    assert np.isfinite(estimate.anticipated_probability).all()
    guessed = (estimate.anticipated_probability != 0.5) & (estimate.obstacle_probability == 0.5)
    assert guessed.sum() > 200
    assert np.hypot(*(log.poses[-1] - log.estimates[-1])[:2]) < 0.2
    again, _ = run_episode(building, places, task, config)
    np.testing.assert_array_equal(log.estimates, again.estimates)


def test_unknown_mappers_are_rejected(tmp_path):
    with pytest.raises(ValueError, match="Did you mean 'neural'"):
        EpisodeConfig(mapper="neurl")
    with pytest.raises(ValueError, match="no such file"):
        EpisodeConfig(mapper="missing.safetensors")
    (tmp_path / "other.safetensors").write_text("not weights")
    with pytest.raises(ValueError, match=r"other\.json: no such file, expected the card of a mapper"):
        make_navigator(SimulatorConfig(), mapper=str(tmp_path / "other.safetensors"))


def test_training_from_shards_to_weights(tmp_path):
    """Two homes, four batches: weights, card, curves; other frames are not mixed in; one home is too few."""
    collect(CollectConfig(homes=2, steps=6), tmp_path / "data", workers=1, console=QUIET)
    recipe = Recipe(steps=4, every=2, batch=4)
    card = train_mapper(tmp_path / "data", tmp_path / "out", recipe, threads=1, console=QUIET)
    assert (tmp_path / "out" / "curves.png").stat().st_size > 1000
    network, stored = load_mapper(tmp_path / "out" / "mapper.safetensors")
    assert stored["parameters"] == card["parameters"] == network.parameters
    assert "1 homes, 6 frames; held out 1, 6 frames" in stored["data"]
    shutil.copy(tmp_path / "data" / "home-00001.npz", tmp_path / "data" / "home-00000.npz")
    with pytest.raises(FolderError, match="holds results of other settings: homes"):
        train_mapper(tmp_path / "data", tmp_path / "out", recipe, threads=1, console=QUIET)
    (tmp_path / "data" / "home-00001.npz").unlink()
    with pytest.raises(ValueError, match="expected two or more"):
        train_mapper(tmp_path / "data", tmp_path / "out2", recipe, threads=1, console=QUIET)
    (tmp_path / "data" / "home-00001.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(ValueError, match="not readable as a shard"):
        read_frames([tmp_path / "data" / "home-00001.npz"])


def test_homes_of_a_seed_are_different():
    """Numbers of homes lead to different buildings, and the two forms of plans both occur."""
    config = CollectConfig(steps=1)
    homes = [home_building(config, home) for home in range(8)]
    assert len({home.plan.name for home in homes}) == 8
    assert {home.plan.wall_line for home in homes} == {"cell_edge", "cell_centre"}
    assert len(collect_home(homes[0], config, seed=0)["depth"]) == 1
