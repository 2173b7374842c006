"""What commands share: the terminal they print to, how points are typed, where plans and results lie."""

import sys
from datetime import datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

from robosim.floorplan import FloorPlan

#: A pipe has no width; tables should not be cut for it.
console = Console(width=None if sys.stdout.isatty() else 150)


def _numbers(least: int, most: int, metavar: str) -> tyro.constructors.PrimitiveConstructorSpec:
    """How tyro reads comma-separated numbers such as 3.2,-4.5."""

    def parse(words: list[str]) -> tuple[float, ...]:
        values = tuple(float(word) for word in words[0].split(","))
        if not least <= len(values) <= most or not np.isfinite(values).all():
            raise ValueError(f"expected {metavar}, finite numbers with commas and no spaces")
        return values

    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar=metavar,
        instance_from_str=parse,
        is_instance=lambda value: isinstance(value, tuple),
        str_from_instance=lambda value: [",".join(f"{v:g}" for v in value)],
    )


XY = Annotated[tuple[float, ...], _numbers(2, 2, "X,Y")]
Place = Annotated[tuple[float, ...], _numbers(2, 3, "X,Y[,Z]")]
Pose = Annotated[tuple[float, ...], _numbers(3, 3, "X,Y,YAW")]


def read(plan: str, resolution_m: float | None = None, floor_height_m: float | None = None) -> FloorPlan:
    """The floor plan of a name or file."""
    from robosim.planfiles import read_plan

    return read_plan(plan, resolution_m=resolution_m, floor_height_m=floor_height_m)


def folder_for(out: Path | None, verb: str) -> Path:
    """The folder asked for, or a new one under runs/ named by the time and the command."""
    folder = out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{verb}"
    folder.mkdir(parents=True, exist_ok=True)
    return folder
