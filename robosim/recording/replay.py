"""Drawing an episode again from its log: the video, and a sheet of some of its frames."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.drawing.picture import LEGEND, Picture
from robosim.drawing.video import VideoWriter
from robosim.recording.decision_log import read_decisions
from robosim.support.files import write_whole

#: Width that a sheet has at most, if two frames fit into it [pixels], and frames beside each other.
_WIDEST, _COLUMNS = 2400, 3


def replay(folder: Path, out: Path, frames: int = 12) -> list[Path]:
    """Draw `replay.mp4`, the same video as of the episode, and `sheet.png`.

    Args:
        folder: An episode's.
        out: Where the files will be.
        frames: How many frames the sheet shows, evenly over the episode from the first to the last.

    Returns:
        The files.

    Raises:
        ValueError: If the folder holds no log, or a log without decisions.
    """
    log = read_decisions(folder)
    if not len(log):
        raise ValueError(f"{folder}: the episode ended where it began, without a decision to draw.")
    log.check_pictures()
    shown = set(np.linspace(0, len(log) - 1, min(frames, len(log))).round().astype(int).tolist())
    picture = Picture(log.rings, log.target, anticipates=log.anticipates)
    picture.seeks_target = log.seeks_target
    video, sheet = Path(out) / "replay.mp4", Path(out) / "sheet.png"
    writer = VideoWriter(video, picture.size)
    kept = []
    try:
        for i, snapshot in enumerate(log.snapshots()):
            frame = picture.draw(snapshot)
            writer.add(frame)
            if i in shown:
                kept.append(frame)
    finally:
        writer.close()
    # One legend for all.
    tiled = _tiled([frame[:, :-LEGEND] for frame in kept])
    beside = np.full((len(tiled), LEGEND, 3), 255, np.uint8)
    beside[: len(kept[0])] = kept[0][:, -LEGEND:]
    _, content = cv2.imencode(".png", cv2.cvtColor(np.hstack([tiled, beside]), cv2.COLOR_RGB2BGR))
    write_whole(sheet, content.tobytes())
    return [video, sheet]


def _tiled(frames: list[UInt8[np.ndarray, "h w 3"]]) -> UInt8[np.ndarray, "H W 3"]:
    """Frames side by side, as many as fit, row by row."""
    fitting = max((_WIDEST - LEGEND) // frames[0].shape[1], 1)
    columns = min(fitting, _COLUMNS, len(frames))
    blank = np.full_like(frames[0], 255)
    full = [*frames, *[blank] * (-len(frames) % columns)]
    return np.vstack([np.hstack(full[i : i + columns]) for i in range(0, len(full), columns)])
