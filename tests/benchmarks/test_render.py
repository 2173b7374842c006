"""The camera benchmark, run small: it measures what it says, and reports what does not work."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from robosim.building.building import Building, make_building
from robosim.camera.model import CameraConfig
from robosim.camera.rendering.gl_systems import OpenGLError, default_system
from robosim.camera.rendering.shading import shaded_mesh
from robosim.plans.floorplan import FloorPlan
from tests.benchmarks import race as race_module
from tests.benchmarks import render
from tests.benchmarks.peers import PEERS
from tests.benchmarks.race import Heat, Result, race
from tests.benchmarks.true_depth import DepthJudge

SMALL = {"sizes": (48,), "warm_up": 3, "turns": 3, "turn_s": 0.02, "n_poses": 2}


@pytest.fixture(scope="module")
def building() -> Building:
    """A room with a column."""
    occupancy = np.zeros((40, 50), np.uint8)
    occupancy[15:20, 20:26] = 1
    return make_building(FloorPlan(occupancy=occupancy, resolution_m=0.1, name="room"))


def test_cameras_are_compared_on_one_scene(building, tmp_path):
    """Ours, Embree, stock pyrender and MuJoCo: depth right to 1 mm + 0.1 %, rates and ratios that fit together.

    No camera is timed against a clock here; that the ratio of two rates is the ratio reported is arithmetic, up
    to medians over three turns of a busy machine.
    """
    system = default_system()
    suffix = "" if system == "osmesa" else "-egl"
    names = [f"{name}{suffix}" for name in ("pyrender", "pyrender-depth", "stock", "mujoco")] + ["embree"]
    table = render.run(building, out=tmp_path, peers=names, **SMALL)
    report = json.loads((tmp_path / "render.json").read_text())
    rows = {(row["camera"], row["images"]): row for row in report["rows"]}
    assert set(rows) == {(PEERS[name].label, PEERS[name].images) for name in names}
    assert report["judge_error_m"] < 1e-6
    for row in rows.values():
        assert row["trouble"] == ""
        assert row["size_px"] == 48
        assert row["frames_per_s"] > 0
        assert row["ours_faster"] > 0
        assert row["cpu_ms"] > 0
        if row["camera"] == "pyrender on EGL, stock, flat":
            continue  # the depth of one of four samples, which is not at the pixel's centre
        assert 0 < row["mean_error_mm"] <= row["max_error_mm"] < 10
        assert row["beyond"] == 0
    for images in ("rgb+depth", "depth"):
        ours = rows[PEERS[f"pyrender{suffix}"].label, images]
        assert ours["ours_faster"] == ours["ours_cheaper"] == 1
        for row in rows.values():
            if row["images"] == images:
                assert row["ours_cheaper"] == pytest.approx(row["cpu_ms"] / ours["cpu_ms"])
    assert (tmp_path / "render.png").stat().st_size > 10_000
    console = Console(record=True, width=200, file=io.StringIO())
    console.print(table)
    assert "mujoco.Renderer" in console.export_text()


def test_a_camera_that_does_not_work_is_reported(building, tmp_path, monkeypatch):
    """One that cannot start has its reason in the table instead of numbers."""
    monkeypatch.setenv("EGL_DEVICE_ID", "97")
    config = CameraConfig(width=16, height=16)
    heat = Heat(shaded_mesh(building), render.random_views(building, config, 2), config)
    (result,) = race(heat, ["pyrender-egl"], tmp_path, warm_up=1, turns=1, turn_s=0.01)
    assert result.seconds.size == 0
    assert result.trouble
    (row,) = render._rows([result], heat, DepthJudge(building.mesh, config))
    assert row.trouble == result.trouble
    assert np.isnan(row.frames_per_s)


def test_without_opengl_the_rest_is_measured(building, tmp_path, monkeypatch):
    """Where OSMesa and EGL are missing Embree is what others are compared with, and the reasons are told."""
    lacks = {
        "osmesa": OpenGLError("OSMesa is not installed.", "install it"),
        "egl": OpenGLError("EGL is not installed.", "install it"),
    }
    for module in (race_module, render):
        monkeypatch.setattr(module, "missing", lacks.get)
    table = render.run(building, out=tmp_path, peers=["pyrender", "stock-egl", "embree"], **SMALL)
    rows = json.loads((tmp_path / "render.json").read_text())["rows"]
    assert {row["camera"]: row["trouble"] for row in rows} == {
        "robosim, pyrender on OSMesa": str(lacks["osmesa"]),
        "pyrender on EGL, stock, flat": str(lacks["egl"]),
        "robosim, Embree": "",
    }
    assert rows[-1]["ours_faster"] == 1
    assert (tmp_path / "render.png").stat().st_size > 10_000
    assert table.row_count == 1
    assert (
        "Left out: robosim, pyrender on OSMesa. OSMesa is not installed. To do: install it." in table.caption
    )


def test_where_nothing_is_measured_the_reasons_are_the_message(building, tmp_path, monkeypatch):
    """No empty plot, whose axes cannot be logarithmic."""
    nothing = Result("embree", np.empty(0), np.empty(0), trouble="no Embree here.")
    monkeypatch.setattr(render, "race", lambda *_, **__: [nothing])
    with pytest.raises(
        RuntimeError, match=r"No camera took a picture\. Left out: robosim, Embree\. no Embree"
    ):
        render.run(building, out=tmp_path, peers=["embree"], **SMALL)


def test_an_unknown_camera_is_refused(building, tmp_path):
    """The message lists the known ones."""
    with pytest.raises(ValueError, match=r"'pyrendr', expected names among pyrender, "):
        render.run(building, out=tmp_path, peers=["pyrendr"], **SMALL)


def test_views_are_the_same_every_time_and_inside(building):
    """Ten views from free floor, equal bit for bit on a second call."""
    views = render.random_views(building, CameraConfig(), 10)
    assert np.array_equal(views, render.random_views(building, CameraConfig(), 10))
    x, y = views[:, 0, 3], views[:, 1, 3]
    assert ((x > 0.2) & (x < 4.8) & (y > 0.2) & (y < 3.8)).all()
    assert not ((x > 1.9) & (x < 2.7) & (y > 1.4) & (y < 2.1)).any()
