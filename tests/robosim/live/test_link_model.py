"""The link of the page: places, paths and radio maps; uploaded plans."""

import io
from dataclasses import replace

import numpy as np
import pytest
import shapely
import trimesh
from PIL import Image

from robosim.building.building import BuildingConfig
from robosim.live.link_model import LinkModel, plan_of
from robosim.live.radio_view import radio_maps
from robosim.live.scene_nodes import linear, power_colours, ray_kind
from robosim.plans.floorplan import MapError
from robosim.radio.scene import RadioConfig
from slam.poses import wrap
from tests.plans import two_rooms
from wireless.paths import Interaction, Paths
from wireless.tracing.tracer import Tracer


@pytest.fixture(scope="module")
def model() -> LinkModel:
    return LinkModel(two_rooms(0.8), RadioConfig())


def link(model: LinkModel, *ends: np.ndarray) -> Paths:
    """Paths between two places on the lowest storey."""
    tx, rx = (model.antenna(place[:2])[None] for place in ends)
    return model.trace(tx, rx)


def test_a_handle_in_a_wall_stops_next_to_it(model):
    """From inside the wall between the rooms to 0.05 m from it; from far away to the nearest room."""
    assert model.nearest_free(np.array([1.0, 2.0])) == pytest.approx([1.0, 2.0])
    place = model.nearest_free(np.array([3.05, 0.5]))
    assert place == pytest.approx([3.0 - model.clearance_m, 0.5], abs=1e-6)
    far = model.nearest_free(np.array([100.0, 1.0]))
    assert model.building.free.covers(shapely.Point(far))
    assert np.isfinite(model.nearest_free(np.array([np.nan, 1.0]))).all()


def test_the_first_link_has_several_paths(model):
    tx = model.first_place()
    assert len(link(model, tx, model.place_out_of_sight(tx))) > 1


def test_settings_change_the_paths_as_the_tracer_does(model):
    """Behind a wall nothing arrives but by reflection and diffraction; ten times the frequency costs 20 dB (Friis)."""
    tx, rx = np.array([1.0, 1.5]), np.array([5.0, 1.5])  # through the door
    bare = replace(model.config.tracer, max_reflections=0, diffraction=False)
    one = model.with_config(replace(model.config, tracer=bare))
    assert one.building is model.building, "only the wall material changes the building"
    assert len(link(one, tx, rx)) == 1
    assert len(link(one, tx, np.array([5.0, 0.3]))) == 0
    low = one.with_config(replace(one.config, frequency_hz=2.8e9))
    gain = link(low, tx, rx).power_db[0] - link(one, tx, rx).power_db[0]
    assert gain == pytest.approx(20.0, abs=1e-6)
    glass = model.with_config(replace(model.config, building=BuildingConfig(wall_material="glazing")))
    assert glass.building is not model.building
    assert "glazing" in glass.building.materials


def test_antennas_above_the_ceiling_are_rejected(model):
    with pytest.raises(
        ValueError, match=r"height is 3 m, expected antennas between floor and ceiling, 0 to 2\.5 m"
    ):
        model.with_config(replace(model.config, height_m=3.0))


def test_radio_maps_become_finer_and_match_the_tracer(model):
    """Colours of the finest map equal those of an independent trace of all places."""
    tx = np.array([1.0, 1.5, 1.5])
    levels = list(radio_maps(model, tx, "received power", lambda: False))
    steps = [level.step_m for level in levels]
    assert steps == sorted(steps, reverse=True) and len(steps) >= 3
    last = levels[-1]
    paths = Tracer(model.building).trace(tx[None], last.grid.position)
    first = paths.select(paths.rank == 0)
    row, column = last.grid.cell[first.rx].T
    expected = power_colours(model.config.tx_power_dbm + first.power_db)
    assert np.array_equal(last.rgba[row, column, :3], expected)
    assert (last.rgba[..., 3] > 0).sum() == len(first)


def test_a_stale_map_is_aborted(model):
    assert list(radio_maps(model, np.array([1.0, 1.5, 1.5]), "link state", lambda: True)) == []


def test_the_receiver_measures_the_traced_paths(model):
    """In line of sight the strongest estimate is within a degree of the direct path, and the same for the same seed."""
    tx, pose = np.array([0.6, 0.6]), np.array([2.6, 1.9, 0.3])
    measurement, _ = model.measure(tx, pose, seed=0)
    direct = np.arctan2(*(tx - pose[:2])[::-1])
    assert abs(np.degrees(wrap(measurement.aoa_rad[0] - direct))) < 1.0
    again, _ = model.measure(tx, pose, seed=0)
    assert np.array_equal(again.aoa_rad, measurement.aoa_rad)


def test_linear_colours_follow_srgb():
    """IEC 61966-2-1 at both ends, and at half of the light, which is 188 in sRGB."""
    assert linear(np.array([[0, 255, 188]], np.uint8)).tolist() == [[0, 255, 128]]


def test_a_picture_is_a_plan_of_its_name():
    """A light room of 40 x 20 pixels at 0.1 m: 4 m x 2 m of floor."""
    picture = np.zeros((30, 50), np.uint8)
    picture[5:25, 5:45] = 255
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "png")
    plan, warning = plan_of("C:\\homes\\my home.png", buffer.getvalue(), 0.1)
    assert (plan.name, warning) == ("my home", "")
    assert plan.free.sum() * plan.resolution_m**2 == pytest.approx(8.0)


def test_a_mesh_is_a_plan():
    room = trimesh.creation.box(bounds=[[0, 0, 0], [4, 3, 2.5]])
    room.invert()
    plan, _ = plan_of("room.stl", room.export(file_type="stl"), 0.3)
    assert plan.free.sum() * plan.resolution_m**2 == pytest.approx(12.0, abs=0.7)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("map.yaml", b"image: /etc/passwd", "map.yaml: expected one file that refers to no other"),
        ("../../plan", b"", "plan: expected one file"),
        ("damaged.png", b"no picture", "damaged.png"),
        ("damaged.stl", b"no mesh", "damaged.stl"),
        ("two\nlines.png", b"", r"the file's name is 'two\nlines.png', expected printable text"),
        ("", b"", "the file's name is '', expected printable text"),
        ("folder/ .png", b"", "the file's name is ' .png'"),
        ("scene.gltf", b"{}", "scene.gltf: expected one file"),
    ],
)
def test_a_bad_file_is_rejected_by_its_own_name(name, content, words):
    with pytest.raises(MapError) as raised:
        plan_of(name, content, 0.05)
    assert words in str(raised.value)
    assert "robosim-live-" not in str(raised.value)


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
