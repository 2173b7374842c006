"""Antenna arrays, and platforms of arrays that look to several sides.

The signature of an array is what its ports receive of a unit plane wave, one complex number each: element
amplitude times exp(+j k p.u) for a port at p and a direction u (towards the source on arrival, away from the
array on departure: both see a port at the front earlier).

Ports that are driven together do not add their powers: the mean over the sphere of |w^H a|^2 is w^H Q w with
the coupling matrix Q = mean of a a^H. Signatures are scaled to Q^(-1/2) a. Then |w^H a|^2 is the directivity
of any unit weight w, it integrates to 4 pi, and the squared norm of a signature is the directivity of the best
beam in that direction. For isotropic elements half a wavelength apart on a line, Q is the identity.

A platform carries equal arrays at one point that face several azimuths. Its signature keeps them apart, since
their oscillators are not locked to each other.
Reference: M. T. Ivrlac and J. A. Nossek, Toward a circuit theory of communication, IEEE TCAS-I 57 (2010).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Complex, Float

from wireless.antennas.elements import Element, element_named
from wireless.antennas.sphere import sphere, unit_vector


@dataclass(frozen=True, kw_only=True, eq=False)
class Array:
    """Equal elements side by side, facing +x of the array's own frame."""

    element: Element
    """Radiator at each port."""
    position_wl: Float[np.ndarray, "n 3"]
    """Positions of the ports, in wavelengths."""

    def __len__(self) -> int:
        return len(self.position_wl)

    def plain_signature(self, direction: Float[np.ndarray, "*batch 3"]) -> Complex[np.ndarray, "*batch n"]:
        """Element amplitude and phase at each port, before coupling."""
        phase = 2 * np.pi * direction @ self.position_wl.T
        return self.element.amplitude(direction)[..., None] * np.exp(1j * phase)

    @cached_property
    def coupling(self) -> Complex[np.ndarray, "n n"]:
        """Mean of a a^H over the sphere: what ports radiate jointly."""
        reach = np.abs(self.position_wl[:, None] - self.position_wl).max(initial=0.0)
        direction, share = sphere(48 + int(8 * reach))
        plain = self.plain_signature(direction)
        # Not a product of matrices: libraries split its sum over threads, so that the last bits depend on the cores.
        return np.einsum("ka,kb->ab", plain * share[:, None], plain.conj())

    @cached_property
    def decoupling(self) -> Complex[np.ndarray, "n n"]:
        """The coupling matrix to the power -1/2."""
        power, mode = np.linalg.eigh(self.coupling)
        if power[0] < 1e-9 * power[-1]:
            raise ValueError(
                f"{len(self)} ports cannot be distinguished by what they radiate (coupling of rank "
                f"{np.sum(power > 1e-9 * power[-1])}). Move them further apart, half a wavelength or more."
            )
        return (mode / np.sqrt(power)) @ mode.conj().T

    def signature(self, direction: Float[np.ndarray, "*batch 3"]) -> Complex[np.ndarray, "*batch n"]:
        """Response of the ports to a unit wave; its squared norm is the directivity there.

        Args:
            direction: Unit vectors in the array's frame.
        """
        return self.plain_signature(direction) @ self.decoupling.T


def uniform_array(
    columns: int, rows: int = 1, *, element: str | Element = "patch", spacing_wl: float = 0.5
) -> Array:
    """A line of elements (one row) or a plane of them, upright and centred.

    Args:
        columns: Number of elements side by side, along y.
        rows: Number of elements above each other, along z.
        element: Radiator, or its name.
        spacing_wl: Distance of neighbours, in wavelengths.

    Raises:
        ValueError: If there is no element or no space between them.
    """
    if columns < 1 or rows < 1:
        raise ValueError(f"columns and rows are {columns} and {rows}, expected at least 1 each.")
    if not spacing_wl > 0:
        raise ValueError(f"spacing_wl is {spacing_wl:g}, expected a positive number of wavelengths.")
    y = (np.arange(columns) - (columns - 1) / 2) * spacing_wl
    z = (np.arange(rows) - (rows - 1) / 2) * spacing_wl
    position = np.stack(np.meshgrid([0.0], y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return Array(
        element=element_named(element) if isinstance(element, str) else element, position_wl=position
    )


def circular_array(n: int, *, element: str | Element = "dipole", spacing_wl: float = 0.4) -> Array:
    """Equal elements on a level circle, which together look to all sides.

    Args:
        n: Number of elements, the first at azimuth 0.
        element: Radiator, or its name.
        spacing_wl: Distance of neighbours, in wavelengths. Four elements half a wavelength apart receive waves from
            opposite sides alike.
    """
    turn = 2 * np.pi * np.arange(n) / n
    position = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=-1)
    return Array(
        element=element_named(element) if isinstance(element, str) else element,
        position_wl=position * spacing_wl / (2 * np.sin(np.pi / n)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Platform:
    """Equal arrays at one point, each facing another azimuth of the platform's frame."""

    array: Array
    """Each of the arrays."""
    face_rad: tuple[float, ...] = (0.0, 2 * np.pi / 3, -2 * np.pi / 3)
    """Azimuths that the arrays face."""

    def signature(
        self,
        azimuth_rad: Float[np.ndarray, "*batch"],
        elevation_rad: float | Float[np.ndarray, "*#batch"] = 0.0,
    ) -> Complex[np.ndarray, "*batch arrays ports"]:
        """Signature of each array.

        Args:
            azimuth_rad: Azimuths in the platform's frame: for those of a scene, less the platform's heading.
            elevation_rad: Elevations.
        """
        # All arrays at once: for a few paths what takes time is the calls.
        face = np.array(self.face_rad).reshape(-1, *[1] * azimuth_rad.ndim)
        seen = np.asarray(azimuth_rad) - face
        elevation = np.broadcast_to(np.asarray(elevation_rad, float), seen.shape)
        return np.ascontiguousarray(np.moveaxis(self.array.signature(unit_vector(seen, elevation)), 0, -2))

    def directivity(
        self,
        azimuth_rad: Float[np.ndarray, "*batch"],
        elevation_rad: float | Float[np.ndarray, "*#batch"] = 0.0,
    ) -> Float[np.ndarray, "*batch arrays"]:
        """Directivity of each array's best beam."""
        return np.sum(np.abs(self.signature(azimuth_rad, elevation_rad)) ** 2, axis=-1)
