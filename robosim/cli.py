"""The `robosim` command: parses what is asked for, calls what does it, prints what came out.

Bad input ends in one sentence on standard error and exit status 2, never in a traceback.
"""

import logging
import sys
from collections.abc import Callable, Sequence

import tyro
from rich.console import Console
from rich.logging import RichHandler

from robosim.commands import bench, figures, train, train_policies
from robosim.commands.collect import collect
from robosim.commands.dataset import dataset
from robosim.commands.episode import episode
from robosim.commands.evaluate import evaluate
from robosim.commands.machine import doctor
from robosim.commands.replay import replay, view
from robosim.commands.scenes import generate, plan
from robosim.commands.trace import trace

_Commands = dict[str, Callable[..., None]]

_BENCH: _Commands = {
    "render": bench.render,
    "physics": bench.physics,
    "navigation": bench.navigation,
    "exploration": bench.exploration,
    "episode": bench.episode,
    "slam": bench.slam,
    "endurance": bench.endurance,
    "wireless": bench.wireless,
    "estimation": bench.estimation,
    "labels": bench.labels,
}
_FIGURES: _Commands = {
    "plans": figures.plans,
    "arrays": figures.arrays,
    "wireless": figures.wireless,
    "search": figures.search,
}
_TRAIN: _Commands = {
    "link-state": train.link_state,
    "mapper": train.mapper,
    "pose": train.pose,
    "explorer": train_policies.explorer,
    "steering": train_policies.steering,
}
_GROUPS: dict[str, tuple[str, _Commands]] = {
    "bench": (f"Measure speed against error: {', '.join(_BENCH)}.", _BENCH),
    "figures": (f"Draw figures: {', '.join(_FIGURES)}.", _FIGURES),
    "train": (f"Train what is learnt: {', '.join(_TRAIN)}.", _TRAIN),
}
_COMMANDS: _Commands = {
    "episode": episode,
    "replay": replay,
    "view": view,
    "evaluate": evaluate,
    "plan": plan,
    "trace": trace,
    "dataset": dataset,
    "generate": generate,
    "collect": collect,
    "doctor": doctor,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the `robosim` command."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    handler = RichHandler(console=Console(stderr=True), show_time=False, show_path=False)
    logging.basicConfig(level=logging.WARNING, format="%(message)s", handlers=[handler])
    if words and words[0] in _GROUPS:
        group = words.pop(0)
        description, commands = _GROUPS[group]
        prog = f"robosim {group}"
    else:
        groups = {name: _as_command(text) for name, (text, _) in _GROUPS.items()}
        commands, prog = {**_COMMANDS, **groups}, "robosim"
        description = (
            "Robots that see and hear in buildings made from floor plans. Each command has its own --help."
        )
    try:
        tyro.extras.subcommand_cli_from_dict(commands, prog=prog, description=description, args=words)
    except (ValueError, OSError) as error:
        Console(stderr=True).print(f"robosim: {error}", style="red", highlight=False, soft_wrap=True)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


def _as_command(text: str) -> Callable[..., None]:
    """Something for the top-level help to list a group by."""

    def group() -> None: ...

    group.__doc__ = text
    return group
