"""Radio materials of buildings: permittivity and conductivity by name and frequency.

A material follows eps_r = a f^b and sigma = c f^d [S/m], f in GHz, fitted to measurements over a range of
frequencies. Its complex relative permittivity is eps = eps_r - j sigma / (2 pi f eps_0): fields vary as
exp(+j omega t), so that losses make Im(eps) < 0. Outside of the measured range nothing is extrapolated.

The rows are Table 3 of Recommendation ITU-R P.2040-4 (09/2025), equal to P.2040-3 (08/2023) where that has
them; the model is its equations (57) to (59). Where ranges of a material overlap, the first holds.
``"drywall"`` is layered drywall as used for 28 GHz navigation data sets (relative permittivity 2.94 and
0.1226 S/m there): the plasterboard row of the older P.2040-1 (07/2015), and above 100 GHz, where that ends, the rows
of plasterboard. That walls there are two boards with air between, as these data sets have them, is what
``"partition"`` says.

`WALLS` are made of layers, and so is a `Material` of your own, each of a material of the table or of a permittivity
of its own; the rest are half-spaces, or layers as thick as `wireless.tracing.tracer.TracerConfig` says.

Left out: magnetic materials, moisture, and walls whose sides differ.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Complex
from scipy.constants import epsilon_0

from robosim.support.checks import Range, checked
from wireless.em.scattering import MOST_NARROW

#: Thicker layers, or more of them, count as a mistake.
THICKEST_M, MOST_LAYERS = 10.0, 20


class Row(NamedTuple):
    """One fit: eps_r = a f^b and sigma = c f^d [S/m], f in GHz, between two frequencies [GHz]."""

    low_ghz: float
    high_ghz: float
    a: float
    b: float
    c: float
    d: float


#: Above 100 GHz, where P.2040-1 ends.
_PLASTERBOARD = (Row(110, 330, 2.56, 0, 0.0001, 1.7799), Row(100, 400, 2.65, 0, 0.0002, 1.598))
#: Fits of each material; where two hold, the first one counts.
MATERIALS: dict[str, tuple[Row, ...]] = {
    "vacuum": (Row(0.001, 450, 1, 0, 0, 0),),  # exact, so up to the end of the table
    "concrete": (Row(1, 100, 5.24, 0, 0.0462, 0.7822), Row(110, 330, 5.17, 0, 0.0145, 1.09)),
    "brick": (Row(1, 40, 3.91, 0, 0.0238, 0.16), Row(110, 330, 4.15, 0, 0.0006, 1.5712)),
    "plasterboard": (Row(1, 100, 2.73, 0, 0.0085, 0.9395), *_PLASTERBOARD),
    "drywall": (Row(1, 100, 2.94, 0, 0.0116, 0.7076), *_PLASTERBOARD),
    "wood": (
        Row(0.001, 100, 1.99, 0, 0.0047, 1.0718),
        Row(110, 330, 1.82, 0, 0.0040, 1.0761),
        Row(100, 400, 2.1183, 0, 0.0055, 1.1113),
    ),
    "glass": (
        Row(0.1, 100, 6.31, 0, 0.0036, 1.3394),
        Row(220, 450, 5.79, 0, 0.0004, 1.658),
        Row(100, 400, 6.5767, 0, 0.0012, 1.4697),
    ),
    "clear_acrylic": (Row(110, 330, 2.58, 0, 0.0001, 1.6524),),
    "ceiling_board": (
        Row(1, 100, 1.48, 0, 0.0011, 1.0750),
        Row(220, 450, 1.52, 0, 0.0029, 1.029),
        Row(100, 400, 1.2567, 0, 0.00013, 1.454),
    ),
    "chipboard": (Row(1, 100, 2.58, 0, 0.0217, 0.78), Row(100, 200, 2.16, 0, 0.0023, 1.359)),
    "plywood": (
        Row(1, 40, 2.71, 0, 0.33, 0),
        Row(110, 330, 1.94, 0, 0.0067, 0.9982),
        Row(100, 400, 2.17, 0, 0.0063, 1.045),
    ),
    "marble": (
        Row(1, 60, 7.074, 0, 0.0055, 0.9262),
        Row(110, 330, 7.94, 0, 0.0001, 1.7330),
        Row(100, 400, 8.62, 0, 0.0027, 1.15),
    ),
    "floorboard": (
        Row(50, 100, 3.66, 0, 0.0044, 1.3515),
        Row(220, 300, 5.27, 0, 2.22e-17, 7.3413),
        Row(300, 400, 5.27, 0, 0.0003, 2.0298),
        Row(400, 450, 5.27, 0, 49.8726, 0),
        Row(100, 400, 3.1575, 0, 0.001675, 1.32775),
    ),
    "vinyl_tile": (Row(1, 40, 3.62, 0, 0.0051, 0.8422),),
    "carpet_tile": (Row(1, 40, 2.08, 0, 0.0009, 0.82),),
    "asphalt_concrete": (Row(1, 40, 4.83, 0, 0.0108, 1.3969),),
    "metal": (Row(1, 100, 1, 0, 1e7, 0),),
    "very_dry_ground": (Row(1, 10, 3, 0, 0.00015, 2.52),),
    "medium_dry_ground": (Row(1, 10, 15, -0.1, 0.035, 1.63),),
    "wet_ground": (Row(1, 10, 30, -0.4, 0.15, 1.30),),
}


@dataclass(frozen=True, kw_only=True)
@checked
class Layer:
    """One layer of a wall: of a material of the table, or of a permittivity and conductivity of its own."""

    thickness_m: Annotated[float, Range(1e-9, THICKEST_M, "m")]
    """Thickness [m]."""
    material: str | None = None
    """A name of `MATERIALS`."""
    relative_permittivity: Annotated[float | None, Range(1, 1e6)] = None
    """Real part of the relative permittivity, at least 1."""
    conductivity_spm: Annotated[float, Range(0, 1e9, "S/m")] = 0.0
    """Conductivity [S/m]."""

    def __post_init__(self) -> None:
        if (self.material is None) == (self.relative_permittivity is None):
            raise ValueError(
                f"material is {self.material!r} and relative_permittivity is {self.relative_permittivity}, expected "
                "one of them."
            )
        if self.material is not None:
            _check_known(self.material, "material", MATERIALS)

    def properties(self, frequency_hz: float) -> tuple[float, float]:
        """Relative permittivity and conductivity [S/m] at a frequency.

        Raises:
            ValueError: If its material was not measured at this frequency.
        """
        if self.material is not None:
            return properties(self.material, frequency_hz)
        assert self.relative_permittivity is not None  # seen to when it was made
        return self.relative_permittivity, self.conductivity_spm


@dataclass(frozen=True)
class Material:
    """A wall made of layers, which are the same from both sides: in `Building` and `Tracer` in place of a name."""

    name: str
    """What pictures and files call it."""
    layers: tuple[Layer, ...]
    """From one face to the other."""
    scattering: float | None = None
    """Scattering coefficient S of its faces, see `wireless.em.scattering`; None for the value of the tracer's
    configuration."""
    lobe: int | None = None
    """Exponent of the scattered lobe, likewise."""

    def __post_init__(self) -> None:
        if not self.layers or len(self.layers) > MOST_LAYERS:
            raise ValueError(
                f"layers of {self.name!r} are {len(self.layers)}, expected 1 to {MOST_LAYERS}, from face to face."
            )
        for name, greatest in (("scattering", 1), ("lobe", MOST_NARROW)):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= greatest:
                raise ValueError(f"{name} of {self.name!r} is {str(value)[:40]}, expected 0 to {greatest}.")
        if self.layers != self.layers[::-1]:
            raise ValueError(
                f"layers of {self.name!r} differ from its two sides, expected the same order from both: walls here "
                "have no front. Take the mean of the sides, or the layer that reflects most, on both."
            )

    def __str__(self) -> str:
        return self.name

    def properties(self, frequency_hz: float) -> tuple[float, float]:
        """Relative permittivity and conductivity [S/m] of its outermost layer at a frequency."""
        return self.layers[0].properties(frequency_hz)


def check_material(name: str | Material, field: str = "material") -> None:
    """Raise ValueError for a name, in the message called `field`, that no material has; it suggests another."""
    if isinstance(name, Material):
        return
    _check_known(name, field, {**MATERIALS, **WALLS})


def _check_known(name: str, field: str, known: Mapping[str, object]) -> None:
    if name not in known:
        near = difflib.get_close_matches(name.lower().removeprefix("itu_"), known, n=1)
        hint = f"Did you mean {near[0]!r}? " if near else ""
        raise ValueError(f"{field} is {name!r}, expected a radio material. {hint}Known: {', '.join(known)}.")


def scattering_of(name: str | Material, share: float, lobe: int | None) -> tuple[float, int | None]:
    """Scattering coefficient and exponent of the lobe of a material, or these where it states none."""
    if not isinstance(name, Material):
        return share, lobe
    return share if name.scattering is None else name.scattering, lobe if name.lobe is None else name.lobe


def properties(name: str | Material, frequency_hz: float) -> tuple[float, float]:
    """Relative permittivity and conductivity [S/m] of a material, or its outermost layer, at a frequency.

    Raises:
        ValueError: If there is no such material, or it was not measured at this frequency.
    """
    if isinstance(name, Material):
        return name.properties(frequency_hz)
    check_material(name)
    if name in WALLS:
        return WALLS[name].properties(frequency_hz)
    frequency_ghz = frequency_hz / 1e9
    for row in MATERIALS[name]:
        if row.low_ghz <= frequency_ghz <= row.high_ghz:
            return row.a * frequency_ghz**row.b, row.c * frequency_ghz**row.d
    ranges = ", ".join(f"{row.low_ghz:g} to {row.high_ghz:g}" for row in MATERIALS[name])
    fits = [other for other, rows in MATERIALS.items() if any(r[0] <= frequency_ghz <= r[1] for r in rows)]
    raise ValueError(
        f"frequency_hz is {frequency_hz:g} ({frequency_ghz:g} GHz), but {name!r} was measured from {ranges} "
        f"GHz only. Measured at this frequency: {', '.join(fits) or 'none'}."
    )


def permittivity(name: str, frequency_hz: float) -> complex:
    """Complex relative permittivity eps_r - j sigma / (2 pi f eps_0) of a material at a frequency.

    Raises:
        ValueError: If there is no such material, or it was not measured at this frequency.
    """
    return _complex(*properties(name, frequency_hz), frequency_hz)


def wall_row(
    material: str | Material, frequency_hz: float, thickness_m: float = 0.0, gap_m: float = 0.0
) -> Complex[np.ndarray, " l"]:
    """Layers of a wall: relative permittivity and thickness [m] of each in turn.

    Args:
        material: A name, or layers of its own, to which thickness and gap do not apply, as to `WALLS`.
        frequency_hz: Carrier frequency.
        thickness_m: Thickness of one layer [m]; 0 for a half-space.
        gap_m: Air between two such layers [m]; 0 for one layer.

    Raises:
        ValueError: If there is no such material, or it was not measured at this frequency.
    """
    if isinstance(material, str):
        material = WALLS.get(material, material)
    if isinstance(material, Material):
        rows = [
            (_complex(*layer.properties(frequency_hz), frequency_hz), layer.thickness_m)
            for layer in material.layers
        ]
    else:
        layer = permittivity(material, frequency_hz), thickness_m
        rows = [layer, (1.0 + 0j, gap_m), layer] if gap_m else [layer]
    return np.array(rows, complex).ravel()


def _complex(relative: float, conductivity_spm: float, frequency_hz: float) -> complex:
    return complex(relative, -conductivity_spm / (2 * np.pi * frequency_hz * epsilon_0))


#: Walls of layers, by name: two plasterboards on studs, as the published radio data of mmwRobotNav has all walls;
#: double glazing; a solid door; a concrete core.
WALLS: dict[str, Material] = {
    wall.name: wall
    for wall in (
        Material(
            "partition",
            (
                Layer(thickness_m=0.013, material="drywall"),
                Layer(thickness_m=0.089, material="vacuum"),
                Layer(thickness_m=0.013, material="drywall"),
            ),
        ),
        Material(
            "glazing",
            (
                Layer(thickness_m=0.006, material="glass"),
                Layer(thickness_m=0.016, material="vacuum"),
                Layer(thickness_m=0.006, material="glass"),
            ),
        ),
        Material("door", (Layer(thickness_m=0.04, material="wood"),)),
        Material("concrete_wall", (Layer(thickness_m=0.2, material="concrete"),)),
    )
}
