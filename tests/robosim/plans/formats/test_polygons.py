"""Mesh files as other programs write them: the same L-shaped body of known area and volume out of every dialect."""

import base64
import json
import struct
from itertools import permutations

import numpy as np
import pytest
import shapely

from robosim.plans.formats.mesh_file import load_triangles
from robosim.plans.formats.polygons import Polygons, triangulate

#: An L of 6 x 4 m2 less 3 x 2 m2, 2.5 m high: 18 m2, 45 m3; surface 2 x 18 + 20 x 2.5 = 86 m2.
OUTLINE = [(0, 0), (6, 0), (6, 2), (3, 2), (3, 4), (0, 4)]
VERTICES = [(x, y, z) for z in (0.0, 2.5) for x, y in OUTLINE]
N = len(OUTLINE)
SIDES = [(i, (i + 1) % N, N + (i + 1) % N, N + i) for i in range(N)]
VOLUME, AREA = 45.0, 86.0


def faces(first=0):
    """Bottom and top as one concave polygon each, beginning at a corner, and six quadrilaterals."""
    ring = [(i + first) % N for i in range(N)]
    return [ring[::-1], [N + i for i in ring], *SIDES]


def measures(triangles):
    """Volume by the divergence theorem, and area of all triangles."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    return np.einsum("ij,ij->", a, normal) / 6, np.linalg.norm(normal, axis=1).sum() / 2


def assert_is_the_body(content, path, unit_m=1.0):
    if isinstance(content, str):
        content = content.encode()
    assert measures(load_triangles(content, path, unit_m)) == pytest.approx((VOLUME, AREA), rel=1e-6)


def obj(corner=lambda i, n: str(i + 1), newline="\n", first=0, head="", colour=""):
    lines = [f"v {x} {y} {z}{colour}" for x, y, z in VERTICES]
    lines += ["f " + " ".join(corner(i, len(VERTICES)) for i in face) for face in faces(first)]
    return head + newline.join(lines) + newline


@pytest.mark.parametrize("first", range(N))
def test_concave_faces_do_not_depend_on_their_first_corner(tmp_path, first):
    """Fanned, areas of 86 to 98 m2 came out."""
    assert_is_the_body(obj(first=first), tmp_path / "a.obj")


@pytest.mark.parametrize(
    "options",
    [
        {"corner": lambda i, n: str(i - n)},
        {"corner": lambda i, n: f"{i + 1}/1/1"},
        {"corner": lambda i, n: f"{i + 1}//3"},
        {"corner": lambda i, n: f"{i - n}/{i - n}"},
        {"newline": "\r\n"},
        {"newline": "\r"},
        {"head": "# comment\nmtllib no.mtl\no L\ng walls\ns off\nusemtl brick\nvn 0 0 1\nvt 0 0\n"},
        {"colour": " 0.5 0.5 0.5"},
        {"colour": " 1.0"},
    ],
)
def test_dialects_of_obj(tmp_path, options):
    assert_is_the_body(obj(**options), tmp_path / "a.obj")


def test_obj_with_vertices_between_faces_and_continued_lines(tmp_path):
    """Indices from the end count from their own line on; a backslash continues a line."""
    lines = []
    for face in faces():
        lines += [f"v {x} {y} {z}" for x, y, z in (VERTICES[i] for i in face)]
        lines.append("f " + " \\\n ".join(str(i - len(face)) for i in range(len(face))))
    assert_is_the_body("\n".join(lines), tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("head", "vertex", "tail"),
    [
        ("OFF\n12 8 0\n", "", ""),
        ("OFF 12 8 18\n", "", ""),
        ("# made by hand\nOFF\n# counts\n12 8 0\n\n", "", ""),
        ("COFF\n12 8 0\n", " 255 0 0 255", ""),
        ("NOFF\n12 8 0\n", " 0 0 1", ""),
        ("STCNOFF\n12 8 0\n", " 0 0 1 1 0 0 1 0 0", ""),
        ("OFF\n12 8 0\n", "", " 0.5 0.5 0.5"),
        ("OFF\r\n12 8 0\r\n", "", "  # a face"),
        ("12 8 0\n", "", ""),
    ],
)
def test_dialects_of_off(tmp_path, head, vertex, tail):
    body = "".join(f"{x} {y} {z}{vertex}\n" for x, y, z in VERTICES)
    body += "".join(f"{len(face)} {' '.join(map(str, face))}{tail}\n" for face in faces())
    assert_is_the_body(head + body, tmp_path / "a.off")


def ply(
    kind,
    *,
    scalar="float",
    size="uchar",
    index="int",
    name="vertex_indices",
    extra=False,
    axes="xyz",
    face_first=False,
    newline="\n",
    polygons=None,
):
    """A PLY file; with extra properties around those that count, and an element of no use."""
    order = {"ascii": None, "binary_little_endian": "<", "binary_big_endian": ">"}[kind]
    code = {"float": "f", "double": "d", "uchar": "B", "int": "i", "uint": "I", "ushort": "H"}
    head = ["ply", f"format {kind} 1.0", "comment made by hand", "obj_info none"]
    of_vertices = [f"element vertex {len(VERTICES)}", *(f"property {scalar} {axis}" for axis in axes)]
    polygons = faces() if polygons is None else polygons
    of_faces = [f"element face {len(polygons)}"]
    if extra:
        of_vertices.append("property uchar red")
        of_faces.append("property float quality")
    of_faces.append(f"property list {size} {index} {name}")
    if extra:
        of_faces.append("property list uchar float texcoord")

    def packed(kinds, values):
        return (
            struct.pack(order + kinds, *values) if order else (" ".join(map(str, values)) + newline).encode()
        )

    vertices = b""
    for place in VERTICES:
        values, kinds = [place["xyz".index(axis)] for axis in axes], code[scalar] * 3
        vertices += packed(kinds + "B", [*values, 7]) if extra else packed(kinds, values)
    rows = b""
    for face in polygons:
        values, kinds = [len(face), *face], code[size] + code[index] * len(face)
        if extra:
            values, kinds = [0.5, *values, 2, 0.25, 0.75], "f" + kinds + "Bff"
        rows += packed(kinds, values)
    parts = [(of_vertices, vertices), (of_faces, rows)]
    if face_first:
        parts.reverse()
    head += [line for lines, _ in parts for line in lines] + ["end_header"]
    return newline.join(head).encode() + newline.encode() + b"".join(content for _, content in parts)


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"scalar": "double", "index": "uint"},
        {"size": "int", "index": "ushort"},
        {"name": "vertex_index"},
        {"extra": True},
        {"face_first": True},
        {"axes": "zxy"},
    ],
)
def test_dialects_of_ply(tmp_path, kind, options):
    """Mixed polygons, which trimesh rejects; types, orders and extra properties of either byte order."""
    assert_is_the_body(ply(kind, **options), tmp_path / "a.ply")


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("newline", ["\r\n", "\r"])
def test_ply_with_other_ends_of_lines(tmp_path, kind, newline):
    assert_is_the_body(ply(kind, newline=newline), tmp_path / "a.ply")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "a.obj",
            "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n",
            "1 corners of faces name a vertex that is not there",
        ),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 0 1 2\n", "vertex 0"),
        ("a.off", "4OFF\n1 0 0\n0 0 0 1\n", "other than three dimensions"),
        ("a.off", "OFF BINARY\n1 0 0\n", "binary"),
        ("a.off", "OFF\n9 9 0\n0 0 0\n", "9 vertices and 9 faces, but has 1 lines"),
        ("a.ply", ply("ascii")[:-40], "cut off"),
        ("a.ply", ply("binary_big_endian")[:-40], "cut off"),
        ("a.ply", ply("ascii").replace(b"property float x", b"property half x"), "property half x"),
        ("a.ply", ply("ascii").replace(b"element face", b"element tristrips"), "triangle strips"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, name, content, words):
    content = content.encode() if isinstance(content, str) else content
    with pytest.raises(ValueError, match=words):
        load_triangles(content, tmp_path / name)


def test_a_floor_with_a_bridged_hole_keeps_its_hole():
    """A hole is joined to the rim by an edge there and back, as exporters do: 4 x 4 less 1 x 1 m2."""
    ring = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]
    vertices = np.insert(np.array(ring, float), 2, 0.0, axis=1)
    found = triangulate(Polygons(vertices, np.arange(len(ring)), np.array([len(ring)])))
    assert measures(found)[1] == pytest.approx(15.0)
    assert (np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])[:, 2] >= 0).all()


@pytest.mark.parametrize("axes", [*permutations(range(3))])
def test_random_polygons_keep_area_and_facing(axes):
    """Star-shaped rings of 3 to 40 corners in any plane: area of shapely, normals all to one side."""
    rng = np.random.default_rng(sum(10**i * axis for i, axis in enumerate(axes)))
    for n in (3, 4, 7, 40):
        angle = np.sort(rng.uniform(0, 2 * np.pi, n))
        ring = rng.uniform(0.2, 2.0, n)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        plane = np.insert(ring, 2, 3.0, axis=1)[:, axes]
        found = triangulate(Polygons(plane, np.arange(n), np.array([n])))
        expected = shapely.Polygon(ring)
        if not expected.is_valid:
            continue
        assert measures(found)[1] == pytest.approx(expected.area)
        normal = np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0])
        newell = np.cross(plane, np.roll(plane, -1, axis=0)).sum(axis=0)
        assert (normal @ newell > 0).all()


def gltf(component=5126, normalized=False, node=None, mode=4, **more):
    """The body as glTF in text, y upwards in the file's custom but read in its own axes; and its indices."""
    triangles = np.array([[f[0], a, b] for f in SIDES for a, b in ((f[1], f[2]), (f[2], f[3]))])
    ends = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 5], [3, 4, 5]])
    index = np.concatenate([triangles, ends[:, ::-1], ends + N]).astype("<u2")
    largest = {5126: 1, 5122: 32767, 5123: 65535, 5121: 255, 5120: 127}[component]
    kind = {5126: "<f4", 5122: "<i2", 5123: "<u2", 5121: "u1", 5120: "i1"}[component]
    place = np.array(VERTICES) / (1 if component == 5126 else 12.0)
    place = np.pad(np.round(place * largest) if largest > 1 else place, ((0, 0), (0, 1))).astype(kind)
    data = place.tobytes() + index.tobytes()
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, **(node or {})}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": mode}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": component,
                "normalized": normalized,
                "count": len(place),
                "type": "VEC3",
            },
            {"bufferView": 1, "componentType": 5123, "count": index.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": place.nbytes, "byteStride": place.strides[0]},
            {"buffer": 0, "byteOffset": place.nbytes, "byteLength": index.nbytes},
        ],
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
        **more,
    }
    return tree


def glb(tree):
    """The same as a binary file."""
    data = base64.b64decode(tree["buffers"][0].pop("uri").partition(",")[2])
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    head = struct.pack("<4s3L4s", b"glTF", 2, 28 + len(text) + len(data), len(text), b"JSON")
    return head + text + struct.pack("<L4s", len(data), b"BIN\0") + data


@pytest.mark.parametrize(("component", "tolerance"), [(5122, 1e-3), (5123, 1e-3), (5121, 0.03), (5120, 0.05)])
@pytest.mark.parametrize("normalized", [True, False])
@pytest.mark.parametrize("binary", [True, False])
def test_quantised_positions_are_in_metres(tmp_path, component, tolerance, normalized, binary):
    """Normalised integers stand for numbers up to 1; others for themselves. A node scales and moves both."""
    largest = {5122: 32767, 5123: 65535, 5121: 255, 5120: 127}[component]
    scale = 12.0 if normalized else 12.0 / largest
    tree = gltf(component, normalized, {"scale": [scale] * 3, "translation": [5, 0, 0]})
    content, name = (glb(tree), "a.glb") if binary else (json.dumps(tree).encode(), "a.gltf")
    found = load_triangles(content, tmp_path / name)
    assert measures(found - [5, 0, 0]) == pytest.approx((VOLUME, AREA), rel=tolerance)
    assert found[..., 0].min() == pytest.approx(5.0)


@pytest.mark.parametrize(
    "nodes",
    [
        [{"mesh": 0, "scale": [-1, 1, 1]}],
        [{"children": [1], "scale": [2, 2, 2]}, {"mesh": 0, "scale": [0.5, -0.5, 0.5]}],
        [{"mesh": 0, "matrix": [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 7, 7, 7, 1]}],
        [{"children": [1], "rotation": [0, 0, 0.6, 0.8]}, {"mesh": 0, "translation": [1, 2, 3]}],
    ],
)
def test_scene_graphs_turn_mirror_and_scale(tmp_path, nodes):
    """A mirrored mesh does not face inside out: its volume stays positive."""
    tree = gltf(nodes=nodes)
    assert_is_the_body(json.dumps(tree), tmp_path / "a.gltf")


def sparse_gltf(number):
    """The body as glTF of which an accessor replaces one of its values (glTF 2.0, 3.6.2.3)."""
    tree = gltf()
    tree["accessors"][number]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": 1, "componentType": 5123},
        "values": {"bufferView": number},
    }
    return tree


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (
            gltf(extensionsRequired=["EXT_meshopt_compression"]),
            "EXT_meshopt_compression.*without compression",
        ),
        (gltf(extensionsRequired=["KHR_meshopt_compression"]), "KHR_meshopt_compression"),
        (gltf(mode=6), "triangle fans"),
        *((sparse_gltf(number), "positions or indices are sparse") for number in (0, 1)),
        (gltf(node={"extensions": {"EXT_mesh_gpu_instancing": {}}}), "EXT_mesh_gpu_instancing"),
    ],
)
def test_gltf_that_is_not_supported_is_named(tmp_path, tree, words):
    """Fans and instances came out as nothing and as one, compression as 'list index out of range'."""
    with pytest.raises(ValueError, match=words):
        load_triangles(json.dumps(tree).encode(), tmp_path / "a.gltf")


def stl(binary=True, tail=b"", name="body", newline="\n", end=True):
    """The body as STL."""
    found = triangulate(
        Polygons(np.array(VERTICES), np.concatenate(faces()), np.array(list(map(len, faces()))))
    )
    if binary:
        rows = b"".join(struct.pack("<12fH", 0, 0, 0, *one.ravel(), 0) for one in found)
        return name.encode().ljust(80) + struct.pack("<L", len(found)) + rows + tail
    lines = [f"solid {name}"]
    for one in found:
        lines += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"  vertex {x} {y} {z}" for x, y, z in one),
            "endloop",
            "endfacet",
        ]
    return newline.join([*lines, *(["endsolid"] if end else [])]).encode()


@pytest.mark.parametrize(
    "content",
    [
        stl(),
        stl(name="solid made by a program that begins so"),
        stl(tail=b"colours of some program"),
        stl(binary=False),
        stl(binary=False, newline="\r\n"),
        stl(binary=False, newline="\r"),
        stl(binary=False, name="one vertex of many", end=False),
        stl(binary=False).upper(),
    ],
)
def test_dialects_of_stl(tmp_path, content):
    """Ends of lines by CR alone lost the last digit of each coordinate in trimesh, a name with 'vertex' all."""
    assert_is_the_body(content, tmp_path / "a.stl")


def test_a_comment_of_obj_is_not_continued(tmp_path):
    """A comment that ends in a backslash does not swallow the vertex in the next line."""
    assert_is_the_body("# made on C:\\\n" + obj(), tmp_path / "a.obj")
