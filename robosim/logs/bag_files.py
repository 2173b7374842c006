"""Records of bags: ROS 1 (versions 1.2 and 2.0), ROS 2 (SQLite) and MCAP, read from the first byte to the last.

Indexes are not used, so that recordings that were cut off or never closed give what they hold. Chunks are unpacked one
at a time, and never to more than they declare. References: wiki.ros.org/Bags/Format/2.0 and 1.2, mcap.dev/spec.
"""

import bz2
import io
import re
import sqlite3
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import quote
from zlib import crc32

from robosim.support.reading import FileError, reading, reason_of

_ROS1, _MCAP, _SQLITE, _ZSTD = b"#ROSBAG", b"\x89MCAP", b"SQLite format 3", b"\x28\xb5\x2f\xfd"
_STORAGE = (".db3", ".mcap", ".db3.zstd", ".mcap.zstd")
_METADATA = "metadata.yaml"
#: Largest chunk or message, unpacked [bytes]. A bag unpacks to this, or to this many times its size.
MOST_BYTES, MOST_RATIO = 1 << 28, 100
#: Largest header of a record of ROS 1 [bytes], and bytes that are unpacked at once.
_MOST_HEADER, _PIECE = 1 << 20, 1 << 16
#: Rows in turn that cannot be read before a database counts as read.
_MOST_FAILURES = 1000
_UNPACK = "Unpack it first, such as by rosbag decompress or ros2 bag convert."
_DAMAGED = (struct.error, KeyError, IndexError, ValueError, EOFError, OSError, RuntimeError, sqlite3.Error)

_Stream = BinaryIO | io.BytesIO


class Channel(NamedTuple):
    """What messages of a topic are: type, definition (empty if the bag has none) and encoding."""

    topic: str
    type_name: str
    definition: str
    encoding: str
    """Of messages, `ros1` or `cdr`; others are not read."""
    is_idl: bool = False


Record = tuple[Channel, int, bytes]


def storage_files(path: Path) -> list[Path]:
    """Files of a bag: the path itself, or those in a folder, in the order of their numbers; none if it is no bag."""
    if path.is_dir():
        files = [file for file in path.iterdir() if file.name.endswith(_STORAGE)]
        return sorted(files, key=lambda file: (len(file.name), file.name))
    if not path.is_file():
        return []
    with path.open("rb") as file:
        head = file.read(16)
    is_packed = head.startswith(_ZSTD) and path.name.endswith(_STORAGE)
    return [path] if head.startswith((_ROS1, _MCAP, _SQLITE)) or is_packed else []


class BagFiles:
    """Messages of the files of a bag, and what is lost of them."""

    def __init__(self, path: Path) -> None:
        self._path, self._files = path, storage_files(path)
        if not self._files:
            raise FileError(f"has no file of a bag, expected one of {', '.join(_STORAGE)}.")
        self._start()

    def _start(self) -> None:
        self._channels: dict[Any, Channel] = {}
        self._declared, self._end, self._n_read, self._is_whole = 0, 0, 0, False
        self._n_stated: int | None = None
        self._n_estimated = 0.0
        self._damage: list[str] = []

    def records(self) -> Iterator[Record]:
        """Yield channel, time of recording [ns] and content of each message, in the order of the files."""
        self._start()
        for file in self._files:
            self._channels, self._end, self._is_whole = {}, 0, False
            with reading(file, "a ROS bag", most_bytes=1 << 50) as stream:
                for channel, time_ns, data in self._of_file(file, stream):
                    if data.startswith(_ZSTD):
                        data = b"".join(_unpacked(io.BytesIO(data), "zstd", MOST_BYTES))
                    yield channel, time_ns, data

    def lost(self) -> str:
        """What is lost of the messages that `records` has yielded, in words; empty if nothing is."""
        metadata = self._path / _METADATA
        n_stated = self._n_stated
        if self._path.is_dir() and metadata.exists():
            with reading(metadata, "metadata of a bag") as file:
                stated = re.search(rb"^  message_count: *(\d+)", file.read(), re.MULTILINE)
            n_stated = int(stated[1]) if stated else n_stated
        n_lost = max((n_stated or 0) - self._n_read, 0)
        if not self._damage and not n_lost:
            return ""
        if n_stated is not None:
            how = f"{n_lost} are lost"
        elif self._n_estimated:
            how = f"about {max(round(self._n_estimated), 1)} are lost, or more"
        else:
            how = "how many are lost is not known"
        return f"{'; '.join(self._damage[:3]) or 'messages are missing'}: {self._n_read} messages are read, {how}"

    def _of_file(self, path: Path, file: _Stream) -> Iterator[Record]:
        head, size, n_before = file.read(18), file.seek(0, io.SEEK_END), self._n_read
        file.seek(0)
        n_over = size % _page_bytes(head) if head.startswith(_SQLITE) else 0
        if head.startswith(_ZSTD) or n_over:
            # SQLite reads the rest of a page that was cut off as zeros.
            most, kind = (size - n_over, "none") if n_over else (max(MOST_BYTES, MOST_RATIO * size), "zstd")
            with tempfile.NamedTemporaryFile(suffix=path.with_suffix("").suffix) as whole:
                for piece in _unpacked(file, kind, most):
                    whole.write(piece)
                whole.flush()
                with open(whole.name, "rb") as unpacked:
                    yield from self._of_file(Path(whole.name), unpacked)
            return
        try:
            if head.startswith(_SQLITE):
                yield from self._sqlite(path, size)
            elif head.startswith(_MCAP):
                file.seek(8)
                yield from self._mcap(file, size)
            elif head.startswith((b"#ROSBAG V1.2", b"#ROSBAG V2.0")):
                file.readline(64)
                yield from self._ros1(file, size)
            else:
                version = head[8:].split(b"\n")[0].decode("ascii", "replace")
                raise FileError(
                    f"is a bag of version {version}, expected V1.2 or V2.0. Convert it by rosbag fix."
                )
        except FileError:
            raise
        except _DAMAGED as error:
            at = file.tell()
            if self._is_whole:  # only the index is damaged
                return
            self._damage.append(f"{path.name} is cut off or damaged at byte {at} ({reason_of(error)})")
            self._n_estimated += (self._n_read - n_before) * max(self._end / max(at, 1) - 1, 0.0)

    def _chunk(self, file: _Stream, length: int, kind: str, declared: int, size: int) -> io.BytesIO:
        """Content of a chunk, or what can be unpacked of it; FileError if it declares too much."""
        self._declared += declared
        if declared > MOST_BYTES or self._declared > max(MOST_BYTES, MOST_RATIO * size):
            raise FileError(
                f"unpacks to {self._declared} bytes or more, expected chunks of at most {MOST_BYTES} and a bag of at "
                f"most {MOST_BYTES} bytes or {MOST_RATIO} times its size. {_UNPACK}"
            )
        start, content = file.tell(), bytearray()
        self._end = max(self._end, start + length)
        try:
            for piece in _unpacked(io.BytesIO(file.read(min(length, size))), kind, declared):
                content += piece
        except _DAMAGED as error:
            self._damage.append(f"the chunk at byte {start} is damaged ({reason_of(error)})")
        return io.BytesIO(bytes(content))

    def _inside(self, walk: Iterator[Record]) -> Iterator[Record]:
        """Messages of a chunk, up to where it is damaged."""
        try:
            yield from walk
        except FileError:
            raise
        except _DAMAGED as error:
            if not self._damage or "chunk" not in self._damage[-1]:
                self._damage.append(f"a chunk is cut off or damaged ({reason_of(error)})")

    def _ros1(self, file: _Stream, size: int) -> Iterator[Record]:
        """Records of ROS 1; those of chunks in turn, whose size is 0."""
        index_at = 0
        while head := file.read(4):
            self._is_whole |= 0 < index_at < file.tell()
            fields = _fields(_exactly(file, min(*struct.unpack("<I", head), _MOST_HEADER)))
            (length,) = struct.unpack("<I", _exactly(file, 4))
            operation = fields[b"op"][0]
            if operation == 5 and size:
                (declared,) = struct.unpack("<I", fields[b"size"])
                start = file.tell()
                inner = self._chunk(file, length, fields[b"compression"].decode(), declared, size)
                yield from self._inside(self._ros1(inner, 0))
                if start + length > size:
                    raise EOFError("its end is missing")
                continue
            data = _exactly(file, length)
            key = fields.get(b"conn", fields.get(b"topic", b""))
            if operation == 2 and key in self._channels:
                seconds, nanoseconds = struct.unpack(
                    "<II", fields.get(b"time") or fields[b"sec"] + fields[b"nsec"]
                )
                self._n_read += 1
                yield self._channels[key], seconds * 10**9 + nanoseconds, data
            elif operation in (1, 7):
                more = {**fields, **(_fields(data) if operation == 7 else {})}
                self._channels[key] = Channel(
                    topic=fields[b"topic"].decode(),
                    type_name=more[b"type"].decode(),
                    definition=more.get(b"message_definition", more.get(b"def", b"")).decode(
                        "utf-8", "replace"
                    ),
                    encoding="ros1",
                )
            elif operation == 6 and len(data) == 8 * struct.unpack("<I", fields[b"count"])[0]:
                counts = [count for _, count in struct.iter_unpack("<II", data)]
                self._n_stated = (self._n_stated or 0) + sum(counts)
            elif operation == 3:
                (index_at,) = struct.unpack("<Q", fields[b"index_pos"])
                self._end = index_at
                if not index_at:
                    self._damage.append("it has no index, as of a recording that was not closed")

    def _mcap(self, file: _Stream, size: int) -> Iterator[Record]:
        """Records of MCAP; those of chunks in turn, whose size is 0."""
        while head := file.read(9):
            operation, length = struct.unpack("<BQ", head)
            if operation == 2:  # the footer
                return
            if operation == 6 and size:
                start = file.tell()
                (declared, checksum) = struct.unpack("<16xQI", _exactly(file, 28))
                kind = _text(file)
                (packed,) = struct.unpack("<Q", _exactly(file, 8))
                inner = self._chunk(file, packed, kind or "none", declared, size)
                if checksum and start + length <= size and crc32(inner.getbuffer()) != checksum:
                    self._damage.append(f"the chunk at byte {start} is damaged (its checksum differs)")
                else:
                    yield from self._inside(self._mcap(inner, 0))
                if start + length > size:
                    raise EOFError("its end is missing")
                file.seek(start + length)
                continue
            if operation not in (3, 4, 5, 11):
                self._is_whole |= operation == 15  # the end of the data
                if size and file.tell() + length > size:
                    raise EOFError("its end is missing")
                file.seek(length, io.SEEK_CUR)
                continue
            record = io.BytesIO(_exactly(file, length))
            if operation == 5:
                channel, time_ns = struct.unpack("<H4xQ8x", _exactly(record, 22))
                if channel in self._channels:
                    self._n_read += 1
                    yield self._channels[channel], time_ns, record.read()
            elif operation == 3:
                (number,) = struct.unpack("<H", _exactly(record, 2))
                self._channels["schema", number] = Channel("", _text(record), "", _text(record))._replace(
                    definition=_text(record)
                )
            elif operation == 4:
                number, schema = struct.unpack("<HH", _exactly(record, 4))
                topic, encoding = _text(record), _text(record)
                kind_of_type = self._channels.get(("schema", schema), Channel("", "", "", ""))
                self._channels[number] = kind_of_type._replace(
                    topic=topic, encoding=encoding, is_idl=kind_of_type.encoding.endswith("idl")
                )
            else:
                self._n_stated = (self._n_stated or 0) + struct.unpack("<Q", _exactly(record, 8))[0]
        if size:
            raise EOFError("its end is missing")

    def _sqlite(self, path: Path, size: int) -> Iterator[Record]:
        """Messages of a database of ROS 2, in the order of its rows."""
        is_damaged, journal = False, Path(f"{path}-wal")
        if journal.is_file() and journal.stat().st_size:
            self._damage.append(f"messages in {journal.name} are not read: open and close it by sqlite3 once")
        base = sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True)
        try:
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
            base.text_factory = lambda text: text.decode("utf-8", "replace")
            base.execute("PRAGMA writable_schema = ON")  # a file that was cut off is opened with it only
            with path.open("rb") as file:
                head = file.read(32)
            self._end = _page_bytes(head) * struct.unpack(">28xI", head)[0]
            tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise FileError(
                    f"has no tables topics and messages, but {', '.join(sorted(tables)) or 'none'}."
                )
            kinds: dict[str, tuple[str, str]] = {}
            if "message_definitions" in tables:
                for name, encoding, text in base.execute(
                    "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
                ):
                    kinds[name] = (encoding, text)
            for number, topic, name, encoding in base.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ):
                form, text = kinds.get(name, ("", ""))
                self._channels[number] = Channel(topic, name, text, encoding, form.endswith("idl"))
            n_before, row, failures = self._n_read, -1, 0
            query = "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY rowid"
            while failures < _MOST_FAILURES:
                try:
                    for at, number, time_ns, data in base.execute(query, (row,)):
                        row, failures = at, 0
                        if number in self._channels and isinstance(data, bytes):
                            self._n_read += 1
                            yield self._channels[number], time_ns, data
                    break
                except sqlite3.DatabaseError:
                    row, failures, is_damaged = row + 1, failures + 1, True
            if is_damaged:
                raise sqlite3.DatabaseError("pages are missing")
        except sqlite3.Error as error:
            self._damage.append(f"its database is cut off or damaged ({reason_of(error)})")
            self._n_estimated += (self._n_read - n_before) * max(self._end / size - 1, 0.0)
        finally:
            base.close()


def _page_bytes(head: bytes) -> int:
    """Size of a page of a database [bytes]."""
    (page,) = struct.unpack_from(">H", head, 16)
    return page if page > 1 else 1 << 16


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Fields of a header of ROS 1."""
    fields, at = {}, 0
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, equals, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not equals:
            raise ValueError("a header has no fields")
        fields[name] = value
        at += 4 + length
    return fields


def _exactly(file: _Stream, length: int) -> bytes:
    data = file.read(min(length, sys.maxsize)) if length <= MOST_BYTES else b""
    if len(data) != length:
        raise EOFError("its end is missing" if length <= MOST_BYTES else f"a record has {length} bytes")
    return data


def _text(file: _Stream) -> str:
    return _exactly(file, *struct.unpack("<I", _exactly(file, 4))).decode("utf-8", "replace")


def _unpacked(file: _Stream, kind: str, most: int) -> Iterator[bytes]:
    """Pieces of content, unpacked; ValueError if it is more than declared."""
    if kind == "none":
        while most > 0 and (piece := file.read(min(most, 1 << 24))):
            most -= len(piece)
            yield piece
        return
    if kind == "bz2":
        unpack: Any = bz2.BZ2Decompressor()
    elif kind == "lz4":
        from lz4.frame import LZ4FrameDecompressor

        unpack = LZ4FrameDecompressor()
    elif kind == "zstd":
        if sys.version_info >= (3, 14):
            from compression.zstd import ZstdDecompressor
        else:
            from backports.zstd import ZstdDecompressor

        unpack = ZstdDecompressor()
    else:
        raise FileError(f"is packed by {kind!r}, expected bz2, lz4 or zstd. {_UNPACK}")
    left = most
    while not unpack.eof:
        piece = file.read(_PIECE) if unpack.needs_input else b""
        if unpack.needs_input and not piece:
            return
        unpacked = unpack.decompress(piece, left + 1)
        left -= len(unpacked)
        if left < 0:
            raise ValueError(f"it unpacks to more than {most} bytes")
        yield unpacked
