"""What `robosim`, `slam` and `wireless` offer by name: all is there, documented, and costs nothing until imported."""

import ast
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

PACKAGES = ("robosim", "slam", "wireless")
#: Libraries that take long to load, and that no one needs for a first look.
HEAVY = {
    "torch",
    "onnxruntime",
    "matplotlib",
    "mujoco",
    "pyrender",
    "numba",
    "pyarrow",
    "scipy",
    "shapely",
    "trimesh",
}


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there_and_documented(package):
    """Each name of the stub resolves, in the module that it names, is listed by `dir`, and has a docstring."""
    module = import_module(package)
    stub = ast.parse(Path(module.__file__).with_suffix(".pyi").read_text())
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    modules = {alias.name: node.module for node in imports for alias in node.names}
    assert ["__version__", *modules] == module.__all__
    for name, place in modules.items():
        assert getattr(module, name) is getattr(import_module(place), name)
        assert getattr(module, name).__doc__, name
    assert set(modules) <= set(dir(module))


@pytest.mark.parametrize("package", PACKAGES)
def test_an_unknown_name_is_an_attribute_error(package):
    """As of every module, so that `hasattr` and imports of submodules work."""
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'no_such_name'"):
        import_module(package).no_such_name  # noqa: B018


@pytest.mark.parametrize("package", PACKAGES)
def test_version_and_types_are_reported(package):
    """`__version__` is the installed one, and `py.typed` says that annotations may be relied on."""
    module = import_module(package)
    assert module.__version__ == version("robosim-wireless")
    assert (Path(module.__file__).parent / "py.typed").is_file()


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_loads_nothing_heavy(package):
    """In a fresh process: a name is imported on first access, and with it what it needs."""
    code = f"import sys, {package}; print(*sys.modules)"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(process.stdout.split())
