"""Antenna elements: what one radiator sends into each direction.

An element looks along its own +x; y is to its left and z up. Its amplitude is the size of its electric field
per direction, in any unit: arrays scale it to directivity. The directivity is the power density over its mean
over the sphere, so that it integrates to 4 pi. All elements are vertically polarised.
Left out: cross-polarisation, losses, the edge of the ground plane (nothing is sent behind the patch).
Reference: C. A. Balanis, Antenna Theory, 4th ed., 14.2 (the patch as a cavity with two radiating slots), 4.5 (dipole);
3GPP TR 38.901 V17, table 7.3-1 (an element of a base station).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robosim.support.checks import Range, checked
from wireless.antennas.pattern_files import SUFFIXES, read_pattern
from wireless.antennas.sphere import mean_over_sphere

#: What to do about thick substrates.
_THIN = "The cavity model is one of thin substrates."


@runtime_checkable
class Element(Protocol):
    """Anything with a field amplitude per direction."""

    def amplitude(self, direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Size of the far field in directions given by unit vectors."""
        ...


@dataclass(frozen=True)
class IsotropicElement:
    """Sends equally into all directions."""

    def amplitude(self, direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Size of the far field: one."""
        return np.ones(direction.shape[:-1])


@dataclass(frozen=True, kw_only=True)
@checked
class PatchElement:
    """Rectangular microstrip patch in its lowest mode, over an endless ground plane."""

    permittivity: Annotated[float, Range(1, 1e6)] = 2.2
    """Relative permittivity of the substrate."""
    thickness_wl: Annotated[float, Range(1e-6, 0.1, "wavelengths", _THIN)] = 0.024
    """Thickness of the substrate, in wavelengths in air (0.254 mm at 28 GHz)."""

    @cached_property
    def width_wl(self) -> float:
        """Horizontal side in wavelengths, of an efficient radiator (Balanis 14-6)."""
        return 0.5 * float(np.sqrt(2 / (self.permittivity + 1)))

    @cached_property
    def length_wl(self) -> float:
        """Distance of the radiating slots in wavelengths: half a wave in the substrate (Balanis 14-1, 14-7)."""
        fringe = 1 / np.sqrt(1 + 12 * self.thickness_wl / self.width_wl)
        effective = (self.permittivity + 1) / 2 + (self.permittivity - 1) / 2 * fringe
        return 0.5 / float(np.sqrt(effective))

    def amplitude(self, direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Size of the far field: two slots a patch apart (Balanis 14-40 to 14-45, thin substrate)."""
        x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
        slot = np.sinc(self.width_wl * y)
        pair = np.cos(np.pi * self.length_wl * z)
        return np.where(x > 0, np.abs(slot * pair) * np.sqrt(np.maximum(0, 1 - y**2)), 0.0)


@dataclass(frozen=True)
@checked
class SectorElement:
    """Element of 3GPP TR 38.901: 65 degrees wide in azimuth and elevation, 30 dB weaker behind.

    The directivity of this shape is 9.83 dBi; the standard's gain of 8 dBi is that with losses of 1.83 dB.
    """

    width_deg: Annotated[float, Range(1, 360, "degrees")] = 65.0
    """Full width at half power, in azimuth and in elevation."""
    floor_db: Annotated[float, Range(0, 200, "dB")] = 30.0
    """Most that any direction is weaker than the best."""
    max_gain_dbi: Annotated[float | None, Range(-50, 50, "dBi")] = None
    """Gain straight ahead where elements have the directivity of their pattern; None for no losses."""

    @cached_property
    def efficiency(self) -> float:
        """Radiated power over the power that it is given."""
        return 1.0 if self.max_gain_dbi is None else 10 ** (self.max_gain_dbi / 10) * mean_power(self)

    def amplitude(self, direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Size of the far field, one straight ahead."""
        x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
        azimuth = np.rad2deg(np.arctan2(y, x))
        elevation = np.rad2deg(np.arcsin(np.clip(z, -1, 1)))
        across = np.minimum(12 * (azimuth / self.width_deg) ** 2, self.floor_db)
        along = np.minimum(12 * (elevation / self.width_deg) ** 2, self.floor_db)
        return 10 ** (-np.minimum(across + along, self.floor_db) / 20)


@dataclass(frozen=True, kw_only=True)
@checked
class DipoleElement:
    """Thin wire along z, fed in its middle, with a current of sinusoidal form."""

    length_wl: Annotated[float, Range(0.001, 1.0, "wavelengths")] = 0.5
    """Length of the wire, in wavelengths."""

    def amplitude(self, direction: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Size of the far field (Balanis 4-62)."""
        z, half = direction[..., 2], np.pi * self.length_wl
        across = np.sqrt(np.maximum(1 - z**2, 0))
        # The difference of two cosines as a product, exact also for short wires.
        field = 2 * np.sin(half * (1 + z) / 2) * np.sin(half * (1 - z) / 2)
        return np.divide(field, across, out=np.zeros_like(field), where=across > 1e-9)


#: Elements by name.
ELEMENTS: dict[str, Element] = {
    "patch": PatchElement(),
    "3gpp": SectorElement(max_gain_dbi=8.0),
    "isotropic": IsotropicElement(),
    "dipole": DipoleElement(),
}


def element_named(name: str) -> Element:
    """An element by its name, or of a pattern file (`wireless.antennas.pattern_files`).

    Raises:
        ValueError: If there is none of this name.
        FileError: If the file is missing or damaged.
    """
    if name in ELEMENTS:
        return ELEMENTS[name]
    if name.lower().endswith(SUFFIXES):
        return read_pattern(name)
    files = " or ".join([", ".join(SUFFIXES[:-1]), SUFFIXES[-1]])
    raise ValueError(f"Unknown antenna element {name!r}. Known: {', '.join(ELEMENTS)}, or a {files} file.")


def mean_power(element: Element, order: int = 64) -> float:
    """Mean of the squared amplitude over the sphere; `order` is the fineness of `sphere`."""
    return mean_over_sphere(lambda direction: element.amplitude(direction) ** 2, order)


def directivity(
    element: Element, direction: Float[np.ndarray, "*batch 3"], order: int = 64
) -> Float[np.ndarray, "*batch"]:
    """Power density in directions (unit vectors, frame of the element) over its mean over the sphere."""
    return element.amplitude(direction) ** 2 / mean_power(element, order)
