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
from contextlib import closing
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
_DAMAGED = (struct.error, KeyError, IndexError, EOFError, OSError, sqlite3.Error)

_Stream = BinaryIO | io.BytesIO


class Channel(NamedTuple):
    """A topic, with type, definition (empty if the bag has none) and encoding of its messages."""

    topic: str
    type_name: str
    definition: str
    encoding: str
    """`ros1` or `cdr`; others are not read."""
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

    def records(self) -> Iterator[Record]:
        """Yield channel, time of recording [ns] and content of each message, in the order of the files."""
        self._n_declared = self._n_read = self._n_stated = 0
        self._n_estimated, self._damage = 0.0, list[str]()
        for file in self._files:
            self._channels: dict[bytes | int, Channel] = {}
            self._schemas: dict[int, tuple[str, str, str]] = {}
            # Where messages end, as far as the file states it, and whether they are read up to there.
            self._end, self._is_whole = 0, False
            with reading(file, "a ROS bag", most_bytes=1 << 50) as stream:
                for channel, time_ns, data in self._of_file(file, stream):
                    self._n_read += 1
                    if data.startswith(_ZSTD):
                        data = b"".join(_unpacked(io.BytesIO(data), "zstd", MOST_BYTES))
                    yield channel, time_ns, data

    def lost(self) -> str:
        """Describe the messages that `records` could not yield; empty if none is lost."""
        metadata, n_stated = self._path / _METADATA, self._n_stated
        if self._path.is_dir() and metadata.exists():
            with reading(metadata, "metadata of a bag") as file:
                stated = re.search(rb"^  message_count: *(\d+)", file.read(), re.MULTILINE)
            n_stated = int(stated[1]) if stated else n_stated
        n_lost = max(n_stated - self._n_read, 0)
        if not self._damage and not n_lost:
            return ""
        lost = f"{n_lost} are lost" if n_stated else "how many are lost is not known"
        if not n_stated and self._n_estimated:
            lost = f"about {max(round(self._n_estimated), 1)} are lost, or more"
        return f"{'; '.join(self._damage[:3]) or 'messages are missing'}: {self._n_read} messages are read, {lost}"

    def _of_file(self, path: Path, file: _Stream) -> Iterator[Record]:
        head, size, n_before = file.read(18), file.seek(0, io.SEEK_END), self._n_read
        file.seek(0)
        n_over = size % _page_bytes(head) if head.startswith(_SQLITE) else 0
        if head.startswith(_ZSTD) or n_over:
            # SQLite reads the rest of a page that was cut off as zeros.
            limit, kind = (size - n_over, "none") if n_over else (max(MOST_BYTES, MOST_RATIO * size), "zstd")
            with tempfile.NamedTemporaryFile() as whole:
                whole.writelines(_unpacked(file, kind, limit))
                whole.flush()
                with open(whole.name, "rb") as unpacked:
                    yield from self._of_file(Path(whole.name), unpacked)
            return
        try:
            if head.startswith(_SQLITE):
                yield from self._sqlite(path, file)
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
        except _DAMAGED as error:
            at = _position(file)
            if not self._is_whole:  # else only the index is damaged
                self._damage.append(f"it is cut off or damaged at byte {at} ({reason_of(error)})")
                self._n_estimated += (self._n_read - n_before) * max(self._end / max(at, 1) - 1, 0.0)

    def _chunk(self, file: _Stream, length: int, kind: str, declared: int, size: int) -> io.BytesIO:
        """Content of a chunk, or what can be unpacked of it; FileError if it declares too much."""
        self._n_declared += declared
        if declared > MOST_BYTES or self._n_declared > max(MOST_BYTES, MOST_RATIO * size):
            raise FileError(
                f"unpacks to {self._n_declared} bytes or more, expected chunks of at most {MOST_BYTES} and a bag of at "
                f"most {MOST_BYTES} bytes or {MOST_RATIO} times its size. {_UNPACK}"
            )
        start, content = _position(file), b""
        self._end = max(self._end, start + length)
        try:
            content = b"".join(_unpacked(io.BytesIO(file.read(min(length, size))), kind, declared))
        except EOFError as error:
            self._damage.append(f"the chunk at byte {start} is damaged ({reason_of(error)})")
        return io.BytesIO(content)

    def _inside(self, walk: Iterator[Record]) -> Iterator[Record]:
        """Messages of a chunk, up to where it is damaged."""
        try:
            yield from walk
        except _DAMAGED as error:
            self._damage.append(f"a chunk is cut off or damaged ({reason_of(error)})")

    def _ros1(self, file: _Stream, size: int) -> Iterator[Record]:
        """Records of ROS 1; those of chunks in turn, whose size is 0."""
        index_at = 0
        while head := file.read(4):
            self._is_whole |= 0 < index_at < _position(file)
            fields = _fields(_exactly(file, min(*struct.unpack("<I", head), _MOST_HEADER)))
            (length,) = struct.unpack("<I", _exactly(file, 4))
            operation = fields[b"op"][0]
            if operation == 5 and size:
                (declared,) = struct.unpack("<I", fields[b"size"])
                end = _position(file) + length
                kind = fields[b"compression"].decode("ascii", "replace")
                yield from self._inside(self._ros1(self._chunk(file, length, kind, declared, size), 0))
                _check_end(end, size)
                continue
            data = _exactly(file, length)
            key = fields.get(b"conn", fields.get(b"topic", b""))
            if operation == 2 and key in self._channels:
                stamp = fields.get(b"time") or fields[b"sec"] + fields[b"nsec"]
                seconds, nanoseconds = struct.unpack("<II", stamp)
                yield self._channels[key], seconds * 10**9 + nanoseconds, data
            elif operation in (1, 7):
                more = {b"message_definition": b"", **fields, **(_fields(data) if operation == 7 else {})}
                words = (fields[b"topic"], more[b"type"], more.get(b"def", more[b"message_definition"]))
                topic, name, text = (word.decode("utf-8", "replace") for word in words)
                self._channels[key] = Channel(topic, name, text, "ros1")
            elif operation == 6 and len(data) == 8 * struct.unpack("<I", fields[b"count"])[0]:
                self._n_stated += sum(count for _, count in struct.iter_unpack("<II", data))
            elif operation == 3:
                (index_at,) = struct.unpack("<Q", fields[b"index_pos"])
                self._end = index_at
                if not index_at:
                    self._damage.append("it has no index, as of a recording that was not closed")

    def _mcap(self, file: _Stream, size: int) -> Iterator[Record]:
        """Records of MCAP; those of chunks in turn, whose size is 0."""
        while head := file.read(9):
            operation, length = struct.unpack("<BQ", head)
            end = _position(file) + length
            if operation == 2:  # the footer
                return
            if operation == 6 and size:
                declared, checksum = struct.unpack("<16xQI", _exactly(file, 28))
                kind, (packed,) = _text(file) or "none", struct.unpack("<Q", _exactly(file, 8))
                inner = self._chunk(file, packed, kind, declared, size)
                if checksum and end <= size and crc32(inner.getbuffer()) != checksum:
                    self._damage.append(f"the chunk up to byte {end} is damaged (its checksum differs)")
                else:
                    yield from self._inside(self._mcap(inner, 0))
            record = io.BytesIO(_exactly(file, length) if operation in (3, 4, 5, 11) else b"")
            if operation == 3:
                (number,) = struct.unpack("<H", _exactly(record, 2))
                self._schemas[number] = (_text(record), _text(record), _text(record))
            elif operation == 4:
                number, schema = struct.unpack("<HH", _exactly(record, 4))
                name, form, text = self._schemas.get(schema, ("", "", ""))
                self._channels[number] = Channel(
                    _text(record), name, text, _text(record), form.endswith("idl")
                )
            elif operation == 5:
                channel, time_ns = struct.unpack("<H4xQ8x", _exactly(record, 22))
                if channel in self._channels:
                    yield self._channels[channel], time_ns, record.read()
            elif operation == 11:
                self._n_stated += struct.unpack("<Q", _exactly(record, 8))[0]
            self._is_whole |= operation == 15  # the end of the data
            _check_end(end, size or end)
            file.seek(end)
        if size:
            raise EOFError("its end is missing")

    def _sqlite(self, path: Path, file: _Stream) -> Iterator[Record]:
        """Messages of a database of ROS 2, in the order of its rows."""
        head, journal = file.read(32), Path(f"{path}-wal")
        self._end = _page_bytes(head) * struct.unpack(">28xI", head)[0]
        file.seek(0, io.SEEK_END)
        if journal.is_file() and journal.stat().st_size:
            self._damage.append(f"messages in {journal.name} are not read: open and close it by sqlite3 once")
        with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True)) as base:
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
            base.text_factory = lambda text: text.decode("utf-8", "replace")
            base.execute("PRAGMA writable_schema = ON")  # a file that was cut off is opened with it only
            tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise FileError(
                    f"has tables {', '.join(sorted(tables)) or 'none'}, expected topics and messages."
                )
            query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            rows = base.execute(query) if "message_definitions" in tables else ()
            kinds = {name: (form, text) for name, form, text in rows}
            for number, *row in base.execute("SELECT id, name, type, serialization_format FROM topics"):
                form, text = kinds.get(row[1], ("", ""))
                self._channels[number] = Channel(row[0], row[1], text, row[2], form.endswith("idl"))
            query = "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ? ORDER BY rowid"
            last, failures, error = -1, 0, None
            while failures < _MOST_FAILURES:
                try:
                    for row_number, number, time_ns, data in base.execute(query, (last,)):
                        if row_number <= last:
                            raise sqlite3.DatabaseError("its rows go round in circles")
                        last, failures = row_number, 0
                        if number in self._channels and isinstance(data, bytes):
                            yield self._channels[number], time_ns, data
                    break
                except sqlite3.DatabaseError as caught:
                    last, failures, error = last + 1, failures + 1, caught
            if error is not None:
                raise error


def _page_bytes(head: bytes) -> int:
    """Size of a page of a database [bytes]."""
    (page,) = struct.unpack_from(">H", head, 16)
    return page if page > 1 else 1 << 16


def _position(file: _Stream) -> int:
    return file.seek(0, io.SEEK_CUR)


def _check_end(end: int, size: int) -> None:
    if end > size:
        raise EOFError("its end is missing")


def _fields(data: bytes) -> dict[bytes, bytes]:
    """Fields of a header of ROS 1."""
    fields, at = {}, 0
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, _, value = data[at + 4 : at + 4 + length].partition(b"=")
        fields[name] = value
        at += 4 + length
    return fields


def _exactly(file: _Stream, length: int) -> bytes:
    data = file.read(min(length, MOST_BYTES))
    _check_end(length, len(data))
    return data


def _text(file: _Stream) -> str:
    return _exactly(file, *struct.unpack("<I", _exactly(file, 4))).decode("utf-8", "replace")


def _decompressor(kind: str) -> Any:
    if kind == "bz2":
        return bz2.BZ2Decompressor()
    if kind == "lz4":
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

        return LZ4FrameDecompressor()
    if kind == "zstd":
        if sys.version_info >= (3, 14):
            from compression.zstd import ZstdDecompressor
        else:
            from backports.zstd import ZstdDecompressor

        return ZstdDecompressor()
    raise FileError(f"is packed by {kind!r}, expected bz2, lz4 or zstd. {_UNPACK}")


def _unpacked(file: _Stream, kind: str, limit: int) -> Iterator[bytes]:
    """Pieces of content, unpacked, as far as it goes; EOFError if it is damaged, or more than so many bytes."""
    if kind == "none":
        while limit > 0 and (piece := file.read(min(limit, 1 << 24))):
            limit -= len(piece)
            yield piece
        return
    unpack = _decompressor(kind)
    while not unpack.eof and (piece := file.read(_PIECE)):
        while True:
            try:
                unpacked = unpack.decompress(piece, limit + 1)
            except Exception as error:
                raise EOFError(reason_of(error)) from error
            limit, piece = limit - len(unpacked), b""
            if limit < 0:
                raise EOFError("it unpacks to more than it declares")
            yield unpacked
            if unpack.eof or unpack.needs_input:
                break
