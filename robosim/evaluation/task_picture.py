"""Pictures of the tasks of an evaluation: trajectories of two policies, their link states and goals."""

from collections.abc import Sequence

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path

from robosim.drawing.plots import explain, heading, wall_keys
from robosim.policies.reason import GoalKind
from robosim.recording.episode_file import RecordedEpisode
from robosim.recording.step_codec import NO_RADIO
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, TARGET, WALL, css
from robosim.task.tasks import ARRIVAL_M
from wireless.paths import LinkState

#: Lines of the two policies.
_LINES = (("#0072B2", "-", 2.0), ("#E69F00", "--", 1.6))
#: Decisions between the numbers along a trajectory.
_EVERY = 50
#: Colour of each kind of goal, after Okabe and Ito (2008).
GOAL_COLOURS = {
    GoalKind.KNOWN: "#000000",
    GoalKind.SEEN: "#D55E00",
    GoalKind.ARRIVAL: "#009E73",
    GoalKind.BELIEVED: "#CC79A7",
    GoalKind.LOOK: "#56B4E9",
    GoalKind.ACTION: "#0072B2",
    GoalKind.EXPLORE: "#F0E442",
    GoalKind.AWAY: "#8C6D46",
    GoalKind.PREVIOUS: "#7F7F7F",
    GoalKind.OTHER: "#DDDDDD",
}


def trajectories_figure(episodes: Sequence[RecordedEpisode]) -> Figure:
    """Draw one or two episodes of a task on one map, each with its link states and kinds of goals below."""
    size, (low, high) = _extent(episodes)
    figure, (plan, below) = plt.subplots(
        2, 1, figsize=size, height_ratios=[size[1] - _BELOW_INCHES, _BELOW_INCHES], layout="constrained"
    )
    plan.set_aspect("equal")
    plan.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    plan.set_facecolor("0.85")
    _draw_building(plan, episodes)
    for episode, style in zip(episodes, _LINES, strict=False):
        _draw_trajectory(plan, episode, style)
    row = episodes[0].head.row
    plan.plot(*row["start"][:2], "o", color="k", ms=6, label="start")
    plan.plot(*row["target"], "*", color=TARGET, ms=14, mec="k", mew=0.5, label="target")
    plan.add_patch(Circle(tuple(row["target"]), ARRIVAL_M, fill=False, color=TARGET, lw=0.8))
    keys = [*wall_keys(furnished=False)]
    keys.append(Line2D([], [], marker=".", ls="", color="0.25", label=f"every {_EVERY} decisions"))
    states, kinds = _draw_ribbons(below, episodes)
    after = [heading("estimated link state:")] if states else []
    after += [Patch(color=css(STATE_COLOURS[s]), label=STATE_NAMES[s]) for s in states]
    after += [heading("goal:"), *(Patch(facecolor=GOAL_COLOURS[kind], label=kind.value) for kind in kinds)]
    explain(plan, keys, after=after)
    return figure


_BELOW_INCHES = 1.3


def _extent(episodes: Sequence[RecordedEpisode]) -> tuple[tuple[float, float], np.ndarray]:
    """Size of the figure [inches], and what is shown: low and high corner [m]."""
    parts = [ring for episode in episodes for ring in episode.rings] + [
        episode.poses[:, :2] for episode in episodes
    ]
    parts.append(np.array([episodes[0].head.row["target"]], float))
    points = np.concatenate(parts)
    low, high = points.min(axis=0) - 0.5, points.max(axis=0) + 0.5
    aspect = (high[1] - low[1]) / (high[0] - low[0])
    width = 6.5 if aspect < 1.2 else 6.5 / aspect * 1.2
    height = float(np.clip(width * aspect, 2.5, 9.0))
    return (max(width, 4.0) + 2.2, height + _BELOW_INCHES + 0.9), np.stack([low, high])


def _draw_building(axes: Axes, episodes: Sequence[RecordedEpisode]) -> None:
    """Floor and walls."""
    closed = [np.vstack([ring, ring[:1]]) for ring in episodes[0].rings]
    codes = [[Path.MOVETO, *[Path.LINETO] * (len(ring) - 2), Path.CLOSEPOLY] for ring in closed]
    floor = Path(np.concatenate(closed), np.concatenate(codes))
    axes.add_patch(PathPatch(floor, facecolor="white", lw=0, zorder=0))
    axes.add_collection(LineCollection(closed, colors=WALL, linewidths=0.9, zorder=2))


def _draw_trajectory(axes: Axes, episode: RecordedEpisode, style: tuple[str, str, float]) -> None:
    row, (colour, dashes, width) = episode.head.row, style
    places = episode.poses[:, :2]
    end = f"arrives at {row['arrived_at_step']}" if row["arrived"] else f"{row['ended']} at {row['steps']}"
    axes.plot(*places.T, dashes, color=colour, lw=width, zorder=4, label=f"{row['policy']}: {end}")
    axes.plot(*places[-1], "s", color=colour, mec="k", ms=6, zorder=5)
    for i in range(_EVERY, len(places), _EVERY):
        axes.plot(*places[i], ".", color="0.25", ms=5, zorder=6)
        axes.annotate(
            str(i), tuple(places[i]), (3, 3), textcoords="offset points", fontsize=6, color=colour, zorder=6
        )


def _draw_ribbons(axes: Axes, episodes: Sequence[RecordedEpisode]) -> tuple[list[LinkState], list[GoalKind]]:
    """Estimated link state and kind of goal at each decision; returns those that occur."""
    states: set[LinkState] = set()
    kinds: set[GoalKind] = set()
    longest, names = max(len(recorded.goals) for recorded in episodes), []
    for k, episode in enumerate(episodes):
        policy = episode.head.row["policy"]
        link_states = [LinkState(state) for state in episode.link_states.tolist() if state != NO_RADIO]
        goals = [reason.kind for reason in episode.reasons]
        states |= set(link_states)
        kinds |= set(goals)
        rows = (
            (f"{policy}: link state", np.array([STATE_COLOURS[s] for s in link_states], np.uint8)),
            (f"{policy}: goal", _rgb([GOAL_COLOURS[kind] for kind in goals])),
        )
        for place, (name, colours) in enumerate(rows):
            y = -(2.4 * k + place)
            names.append((y, name))
            if len(colours):
                axes.imshow(colours[None], extent=(0, len(colours), y - 0.4, y + 0.4), aspect="auto")
    axes.set(xlim=(0, max(longest, 1)), ylim=(names[-1][0] - 0.5, 0.5), xlabel="decisions")
    axes.set_yticks([y for y, _ in names], [name for _, name in names], fontsize=7)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
    return sorted(states), [kind for kind in GoalKind if kind in kinds]


def _rgb(colours: Sequence[str]) -> UInt8[np.ndarray, "n 3"]:
    rgb: Float[np.ndarray, "n 3"] = np.array([to_rgb(colour) for colour in colours]).reshape(-1, 3)
    return np.rint(255 * rgb).astype(np.uint8)
