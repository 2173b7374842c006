"""Triangles of a mesh file, whatever its format.

Polygons of OBJ, OFF, PLY and STL are cut into triangles by `robosim.plans.formats.polygons`. The other formats are read
by trimesh, which trusts what a file declares. glTF can declare far more than it holds: repeated accessors over the same
bytes, or over none; nodes that repeat a mesh, in chains; buffers in other files of any kind. All of that is counted
first. Numbers that no building has are rejected.

Reference: glTF 2.0 specification, 3.5 to 3.7 (scenes, buffers, meshes).
"""

import importlib.util
import io
import json
import re
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote

import numpy as np
import trimesh
from jaxtyping import Float

from robosim.plans.floorplan import FARTHEST_M, MapError
from robosim.plans.formats.polygons import read_obj, read_off, read_ply, read_stl, triangulate
from robosim.support.reading import read_bytes, shown
from robosim.support.text_in import MOST_JSON, check_object, parse_json
from wireless.geometry.tolerance import check_rounding

Triangles = Float[np.ndarray, "n 3 3"]

#: Larger files are not meshes of buildings; reading them whole would only exhaust the memory [bytes].
MOST_BYTES = 300_000_000
#: Triangles that any file may have; a larger file may have as many as fit in it, 16 bytes each.
_MOST_TRIANGLES = 1_000_000
#: Most parts of meshes in a scene, each counted where it is shown; entries of a list; nested nodes.
_MOST_PARTS, _MOST_ENTRIES, _MOST_DEEP = 10_000, 100_000, 100
_BYTES_OF = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_NUMBERS_OF = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_DRACO = "KHR_draco_mesh_compression"
#: Extensions that do not change triangles, or that are read.
_READ_EXTENSIONS = re.compile(
    r"KHR_(draco_mesh_compression|mesh_quantization|materials_\w+|texture_\w+|lights_\w+)"
)
#: Values of normalised integers that mean 1, by type; mode of triangle fans.
_LARGEST, _FAN = {5120: 127.0, 5121: 255.0, 5122: 32767.0, 5123: 65535.0}, 6
#: Formats whose polygons are read here; the others have triangles only.
_POLYGONS = {".obj": read_obj, ".off": read_off, ".ply": read_ply, ".stl": read_stl}


def load_triangles(content: bytes, path: Path, unit_m: float = 1.0) -> Triangles:
    """All triangles of a mesh file [m] in its own axes, its scene graph applied.

    The path's ending is the format; other files that it names are in its folder. A ValueError in a few words for no
    triangles, too many, one too far away, or ones that were rounded to coarse 32-bit numbers.
    """
    suffix = path.suffix.lower()
    polygons = _POLYGONS.get(suffix)
    triangles = _of_scene(content, path) if polygons is None else triangulate(polygons(content))
    if triangles.size == 0:
        raise ValueError("no triangles in space; a point cloud must be meshed before it can be sliced")
    if not np.isfinite(triangles).all():
        n_wrong = np.count_nonzero(~np.isfinite(triangles).all(axis=(1, 2)))
        raise ValueError(f"{n_wrong} of {len(triangles)} triangles have a vertex that is not finite")
    if (farthest := unit_m * float(np.abs(triangles).max())) > FARTHEST_M:
        raise ValueError(
            f"a vertex lies {farthest:.3g} m away, expected at most {FARTHEST_M:g} m; pass unit_m=0.001 (--unit 0.001) "
            "if its numbers are mm"
        )
    check_rounding(triangles, unit_m)
    return triangles * unit_m


def _of_scene(content: bytes, path: Path) -> Triangles:
    """Triangles of a file that trimesh reads, its scene graph applied."""
    suffix, resolver = path.suffix.lower(), None
    if suffix in (".gltf", ".glb"):
        tree, lengths = _check_gltf(content if suffix == ".gltf" else _json_of_glb(content), len(content))
        if _scale_normalised(tree):
            content = _with_json(content, tree, suffix)
        resolver = _OtherFiles(path, lengths)
    scene = trimesh.load_scene(
        io.BytesIO(content), file_type=suffix[1:], resolver=resolver, process=False, skip_materials=True
    )
    count, limit = 0, max(_MOST_TRIANGLES, len(content) // 16)
    for node in scene.graph.nodes_geometry:
        count += len(getattr(scene.geometry[scene.graph[node][1]], "faces", ()))
        if count > limit:
            raise ValueError(
                f"more than {count} triangles, far more than a file of {len(content)} bytes should have"
            )
    parts = [_placed(scene.geometry[name], T) for T, name in map(scene.graph.get, scene.graph.nodes_geometry)]
    return np.concatenate([np.empty((0, 3, 3)), *parts]) if len(parts) != 1 else parts[0]


class _OtherFiles(Mapping[str, bytes]):
    """Files that a glTF file names, in its folder or below, each read when needed."""

    def __init__(self, file: Path, lengths: Mapping[str, int]):
        """Files in the folder of `file`, with the least number of bytes of each."""
        self._file, self._lengths, self._left = file, lengths, MOST_BYTES

    def __len__(self) -> int:
        return 0

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __getitem__(self, name: str) -> bytes:
        inside = PurePosixPath(unquote(name))
        if inside.is_absolute() or ".." in inside.parts:
            raise ValueError(f"it names {name[:80]!r}, expected a file in its own folder")
        path, what = self._file.parent / inside, f"data of {self._file.name}"
        content = read_bytes(path, what, most_bytes=self._left, kind=MapError)
        if len(content) < (length := self._lengths.get(name, 0)):
            raise MapError(
                f"{shown(path)}: {len(content)} bytes, but {self._file.name} says {length}. Copy it again."
            )
        self._left -= len(content)
        return content


def _json_of_glb(content: bytes) -> bytes:
    """The first chunk."""
    length, kind = struct.unpack_from("<L4s", content, 12)
    if content[:4] != b"glTF" or kind != b"JSON":
        raise ValueError("no GLB file, which begins with glTF and a chunk of JSON")
    return content[20 : 20 + length]


def _check_gltf(text: bytes, n_bytes: int) -> tuple[dict[str, Any], dict[str, int]]:
    """The scene of a glTF file, and least sizes of files it names; ValueError for what is too much or not supported."""
    if len(text) > MOST_JSON and b"base64," not in text:
        raise ValueError(f"its JSON has {len(text)} bytes, expected at most {MOST_JSON}")
    tree = check_object(parse_json(text))
    required = tree.get("extensionsRequired", ())
    if _DRACO in required and importlib.util.find_spec("DracoPy") is None:
        raise ValueError("its triangles are compressed by Draco; export it without, or install DracoPy")
    if unknown := [str(item)[:40] for item in required if not _READ_EXTENSIONS.fullmatch(str(item))]:
        raise ValueError(f"it needs {unknown[0]}, which is not supported; export it without compression")
    for kind in ("accessors", "bufferViews", "buffers", "nodes"):
        if len(_listed(tree, kind)) > _MOST_ENTRIES:
            raise ValueError(f"it lists {len(tree[kind])} {kind}, expected at most {_MOST_ENTRIES}")
    views = sum(_count(view, "byteLength") for view in _listed(tree, "bufferViews"))
    accessors = sum(
        _count(item, "count")
        * _NUMBERS_OF.get(str(item.get("type")), 16)
        * _BYTES_OF.get(item.get("componentType", 0), 4)
        for item in _listed(tree, "accessors")
    )
    # Bytes may be shared, but hardly by more than a few accessors; compressed they may be 50 times fewer.
    times = 50 if _DRACO in required else 4
    limit = (
        times * (n_bytes + sum(_count(item, "byteLength") for item in _listed(tree, "buffers"))) + 1_000_000
    )
    if max(views, accessors) > min(limit, 2 * MOST_BYTES):
        raise ValueError(f"it declares {max(views, accessors)} bytes of data, far more than there can be")
    _check_nodes(_listed(tree, "nodes"), _listed(tree, "meshes"))
    lengths = {
        item["uri"]: item["byteLength"]
        for item in _listed(tree, "buffers")
        if isinstance(item.get("uri"), str)
    }
    return tree, lengths


def _scale_normalised(tree: dict[str, Any]) -> bool:
    """Give meshes of normalised integers, which trimesh reads as plain, a node with their scale (glTF 2.0, 3.6.2.2)."""
    scale: dict[int, float] = {}
    accessors = _listed(tree, "accessors")
    for number, mesh in enumerate(_listed(tree, "meshes")):
        largest = set()
        for primitive in mesh.get("primitives", ()):
            accessor = accessors[primitive.get("attributes", {}).get("POSITION", 0)]
            if "sparse" in accessor or (
                "indices" in primitive and "sparse" in accessors[primitive["indices"]]
            ):
                raise ValueError(
                    "its positions or indices are sparse, which is not supported; export it with all of them"
                )
            if primitive.get("mode", 4) == _FAN:
                raise ValueError("it has triangle fans, which are not supported; export it with triangles")
            largest.add(
                _LARGEST.get(accessor.get("componentType"), 1.0) if accessor.get("normalized") else 1.0
            )
        if len(largest) > 1:
            raise ValueError("a mesh has positions of several kinds; export it with one kind")
        if largest and largest != {1.0}:
            scale[number] = 1 / largest.pop()
    nodes = _listed(tree, "nodes")
    for node in [*nodes]:
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise ValueError("it repeats meshes by EXT_mesh_gpu_instancing; export it with a node for each")
        if node.get("mesh") in scale:
            mesh = node.pop("mesh")
            node["children"] = [*node.get("children", ()), len(nodes)]
            nodes.append({"mesh": mesh, "scale": [scale[mesh]] * 3})
    return bool(scale)


def _with_json(content: bytes, tree: dict[str, Any], suffix: str) -> bytes:
    """A glTF file with its scene replaced."""
    text = json.dumps(tree).encode()
    if suffix == ".gltf":
        return text
    rest = content[20 + struct.unpack_from("<L", content, 12)[0] :]
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4s3L4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return head + text + rest


def _check_nodes(nodes: list[dict[str, Any]], meshes: list[dict[str, Any]]) -> None:
    parts = [len(mesh.get("primitives", ())) for mesh in meshes]
    count = max(sum(parts), sum(parts[node["mesh"]] for node in nodes if "mesh" in node))
    if count > _MOST_PARTS:
        raise ValueError(f"{count} parts of meshes, expected at most {_MOST_PARTS}")
    children = [node.get("children", ()) for node in nodes]
    if sum(map(len, children)) > len(nodes):
        raise ValueError("a node has several parents")
    level = set(range(len(nodes))) - {child for each in children for child in each}
    for _ in range(_MOST_DEEP):
        level = {child for node in level for child in children[node]}
        if not level:
            return
    raise ValueError(f"nodes lie more than {_MOST_DEEP} deep within each other")


def _listed(tree: dict[str, Any], key: str) -> list[dict[str, Any]]:
    entries = tree.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
        raise ValueError(f"{key!r} is no list of objects")
    return entries


def _count(entry: dict[str, Any], key: str) -> int:
    count = entry.get(key)
    if not isinstance(count, int) or count < 0:
        raise ValueError(f"{key} is {str(count)[:40]}, expected a whole number of 0 or more")
    return count


def _placed(mesh: Any, T_scene_mesh: Float[np.ndarray, "4 4"]) -> Triangles:
    """Triangles of a mesh at its place in the scene; none for other geometry."""
    if len(faces := getattr(mesh, "faces", ())) == 0 or np.shape(faces)[1:] != (3,):
        return np.empty((0, 3, 3))
    corners = trimesh.transform_points(np.asarray(mesh.vertices, np.float64), T_scene_mesh)
    if corners.shape[1:] != (3,):
        return np.empty((0, 3, 3))
    # A mirrored mesh would face inside out.
    mirrored = np.linalg.det(T_scene_mesh[:3, :3]) < 0
    return corners[np.asarray(faces, np.int64)[:, ::-1] if mirrored else np.asarray(faces, np.int64)]
