"""Arrays mounted in a scene: how they are turned, how they are polarised, and what their ports receive of a wave.

An array is turned by yaw about z, then by pitch about its new y (positive looks down), then by roll about its new x:
the bearing, downtilt and slant angles of TR 38.901, section 7.1. Elements are vertically polarised in the array's
frame, or slanted there by an angle zeta, with the field (A cos zeta, A sin zeta) along theta and phi (its model 2,
equations 7.3-4 and 7.3-5). The turned field is read along theta and phi of the scene, as `wireless.em.fields` does.
Reference: 3GPP TR 38.901 V17, sections 7.1 and 7.3.2.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Complex, Float, Int
from scipy.spatial.transform import Rotation

from wireless.antennas.arrays import Array, uniform_array
from wireless.antennas.elements import mean_power
from wireless.antennas.sphere import unit_vector

#: Angles of the ports from the vertical, by the polarisation of a tracer.
_SLANT_RAD = {"vertical": (0.0,), "horizontal": (np.pi / 2,), "both": (0.0, np.pi / 2)}


@dataclass(frozen=True, kw_only=True, eq=False)
class MountedArray:
    """Equal arrays at one end of links, each turned by its own angles or all by the same."""

    array: Array = field(default_factory=lambda: uniform_array(1, element="isotropic"))
    """Elements and their positions about the terminal's; two at the same position for two polarisations."""
    yaw_rad: float | Float[np.ndarray, " terminals"] = 0.0
    """Azimuth in the scene that the array faces, of all or of each terminal."""
    pitch_rad: float | Float[np.ndarray, " terminals"] = 0.0
    """Downtilt: how far it looks below the horizon."""
    roll_rad: float | Float[np.ndarray, " terminals"] = 0.0
    """Turn about the direction that it faces, counter-clockwise as seen from where it looks to."""
    slant_rad: float | Float[np.ndarray, " ports"] = 0.0
    """Polarisation of all or of each port: 0 for vertical, +-pi/4 for a slanted pair."""
    scaling: str = "directivity"
    """`directivity`: elements have the directivity of their pattern, less the losses of `3gpp`; `given`: amplitudes are
    gains, such as those of a pattern file; `coupled`: ports are scaled by their coupling (`wireless.antennas.arrays`),
    as in soundings."""

    @classmethod
    def polarised(cls, polarisation: str, array: Array | None = None, **mounting: Any) -> "MountedArray":
        """An array, or an isotropic element, with the polarisation of a tracer; for both, all vertical ports first."""
        array, slant_rad = array or cls().array, _SLANT_RAD[polarisation]
        array = replace(array, position_wl=np.tile(array.position_wl, (len(slant_rad), 1)))
        return cls(array=array, slant_rad=np.repeat(slant_rad, len(array) // len(slant_rad)), **mounting)

    def __post_init__(self) -> None:
        if self.scaling not in ("directivity", "given", "coupled"):
            raise ValueError(f"scaling is {self.scaling!r}, expected 'directivity', 'given' or 'coupled'.")
        for name in ("yaw_rad", "pitch_rad", "roll_rad", "slant_rad"):
            if np.ndim(angles := getattr(self, name)):
                object.__setattr__(self, name, np.asarray(angles, float))
        if np.ndim(self.slant_rad) and np.shape(self.slant_rad) != (len(self.array),):
            raise ValueError(
                f"slant_rad has the shape {np.shape(self.slant_rad)}, expected one angle for each of "
                f"{len(self.array)} ports."
            )

    def of_terminals(self, which: slice) -> "MountedArray":
        """The arrays of a slice of the terminals."""
        yaw, pitch, roll = (
            angle if np.size(angle) == 1 else np.asarray(angle)[which]
            for angle in (self.yaw_rad, self.pitch_rad, self.roll_rad)
        )
        return replace(self, yaw_rad=yaw, pitch_rad=pitch, roll_rad=roll)

    def response(
        self,
        azimuth_rad: Float[np.ndarray, " n"],
        elevation_rad: Float[np.ndarray, " n"],
        terminal: Int[np.ndarray, " n"],
        n_terminals: int | None = None,
    ) -> Complex[np.ndarray, "n ports 2"]:
        """Field along theta and phi that each port sends into directions of the scene, or receives from there.

        Args:
            azimuth_rad: Azimuths in the scene.
            elevation_rad: Elevations.
            terminal: Number of the terminal that each direction belongs to.
            n_terminals: Number of terminals; None for any that includes those.

        Raises:
            ValueError: If angles are given for another number of terminals.
        """
        turns = np.stack(np.broadcast_arrays(self.yaw_rad, self.pitch_rad, self.roll_rad), axis=-1)
        turns = turns.reshape(-1, 3)
        n_least = int(terminal.max(initial=0)) + 1
        if len(turns) > 1 and (len(turns) < n_least or n_terminals not in (None, len(turns))):
            raise ValueError(
                f"An array is turned by {len(turns)} angles, expected one for each of {n_terminals or n_least} "
                "terminals."
            )
        T_scene_array = Rotation.from_euler("ZYX", turns).as_matrix()
        T_scene_array = T_scene_array[terminal if len(turns) > 1 else np.zeros_like(terminal)]
        array_direction = np.einsum("nij,ni->nj", T_scene_array, unit_vector(azimuth_rad, elevation_rad))
        array_azimuth = np.arctan2(array_direction[:, 1], array_direction[:, 0])
        array_elevation = np.arcsin(np.clip(array_direction[:, 2], -1, 1))
        turned = np.einsum(
            "npi,nij,nqj->npq",
            _tangents(azimuth_rad, elevation_rad),
            T_scene_array,
            _tangents(array_azimuth, array_elevation),
        )
        slant = np.stack([np.cos(self.slant_rad), np.sin(self.slant_rad)]).reshape(2, -1)
        return self._signature(array_direction)[:, :, None] * np.einsum("npq,qk->nkp", turned, slant)

    def _signature(self, direction: Float[np.ndarray, "n 3"]) -> Complex[np.ndarray, "n ports"]:
        if self.scaling == "coupled":
            return self.array.signature(direction)
        plain = self.array.plain_signature(direction)
        if self.scaling == "given":
            return plain
        efficiency = getattr(self.array.element, "efficiency", 1.0)
        return plain * np.sqrt(efficiency / mean_power(self.array.element))


def _tangents(
    azimuth_rad: Float[np.ndarray, " n"], elevation_rad: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2 3"]:
    """Unit vectors theta (downwards at the horizon) and phi (counter-clockwise) of directions."""
    theta = unit_vector(azimuth_rad, elevation_rad - np.pi / 2)
    phi = unit_vector(azimuth_rad + np.pi / 2, np.zeros_like(elevation_rad))
    return np.stack([theta, phi], axis=1)
