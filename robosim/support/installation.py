"""How this program is installed, what to type to install more of it, and where its shipped files are.

The distribution is called robosim-wireless. A distribution called robosim on the public index is another project.
"""

import json
from importlib.metadata import PackageNotFoundError, distribution
from importlib.metadata import version as _version
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: Name under which pip knows this program.
DISTRIBUTION = "robosim-wireless"
#: Extras by the module that each brings.
EXTRAS = {
    "torch": "train",
    "viser": "live",
    "minari": "minari",
    "pettingzoo": "team",
    "distributed": "cluster",
    "rosbags": "bags",
    "ezdxf": "dxf",
    "svgelements": "svg",
    "ifcopenshell": "ifc",
}
_ROOT = Path(__file__).resolve().parents[2]


def package_version(name: str = "robosim") -> str:
    """Version of an installed package; this program's own for `robosim`."""
    return _version(DISTRIBUTION if name == "robosim" else name)


def install_command(extra: str) -> str:
    """Return the command that installs an extra, from a checkout or a wheel, as this program was installed."""
    source = _source()
    if not source.is_dir():
        return f"pip install '{DISTRIBUTION}[{extra}]'"
    place = "." if source == Path.cwd() else source
    return f"pip install {'-e ' if source == _ROOT else ''}'{place}[{extra}]'"


def is_installed(module: str) -> bool:
    """Whether a module can be imported."""
    try:
        return find_spec(module) is not None
    except ImportError:  # from a finder that blocks it
        return False


def missing_extra(module: str, purpose: str) -> ImportError:
    """The error of what needs a module that an extra brings, with the remedy."""
    return ImportError(
        f"{purpose} needs {module}, which is not installed: {install_command(EXTRAS[module])}", name=module
    )


def install_first(module: str) -> str:
    """Return the command that installs a module needed by another command; empty if it is installed."""
    if is_installed(module):
        return ""
    return f"{install_command(EXTRAS[module]) if module in EXTRAS else f'pip install {module}'}; "


def namesake() -> str | None:
    """How to remove the other project called robosim; None if it is not installed, and in worker processes."""
    try:
        other = distribution("robosim")
    except PackageNotFoundError:
        return None
    from multiprocessing import parent_process

    # This program under its former name has the same command.
    ours = any(point.value == "robosim.__main__:main" for point in other.entry_points)
    if ours or parent_process() is not None:
        return None
    message = f"robosim {other.version} is installed, another project"
    if not any(file.parts[0] == "robosim" for file in other.files or ()):
        return f"{message} than {DISTRIBUTION}, which is this one. Remove it: pip uninstall robosim"
    return (
        f"{message}, whose files lie among those of {DISTRIBUTION} and replace them. "
        f"Remove it: pip uninstall -y robosim && pip install --force-reinstall --no-deps '{_source()}'"
    )


def _source() -> Path:
    """The checkout that this program runs in, the folder or wheel it was installed from, or the distribution's name."""
    if (_ROOT / "pyproject.toml").is_file():
        return _ROOT
    try:
        # Where pip took it from (PEP 610), unless from an index.
        origin = json.loads(distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
    except PackageNotFoundError:
        origin = {}
    url = urlsplit(origin.get("url", ""))
    return Path(unquote(url.path)) if url.scheme == "file" else Path(DISTRIBUTION)


def assets_dir() -> Path:
    """Folder of the shipped files: inside the package once installed, next to it in a source tree."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "assets"
    return installed if installed.is_dir() else package.parent / "assets"


def shipped_plans() -> dict[str, Path]:
    """Names of the shipped floor plans and the ROS map YAML file of each, in alphabetical order."""
    return {path.stem: path for path in sorted((assets_dir() / "plans").glob("*.yaml"))}


def shipped_weights() -> dict[str, Path]:
    """Names of the shipped classifiers of link states and the weights of each, in alphabetical order."""
    folder = assets_dir() / "weights"
    return {
        path.stem.removeprefix("link-state-"): path
        for path in sorted(folder.glob("link-state-*.safetensors"))
    }


def shipped_network(name: str) -> Path:
    """Weights of a shipped network of the navigator: mapper, pose, explorer or search."""
    return assets_dir() / "weights" / f"{name}.safetensors"
