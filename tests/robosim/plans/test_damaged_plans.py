"""Damaged files of every format end in a plan or in one MapError, never in an error of another kind."""

import io
import json
import struct

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from robosim.plans.files import read_plan
from robosim.plans.floorplan import FloorPlan, MapError
from robosim.plans.formats.plan_image import encode_pgm

GREY = np.where(np.add.outer(np.arange(12), np.arange(16)) % 5 == 0, 0, 254).astype(np.uint8)


def image(kind, pixels=GREY, **options):
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind, **options)
    return buffer.getvalue()


def mesh(kind):
    box = trimesh.creation.box(bounds=[[0, 0, 0], [2, 1.5, 2.5]])
    box.faces = box.faces[:, ::-1]
    if kind == "glb":
        box.vertices = box.vertices[:, [0, 2, 1]] * (1, 1, -1)
    content = box.export(file_type=kind)
    return content.encode() if isinstance(content, str) else content


def array():
    buffer = io.BytesIO()
    np.save(buffer, GREY / 254)
    return buffer.getvalue()


YAML = (
    b"image: map.pgm\nmode: trinary\nresolution: 0.05\norigin: [-1.5, 2.25, 0.1]\nnegate: 0\n"
    b"occupied_thresh: 0.65\nfree_thresh: 0.196\nname: office\nwall_line: cell_centre\neroded_m: 0.1\n"
)
FILES = {
    "map.yaml": YAML,
    "image.pgm": encode_pgm(GREY),
    "text.pgm": b"P2\n# comment\n16 12\n255\n" + b"\n".join(b" ".join(b"%d" % v for v in r) for r in GREY),
    "deep.pgm": b"P5 16 12 65535 " + (GREY.astype(">u2") * 257).tobytes(),
    "grey.png": image("PNG"),
    "colour.png": image("PNG", np.dstack([GREY, GREY, GREY, np.full_like(GREY, 255)])),
    "deep.png": image("PNG", GREY.astype(np.uint16) * 257),
    "image.bmp": image("BMP"),
    "image.tif": image("TIFF"),
    "image.gif": image("GIF"),
    "image.jpg": image("JPEG"),
    "image.webp": image("WEBP", lossless=True),
    "grid.out": b"\n".join(b",".join(b"%d" % (v > 0) for v in row) for row in GREY),
    "house.json": json.dumps({"id": "a", "verts": [[0, 0], [2.5, 0], [2.5, 1], [0, 1.5]]}).encode(),
    "array.npy": array(),
    "room.ply": mesh("ply"),
    "room.stl": mesh("stl"),
    "room.obj": mesh("obj"),
    "room.off": mesh("off"),
    "room.glb": mesh("glb"),
}
SCALELESS = (".pgm", ".png", ".bmp", ".tif", ".gif", ".jpg", ".webp", ".npy")


def read(folder, name, content):
    """A plan, or None after a MapError of one line that names the file."""
    (folder / "map.pgm").write_bytes(encode_pgm(GREY))
    path = folder / name
    path.write_bytes(content)
    try:
        plan = read_plan(path, resolution_m=0.05 if name.endswith(SCALELESS) else None)
    except MapError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)
        return None
    assert isinstance(plan, FloorPlan)
    return plan


@st.composite
def damages(draw, content):
    """Cut short, bytes overwritten, a stretch taken out or put in twice, or numbers blown up."""
    kind = draw(st.sampled_from(["cut", "overwrite", "remove", "repeat", "insert", "number"]))
    start = draw(st.integers(0, len(content)))
    stop = min(len(content), start + draw(st.integers(0, 40)))
    if kind == "cut":
        return content[:start]
    if kind == "overwrite":
        new = bytearray(content)
        for _ in range(draw(st.integers(1, 8))):
            new[draw(st.integers(0, len(content) - 1))] = draw(st.integers(0, 255))
        return bytes(new)
    if kind == "remove":
        return content[:start] + content[stop:]
    if kind == "repeat":
        return content[:stop] + content[start:]
    if kind == "insert":
        return content[:start] + draw(st.binary(max_size=20)) + content[start:]
    number = draw(
        st.sampled_from(
            [b"\xff" * 4, b"\x7f\xff\xff\xff", b"-1", b"nan", b"1e999", struct.pack("<f", np.nan)]
        )
    )
    return content[:start] + number + content[start + len(number) :]


@pytest.mark.parametrize("name", FILES)
def test_undamaged_files_are_read(tmp_path, name):
    """So that the damage below is done to files that can be read."""
    assert read(tmp_path, name, FILES[name]) is not None


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_give_a_plan_or_a_map_error(tmp_path, name, data):
    """Any bytes: warnings count as errors here, and so does a message without the file's name."""
    read(tmp_path, name, data.draw(damages(FILES[name])))


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.binary(max_size=300))
def test_binary_garbage_gives_a_map_error(tmp_path, name, content):
    read(tmp_path, name, content)


@pytest.mark.parametrize("name", FILES)
def test_each_truncation_of_a_file_is_survived(tmp_path, name):
    """Every length up to 32, then forty lengths more; nothing may be read out of nothing."""
    content = FILES[name]
    lengths = {*range(min(32, len(content))), *np.linspace(0, len(content) - 1, 40).astype(int).tolist()}
    plans = [read(tmp_path, name, content[:length]) for length in sorted(lengths)]
    assert plans[0] is None
