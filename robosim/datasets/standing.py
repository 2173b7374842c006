"""People and other movers who stand in a building while links are traced: those of an episode at time 0."""

from dataclasses import replace
from typing import Any

import numpy as np

from robosim.movers.movers import MoversConfig, make_movers
from robosim.radio.scene import RadioSite
from wireless.motion.bodies import Bodies


def standing_bodies(site: RadioSite, config: MoversConfig, seed: int) -> Bodies | None:
    """Bodies of movers at time 0 on the floor of the storey of receivers; None if there are no movers.

    There is no robot: movers have it at an infinite distance.

    Raises:
        ValueError: If the site is a scene, no body is there at time 0, or there is no room for so many.
    """
    if not config.any:
        return None
    if site.building is None:
        raise ValueError(f"{site.name}: people and movers need a floor plan. Leave them out.")
    movers = make_movers(config, site.building, 0.0)
    assert movers is not None
    movers.reset(np.full(3, np.inf), np.random.default_rng(seed))
    bodies = movers.radio_bodies
    if not len(bodies):
        raise ValueError(
            f"mover is {config.mover}, but no body of it is there at time 0. Let one begin then."
        )
    return replace(bodies, position=bodies.position + np.array([0.0, 0.0, site.floor_m]))


def bodies_dict(bodies: Bodies | None) -> dict[str, Any]:
    """The bodies as settings and results have them: feet, radii and heights [m]; empty for None."""
    if bodies is None:
        return {}
    return {"bodies": {name: getattr(bodies, name) for name in ("position", "radius_m", "height_m")}}
