"""Polygons of OBJ, OFF, PLY and STL files, and the triangles that they are made of.

A polygon may be concave, and may have more corners than its neighbours. Convex ones are fanned; others are cut into
ears in the plane that Newell's normal fits best (M. Held, FIST, Algorithmica 30, 2001; by the library earcut), which
also handles holes that a bridge joins to the rim.

Read are: of OBJ faces with texture and normal references, indices counted from the end, vertices between faces and
colours behind vertices; of OFF all prefixes for colours, normals and texture, comments, and counts on the first line;
of PLY text and binary of both byte orders, with elements and properties in any order and of any type.
Left out: curves and free-form surfaces of OBJ, binary OFF, triangle strips of PLY.
References: Wavefront, Advanced Visualizer Manual, appendix B1 (OBJ); G. Turk, The PLY polygon file format, 1994;
Geomview manual, section 4.2.5 (OFF).
"""

import re
from collections.abc import Callable
from typing import Any, NamedTuple

import mapbox_earcut
import numpy as np
from jaxtyping import Float, Int


class Polygons(NamedTuple):
    """Polygons, one after the other."""

    vertices: Float[np.ndarray, "n 3"]
    """Corners, in the file's unit of length."""
    corner: Int[np.ndarray, " c"]
    """Vertices around each polygon."""
    size: Int[np.ndarray, " p"]
    """Number of corners of each polygon."""


#: Prefixes of OFF by the values that follow a vertex; "4" and "n" have other dimensions.
_OFF = re.compile(rb"(?:\s|#[^\n]*\n)*(ST)?(C)?(N)?(4)?(n)?OFF\b")
#: Bytes of a binary STL file before its triangles, and each of them; lines of vertices of one in text.
_STL_HEAD = 84
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_VERTEX = re.compile(rb"(?:^|[\r\n])[ \t]*(vertex[ \t][^\r\n]*)", re.IGNORECASE)
_PLY_KINDS = ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
_PLY_NAMES = (
    "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
)
_PLY_TYPES = dict(zip(_PLY_NAMES.split(), 2 * _PLY_KINDS, strict=True))
_PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
#: Bytes of a header, and properties of an element, that no file exceeds.
_LONGEST_HEADER, _MOST_PROPERTIES = 100_000, 100
#: Lines of vertices and faces of an OBJ file; references after a vertex in a face; comments.
_OBJ_SHAPES = re.compile(rb"^[ \t]*([vf][ \t][^\n]*)", re.MULTILINE)
_OBJ_REFERENCES, _OBJ_COMMENT = re.compile(rb"/[^\s]*"), re.compile(rb"#[^\n]*")
_LONGEST_LINE = 20_000


def read_obj(content: bytes) -> Polygons:
    """Polygons of an OBJ file; ValueError, in a few words, if numbers are damaged or faces name no vertex."""
    text = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    text = _OBJ_COMMENT.sub(b"", text).replace(b"\\\n", b" ")  # a comment is not continued
    lines = _OBJ_SHAPES.findall(text)
    if max(map(len, lines), default=0) > _LONGEST_LINE:
        raise ValueError(f"a face has more corners than fit in {_LONGEST_LINE} bytes")
    is_vertex = np.array([line[:1] == b"v" for line in lines], bool)
    words = [_OBJ_REFERENCES.sub(b"", line).split()[1:] for line in lines]
    vertices = _rows([words[i][:3] for i in np.flatnonzero(is_vertex)])
    faces = [words[i] for i in np.flatnonzero(~is_vertex)]
    count = np.array(list(map(len, faces)), np.int64)
    corner = np.array([word for face in faces for word in face], "S20").astype(np.int64)
    if (corner == 0).any():
        raise ValueError("a face names vertex 0, expected vertices from 1 on, or from -1 backwards")
    # A negative number counts back from its own line.
    before = np.repeat(np.cumsum(is_vertex)[~is_vertex], count)
    return _checked(vertices, np.where(corner < 0, before + corner, corner - 1), count)


def read_off(content: bytes) -> Polygons:
    """Polygons of an OFF file; see `read_obj`."""
    head = _OFF.match(content)
    if head is not None and (head[4] or head[5]):
        raise ValueError("its vertices have other than three dimensions")
    body = content[head.end() :] if head else content
    if body.lstrip().startswith(b"BINARY"):
        raise ValueError("it is binary; export it as text, or as PLY")
    lines = [line for line in (each.partition(b"#")[0].split() for each in body.splitlines()) if line]
    if not lines or len(lines[0]) < 2:
        raise ValueError("it does not begin with the numbers of vertices and faces")
    n_vertices, n_faces = (int(word) for word in lines[0][:2])
    if not (n_vertices >= 0 and n_faces >= 0 and n_vertices + n_faces <= len(lines) - 1):
        raise ValueError(f"it says {n_vertices} vertices and {n_faces} faces, but has {len(lines) - 1} lines")
    faces = lines[1 + n_vertices : 1 + n_vertices + n_faces]
    count = np.array([int(face[0]) for face in faces], np.int64)
    if any(not 0 <= n <= len(face) - 1 for n, face in zip(count, faces, strict=True)):
        raise ValueError("a face has fewer corners than it says")
    corner = [word for n, face in zip(count, faces, strict=True) for word in face[1 : 1 + n]]
    vertices = _rows([line[:3] for line in lines[1 : 1 + n_vertices]])
    return _checked(vertices, np.array(corner, "S20").astype(np.int64), count)


def read_ply(content: bytes) -> Polygons:
    """Polygons of a PLY file; see `read_obj`."""
    end = re.search(rb"end_header[ \t]*(\r\n|\r|\n)", content[:_LONGEST_HEADER])
    if content[:3] != b"ply" or end is None:
        raise ValueError("its header does not go from 'ply' to 'end_header'")
    order, elements = _ply_header(content[: end.start()].decode("latin-1"))
    body = content[end.end() :]
    read: Callable[[int, list[tuple[str, str, str]]], dict[str, tuple[np.ndarray, np.ndarray]]]
    read = (_PlyText(body) if order == "" else _PlyBinary(body, order)).element
    contents = {name: read(n, properties) for name, n, properties in elements}
    if "tristrips" in contents:
        raise ValueError("it has triangle strips, which are not supported; export it with faces")
    if not {"x", "y", "z"} <= set(contents.get("vertex", {})):
        raise ValueError("it has no vertices with x, y and z")
    vertices = np.column_stack([contents["vertex"][axis][0].astype(float) for axis in "xyz"])
    faces = contents.get("face", {})
    lists = [faces[name] for name in ("vertex_indices", "vertex_index") if name in faces]
    if not lists:
        return Polygons(vertices, np.empty(0, np.int64), np.empty(0, np.int64))
    return _checked(vertices, *(column.astype(np.int64) for column in lists[0]))


def read_stl(content: bytes) -> Polygons:
    """Triangles of an STL file, text or binary; see `read_obj`. A binary one may have anything behind its triangles."""
    held = (len(content) - _STL_HEAD) // _STL_TRIANGLE.itemsize
    said = int.from_bytes(content[_STL_HEAD - 4 : _STL_HEAD], "little") if held >= 0 else -1
    if content.lstrip()[:5].lower() == b"solid" and _STL_HEAD + said * _STL_TRIANGLE.itemsize != len(content):
        vertices = _rows([line.split()[1:] for line in _STL_VERTEX.findall(content)])
        if len(vertices) % 3:
            raise ValueError(f"{len(vertices)} vertices are no whole triangles: the file was cut off")
    elif said > held:
        raise ValueError(
            f"it says {max(said, 0)} triangles, but only {max(held, 0)} are in it: the file was cut off"
        )
    else:
        vertices = (
            np.frombuffer(content, _STL_TRIANGLE, said, _STL_HEAD)["corner"].reshape(-1, 3).astype(float)
        )
    return Polygons(vertices, np.arange(len(vertices)), np.full(len(vertices) // 3, 3))


def _ply_header(text: str) -> tuple[str, list[tuple[str, int, list[tuple[str, str, str]]]]]:
    """Byte order ("" for text), and name, number and properties (name, type of the count or "", type) of elements."""
    order: str | None = None
    elements: list[tuple[str, int, list[tuple[str, str, str]]]] = []
    for line in re.split(r"[\r\n]+", text):
        match line.split():
            case ["format", kind, *_] if kind in _PLY_FORMATS:
                order = _PLY_FORMATS[kind]
            case ["element", name, n] if n.isdigit():
                elements.append((name, int(n), []))
            case ["property", "list", size, kind, name] if elements and {size, kind} <= set(_PLY_TYPES):
                elements[-1][2].append((name, _PLY_TYPES[size], _PLY_TYPES[kind]))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1][2].append((name, "", _PLY_TYPES[kind]))
            case [("format" | "element" | "property"), *_]:
                raise ValueError(f"its header has {line.strip()[:60]!r}, which is not understood")
    if order is None or any(not 0 < len(p) <= _MOST_PROPERTIES for _, n, p in elements if n):
        raise ValueError("its header names no format, or an element without properties")
    return order, elements


class _PlyText:
    """Reads elements of a text file one after the other."""

    def __init__(self, body: bytes):
        self._lines = [line.split() for line in body.splitlines() if line.strip()]

    def element(
        self, n: int, properties: list[tuple[str, str, str]]
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Values of each property, and how many each item has."""
        if n > len(self._lines):
            raise ValueError(
                f"it says {n} items, but only {len(self._lines)} lines are left: the file was cut off"
            )
        lines, self._lines = self._lines[:n], self._lines[n:]
        at, columns = [0] * n, {}
        for name, size, kind in properties:
            if size:
                sizes = [int(line[i]) for line, i in zip(lines, at, strict=True)]
                at = [i + 1 for i in at]
            else:
                sizes = [1] * n
            values = [line[i : i + k] for line, i, k in zip(lines, at, sizes, strict=True)]
            if any(len(value) != k for value, k in zip(values, sizes, strict=True)):
                raise ValueError(f"a line has too few values for {name}")
            flat = np.array([word for value in values for word in value], "S40")
            columns[name] = flat.astype(float).astype(kind), np.array(sizes, np.int64)
            at = [i + k for i, k in zip(at, sizes, strict=True)]
        return columns


class _PlyBinary:
    """Reads elements of a binary file one after the other."""

    def __init__(self, body: bytes, order: str):
        self._body, self._order, self._at = body, order, 0

    def element(
        self, n: int, properties: list[tuple[str, str, str]]
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Values of each property, and how many each item has."""
        # Most files have lists of one length: then all items have the layout of the first.
        sizes = (
            [len(values) for values in self._item(self._at, properties)[0]] if n else [1] * len(properties)
        )
        fields: list[Any] = []
        for number, ((_, size, kind), k) in enumerate(zip(properties, sizes, strict=True)):
            fields += [(f"n{number}", self._order + size)] if size else []
            fields.append((f"v{number}", self._order + kind, (k,)))
        layout = np.dtype(fields)
        if n * layout.itemsize <= len(self._body) - self._at:
            items = np.frombuffer(self._body, layout, n, self._at)
            counts = {name: items[name] for name, *_ in fields if name[0] == "n"}
            if all((count == sizes[int(name[1:])]).all() for name, count in counts.items()):
                self._at += n * layout.itemsize
                return {
                    name: (items[f"v{number}"].ravel(), np.full(n, k))
                    for number, ((name, _, _), k) in enumerate(zip(properties, sizes, strict=True))
                }
        columns: list[list[np.ndarray]] = [[] for _ in properties]
        for _ in range(n):
            item, self._at = self._item(self._at, properties)
            for column, values in zip(columns, item, strict=True):
                column.append(values)
        return {
            name: (np.concatenate([np.empty(0), *column]), np.array(list(map(len, column)), np.int64))
            for column, (name, _, _) in zip(columns, properties, strict=True)
        }

    def _item(self, at: int, properties: list[tuple[str, str, str]]) -> tuple[list[np.ndarray], int]:
        """Values of each property of the item that begins at a byte, and the byte after it."""
        item = []
        for _, size, kind in properties:
            k = 1
            if size:
                k = int(self._values(at, size, 1)[0])
                at += np.dtype(size).itemsize
            item.append(self._values(at, kind, k))
            at += item[-1].nbytes
        return item, at

    def _values(self, at: int, kind: str, k: int) -> np.ndarray:
        if not (k >= 0 and at + k * np.dtype(kind).itemsize <= len(self._body)):
            raise ValueError("it says more items than are in it: the file was cut off")
        return np.frombuffer(self._body, self._order + kind, k, at)


def _rows(words: list[list[bytes]]) -> Float[np.ndarray, "n 3"]:
    if any(len(row) != 3 for row in words):
        raise ValueError("a vertex has fewer than three coordinates")
    return np.array(words, "S40").astype(float).reshape(-1, 3)


def _checked(
    vertices: Float[np.ndarray, "n 3"], corner: Int[np.ndarray, " c"], count: Int[np.ndarray, " p"]
) -> Polygons:
    wrong = (corner < 0) | (corner >= len(vertices))
    if wrong.any():
        raise ValueError(
            f"{wrong.sum()} corners of faces name a vertex that is not there, of {len(vertices)} vertices"
        )
    return Polygons(vertices, corner, count)


def triangulate(polygons: Polygons) -> Float[np.ndarray, "t 3 3"]:
    """Triangles of all polygons, in order if all have equally many corners; two corners make none."""
    vertices, corner, count = polygons
    start = np.cumsum(count) - count
    parts = [np.empty((0, 3), np.int64)]
    for k in np.unique(count[count >= 3]):
        rings = corner[start[count == k][:, None] + np.arange(k)]
        around = vertices[rings] - vertices[rings[:, :1]]
        after = np.roll(around, -1, axis=1)
        normal = np.cross(around, after).sum(axis=1)  # Newell's
        turn = np.einsum("nki,ni->nk", np.cross(after - around, np.roll(after, -1, axis=1) - after), normal)
        fanned = (turn >= 0).all(axis=1) | (k == 3)
        fan = np.stack([np.zeros(k - 2, int), np.arange(1, k - 1), np.arange(2, k)], axis=1)
        parts.append(rings[fanned][:, fan].reshape(-1, 3))
        parts += [
            ring[_ears(ring_axes, up)]
            for ring, ring_axes, up in zip(*(a[~fanned] for a in (rings, around, normal)), strict=True)
        ]
    return vertices[np.concatenate(parts)]


def _ears(around: Float[np.ndarray, "k 3"], normal: Float[np.ndarray, "3"]) -> Int[np.ndarray, "t 3"]:
    """Triangles of one polygon, as numbers of its corners, turning like it."""
    x, y = np.roll(np.arange(3), -1 - int(np.argmax(np.abs(normal))))[:2]
    flat = np.ascontiguousarray(around[:, [x, y]], float)
    ears = mapbox_earcut.triangulate_float64(flat, np.array([len(flat)], np.uint32)).reshape(-1, 3)
    a, b, c = flat[ears].transpose(1, 0, 2)
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    backwards = area * normal[np.argmax(np.abs(normal))] < 0
    return np.where(backwards[:, None], ears[:, ::-1], ears).astype(np.int64)
