"""Which commands there are: a table that imports none of them, so that each starts with what it needs itself."""

import importlib
from collections.abc import Callable

#: Commands by their words: where they are, and what a list says of them. None is imported before it is asked for.
COMMANDS = {
    "episode": ("episode:episode", "Drive a robot through a building, and record what it did and saw."),
    "replay": (
        "replay:replay",
        "Draw an episode again from its log: the same video, and a sheet of frames. Nothing is simulated.",
    ),
    "view": (
        "replay:view",
        "Open an episode's recording in the Rerun viewer: maps, rays, angles of arrival and belief over time, in 3D.",
    ),
    "evaluate": (
        "evaluate:evaluate",
        "Compare goal policies: the same searches by all of them, and how often and how fast they arrive.",
    ),
    "plan": (
        "scenes:plan",
        "Show a floor plan: its size, its rooms and what a robot can reach; and export it and its building.",
    ),
    "trace": ("trace:trace", "Trace radio paths from transmitters to receivers all over a floor plan."),
    "dataset": (
        "dataset:dataset",
        "Make a data set of links: true paths, link states, and what a receiver with beams estimates of them.",
    ),
    "generate": ("scenes:generate", "Make floor plans of buildings like real ones, each from its own seed."),
    "collect": (
        "collect:collect",
        "Collect frames to train a mapper on: a robot explores made homes; the truth is kept beside what it senses.",
    ),
    "doctor": (
        "machine:doctor",
        "Check this machine: what works, how fast, and what to install where something does not.",
    ),
    "bench render": (
        "bench:render",
        "Measure cameras: frames per second against depth error, with the usual alternatives beside ours.",
    ),
    "bench physics": (
        "bench:physics",
        "Measure driving: steps per second against motion error, over time steps and against kinematic.",
    ),
    "bench navigation": (
        "bench:navigation",
        "Measure navigation: one task a plan, arrival, SPL, wall penetration, coverage and pose error.",
    ),
    "bench exploration": (
        "bench:exploration",
        "Measure exploration: how much of the floor is seen after how many decisions, explorer beside explorer.",
    ),
    "bench episode": (
        "bench:episode",
        "Measure whole episodes: decisions per second against arrival time, with one part changed at a time.",
    ),
    "bench slam": (
        "bench:slam",
        "Measure mapping: the learned mapper against the classical one, and ways to know the pose, on the same frames.",
    ),
    "bench endurance": (
        "bench:endurance",
        "Measure endurance: thousands of decisions in one building; pose error, memory, and numbers that are none.",
    ),
    "bench wireless": (
        "bench:wireless",
        "Measure the radio tracer: links per second against errors, over outline tolerance, reflections, diffraction.",
    ),
    "bench estimation": (
        "bench:estimation",
        "Measure sounding and path estimation: links per second against the error of the angle of arrival.",
    ),
    "bench labels": (
        "bench:labels",
        "Compare traced link states and angles with the published ones of mmwRobotNav, and say how many agree.",
    ),
    "figures plans": (
        "figures:plans",
        "Compare generated buildings with real ones: size, rooms, walls, doors, narrowest passages.",
    ),
    "figures arrays": (
        "figures:arrays",
        "Draw antenna elements, and the beams and coverage of the base station's and the robot's three arrays.",
    ),
    "figures wireless": (
        "figures:wireless",
        "Draw the published figures of radio from any plans: arrays, links, angles, training, maps of link states.",
    ),
    "figures search": (
        "figures:search",
        "Draw the published figures of the search from an evaluation: arrival rates, relative times, an example.",
    ),
    "train link-state": (
        "train:link_state",
        "Train a classifier of link states on public measurements (mmwRobotNav) or a data set, and score it.",
    ),
    "train mapper": (
        "train:mapper",
        "Train the learned mapper on collected frames, supervised by the truth kept with them.",
    ),
    "train pose": (
        "train:pose",
        "Train the learned pose on collected frames: how far off a predicted pose is, from map and frame.",
    ),
    "train explorer": (
        "train_policies:explorer",
        "Train the choice among frontiers by reinforcement (PPO), on walks through invented homes.",
    ),
    "train steering": (
        "train_policies:steering",
        "Train the learned local policy by imitation of the deterministic one (DAgger), on drives in made homes.",
    ),
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
    module, function = COMMANDS[name][0].split(":")
    found: Callable[..., None] = getattr(importlib.import_module(f"robosim.commands.{module}"), function)
    return found


def listed(group: str = "") -> dict[str, Callable[..., None]]:
    """What a list of commands shows: those of a group, or those of one word and the groups."""
    if group:
        return {
            name.split()[1]: _saying(text)
            for name, (_, text) in COMMANDS.items()
            if name.startswith(f"{group} ")
        }
    of_one_word = {name: _saying(text) for name, (_, text) in COMMANDS.items() if " " not in name}
    return of_one_word | {
        name: _saying(f"{text}: {', '.join(listed(name))}.") for name, text in GROUPS.items()
    }


def _saying(text: str) -> Callable[..., None]:
    """Something for a list to show a text of."""

    def command() -> None: ...

    command.__doc__ = text
    return command
