"""Video by PyAV, which brings its own ffmpeg."""

import os
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from jaxtyping import UInt8


class VideoWriter:
    """An H.264 MP4 file, there under its name once closed.

    A video that stops early (an interrupt, an error in the loop that draws) is playable too, if it is closed.
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
        self._partial = self.path.with_name(f".{self.path.stem}.partial-{os.getpid()}{self.path.suffix}")
        self._file = av.open(str(self._partial), "w")
        self._empty = True
        options = {"preset": "ultrafast", "crf": "28", "tune": "fastdecode"}
        self._stream = self._file.add_stream("libx264", rate=Fraction(fps), options=options)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = "yuv420p"
        # One thread: two would race the simulation for the cores, and the bytes would depend on their number.
        self._stream.codec_context.thread_count = 1

    def add(self, frame: UInt8[np.ndarray, "h w 3"]) -> None:
        """Append an RGB frame."""
        self._empty = False
        # OpenCV converts five times faster than ffmpeg's scaler does.
        planes = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2YUV_I420), np.uint8)
        for packet in self._stream.encode(av.VideoFrame.from_ndarray(planes, format="yuv420p")):
            self._file.mux(packet)

    def close(self) -> None:
        """Finish the file and give it its name; without a frame there will be no file."""
        if self._empty:
            self._file.close()
            self._partial.unlink(missing_ok=True)
            return
        for packet in self._stream.encode():
            self._file.mux(packet)
        self._file.close()
        os.replace(self._partial, self.path)
