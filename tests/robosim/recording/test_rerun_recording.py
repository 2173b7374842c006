"""Recordings for the Rerun viewer, read back without one; and what is said where Rerun is missing."""

import re
import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest

from robosim.cli import main
from robosim.drawing.plan_view import PALETTE
from robosim.episode_config import EpisodeConfig
from robosim.recording.episode_file import read_episode
from robosim.recording.rerun_recording import RAY_COLOURS, RECORDING, ray_kind, rerun_sdk
from robosim.run import record_episode
from robosim.simulator import SimulatorConfig
from robosim.support.installation import install_command
from tests.plans import two_rooms
from wireless.paths import Interaction

STEPS = 8
START, TARGET = np.array([1.0, 0.6, 0.7]), np.array([5.0, 2.4])
HEIGHT_M = 1.5


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recorded episode."""
    pytest.importorskip("rerun", reason="needs rerun-sdk, a download of 170 MB: pip install -e '.[viz]'")
    folder = tmp_path_factory.mktemp("episode")
    config = EpisodeConfig(
        goal="fused", link_states="true", simulator=SimulatorConfig(physics="kinematic"), max_steps=STEPS
    )
    record_episode(two_rooms(0.8), config, folder, start=START, target=TARGET, video=False, rerun=True)
    return folder


@pytest.fixture(scope="module")
def columns(recorded):
    """By entity and component: a value for each decision."""
    from rerun.chunk import RrdReader

    found: dict[str, dict[str, list]] = defaultdict(lambda: defaultdict(list))
    for chunk in RrdReader(recorded / RECORDING).store().stream():
        batch = chunk.to_record_batch()
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            found[chunk.entity_path][name] += column.to_pylist()
    return found


@pytest.fixture(scope="module")
def steps(recorded):
    return list(read_episode(recorded).steps())


def test_every_decision_has_every_kind_of_data(columns):
    """One row a decision, numbered from 0; walls, target and lens once."""
    for entity in (
        "world/camera/rgb", "world/camera/depth", "world/true", "world/estimated", "world/built", "world/belief",
        "world/goal", "world/path", "world/rays", "world/arrivals", "link/true_state", "link/believed_state",
        "link/snr_db", "link/probability/los", "belief/mass_at_peak", "pose/position_error_m",
    ):  # fmt: skip
        assert columns[f"/{entity}"]["decision"] == list(range(STEPS)), entity
    for entity in ("world/walls", "world/target"):
        assert "decision" not in columns[f"/{entity}"]


def test_pictures_and_poses_are_those_of_the_log(columns, steps):
    """Colours bit-identical; depth to half a millimetre; where the camera, the goal and the two robots are."""
    for i, step in enumerate(steps):
        rgb = np.array(columns["/world/camera/rgb"]["Image:buffer"][i][0], np.uint8)
        np.testing.assert_array_equal(rgb.reshape(step.sensed.rgb.shape), step.sensed.rgb)
        depth = np.array(columns["/world/camera/depth"]["DepthImage:buffer"][i][0], np.uint8).view(np.float32)
        assert np.abs(depth.reshape(step.sensed.depth.shape) - step.sensed.depth).max() < 0.6e-3
        goal = columns["/world/goal"]["Points3D:positions"][i][0]
        np.testing.assert_allclose(goal[:2], step.decided.goal, atol=1e-6)
        for name, pose in (("true", step.true.pose), ("estimated", step.estimated.pose)):
            arrow = columns[f"/world/{name}"]
            np.testing.assert_allclose(arrow["Arrows3D:origins"][i][0][:2], pose[:2], atol=1e-6)
            x, y, _ = arrow["Arrows3D:vectors"][i][0]
            assert np.arctan2(y, x) == pytest.approx(pose[2], abs=1e-6)
    shift = [row for row in columns["/world/camera"]["Transform3D:translation"] if row]
    np.testing.assert_allclose(
        [row[0][:2] for row in shift], [step.true.pose[:2] for step in steps], atol=1e-6
    )


def test_rays_lead_from_the_target_to_the_robot(columns, steps):
    """Each begins at the transmitter and ends at the true place; as many points as its kind needs."""
    kinds = set()
    for i, step in enumerate(steps):
        strips, labels = (columns["/world/rays"][f"LineStrips3D:{name}"][i] for name in ("strips", "labels"))
        assert len(strips) == len(labels) > 0
        for strip, label in zip(strips, labels, strict=True):
            np.testing.assert_allclose(strip[0], [*TARGET, HEIGHT_M], atol=1e-5)
            np.testing.assert_allclose(strip[-1], [*step.true.pose[:2], HEIGHT_M], atol=1e-5)
            assert (len(strip) == 2) == (label == "line of sight")
            assert np.isfinite(strip).all()
        kinds.update(labels)
    assert kinds <= set(RAY_COLOURS)
    assert len(kinds) > 1


def test_arrivals_point_as_measured(columns, steps):
    for i, step in enumerate(steps):
        vectors = np.array(columns["/world/arrivals"]["Arrows3D:vectors"][i]).reshape(-1, 3)
        angles = np.arctan2(vectors[:, 1], vectors[:, 0])
        np.testing.assert_allclose(
            np.exp(1j * angles), np.exp(1j * step.estimated.measurement.aoa_rad), atol=1e-5
        )
        assert columns["/link/snr_db"]["Scalars:scalars"][i] == [
            pytest.approx(step.estimated.measurement.snr_db[0])
        ]
        state = step.estimated.measurement.state.name.lower().replace("_", " ")
        assert columns["/link/believed_state"]["StateChange:state"][i] == [state]
        assert columns["/link/true_state"]["StateChange:state"][i] == [state]


def test_maps_have_their_place_and_orientation(columns, steps):
    """The first row of a picture is drawn at its top: y downwards, as the log's from below."""
    grid = columns["/world/built"]
    for i, step in enumerate(steps):
        rows, width = step.map_layer.values.shape
        data = np.array(grid["GridMap:data"][i][0], np.uint8).reshape(rows, width, 4)
        np.testing.assert_array_equal(data[::-1, :, :3], PALETTE[step.map_layer.values, 0])
        np.testing.assert_allclose(
            grid["GridMap:translation"][i][0][:2], step.map_layer.frame.origin_xy, atol=1e-5
        )
        belief = np.array(columns["/world/belief"]["GridMap:data"][i][0], np.uint8)
        assert (
            belief.reshape(*step.belief_layer.values.shape, 4)[::-1, :, 3] > 0
        ).any() == step.belief_layer.values.any()


def test_rerun_itself_finds_the_file_valid(recorded):
    command = [sys.executable, "-m", "rerun", "rrd", "verify", str(recorded / RECORDING)]
    assert subprocess.run(command, capture_output=True, timeout=1200).returncode == 0
    assert not list(recorded.glob(".*partial*"))


def test_kinds_of_rays():
    none, reflection, diffraction = Interaction.NONE, Interaction.REFLECTION, Interaction.DIFFRACTION
    for met, kind in (
        ((none, none), "line of sight"),
        ((reflection, reflection), "reflection"),
        ((diffraction, none), "diffraction"),
        ((diffraction, reflection), "reflection and diffraction"),
        ((Interaction.TRANSMISSION, reflection), "transmission"),
        ((Interaction.SCATTERING, none), "scattering"),
    ):
        assert ray_kind(np.array(met, np.uint8)) == kind


def test_without_rerun_the_fix_is_named_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ValueError, match=re.escape(install_command("viz"))):
        rerun_sdk()
    with pytest.raises(ValueError, match=r"robosim replay DIR"):
        record_episode(two_rooms(0.8), EpisodeConfig(), tmp_path / "out", rerun=True)
    assert not (tmp_path / "out").exists()


def test_an_episode_without_a_recording_cannot_be_viewed(tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["view", str(tmp_path)])
    assert stopped.value.code == 2
    assert "Run the episode with --rerun." in capsys.readouterr().err.replace("\n", " ")
