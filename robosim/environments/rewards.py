"""Terms of the reward of a search; the reward of a step is their weighted sum.

arrival      1 on the step that brings the robot within 0.3 m of the target
progress     metres by which the shortest drive to the target became shorter; its sum does not depend on the route, so
             it does not change the optimal policy (Ng, Harada and Russell, Policy invariance under reward
             transformations, ICML 1999)
step         1 on every step: give it a negative weight
collision    1 on a step in which a wall, a person or another robot stopped the robot
coverage     floor seen for the first time [m2] (Chaplot et al., Learning to explore using Active Neural
             SLAM, ICLR 2020)
link_state   rise of the worth of the true link state: 0 for an outage, 0.25 for higher order, 0.5 for first order,
             1 for line of sight; after the rule of Yin et al., Zero-shot wireless indoor navigation through
             physics-informed reinforcement learning, ICRA 2024, that the order of the link falls along a good route
snr          rise of the SNR of the strongest measured path [dB], an outage counting as -30 dB

A term of any other name is a function of the observation and the `info` of a step; its weight is 1:

    def near(observation, info):
        return 0.1 * (info["distance_m"] < 2.0)

    gymnasium.make("robosim/TargetSearch-v1", rewards={"arrival": 10.0, "near": near})
"""

from collections.abc import Callable, Mapping
from typing import Any

from robosim.support.checks import check_number, shown
from wireless.paths import LinkState

#: A term of your own: from observation and `info` of a step to its reward.
OwnTerm = Callable[[dict[str, Any], dict[str, Any]], float]
#: Terms, and their default weights.
TERMS = ("arrival", "progress", "step", "collision", "coverage", "link_state", "snr")
DEFAULT_WEIGHTS: Mapping[str, float] = {"arrival": 10.0, "progress": 1.0, "step": -0.01}
#: How good a link state is for finding the transmitter.
WORTH = {LinkState.OUTAGE: 0.0, LinkState.HIGHER_ORDER: 0.25, LinkState.FIRST_ORDER: 0.5, LinkState.LOS: 1.0}
#: SNR of an outage [dB].
NO_SNR_DB = -30.0


def check_weights(weights: Mapping[str, float | OwnTerm]) -> None:
    """Raise ValueError unless known terms have numbers as weights, and other names functions."""
    if not isinstance(weights, Mapping):
        raise ValueError(f"rewards is {shown(weights)}, expected a dictionary of weights by term.")
    for term, weight in weights.items():
        if callable(weight) == (term in TERMS):
            raise ValueError(
                f"rewards has {term!r}: {type(weight).__name__}. Known terms, each with a number as its weight: "
                f"{', '.join(TERMS)}. A term of your own has another name and a function of observation and info."
            )
        if not callable(weight):
            check_number(f"weight of {term}", weight, -1e6, 1e6)


def weighted(
    weights: Mapping[str, float | OwnTerm],
    terms: Mapping[str, float],
    observation: dict[str, Any],
    info: dict[str, Any],
) -> dict[str, float]:
    """Each term of a step's reward times its weight; ValueError if one of the user is NaN, infinite or beyond 1e6."""
    weighted_terms = {}
    for term, weight in weights.items():
        if callable(weight):
            weighted_terms[term] = float(weight(observation, info))
            check_number(f"reward term {term}", weighted_terms[term], -1e6, 1e6)
        else:
            weighted_terms[term] = float(weight * terms[term])
    return weighted_terms
