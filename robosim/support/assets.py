"""Paths of shipped files: floor plans and weights."""

from pathlib import Path


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
    """Weights of a shipped network of the navigator: mapper, pose, explorer, steering or search."""
    return assets_dir() / "weights" / f"{name}.safetensors"
