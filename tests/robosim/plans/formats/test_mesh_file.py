"""Mesh files that declare more than they hold, name other files, or lie beyond all buildings."""

import base64
import json
import os
import struct
import time

import numpy as np
import pytest
import trimesh

from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from robosim.plans.formats.mesh_file import load_triangles

#: A room: floor and four walls, y upwards, as glTF has it.
CORNERS = np.array(
    [[0, 0, 0], [5, 0, 0], [5, 0, 4], [0, 0, 4], [0, 2, 0], [5, 2, 0], [5, 2, 4], [0, 2, 4]], "<f4"
)
FACES = np.array(
    [
        [0, 2, 1],
        [0, 3, 2],
        [0, 1, 5],
        [0, 5, 4],
        [1, 2, 6],
        [1, 6, 5],
        [2, 3, 7],
        [2, 7, 6],
        [3, 0, 4],
        [3, 4, 7],
    ],
    "<u4",
)
DATA = CORNERS.tobytes() + FACES.tobytes()


def gltf(uri=None, **changes) -> dict:
    """The room as a glTF tree."""
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 30, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 96},
            {"buffer": 0, "byteOffset": 96, "byteLength": 120},
        ],
        "buffers": [{"byteLength": len(DATA), **({"uri": uri} if uri else {})}],
        **changes,
    }


def glb(tree: dict) -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(DATA), b"BIN\0") + DATA
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def rejection(path, content=None):
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    begin = time.process_time()
    with pytest.raises(MapError) as error:
        read_plan(path)
    assert time.process_time() - begin < 5
    assert str(path) in str(error.value) and "\n" not in str(error.value)
    return str(error.value)


def test_buffers_may_lie_in_the_file_and_next_to_it(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "my room.bin").write_bytes(DATA)
    trees = {
        "outside.gltf": gltf("sub/my%20room.bin"),
        "within.gltf": gltf("data:application/octet-stream;base64," + base64.b64encode(DATA).decode()),
    }
    for name, tree in trees.items():
        (tmp_path / name).write_text(json.dumps(tree))
    (tmp_path / "room.glb").write_bytes(glb(gltf()))
    plans = [read_plan(tmp_path / name) for name in (*trees, "room.glb")]
    assert all(plan.free.sum() == plans[0].free.sum() > 7000 for plan in plans)


def test_buffers_in_other_folders_are_not_opened(tmp_path):
    """Neither devices nor pipes, which would never end, nor files outside of the folder, which are not its own."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    assert "is a named pipe" in rejection(tmp_path / "a.gltf", gltf("pipe"))
    assert "is a device" in rejection(tmp_path / "a.gltf", gltf("zero"))
    assert "no such file" in rejection(tmp_path / "a.gltf", gltf("missing.bin"))
    assert "expected a file in its own folder" in rejection(tmp_path / "a.gltf", gltf("/etc/passwd"))
    assert "expected a file in its own folder" in rejection(tmp_path / "a.gltf", gltf("../room.bin"))
    assert "expected a file in its own folder" in rejection(tmp_path / "a.glb", glb(gltf("%2e%2e/room.bin")))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"accessors": [{"componentType": 5126, "count": 10**9, "type": "VEC3"}] * 2}, "bytes of data"),
        ({"accessors": [*gltf()["accessors"] * 100_000]}, "lists 200000 accessors"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 216}] * 20_000}, "bytes of data"),
        (
            {"accessors": [{"bufferView": 0, "componentType": 5126, "count": -8, "type": "VEC3"}]},
            "count is -8",
        ),
        ({"nodes": [{"mesh": 0}] * 20_000, "scenes": [{"nodes": list(range(20_000))}]}, "20000 parts"),
        ({"meshes": [{"primitives": gltf()["meshes"][0]["primitives"] * 20_000}]}, "20000 parts"),
        ({"nodes": [{"mesh": 0, "children": [i + 1]} for i in range(999)] + [{"mesh": 0}]}, "deep"),
        ({"nodes": [{"mesh": 0, "children": [1, 2, 3]}] + [{"children": [1, 2, 3]}] * 3}, "several parents"),
        ({"nodes": [{"mesh": 0, "scale": [1e30] * 3}]}, "lies"),
        ({"nodes": [{"mesh": 0, "translation": [1e300, 0, 0]}]}, "lies"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "Draco"),
        ({"meshes": {}}, "'meshes' is no list"),
        ({"nodes": [{"mesh": 7}]}, "mesh"),
    ],
)
def test_scenes_that_unfold_without_end_are_rejected_before_they_do(tmp_path, changes, words):
    assert words in rejection(tmp_path / "a.glb", glb(gltf(**changes)))


def test_a_node_within_itself_ends(tmp_path):
    (tmp_path / "a.glb").write_bytes(glb(gltf(nodes=[{"mesh": 0, "children": [0]}])))
    assert read_plan(tmp_path / "a.glb").free.any()


def test_coordinates_beyond_all_buildings_are_rejected(tmp_path):
    far = trimesh.Trimesh(CORNERS.astype(float) * 1e30, FACES, process=False)
    assert "lies 5e+30 m away, expected at most 1e+07 m" in rejection(
        tmp_path / "far.stl", far.export(file_type="stl")
    )
    with pytest.raises(MapError, match="expected at most"):
        read_plan(tmp_path / "far.stl", unit_m=1e-9)


def test_coordinates_rounded_to_32_bits_at_utm_are_rejected(tmp_path):
    """STL holds 32-bit numbers; the same building as text keeps its digits."""
    rotated = trimesh.Trimesh(
        CORNERS[:, [0, 2, 1]] * 1.137 + (691_607.3, 5_334_760.7, 519.0), FACES, process=False
    )
    assert "y is rounded to 0.5 m" in rejection(tmp_path / "utm.stl", rotated.export(file_type="stl"))
    text = rotated.export(file_type="obj", digits=8)
    np.testing.assert_allclose(
        np.ptp(load_triangles(text.encode(), tmp_path / "utm.obj").reshape(-1, 3), 0)[0], 5 * 1.137
    )


def test_more_storeys_than_any_building_has_are_rejected(tmp_path):
    floor = np.array([[0, 0, 0], [5, 0, 0], [5, 5, 0]])
    tower = floor + np.arange(5000)[:, None, None] * (0, 0, 3)
    mesh = trimesh.Trimesh(tower.reshape(-1, 3), np.arange(15_000).reshape(-1, 3), process=False)
    assert "more than 300 storeys" in rejection(tmp_path / "tower.stl", mesh.export(file_type="stl"))


def test_materials_and_groups_of_an_obj_file_change_nothing(tmp_path):
    """Twenty thousand of them would each become a mesh; faces are said with textures, normals and over two lines."""
    lines = [f"v {x} {-z} {y} 0.5 0.5 0.5" for x, y, z in CORNERS]
    plain = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    rich = [
        f"usemtl m{i}\no part{i}\ns off\r\nvt 0 0\n f {a + 1}/1/{i} {b + 1}//2 \\\n {c + 1}/3 # side"
        for i, (a, b, c) in enumerate(FACES)
    ]
    many = "\n".join(f"usemtl m{i}\ng group{i}" for i in range(20_000))
    path = tmp_path / "room.obj"
    begin = time.process_time()
    got = load_triangles("\n".join([*lines, *rich, many]).encode(), path)
    assert time.process_time() - begin < 5
    np.testing.assert_array_equal(got, load_triangles("\n".join([*lines, *plain]).encode(), path))
    assert len(got) == len(FACES)


def test_mirrored_meshes_keep_their_faces_outside(tmp_path):
    """As trimesh's own concatenation has it."""
    tree = gltf(
        nodes=[{"mesh": 0, "scale": [-1, 1, 1], "translation": [9, 0, 1]}, {"mesh": 0}],
        scenes=[{"nodes": [0, 1]}],
    )
    path = tmp_path / "a.glb"
    path.write_bytes(glb(tree))
    mesh = trimesh.load_scene(path, process=False).to_mesh()
    np.testing.assert_allclose(
        load_triangles(path.read_bytes(), path).mean(axis=1), mesh.triangles.mean(axis=1)
    )
    normals = np.cross(*np.diff(load_triangles(path.read_bytes(), path), axis=1).transpose(1, 0, 2))
    np.testing.assert_allclose(np.sign(normals.sum(axis=1)), np.sign(mesh.face_normals.sum(axis=1)))


@pytest.mark.parametrize("stored", [84, 84 + 50 * 3, 84 + 50 * 9 + 20])
def test_an_stl_file_that_was_cut_off_is_rejected(tmp_path, stored):
    """What is left is treated as a text by trimesh; the message says how many of the ten triangles are there."""
    whole = trimesh.Trimesh(CORNERS, FACES).export(file_type="stl")
    assert len(load_triangles(whole, tmp_path / "room.stl")) == 10
    output = rejection(tmp_path / "room.stl", whole[:stored])
    assert "it says 10 triangles" in output and f"only {(stored - 84) // 50} are in it" in output
