"""Variants of `fused` without one part, or with the truth about one: how much each part contributes.

They have names of their own wherever goal policies do, so that they run on the same tasks with the same noise.

    fused-no-vision    the target is not recognised in pictures; the camera still maps
    fused-no-aod       directions of departure are unknown to the belief and to the link-state classifier
    fused-no-clock     neither directions of departure nor delays are known; the mapper's landmarks are not used either
    fused-no-memory    the belief is that of the last measurement alone
    fused-no-graph     the mapper's landmarks are not used
    fused-true-states  link states are the true ones
    fused-true-pose    odometry measures true motions, and the mapper relies on it: pose and map are true to the frame
"""

from dataclasses import replace
from typing import Any

from robosim.episode_config import EpisodeConfig
from robosim.parts import GOAL
from robosim.support.parts import Part

_NO_AOD = {"fused.belief.departures": False}
_NO_GRAPH = {"fused.uses_graph": False}
#: Settings that each variant changes, by their paths in the configuration.
VARIANTS: dict[str, dict[str, Any]] = {
    "fused-no-vision": {"fused.uses_camera": False},
    "fused-no-aod": {**_NO_AOD, "link_states": "generated-no-aod"},
    "fused-no-clock": {**_NO_AOD, **_NO_GRAPH, "link_states": "generated-no-sync"},
    "fused-no-memory": {**_NO_GRAPH, "fused.belief.remembers": False},
    "fused-no-graph": _NO_GRAPH,
    "fused-true-states": {"link_states": "true"},
    "fused-true-pose": {"simulator.robot.noise.exact_odometry": True},
}
#: Goal policies and the variants of one.
POLICY = replace(GOAL, shipped={**GOAL.shipped, **dict.fromkeys(VARIANTS, GOAL.shipped["fused"])})


def configured(config: EpisodeConfig, policy: Part) -> EpisodeConfig:
    """An episode's configuration with a goal policy, or one of the variants above."""
    POLICY.check("goal", policy)
    changes = VARIANTS.get(policy) if isinstance(policy, str) else None
    config = replace(config, goal=policy if changes is None else "fused")
    for path, value in (changes or {}).items():
        config = _with(config, path, value)
    return config


def place_of(policy: str) -> tuple[int, str]:
    """Sort key of a policy in tables: shipped policies in the order of their list, others by name."""
    known = POLICY.names
    return (known.index(policy) if policy in known else len(known)), policy


def _with(config: Any, path: str, value: Any) -> Any:
    """A configuration with another value at a path of fields."""
    name, _, rest = path.partition(".")
    return replace(config, **{name: _with(getattr(config, name), rest, value) if rest else value})
