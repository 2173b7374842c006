"""Video files, written by PyAV with its own ffmpeg."""

import contextlib
import io
import os
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.support.files import partial_path


class VideoWriter:
    """An H.264 MP4 file, which gets its name when it is closed.

    A video that ends early, by an interrupt or an error, can be played too, if it is closed.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: int = 20) -> None:
        """Open the file for frames of an even width and height [pixels].

        Raises:
            ValueError: If a side is odd, which the pixel format cannot hold.
        """
        if size[0] % 2 or size[1] % 2:
            raise ValueError(f"size = {size}, expected even numbers of pixels. Pad the frame by one.")
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = partial_path(self.path)
        self._is_empty = True
        self._sink = _Sink(self._partial, self.path)
        self._file = av.open(self._sink, "w", format="mp4")
        options = {"preset": "ultrafast", "crf": "28", "tune": "fastdecode"}
        self._stream = self._file.add_stream("libx264", rate=Fraction(fps), options=options)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        # A single thread: two would race the simulation for the cores, and the bytes would depend on their number.
        self._stream.codec_context.thread_count = 1

    def add(self, frame: UInt8[np.ndarray, "h w 3"]) -> None:
        """Append an RGB frame; OSError if it cannot be written."""
        self._is_empty = False
        # OpenCV converts five times faster than ffmpeg's scaler does.
        planes = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2YUV_I420), np.uint8)
        for packet in self._stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv420p")):
            self._file.mux(packet)
        self._sink.check()

    def close(self) -> None:
        """Finish the file and give it its name; without frames no file is written.

        Raises:
            OSError: If it could not be written; no file remains then.
        """
        try:
            if not self._is_empty:
                for packet in self._stream.encode():
                    self._file.mux(packet)
            self._file.close()
            self._sink.check()
            self._sink.close()
            if not self._is_empty:
                os.replace(self._partial, self.path)
        finally:
            with contextlib.suppress(OSError):
                self._sink.close()
            self._partial.unlink(missing_ok=True)


class _Sink(io.FileIO):
    """A file for ffmpeg that stores errors until `check`.

    On a full disk ffmpeg crashes with a segmentation fault when it closes the file, if a method raises an error.
    """

    def __init__(self, partial: Path, path: Path) -> None:
        super().__init__(partial, "wb")
        self._path = path
        self._error: OSError | None = None

    def write(self, content: bytes) -> int:  # type: ignore[override]
        """Write all bytes, unless an error has occurred."""
        rest = memoryview(content)
        try:
            while len(rest) and self._error is None:
                rest = rest[super().write(rest) or 0 :]
        except OSError as error:
            self._store(error)
        return len(content)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position."""
        try:
            return super().seek(offset, whence)
        except OSError as error:
            self._store(error)
            return 0

    def _store(self, error: OSError) -> None:
        error.filename = str(self._path)
        self._error = self._error or error

    def check(self) -> None:
        """Raise the first error, if there is one."""
        if self._error is not None:
            raise self._error
