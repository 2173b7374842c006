"""Video files, written by PyAV with its own ffmpeg."""

import contextlib
import os
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.support.files import partial_path


class VideoWriter:
    """An H.264 MP4 file, which takes its name when it is closed.

    A video that ends early, by an interrupt or an error, can be played too, if it is closed.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: int = 20) -> None:
        """Open the file.

        Args:
            path: Where the video will be.
            size: Width and height of the frames [pixels], both even.
            fps: Frames per second of play.

        Raises:
            ValueError: If a side is odd, which the pixel format cannot hold.
        """
        if size[0] % 2 or size[1] % 2:
            raise ValueError(f"size = {size}, expected even numbers of pixels. Pad the frame by one.")
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = partial_path(self.path)
        self._empty = True
        self._sink = _Sink(self._partial, self.path)
        self._file = av.open(self._sink, "w", format="mp4")
        options = {"preset": "ultrafast", "crf": "28", "tune": "fastdecode"}
        self._stream = self._file.add_stream("libx264", rate=Fraction(fps), options=options)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        # One thread: two would race the simulation for the cores, and the bytes would depend on their number.
        self._stream.codec_context.thread_count = 1

    def add(self, frame: UInt8[np.ndarray, "h w 3"]) -> None:
        """Append an RGB frame.

        Raises:
            OSError: If it cannot be written.
        """
        self._empty = False
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
            if not self._empty:
                for packet in self._stream.encode():
                    self._file.mux(packet)
            self._file.close()
            self._sink.close()
            if not self._empty:
                os.replace(self._partial, self.path)
        finally:
            self._sink.abandon()
            self._partial.unlink(missing_ok=True)


class _Sink:
    """A file for ffmpeg whose methods never fail.

    On a full disk ffmpeg crashes with a segmentation fault when it closes the file. So errors are stored here, and
    raised where they can be handled.
    """

    def __init__(self, partial: Path, path: Path) -> None:
        self._file, self._path = partial.open("wb"), path
        self._error: OSError | None = None

    def write(self, content: bytes) -> int:
        """Write, unless an error has occurred."""
        return self._try(lambda: self._file.write(content), len(content))

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position."""
        return self._try(lambda: self._file.seek(offset, whence), 0)

    def tell(self) -> int:
        """The position."""
        return self._try(self._file.tell, 0)

    def _try(self, action: Callable[[], int], otherwise: int) -> int:
        if self._error is None:
            try:
                return action()
            except OSError as error:
                error.filename = str(self._path)
                self._error = error
        return otherwise

    def _flush(self) -> int:
        self._file.flush()
        return 0

    def check(self) -> None:
        """Raise the error, if there is one."""
        if self._error is not None:
            raise self._error

    def close(self) -> None:
        """Close the file; raise the error, if there is one."""
        self._try(self._flush, 0)
        self.check()
        self._file.close()

    def abandon(self) -> None:
        """Close the file, complete or not."""
        with contextlib.suppress(OSError):
            self._file.close()
