"""`fused` with one thing taken from it, or told the truth about one: which part brings what.

They go by names of their own wherever goal policies do, so that they search the same tasks with the same noise.

    fused-no-vision    the target is not looked for in pictures; the camera still maps
    fused-no-aod       directions of departure are not known, neither to the belief nor to the link state's classifier
    fused-no-memory    the belief is that of the last measurement alone
    fused-true-states  link states are the true ones
    fused-true-pose    odometry tells true motions, and the mapper relies on it: pose and map are true to the frame
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, get_args

from robosim.episode import EpisodeConfig
from robosim.policies.belief import BeliefConfig
from robosim.policies.goals import GoalName
from robosim.radio.measurement import TRUE_STATES
from robosim.support.checks import check_choice

AblationName = Literal[
    "fused-no-vision", "fused-no-aod", "fused-no-memory", "fused-true-states", "fused-true-pose"
]
PolicyName = GoalName | AblationName

#: Every policy by name, those of `robosim.policies.goals` first.
POLICIES: tuple[PolicyName, ...] = (*get_args(GoalName), *get_args(AblationName))


def configured(config: EpisodeConfig, policy: PolicyName) -> EpisodeConfig:
    """An episode's configuration with a goal policy, or one of the variants above.

    Raises:
        ValueError: If there is none of that name.
    """
    check_choice("goal", policy, POLICIES)
    for name in get_args(GoalName):
        if name == policy:
            return replace(config, goal=name)
    return _CHANGES[policy](replace(config, goal="fused"))


def _no_vision(config: EpisodeConfig) -> EpisodeConfig:
    return replace(config, fused=replace(config.fused, uses_camera=False))


def _no_aod(config: EpisodeConfig) -> EpisodeConfig:
    return replace(_believing(config, departures=False), link_states="generated-no-aod")


def _no_memory(config: EpisodeConfig) -> EpisodeConfig:
    return _believing(config, remembers=False)


def _true_states(config: EpisodeConfig) -> EpisodeConfig:
    return replace(config, link_states=TRUE_STATES)


def _true_pose(config: EpisodeConfig) -> EpisodeConfig:
    noise = replace(config.simulator.noise, exact_odometry=True)
    return replace(config, simulator=replace(config.simulator, noise=noise))


def _believing(config: EpisodeConfig, **changes: bool) -> EpisodeConfig:
    belief: BeliefConfig = replace(config.fused.belief, **changes)
    return replace(config, fused=replace(config.fused, belief=belief))


_CHANGES: dict[PolicyName, Callable[[EpisodeConfig], EpisodeConfig]] = {
    "fused-no-vision": _no_vision,
    "fused-no-aod": _no_aod,
    "fused-no-memory": _no_memory,
    "fused-true-states": _true_states,
    "fused-true-pose": _true_pose,
}
