"""Uploaded plans."""

import io

import numpy as np
import pytest
import trimesh
from PIL import Image

from robosim.live.own_plan import plan_of
from robosim.plans.floorplan import MapError


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
