"""Look back: a recorded episode with a scrubber, or an evaluation as a table from which each episode opens."""

from collections.abc import Callable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.live.client import LIST, OPTION
from robosim.live.latest import Latest, close_all
from robosim.live.page_html import block
from robosim.live.player import Player
from robosim.live.recorded import Searched, is_episode, read_recording, read_searches
from wireless.support.counting import counted

if TYPE_CHECKING:
    import viser

ROOT = "/recorded"
#: Rows of the table of an evaluation; the list to choose from has all.
_ROWS = 40
NOBODY = "nothing"
#: Label of the list to choose from.
EPISODE = "episode"


class ResultsPanel:
    """The part `Look back` of the panel."""

    def __init__(self, server: "viser.ViserServer", folder: Path, *, on_view: Callable[[], None]) -> None:
        """Fill the current part of the panel.

        Args:
            server: The page.
            folder: Of an episode or an evaluation.
            on_view: Called when another episode is drawn.

        Raises:
            FileError: If a file in it is damaged.
            ValueError: If there is nothing to show.
        """
        self._on_view = on_view
        self._searches: dict[str, Searched] = {}
        self._recording = read_recording(folder) if is_episode(folder) else None
        if self._recording is None:
            self._offer(server.gui, read_searches(folder))
        self.player = Player(server, ROOT)
        self._opener: Latest[tuple[str, str]] = Latest("results", self._open, self._failed)
        if self._recording is not None:
            self.player.load([self._recording], playing=False, following=False)
        else:
            self.choose(next(iter(self._searches)), NOBODY)

    def close(self) -> None:
        """End what plays."""
        close_all([self._opener])
        self.player.close()

    def choose(self, name: str, other: str) -> None:
        """Open an episode of the evaluation, and perhaps another beside it."""
        self._opener.put((name, other))

    def settle(self, timeout_s: float) -> bool:
        """Wait until what was chosen is open; returns whether it came in time."""
        return self._opener.settle(timeout_s)

    def _offer(self, gui: "viser.GuiApi", searches: list[Searched]) -> None:
        self._searches = {_label(one): one for one in searches}
        names = tuple(self._searches)
        gui.add_html(_table(searches))
        first = gui.add_dropdown(EPISODE, names, initial_value=names[0])
        other = gui.add_dropdown("beside it", (NOBODY, *names), initial_value=NOBODY)
        for control in (first, other):
            control.on_update(lambda event: self.choose(first.value, other.value))

    def _open(self, names: tuple[str, str]) -> None:
        chosen = [self._searches[name].read() for name in names if name != NOBODY]
        self.player.say("")
        self.player.load(chosen, playing=False, following=False)
        self._on_view()

    def _failed(self, error: Exception) -> None:
        self.player.say(" ".join(str(error).split()), bad=True)


def _label(one: Searched) -> str:
    row = one.row
    arrived = counted(row["arrived_at_step"], "step") if row["arrived"] else str(row["ended"])
    again = f".{row['repeat']}" if row["repeat"] else ""
    return f"{row['plan']} {row['task']}{again} {row['policy']}: {arrived}"


def _table(searches: list[Searched]) -> str:
    rows = []
    for one in searches[:_ROWS]:
        row = one.row
        slower = "–" if np.isnan(one.slower) else "never" if np.isinf(one.slower) else f"{one.slower:.2f}"
        cells: list[Any] = [
            row["plan"], row["task"], row["policy"], "yes" if row["arrived"] else "no", row["steps"], slower,
            f"{row['path_length_m']:.1f}", f"{row['shortest_m']:.1f}",
        ]  # fmt: skip
        takes = f'{LIST}="{EPISODE}" {OPTION}="{escape(_label(one))}"'
        rows.append(f"<tr {takes}>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in cells) + "</tr>")
    heads = ("plan", "task", "policy", "arrived", "steps", "x fastest", "way [m]", "least [m]")
    head = "".join(f"<th>{name}</th>" for name in heads)
    more = f"<br>{len(searches) - _ROWS} more in the list below" if len(searches) > _ROWS else ""
    about = (
        f"<b>{counted(len(searches), 'episode')}</b>: failures first, then the slowest beside other policies on the "
        "same task. A click on one opens it."
    )
    table = f"<table><tr>{head}</tr>{''.join(rows)}</table>"
    return block(
        f'{about}<div class="wide heads" style="max-height:14em;overflow-y:auto">{table}</div>{more}'
    )
