"""Variants of `fused` without one part, or with the truth about one: how much each part contributes.

They go by names of their own wherever goal policies do, so that they search the same tasks with the same noise.

    fused-no-vision    the target is not looked for in pictures; the camera still maps
    fused-no-aod       directions of departure are not known, neither to the belief nor to the link state's classifier
    fused-no-clock     neither directions of departure nor delays are known; the mapper is not asked either
    fused-no-memory    the belief is that of the last measurement alone
    fused-no-graph     the mapper is not asked where the target stands
    fused-true-states  link states are the true ones
    fused-true-pose    odometry measures true motions, and the mapper relies on it: pose and map are true to the frame
"""

from collections.abc import Callable
from dataclasses import replace

from robosim.episode import EpisodeConfig
from robosim.parts import GOAL
from robosim.policies.belief import BeliefConfig
from robosim.support.parts import Part


def configured(config: EpisodeConfig, policy: Part) -> EpisodeConfig:
    """An episode's configuration with a goal policy, or one of the variants above."""
    POLICY.check("goal", policy)
    if isinstance(policy, str) and policy in _CHANGES:
        return _CHANGES[policy](replace(config, goal="fused"))
    return replace(config, goal=policy)


def place_of(policy: str) -> tuple[int, str]:
    """Where a policy stands in tables: those that come with this package as they are listed, others by name."""
    known = POLICY.names
    return (known.index(policy) if policy in known else len(known)), policy


def _no_vision(config: EpisodeConfig) -> EpisodeConfig:
    return replace(config, fused=replace(config.fused, uses_camera=False))


def _no_aod(config: EpisodeConfig) -> EpisodeConfig:
    return replace(_believing(config, departures=False), link_states="generated-no-aod")


def _no_clock(config: EpisodeConfig) -> EpisodeConfig:
    return replace(_no_graph(_no_aod(config)), link_states="generated-no-sync")


def _no_graph(config: EpisodeConfig) -> EpisodeConfig:
    return replace(config, fused=replace(config.fused, uses_graph=False))


def _no_memory(config: EpisodeConfig) -> EpisodeConfig:
    return _believing(_no_graph(config), remembers=False)


def _true_states(config: EpisodeConfig) -> EpisodeConfig:
    return replace(config, link_states="true")


def _true_pose(config: EpisodeConfig) -> EpisodeConfig:
    noise = replace(config.simulator.noise, exact_odometry=True)
    return replace(config, simulator=replace(config.simulator, noise=noise))


def _believing(config: EpisodeConfig, **changes: bool) -> EpisodeConfig:
    belief: BeliefConfig = replace(config.fused.belief, **changes)
    return replace(config, fused=replace(config.fused, belief=belief))


_CHANGES: dict[str, Callable[[EpisodeConfig], EpisodeConfig]] = {
    "fused-no-vision": _no_vision,
    "fused-no-aod": _no_aod,
    "fused-no-clock": _no_clock,
    "fused-no-memory": _no_memory,
    "fused-no-graph": _no_graph,
    "fused-true-states": _true_states,
    "fused-true-pose": _true_pose,
}

#: Goal policies and the variants of one.
POLICY = replace(GOAL, shipped={**GOAL.shipped, **dict.fromkeys(_CHANGES, GOAL.shipped["fused"])})
