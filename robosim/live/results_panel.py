"""The tab `Replay`: a recorded episode, or an evaluation as a table from which each episode opens."""

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robosim.live.latest_worker import LatestWorker, close_all
from robosim.live.page_html import block, table
from robosim.live.player import Player
from robosim.live.recordings import EvaluatedEpisode, is_episode, read_evaluation, read_recording
from robosim.live.server import LIST, OPTION
from wireless.support.counting import counted

if TYPE_CHECKING:
    import viser

ROOT = "/recorded"
#: Largest number of rows of the table; the list has all episodes.
_ROWS = 40
NONE = "none"
#: Label of the list of episodes.
EPISODE = "episode"


class ResultsPanel:
    """The controls of the tab `Replay`."""

    def __init__(self, server: "viser.ViserServer", folder: Path, *, on_view: Callable[[], None]) -> None:
        """Fill the current part of the panel; `on_view` is called when another episode is drawn.

        Raises:
            FileError: If a file of the folder is damaged.
            ValueError: If there is nothing to show.
        """
        self._on_view = on_view
        self._episodes: dict[str, EvaluatedEpisode] = {}
        recording = read_recording(folder) if is_episode(folder) else None
        if recording is None:
            episodes = read_evaluation(folder)
            self._episodes = {_label(episode): episode for episode in episodes}
            names = tuple(self._episodes)
            server.gui.add_html(_table(episodes))
            first = server.gui.add_dropdown(EPISODE, names, initial_value=names[0])
            other = server.gui.add_dropdown("compared with", (NONE, *names), initial_value=NONE)
            for control in (first, other):
                control.on_update(lambda event: self._opener.put((first.value, other.value)))
        self.player = Player(server, ROOT)
        self._opener: LatestWorker[tuple[str, str]] = LatestWorker("results", self._open, self._show_error)
        if recording is not None:
            self.player.load([recording], playing=False, following=False)
        else:
            self._opener.put((next(iter(self._episodes)), NONE))

    def close(self) -> None:
        """End everything."""
        close_all([self._opener])
        self.player.close()

    def _open(self, names: tuple[str, str]) -> None:
        recordings = [self._episodes[name].read() for name in names if name != NONE]
        self.player.say("")
        self.player.load(recordings, playing=False, following=False)
        self._on_view()

    def _show_error(self, error: Exception) -> None:
        self.player.say(" ".join(str(error).split()), bad=True)


def _label(episode: EvaluatedEpisode) -> str:
    row = episode.row
    end = counted(row["arrived_at_step"], "step") if row["arrived"] else str(row["ended"])
    repeat = f".{row['repeat']}" if row["repeat"] else ""
    return f"{row['plan']} {row['task']}{repeat} {row['policy']}: {end}"


def _table(episodes: list[EvaluatedEpisode]) -> str:
    rows = []
    for episode in episodes[:_ROWS]:
        row, relative = episode.row, episode.relative_steps
        slower = "–" if np.isnan(relative) else "never" if np.isinf(relative) else f"{relative:.2f}"
        cells = [
            row["plan"], row["task"], row["policy"], "yes" if row["arrived"] else "no", row["steps"], slower,
            f"{row['path_length_m']:.1f}", f"{row['shortest_m']:.1f}",
        ]  # fmt: skip
        opening = f'<tr {LIST}="{EPISODE}" {OPTION}="{escape(_label(episode))}">'
        rows.append([opening, *(escape(str(cell)) for cell in cells)])
    heads = ("plan", "task", "policy", "arrived", "steps", "x fastest", "path [m]", "min. [m]")
    style = "max-height:14em;overflow-y:auto"
    more = f"<br>{len(episodes) - _ROWS} more in the list below" if len(episodes) > _ROWS else ""
    return block(
        f"<b>{counted(len(episodes), 'episode')}</b>: failures first, then the slowest relative to other policies on "
        f'the same task. A click opens one.<div class="wide heads" style="{style}">{table(heads, rows)}</div>{more}'
    )
