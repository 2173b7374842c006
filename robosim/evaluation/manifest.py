"""What a folder of episodes was made of, so that a run goes on only with episodes of its own kind.

Episodes depend on the plans, the tasks and the configuration. A run that differs in any of what the folder holds is
rejected (`robosim.support.run_folder`); one that adds policies, repetitions, tasks or plans goes on. Code and versions
of packages are stored with each episode: a mixture is reported, not rejected, since most changes of code change
no result.
"""

import hashlib
import importlib.metadata
import json
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from robosim.episode import EpisodeConfig
from robosim.evaluation.suite import Suite
from robosim.plans.files import read_plan
from robosim.support.assets import assets_dir
from robosim.support.files import plain
from robosim.support.installation import package_version
from robosim.support.parts import to_dict
from robosim.support.reading import read_bytes

#: Packages whose code results depend on, loaded by what is imported above.
_OURS = ("robosim", "slam", "wireless")
_PACKAGES = (
    "robosim",
    "mujoco",
    "numpy",
    "scipy",
    "onnxruntime",
    "embreex",
    "pyrender",
    "opencv-contrib-python-headless",
)


def settings_of(suite: Suite, config: EpisodeConfig) -> dict[str, Any]:
    """All that the episodes of a folder depend on."""
    episode = plain(to_dict(config))
    for varied in ("goal", "seed"):
        episode.pop(varied)
    for name, value in _flat(episode).items():
        if isinstance(value, str) and value.endswith(".safetensors"):
            content = read_bytes(value, "weights of a network")
            episode[f"{name} content"] = hashlib.sha256(content).hexdigest()[:16]
    return {
        "seed": suite.seed,
        "plans": {name: read_plan(file, reader=suite.reader).digest() for name, file in suite.plans.items()},
        "tasks": {f"{t.plan}/{t.number}": [*t.start, *t.target] for t in suite.tasks},
        "episode": episode,
    }


def code_digest(policies: Iterable[str] = ()) -> str:
    """A text that changes with code and weights of the three packages, their libraries, and policies that are files."""
    digest = hashlib.sha256(json.dumps(versions()).encode())
    for policy in policies:
        if policy.endswith(".safetensors"):
            digest.update(policy.encode() + read_bytes(policy, "weights of a goal policy"))
    for file in sorted((assets_dir() / "weights").glob("*")):
        digest.update(file.name.encode() + file.read_bytes())
    for package in _OURS:
        folder = Path(str(sys.modules[package].__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(f"{package}/{file.relative_to(folder)}".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions of the packages that results depend on."""
    return {name: package_version(name) for name in _PACKAGES if _installed(name)}


def _installed(name: str) -> bool:
    try:
        package_version(name)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def _flat(value: Any, name: str = "") -> dict[str, Any]:
    """Nested dictionaries as one, keys joined by dots; lists whole."""
    if not isinstance(value, Mapping):
        return {name: value}
    items: Iterable[tuple[str, Any]] = (
        pair for key, item in value.items() for pair in _flat(item, f"{name}.{key}" if name else key).items()
    )
    return dict(items)
