"""Diffraction at a thin, opaque, rectangular screen: the field behind it over the field without it.

An edge at a signed distance h from the path, negative to the left of it and below, has the Fresnel parameter
    v = sign(h) 2 sqrt(excess / lambda),   excess = D1 + D2 - r,
where D1 and D2 are the distances from both ends of the path to the edge, and r is the length of the path; near the
path v = h sqrt(2 / lambda (1 / d1 + 1 / d2)). Of a wave between two parallel edges the share
    T = g(v2) - g(v1)
arrives. A screen takes away what passes through its outline (Babinet): F = 1 - T_width T_height. Models differ in g:
    knife-edges   g(v) = e^(j pi/4) / sqrt(2) (integral of e^(-j pi t^2 / 2) from 0 to v), the Fresnel integral, so that
                  the fields of all edges add with their phases;
    model-b       g(v) = arctan(pi / 2 sqrt(pi / lambda excess)) / pi with the sign of v, a real fit without ripple.

Left out: thickness and material of the body, polarisation, creeping waves.
References: ITU-R P.526-15, sections 4.1, 5.1 and 5.2.1; 3GPP TR 38.901 V17, section 7.6.4.2, equation 7.6-30.
"""

import numpy as np

from robosim.support.compiled import compiled
from wireless.em.diffraction import transition_over_root

#: Models of a screen by name, and whether its edges add with their phases.
SCREEN_MODELS = {"knife-edges": True, "model-b": False}


@compiled
def edge_share(v: float, phases: bool) -> complex:
    """g(v): from -1/2 to 1/2 as an edge moves over the path, left to right; `phases` as in `SCREEN_MODELS`."""
    if not phases:
        return complex(np.arctan(0.25 * np.pi**1.5 * v) / np.pi, 0.0)
    t = np.sqrt(0.5 * np.pi) * abs(v)
    beyond = 0.5 * np.exp(-0.25j * np.pi) / np.sqrt(np.pi) * transition_over_root(t) * np.exp(-1j * t * t)
    return 0.5 - beyond if v >= 0 else beyond - 0.5
