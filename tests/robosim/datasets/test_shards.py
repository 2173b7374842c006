"""Shards of collected frames: what their headers declare is compared with what is there."""

import io
import struct
import zipfile

import numpy as np
import pytest

from robosim.datasets.collect import read_shard
from robosim.support.reading import FileError


def depth(shape: str, data: bytes = bytes(64), kind: str = "<u2") -> bytes:
    """An archive whose array of depths declares any shape."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("depth.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data)
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (
            depth("(1000000, 4096, 4096)"),
            "depth is declared as (1000000, 4096, 4096) of uint16, but 64 bytes are",
        ),
        (depth("(-1, 8, 8)"), "depth is declared as (-1, 8, 8)"),
        (depth("(2, 4, 4)"), "it has 2 frames of 4 x 4 pixels"),
        (depth("(1, 1, 32)"), "it has 1 frames of 1 x 32 pixels"),
        (depth("(0, 8, 8)"), "it has 0 frames of 8 x 8 pixels"),
        (depth("(8, 8)", bytes(128)), "depth is uint16 of shape (8, 8)"),
        (depth("(1, 2, 2)", kind="|O"), "depth holds object"),
        (depth("(1, 2, 2)", kind="<f8"), "depth is float64"),
    ],
)
def test_a_header_that_declares_something_else_is_rejected(tmp_path, content, words):
    path = tmp_path / "home-00001.npz"
    path.write_bytes(content)
    with pytest.raises(FileError) as raised:
        read_shard(path, ["depth"])
    assert str(path) in str(raised.value) and words in str(raised.value)


def test_a_good_header_is_read(tmp_path):
    path = tmp_path / "home-00001.npz"
    path.write_bytes(depth("(1, 8, 8)", np.arange(64, dtype="<u2").tobytes()))
    assert np.array_equal(read_shard(path, ["depth"])[0].ravel(), np.arange(64))
