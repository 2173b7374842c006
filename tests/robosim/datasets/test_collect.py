"""Frames for training: reproducible, complete, and true."""

import numpy as np
import pytest
from rich.console import Console
from scipy.ndimage import maximum_filter

from robosim.building.building import make_building
from robosim.camera.cameras import make_camera
from robosim.camera.depth_noise import DepthNoise
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.rendering.shading import shaded_mesh
from robosim.datasets.collect import CollectConfig, collect, collect_home, home_building
from robosim.datasets.true_patch import TruePatches
from robosim.robot.odometry import NoiseModel
from slam.poses import between
from tests.plans import two_rooms

SMALL = CollectConfig(homes=2, steps=8, seed=3)


def test_files_do_not_depend_on_workers_or_interruptions(tmp_path):
    """One worker, two workers, and a run that finds one of two shards: the same bytes."""
    quiet = Console(quiet=True)
    first = collect(SMALL, tmp_path / "one", workers=1, console=quiet)
    second = collect(SMALL, tmp_path / "two", workers=2, console=quiet)
    contents = [path.read_bytes() for path in first]
    assert [path.read_bytes() for path in second] == contents
    second[0].unlink()
    before = second[1].stat().st_mtime_ns
    collect(SMALL, tmp_path / "two", workers=1, console=quiet)
    assert [path.read_bytes() for path in second] == contents
    assert second[1].stat().st_mtime_ns == before
    assert contents[0] != contents[1]


def test_other_settings_are_not_mixed_in(tmp_path):
    quiet = Console(quiet=True)
    collect(CollectConfig(homes=1, steps=2), tmp_path, workers=1, console=quiet)
    with pytest.raises(ValueError, match="other settings"):
        collect(CollectConfig(homes=1, steps=3), tmp_path, workers=1, console=quiet)


def test_frames_are_what_the_true_poses_see():
    """Without noise: depth is that of another camera at the stored pose, odometry chains poses, truth is the patch."""
    still = CollectConfig(homes=1, steps=12, depth_noise=DepthNoise(), noise=NoiseModel(level=0.0))
    building = home_building(still, 0)
    frames = collect_home(building, still, seed=0)
    camera = make_camera([shaded_mesh(building)], CameraConfig())
    patches = TruePatches(building)
    for i in range(12):
        depth = camera.render(camera_pose(frames["pose"][i], CameraConfig())).depth
        off = np.abs(frames["depth"][i] / 1000 - depth)
        assert (off > 0.002).mean() < 0.05  # the target's post may be in the picture
        truth = np.unpackbits(frames["truth"][i], axis=-1).astype(bool)
        assert (truth == patches.at(frames["pose"][i])).all()
        if i and frames["action"][i] >= 0:
            np.testing.assert_allclose(
                frames["odometry"][i], between(frames["pose"][i - 1], frames["pose"][i]), atol=1e-6
            )
    camera.close()


def test_beliefs_resemble_the_truth():
    """The classical map ahead: in seen cells, its obstacles are true ones or next to one (bound 90 %, is 95).

    Walls lie on the borders of cells here, so noise puts them into either cell. A patch with a wrong
    turn, or at a wrong pose, has its walls anywhere. The target's post is no obstacle, and in the picture for a while.
    """
    frames = collect_home(make_building(two_rooms(0.8)), CollectConfig(steps=30), seed=1)
    truth = np.unpackbits(frames["truth"], axis=-1).astype(bool)
    obstacle = (frames["belief"] > 127) & truth[:, 1]
    assert obstacle.sum() > 100
    near = maximum_filter(truth[:, 0], size=(1, 3, 3))
    assert (near & obstacle).sum() > 0.9 * obstacle.sum()
