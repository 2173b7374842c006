"""What a folder of results was made of, so that a run goes on only with episodes of its own kind.

Episodes depend on the plans, the tasks and the configuration. A run that differs in any of what the folder holds is
refused; one that adds policies, repetitions, tasks or plans goes on. Code and versions of packages are kept with
each episode: results of a mixture are told, not refused, since most changes of code change no result.
"""

import hashlib
import importlib.metadata
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import robosim
import slam
import wireless
from robosim.episode import EpisodeConfig
from robosim.evaluation.suite import Suite
from robosim.planfiles import read_plan
from robosim.support.assets import assets_dir
from robosim.support.files import plain, write_json

_PACKAGES = (
    "robosim",
    "mujoco",
    "numpy",
    "scipy",
    "torch",
    "embreex",
    "pyrender",
    "opencv-contrib-python-headless",
)


def check_manifest(out: Path, suite: Suite, config: EpisodeConfig) -> None:
    """Compare with the folder's manifest if it has one, and write what both come to.

    Raises:
        ValueError: If the folder holds episodes of another configuration, plan or task; the first difference is named.
        MapError: If a plan cannot be read.
    """
    episode = plain(asdict(config))
    for varied in ("goal", "seed"):
        episode.pop(varied)
    for name, value in _flat(episode).items():
        if isinstance(value, str) and value.endswith(".safetensors") and Path(value).is_file():
            episode[f"{name} content"] = hashlib.sha256(Path(value).read_bytes()).hexdigest()[:16]
    new = {
        "seed": suite.seed,
        "plans": {name: read_plan(file).digest() for name, file in suite.plans.items()},
        "tasks": {f"{t.plan}/{t.number}": [*t.start, *t.target] for t in suite.tasks},
        "config_hash": hashlib.sha256(json.dumps(episode, sort_keys=True).encode()).hexdigest()[:16],
        "episode": episode,
    }
    path = Path(out) / "manifest.json"
    old = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else new
    before, now = _flat(old), _flat(new)
    # Plans and tasks may be added, or not be asked for this time; an option can be in one only by other code.
    both = [
        key
        for key in sorted(before.keys() | now.keys())
        if key != "config_hash" and (key.startswith("episode.") or (key in before and key in now))
    ]
    different = [key for key in both if before.get(key) != now.get(key)]
    if different:
        key = different[0]
        more = f", and {len(different) - 1} more" if len(different) > 1 else ""
        raise ValueError(
            f"{out}: holds episodes with {key} = {before.get(key)!r}, this run has {now.get(key)!r}{more}. "
            "Choose another --out, or give the same options and plans."
        )
    for kind in ("plans", "tasks"):
        new[kind] = {**old[kind], **new[kind]}
    write_json(path, new)


def code_digest() -> str:
    """A text that changes with the code of the three packages, their weights, and what they stand on."""
    digest = hashlib.sha256(json.dumps(versions()).encode())
    for file in sorted((assets_dir() / "weights").glob("*")):
        digest.update(file.name.encode() + file.read_bytes())
    for package in (robosim, slam, wireless):
        folder = Path(str(package.__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            digest.update(f"{package.__name__}/{file.relative_to(folder)}".encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def versions() -> dict[str, str]:
    """Versions of the packages that results depend on."""
    return {name: importlib.metadata.version(name) for name in _PACKAGES if _installed(name)}


def _installed(name: str) -> bool:
    try:
        importlib.metadata.version(name)
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
