"""Which commands there are: a table that imports none of them, so that each starts with what it needs itself."""

import importlib
import re
from collections.abc import Callable
from pathlib import Path

#: Commands by their words, and where they are. None is imported before it is asked for.
COMMANDS = {
    "episode": "episode:episode",
    "replay": "replay:replay",
    "view": "replay:view",
    "live": "live:live",
    "evaluate": "evaluate:evaluate",
    "plan": "scenes:plan",
    "trace": "trace:trace",
    "dataset": "dataset:dataset",
    "generate": "scenes:generate",
    "collect": "collect:collect",
    "collect-searches": "collect:collect_searches",
    "calibrate": "calibrate:calibrate",
    "calibrate-materials": "calibrate_materials:calibrate_materials",
    "slam": "slam:slam",
    "doctor": "machine:doctor",
    "bench render": "bench:render",
    "bench physics": "bench:physics",
    "bench navigation": "bench_maps:navigation",
    "bench exploration": "bench_maps:exploration",
    "bench episode": "bench:episode",
    "bench slam": "bench_maps:slam",
    "bench belief": "bench:belief",
    "bench endurance": "bench_maps:endurance",
    "bench wireless": "bench_radio:wireless",
    "bench storeys": "bench_radio:storeys",
    "bench estimation": "bench_radio:estimation",
    "bench labels": "bench_radio:labels",
    "bench edges": "bench_radio:edges",
    "bench scattering": "bench_radio:scattering",
    "bench positioning": "bench_radio:positioning",
    "bench live": "bench_live:live",
    "bench environment": "bench:environment",
    "figures plans": "figures:plans",
    "figures arrays": "figures:arrays",
    "figures wireless": "figures:wireless",
    "figures search": "figures:search",
    "train link-state": "train:link_state",
    "train mapper": "train:mapper",
    "train pose": "train:pose",
    "train explorer": "train_policies:explorer",
    "train steering": "train_policies:steering",
    "train search": "train_policies:search",
}
#: Commands of two words by their first.
GROUPS = {
    "bench": "Measure speed against error",
    "figures": "Draw figures",
    "train": "Train what is learnt",
}


def named(words: list[str]) -> str:
    """The command that words begin with; empty if they begin with none."""
    two = " ".join(words[:2])
    return two if two in COMMANDS else words[0] if words and words[0] in COMMANDS else ""


def loaded(name: str) -> Callable[..., None]:
    """The function of a command."""
    module, function = COMMANDS[name].split(":")
    found: Callable[..., None] = getattr(importlib.import_module(f"robosim.commands.{module}"), function)
    return found


def said(name: str) -> str:
    """What a list says of a command: the first sentence of its function, which is read and not imported."""
    module, function = COMMANDS[name].split(":")
    source = (Path(__file__).parent / f"{module}.py").read_text("utf-8")
    # Parsing a file takes ten times as long.
    found = re.search(rf'^def {function}\(.*?"""(.*?)(?:\n\n|""")', source, re.DOTALL | re.MULTILINE)
    if found is None:
        raise LookupError(f"{module}.py has no function {function} with a docstring.")
    return " ".join(found[1].split())


def listed(group: str = "") -> dict[str, Callable[..., None]]:
    """What a list of commands shows: those of a group, or those of one word and the groups."""
    if group:
        return {name.split()[1]: _saying(said(name)) for name in COMMANDS if name.startswith(f"{group} ")}
    of_one_word = {name: _saying(said(name)) for name in COMMANDS if " " not in name}
    return of_one_word | {
        name: _saying(f"{text}: {', '.join(listed(name))}.") for name, text in GROUPS.items()
    }


def _saying(text: str) -> Callable[..., None]:
    """Something for a list to show a text of."""

    def command() -> None: ...

    command.__doc__ = text
    return command
