"""Videos that other programs can read, also when they end early."""

import av
import numpy as np
import pytest

from robosim.drawing.video import VideoWriter


def test_frames_come_back_in_order_and_colour(tmp_path):
    """Flat frames of four colours survive the codec within 6 levels of 255 (measured 3)."""
    colours = [(200, 30, 30), (30, 200, 30), (30, 30, 200), (120, 120, 120)]
    video = VideoWriter(tmp_path / "a.mp4", (64, 32), fps=10)
    for colour in colours:
        video.add(np.full((32, 64, 3), colour, np.uint8))
    assert not (tmp_path / "a.mp4").exists(), "a video has its name once it is whole"
    video.close()
    with av.open(str(tmp_path / "a.mp4")) as file:
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
        assert float(file.streams.video[0].average_rate) == 10
    assert len(frames) == 4
    for frame, colour in zip(frames, colours, strict=True):
        assert np.abs(frame.astype(int) - colour).max() <= 6


def test_a_video_without_frames_leaves_no_file(tmp_path):
    VideoWriter(tmp_path / "a.mp4", (64, 32)).close()
    assert list(tmp_path.iterdir()) == []


def test_odd_sizes_are_rejected(tmp_path):
    with pytest.raises(ValueError, match="even"):
        VideoWriter(tmp_path / "a.mp4", (63, 32))
