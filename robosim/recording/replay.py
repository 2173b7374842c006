"""Replay of a recorded episode: its video, and a sheet of some of its frames."""

from collections.abc import Iterator, Mapping
from itertools import zip_longest
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from robosim.drawing.picture import LEGEND, Picture
from robosim.drawing.team_picture import TeamPicture
from robosim.drawing.video import VideoWriter
from robosim.recording.episode_file import RecordedEpisode, read_team
from robosim.support.files import write_whole

#: Width of a sheet that two frames or more fit into, and frames side by side [pixels].
_WIDEST, _COLUMNS = 2400, 3


def replay(folder: Path, out: Path, frames: int = 12) -> list[Path]:
    """Draw `replay.mp4`, the video of the episode, and `sheet.png` with evenly distributed frames; returns the files.

    The folder of a team gives the video of the team.

    Raises:
        ValueError: If the folder holds no episode, or one without decisions.
    """
    episodes = read_team(folder)
    count = max(map(len, episodes.values()))
    if not count:
        raise ValueError(f"{folder}: the episode ended at its start, without a step to draw.")
    picture = picture_of(episodes[""]) if "" in episodes else team_picture_of(episodes)
    chosen = set(np.linspace(0, count - 1, min(frames, count)).round().astype(int).tolist())
    video, sheet = Path(out) / "replay.mp4", Path(out) / "sheet.png"
    writer = VideoWriter(video, picture.size)
    on_sheet = []
    try:
        for number, frame in enumerate(_frames(picture, episodes)):
            writer.add(frame)
            if number in chosen:
                on_sheet.append(frame)
    finally:
        writer.close()
    # A single legend for all.
    before_legend = picture.size[0] - picture.legend_width
    tiled = _tiled([frame[:, :before_legend] for frame in on_sheet])
    legend = np.full((len(tiled), picture.legend_width, 3), 255, np.uint8)
    legend[: len(on_sheet[0])] = on_sheet[0][:, before_legend:]
    _, content = cv2.imencode(".png", cv2.cvtColor(np.hstack([tiled, legend]), cv2.COLOR_RGB2BGR))
    write_whole(sheet, content.tobytes())
    return [video, sheet]


def _frames(
    picture: Picture | TeamPicture, episodes: Mapping[str, RecordedEpisode]
) -> Iterator[UInt8[np.ndarray, "h w 3"]]:
    """Pictures of all steps, in the order in which the robots took them."""
    for steps in zip_longest(*(episode.steps() for episode in episodes.values())):
        for name, step in zip(episodes, steps, strict=True):
            # A robot that was lost has fewer steps.
            if step is not None and (frame := picture.add(name, step)) is not None:
                yield frame
    if (frame := picture.last()) is not None:
        yield frame


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


def team_picture_of(episodes: Mapping[str, RecordedEpisode]) -> TeamPicture:
    """A picture for the steps of a team by robot, all of which are unpacked first, as `picture_of` does.

    Raises:
        FileError: If a step is damaged.
    """
    for episode in episodes.values():
        episode.anticipates()
    first = next(iter(episodes.values()))
    return TeamPicture(
        first.rings,
        first.target if first.head.seeks_target else None,
        list(episodes),
        title=f"{first.head.row['plan']}  {first.head.row['policy']}",
    )


def _tiled(frames: list[UInt8[np.ndarray, "h w 3"]]) -> UInt8[np.ndarray, "H W 3"]:
    """Frames side by side, as many as fit, row by row."""
    fitting = max((_WIDEST - LEGEND) // frames[0].shape[1], 1)
    columns = min(fitting, _COLUMNS, len(frames))
    blank = np.full_like(frames[0], 255)
    full = [*frames, *[blank] * (-len(frames) % columns)]
    return np.vstack([np.hstack(full[i : i + columns]) for i in range(0, len(full), columns)])
