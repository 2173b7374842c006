"""Public names of a package: listed in its `__init__.pyi`, each imported at its first use."""

import re
import sys
from collections.abc import Callable, Container
from importlib import import_module
from pathlib import Path

_IMPORT = re.compile(r"^from ([\w.]+) import (\w+) as \2$", re.MULTILINE)


def public_names(
    package: str, file: str, hidden: Container[str] = ()
) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of a package, from the stub next to its file.

    Names from `hidden` modules are not in `__all__`.
    """
    stub = Path(file).with_suffix(".pyi").read_text("utf-8")
    modules = {name: module for module, name in _IMPORT.findall(stub)}
    listed = ["__version__"] if "\n__version__: str\n" in stub else []
    listed += [name for name, module in modules.items() if module not in hidden]

    def get(name: str) -> object:
        if name == "__version__" and name in listed:
            from importlib.metadata import version

            value: object = version("robosim-wireless")
        elif name in modules:
            value = getattr(import_module(modules[name]), name)
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        setattr(sys.modules[package], name, value)
        return value

    return get, lambda: sorted({*vars(sys.modules[package]), *listed}), listed
