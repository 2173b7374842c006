"""Laws by which the edges of the published radio data may diffract, one for each hypothesis.

All are the uniform theory's four terms (`wireless.em.diffraction`), with other reflection ratios of the faces, other
weights, or another wedge. Rays are level and edges upright, so that vertical polarisation is soft.

References: R. J. Luebbers, IEEE Trans. Antennas Propag. 32 (1984); P. D. Holm, IEEE Trans. Antennas Propag. 48 (2000);
W. D. Burnside and K. W. Burgener, IEEE Trans. Antennas Propag. 31 (1983), for walls that transmit.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float
from scipy.constants import speed_of_light

from tests.wireless.em.plane_waves import cavity_wall, reflection, slab
from wireless.em.diffraction import boundary_term
from wireless.em.materials import permittivity

#: Ratio of a wall over the sine of the angle to it.
Ratio = Callable[[Float[np.ndarray, " n"]], Complex[np.ndarray, " n"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Wedges:
    """Where source and observer stand at an edge, for each of many."""

    n: Float[np.ndarray, " m"]
    """Open angle over pi."""
    phi_source: Float[np.ndarray, " m"]
    """Angle of the source from the 0-face [rad]."""
    phi: Float[np.ndarray, " m"]
    """Angle of the observer [rad]."""
    before_m: Float[np.ndarray, " m"]
    """Distance of the source from the edge."""
    after_m: Float[np.ndarray, " m"]
    """Distance of the observer."""

    @property
    def bending_rad(self) -> Float[np.ndarray, " m"]:
        """Angle by which the observer stands in the edge's shadow; negative where the edge hides nothing."""
        return np.abs(self.phi - self.phi_source) - np.pi


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """What a wall does to a plane wave, over the sine of the angle to it."""

    te: Ratio
    tm: Ratio
    through: Ratio


def published_faces(frequency_hz: float, material: str, thickness_m: float, gap_m: float) -> dict[str, Faces]:
    """The published wall, one board of it, and a half-space of its boards."""
    eps = permittivity(material, frequency_hz)

    def cavity(i: int) -> Ratio:
        def ratio(sine: Float[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
            found = cavity_wall(sine, eps, thickness_m, gap_m, frequency_hz)[i]
            if i < 2:
                return found
            # Over the free field, which the wall takes the place of.
            k = 2 * np.pi * frequency_hz / speed_of_light
            return found * np.exp(1j * k * (2 * thickness_m + gap_m) * sine)

        return ratio

    def nothing(sine: Float[np.ndarray, " n"]) -> Complex[np.ndarray, " n"]:
        return np.zeros(len(sine), complex)

    board, half = (
        [lambda sine, i=i, of=of: of(sine)[i] for i in range(2)]
        for of in (lambda s: slab(s, eps, thickness_m, frequency_hz), lambda s: reflection(s, eps))
    )
    return {
        "wall": Faces(te=cavity(0), tm=cavity(1), through=cavity(2)),
        "board": Faces(te=board[0], tm=board[1], through=nothing),
        "half-space": Faces(te=half[0], tm=half[1], through=nothing),
    }


def terms(wedges: Wedges, wavenumber: float) -> Complex[np.ndarray, "4 m"]:
    """The four terms of D: pi + b-, pi - b-, and those that R_0 and R_n belong to."""
    found = np.empty((4, len(wedges.n)), complex)
    w = wedges
    for i in range(len(w.n)):
        n, minus, plus = w.n[i], w.phi[i] - w.phi_source[i], w.phi[i] + w.phi_source[i]
        kl = wavenumber * w.before_m[i] * w.after_m[i] / (w.before_m[i] + w.after_m[i])
        factor = -np.exp(-0.25j * np.pi) / (2 * n * np.sqrt(2 * np.pi * wavenumber))
        for j, y in enumerate((np.pi + minus, np.pi - minus, np.pi - plus, np.pi + plus)):
            found[j, i] = factor * boundary_term(y, n, kl, 1e-9)
    return found


def turned(wedges: Wedges, n: float, share: float) -> Wedges:
    """The same ends at a wedge of another angle; of what opens or closes, this share lies at the 0-face."""
    more = (n - wedges.n) * np.pi * share
    most = n * np.pi
    return Wedges(
        n=np.full(len(wedges.n), n),
        phi_source=np.clip(wedges.phi_source + more, 0, most),
        phi=np.clip(wedges.phi + more, 0, most),
        before_m=wedges.before_m,
        after_m=wedges.after_m,
    )


def laws(wedges: Wedges, faces: dict[str, Faces], wavenumber: float) -> dict[str, Float[np.ndarray, " m"]]:
    """Power |D|^2 by each hypothesis, the tracer's own law first.

    Args:
        wedges: Geometry.
        faces: Of `published_faces`.
        wavenumber: 2 pi over the wavelength [1/m].
    """
    w, wall, half = wedges, faces["wall"], faces["half-space"]
    most = w.n * np.pi
    first, second, on_0, on_n = terms(w, wavenumber)
    direct = first + second
    flip = w.phi_source > most - w.phi_source  # Luebbers counts from the face nearer to the source

    def power(d: Complex[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        return np.abs(d) ** 2

    def at(ratio: Ratio, angle: Float[np.ndarray, " m"]) -> Complex[np.ndarray, " m"]:
        return ratio(np.minimum(np.abs(np.sin(angle)), 1.0))

    def faced(
        ratio: Ratio, of_0: Float[np.ndarray, " m"], of_n: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        return power(direct + at(ratio, of_0) * on_0 + at(ratio, of_n) * on_n)

    near = np.minimum(w.phi, w.phi_source), np.minimum(most - w.phi, most - w.phi_source)
    own = np.where(flip, w.phi, w.phi_source), np.where(flip, most - w.phi_source, most - w.phi)
    middle = (np.pi - np.abs(w.phi - w.phi_source)) / 2
    r_0, r_n = (at(wall.te, angle) for angle in near)
    r_half = at(wall.te, middle)
    passed = at(wall.through, middle)
    found = {
        "nearer face (default)": faced(wall.te, *near),
        "Luebbers' own angles": faced(wall.te, *own),
        "bisector": faced(wall.te, middle, middle),
        "angle of the source": faced(wall.te, w.phi_source, most - w.phi_source),
        "angle of the observer": faced(wall.te, w.phi, most - w.phi),
        "Holm": power(r_0 * r_n * first + second + r_0 * on_0 + r_n * on_n),
        "horizontal polarisation": faced(wall.tm, *near),
        "both polarisations": (faced(wall.te, *near) + faced(wall.tm, *near)) / 2,
        "one board": faced(faces["board"].te, *near),
        "half-space": faced(half.te, *near),
        "perfect conductor": power(direct - on_0 - on_n),
        "black wedge": power(direct),
        "walls transmit": power((1 - passed) * direct + r_0 * on_0 + r_n * on_n),
        "terms without phase": sum(power(t) for t in (first, second, r_0 * on_0, r_n * on_n)),
    }
    for name, n, share in (
        ("free end, first wall", 2.0, 0.0),
        ("free end, second wall", 2.0, 1.0),
        ("all edges 90 degrees", 1.5, 0.5),
    ):
        other = turned(w, n, share)
        a, b, c, d = terms(other, wavenumber)
        found[name] = power(a + b + r_0 * c + r_n * d)
    found["bisector, half-space"] = faced(half.te, middle, middle)
    found["bisector, Holm"] = power(r_half**2 * first + second + r_half * (on_0 + on_n))
    found["bisector, walls transmit"] = power((1 - passed) * direct + r_half * (on_0 + on_n))
    return found
