"""What commands share: the terminal they print to, how points are typed, where plans and results lie."""

import os
import sys
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

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


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """How to read floor plans that do not say everything themselves."""

    resolution: float | None = None
    """Metres per pixel, for plans that do not say (images, arrays)."""
    floor_height: float | None = None
    """Height of the storey's floor [m], for meshes of several storeys."""
    up: Literal["auto", "y", "z"] = "auto"
    """Axis of a mesh that points up; auto goes by its format and floors."""
    unit: float = 1.0
    """Unit of length of a mesh [m]: 0.001 for millimetres, 0.0254 for inches."""


#: For plans that say everything themselves.
NO_OPTIONS = PlanOptions()


def read(plan: str, options: PlanOptions = NO_OPTIONS) -> FloorPlan:
    """The floor plan of a name or file."""
    from robosim.planfiles import read_plan

    return read_plan(
        plan,
        resolution_m=options.resolution,
        floor_height_m=options.floor_height,
        up=options.up,
        unit_m=options.unit,
    )


def folder_for(out: Path | None, verb: str) -> Path:
    """The folder asked for, or a new one under runs/ named by the time and the command.

    Raises:
        ValueError: If it cannot be made or written to: said before the work rather than after it.
    """
    folder = out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-{verb}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"out is {str(folder)!r}, which cannot be a folder ({error.strerror}). Choose another."
        ) from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"out is {str(folder)!r}, a folder that you may not write to. Choose another.")
    return folder
