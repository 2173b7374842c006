"""Beams of a platform, even in azimuth; the reference's two terminals, and those of bands below 10 GHz.

Beam k of n points to azimuth 2 pi k / n at zero elevation. The array that faces nearest sends it, with the
conjugate match of its signature there (unit weight, so that the squared response is a directivity); midway
between two faces, the one to the left. Only one beam is sent at a time.
Reference: the arrays and codebooks of arXiv 2110.14789: base station (gNB) 3 x 16 ports (4 x 4), 48 beams;
robot (UE) 3 x 8 ports in a line, 24 beams.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from wireless.antennas.arrays import Platform, circular_array, uniform_array
from wireless.antennas.elements import Element


@dataclass(frozen=True, kw_only=True, eq=False)
class Terminal:
    """A platform and its codebook: either end of a link."""

    platform: Platform
    """The arrays."""
    n_beams: int
    """Number of beams, over all arrays."""

    def __post_init__(self) -> None:
        if self.n_beams < len(self.platform.face_rad):
            raise ValueError(
                f"n_beams is {self.n_beams}, expected at least one for each of "
                f"{len(self.platform.face_rad)} arrays."
            )

    @cached_property
    def beam_rad(self) -> Float[np.ndarray, " n_beams"]:
        """Azimuth that each beam points to, in [-pi, pi); rising from zero, then from -pi."""
        azimuth = 2 * np.pi * np.arange(self.n_beams) / self.n_beams
        return np.where(azimuth < np.pi - 1e-9, azimuth, azimuth - 2 * np.pi)

    @cached_property
    def beam_array(self) -> Int[np.ndarray, " n_beams"]:
        """Array that sends each beam."""
        off = self.beam_rad[:, None] - np.array(self.platform.face_rad) + 1e-9
        off = np.abs((off + np.pi) % (2 * np.pi) - np.pi)
        return np.argmin(off, axis=1)

    @cached_property
    def weight(self) -> Complex[np.ndarray, "n_beams ports"]:
        """Unit weights at the ports of the array that sends."""
        signature = self.platform.signature(self.beam_rad)[np.arange(self.n_beams), self.beam_array]
        size = np.linalg.norm(signature, axis=-1, keepdims=True)
        if not size.all():
            blind = np.rad2deg(self.beam_rad[size[:, 0] == 0][0])
            raise ValueError(
                f"n_beams is {self.n_beams}, but no array radiates towards {blind:g} degrees, where one of them "
                "points. Add a face, or take an element that radiates backwards."
            )
        return signature / size

    def beam_response(
        self,
        azimuth_rad: Float[np.ndarray, "*batch"],
        elevation_rad: float | Float[np.ndarray, "*#batch"] = 0.0,
    ) -> Complex[np.ndarray, "*batch n_beams"]:
        """Field of each beam in directions of the platform's frame; its square is the beam's directivity."""
        signature = self.platform.signature(azimuth_rad, elevation_rad)
        response = np.empty((*azimuth_rad.shape, self.n_beams), complex)
        for array, (mine, weight) in enumerate(self._of_arrays):
            response[..., mine] = signature[..., array, :] @ weight
        return response

    @cached_property
    def _of_arrays(self) -> list[tuple[Bool[np.ndarray, " n_beams"], Complex[np.ndarray, "ports mine"]]]:
        """Which beams are each array's, and their weights."""
        of_arrays = (self.beam_array == array for array in range(len(self.platform.face_rad)))
        return [(mine, self.weight[mine].conj().T) for mine in of_arrays]


def gnb(element: str | Element = "patch") -> Terminal:
    """The reference's base station: 3 planes of 4 x 4, 48 beams."""
    return Terminal(platform=Platform(array=uniform_array(4, 4, element=element)), n_beams=48)


def ue(element: str | Element = "patch") -> Terminal:
    """The reference's robot: 3 lines of 8, 24 beams."""
    return Terminal(platform=Platform(array=uniform_array(8, element=element)), n_beams=24)


def tag(element: str | Element = "dipole") -> Terminal:
    """A tag with one antenna, and one beam: its directions of departure cannot be measured."""
    platform = Platform(array=uniform_array(1, element=element), face_rad=(0.0,))
    return Terminal(platform=platform, n_beams=1)


def ring_8(element: str | Element = "dipole") -> Terminal:
    """A ring of 8 antennas, 13 cm wide at 2.44 GHz, which look to all sides; 16 beams."""
    return Terminal(platform=Platform(array=circular_array(8, element=element), face_rad=(0.0,)), n_beams=16)


#: Terminals by name.
TERMINALS = {"gnb": gnb, "ue": ue, "tag": tag, "ring-8": ring_8}


def terminal_named(name: str, element: str | Element | None = None) -> Terminal:
    """A terminal by its name, as transmitter or receiver, with its usual elements or others.

    Raises:
        ValueError: If there is none of this name.
    """
    if name not in TERMINALS:
        raise ValueError(f"Unknown terminal {name!r}. Known: {', '.join(TERMINALS)}.")
    return TERMINALS[name]() if element is None else TERMINALS[name](element)
