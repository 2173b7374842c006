"""Replay of a recorded episode: its video, and a sheet of some of its frames."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.drawing.picture import LEGEND, Picture
from robosim.drawing.video import VideoWriter
from robosim.recording.episode_file import RecordedEpisode, read_episode
from robosim.support.files import write_whole

#: Width of a sheet that two frames or more fit into, and frames side by side [pixels].
_WIDEST, _COLUMNS = 2400, 3


def replay(folder: Path, out: Path, frames: int = 12) -> list[Path]:
    """Draw `replay.mp4`, the video of the episode, and `sheet.png` with evenly distributed frames; returns the files.

    Raises:
        ValueError: If the folder holds no episode, or one without decisions.
    """
    episode = read_episode(folder)
    if not len(episode):
        raise ValueError(f"{folder}: the episode ended at its start, without a step to draw.")
    picture = picture_of(episode)
    chosen = set(np.linspace(0, len(episode) - 1, min(frames, len(episode))).round().astype(int).tolist())
    video, sheet = Path(out) / "replay.mp4", Path(out) / "sheet.png"
    writer = VideoWriter(video, picture.size)
    on_sheet = []
    try:
        for step in episode.steps():
            frame = picture.draw(step)
            writer.add(frame)
            if step.number in chosen:
                on_sheet.append(frame)
    finally:
        writer.close()
    # A single legend for all.
    tiled = _tiled([frame[:, :-LEGEND] for frame in on_sheet])
    legend = np.full((len(tiled), LEGEND, 3), 255, np.uint8)
    legend[: len(on_sheet[0])] = on_sheet[0][:, -LEGEND:]
    _, content = cv2.imencode(".png", cv2.cvtColor(np.hstack([tiled, legend]), cv2.COLOR_RGB2BGR))
    write_whole(sheet, content.tobytes())
    return [video, sheet]


def picture_of(episode: RecordedEpisode) -> Picture:
    """A picture for the steps of a recorded episode, all of which are unpacked first, so that damage is found early.

    Raises:
        FileError: If a step is damaged.
    """
    row = episode.head.row
    return Picture(
        episode.rings,
        episode.target if episode.head.seeks_target else None,
        title=f"{row['plan']}  {row['policy']}",
        anticipates=episode.anticipates(),
    )


def _tiled(frames: list[UInt8[np.ndarray, "h w 3"]]) -> UInt8[np.ndarray, "H W 3"]:
    """Frames side by side, as many as fit, row by row."""
    fitting = max((_WIDEST - LEGEND) // frames[0].shape[1], 1)
    columns = min(fitting, _COLUMNS, len(frames))
    blank = np.full_like(frames[0], 255)
    full = [*frames, *[blank] * (-len(frames) % columns)]
    return np.vstack([np.hstack(full[i : i + columns]) for i in range(0, len(full), columns)])
