"""Every configuration rejects numbers and names that make no sense, where it is made."""

import dataclasses
import importlib
import math
from functools import partial
from pathlib import Path
from typing import Any, get_args, get_type_hints

import jaxtyping
import pytest

import robosim
import slam
import wireless
from robosim.commands.shared_options import RadioOptions, WaveformOptions
from robosim.datasets.link_units import LinkSetConfig
from robosim.episode_config import EpisodeConfig
from robosim.generator.generate import GeneratorConfig
from robosim.navigation import make_navigator
from robosim.radio.link import RadioLinkConfig
from robosim.robot.odometry import NoiseModel
from robosim.simulator import SimulatorConfig
from slam.exploration.explorer import ExplorerConfig
from slam.grid import GridFrame
from wireless.em.materials import Layer, Material

#: Frozen dataclasses with numbers by default that are no configurations.
EXEMPT = {
    "Row": "a measurement, in which not-a-number stands for what was not measured",
    "ReadingOptions": "checked where a plan is read, with the file's name",
    "Style": "a kind of generated buildings, of which users choose one by its name",
    "LargeStyle": "the same",
    "Suite": "what a file holds, checked where it is read or drawn, with the file's name",
}
#: What must be given to make one of them.
NEEDED = {
    "DoorConfig": {"door": (0.0, 0.0)},
    "GridFrame": {"origin_xy": (0.0, 0.0)},
    "Layer": {"thickness_m": 0.01, "relative_permittivity": 2.0},
    "Material": {"name": "wall", "layers": (Layer(thickness_m=0.01, material="wood"),)},
}
BAD = {
    float: (math.nan, math.inf, -math.inf, -1e300, 1e300),
    int: (math.nan, math.inf, -(10**300), 10**300, 1.5, True),
}


@pytest.fixture(autouse=True)
def as_users_have_it(monkeypatch) -> None:
    """Without the type checker of the tests, which would be first to complain."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


def configurations() -> list[type]:
    """Frozen dataclasses of all packages that compare by value: those with arrays in them do not."""
    found = []
    for package in (robosim, slam, wireless):
        root = Path(package.__file__).parent
        for file in sorted(root.rglob("*.py")):
            if "@dataclass(frozen=True" not in file.read_text(encoding="utf-8"):
                continue
            name = ".".join((package.__name__, *file.relative_to(root).with_suffix("").parts))
            for kind in vars(importlib.import_module(name)).values():
                if (
                    not isinstance(kind, type)
                    or kind.__module__ != name
                    or not dataclasses.is_dataclass(kind)
                ):
                    continue
                if kind.__dataclass_params__.frozen and kind.__dataclass_params__.eq:
                    found.append(kind)
    return found


def numbers(kind: type) -> list[tuple[str, type]]:
    """Names of fields that have a number, or several, by default, and what they are."""
    found, types = [], get_type_hints(kind)
    for field in dataclasses.fields(kind):
        own = types[field.name]
        parts = {own, *(part for part in get_args(own) if isinstance(part, type))}
        if field.default is not dataclasses.MISSING and parts & {int, float}:
            found.append((field.name, float if float in parts else int))
    return found


CASES = [
    pytest.param(kind, name, what, id=f"{kind.__module__}.{kind.__name__}.{name}")
    for kind in configurations()
    if kind.__name__ not in EXEMPT
    and not kind.__name__.startswith("_")  # keys of files: checked where they go
    for name, what in numbers(kind)
]


def make(kind: type, **values: Any) -> None:
    """Make a configuration; options of commands check what they stand for when they need it."""
    made = kind(**{**NEEDED.get(kind.__name__, {}), **values})
    if kind in (RadioOptions, WaveformOptions):
        made.config()


def test_the_configurations_are_found():
    """There are some fifty, and those that this test stands for are among them."""
    names = {case.values[0].__name__ for case in CASES}
    assert len(names) > 40
    assert {
        "EpisodeConfig",
        "CameraConfig",
        "ControlConfig",
        "Recipe",
        "SoundingConfig",
        "WorkOptions",
    } <= names


@pytest.mark.parametrize(("kind", "name", "what"), CASES)
def test_every_number_of_a_configuration_has_bounds(kind, name, what):
    """Not-a-number, infinities and what no memory or patience would do are rejected, by the field's name."""
    make(kind)
    default = getattr(kind(**NEEDED.get(kind.__name__, {})), name)
    for bad in BAD[what]:
        if kind in (Material, GridFrame) and bad in (1.5, True):
            continue  # left to type checkers
        value = (bad, *default[1:]) if isinstance(default, tuple) else bad
        with pytest.raises(ValueError, match=r"is .*expected") as rejected:
            make(kind, **{name: value})
        assert "\n" not in str(rejected.value)
        assert len(str(rejected.value)) < 250


@pytest.mark.parametrize(
    ("make_it", "words"),
    [
        (
            partial(SimulatorConfig, physics="dynmic"),
            "physics is 'dynmic'. Did you mean 'dynamic'? Known: dynamic, ",
        ),
        (partial(SimulatorConfig, camera="pyrendr"), "Did you mean 'pyrender'?"),
        (partial(SimulatorConfig, recognition="markr"), "Did you mean 'marker'?"),
        (partial(RadioLinkConfig, engine="lve"), "engine is 'lve'. Did you mean 'live'?"),
        (partial(RadioLinkConfig, transmitter="gnd"), "Did you mean 'gnb'?"),
        (partial(RadioLinkConfig, receiver="uee"), "receiver is 'uee'. Did you mean 'ue'?"),
        (partial(RadioLinkConfig, estimator="sag"), "Did you mean 'sage'?"),
        (partial(EpisodeConfig, goal="fusd"), "goal is 'fusd'. Did you mean 'fused'?"),
        (partial(EpisodeConfig, explorer="gian"), "explorer is 'gian'. Did you mean 'gain'?"),
        (partial(EpisodeConfig, controller="planed"), "Did you mean 'planned'?"),
        (partial(EpisodeConfig, mapper="classic"), "mapper is 'classic'. Did you mean 'classical'?"),
        (
            partial(EpisodeConfig, mapper="not/there.safetensors"),
            "mapper is 'not/there.safetensors', but there is no",
        ),
        (partial(EpisodeConfig, mapper="mapper.pt"), "a .safetensors file"),
        (partial(EpisodeConfig, link_states="genrated"), "Did you mean 'generated'?"),
        (
            partial(EpisodeConfig, link_states="not/there.safetensors"),
            "link_states is 'not/there.safetensors', but",
        ),
        (partial(make_navigator, SimulatorConfig(), "gian"), "Did you mean 'gain'?"),
        (partial(make_navigator, SimulatorConfig(), mapper="neurl"), "Did you mean 'neural'?"),
        (partial(make_navigator, SimulatorConfig(), controller="planed"), "Did you mean 'planned'?"),
        (partial(LinkSetConfig, estimator="pac"), "Did you mean 'pca'?"),
        (partial(LinkSetConfig, headings="fixd"), "Did you mean 'fixed'?"),
        (partial(LinkSetConfig, formats=("deepmino",)), "Did you mean 'deepmimo'?"),
        (partial(LinkSetConfig, tx="gbn"), "Did you mean 'gnb'?"),
        (partial(GeneratorConfig, style="hone"), "style is 'hone'. Did you mean 'home'?"),
        (partial(NoiseModel, variant="publshed"), "Did you mean 'published'?"),
        (
            partial(ExplorerConfig, rating="clever"),
            "rating is 'clever'. Known: nearest, cheapest, gain, tour, learned.",
        ),
        (partial(SimulatorConfig, physics=None), "physics is None, a NoneType without pose."),
    ],
)
def test_names_of_parts_are_checked_where_a_configuration_is_made(make_it, words):
    with pytest.raises(ValueError) as rejected:
        make_it()
    assert words in str(rejected.value)
    assert "Known" in str(rejected.value)
