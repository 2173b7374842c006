"""Link states of estimated paths by a trained classifier: one call from arrays to calibrated probabilities.

A classifier is one or a few networks whose probabilities are averaged, a temperature, and the states that its
training data had among links with paths. A link without any estimated path is an outage for sure: networks are
neither trained on such links nor evaluated for them. On disk it is `NAME.safetensors` with the weights and
`NAME.json` with the card: data, seeds, recipe, scores.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from robosim.support.weights import Weights, check_weights, load_network, network_files, trained_numbers
from wireless.linkstate.calibration import scaled
from wireless.linkstate.forward import N_STATES, WIDEST, relation_logits, relation_shapes, softmax
from wireless.linkstate.tokens import COLUMNS, is_path, make_tokens
from wireless.paths import LinkState

#: Links given to a network at once, which bounds the memory.
_BLOCK = 4096
#: Temperatures are about 1.
_HOTTEST = 1e6


class LinkStateClassifier:
    """Trained networks behind one call."""

    def __init__(
        self,
        networks: Sequence[Weights],
        *,
        inputs: Sequence[str],
        options: dict[str, Any] | None = None,
        states: Sequence[int] = (1, 2, 3),
        temperature: float = 1.0,
        card: dict[str, Any] | None = None,
    ) -> None:
        """Make a classifier.

        Args:
            networks: Weights of trained networks, by their names.
            inputs: Columns of tokens that they use.
            options: What they were made with besides the inputs.
            states: States possible of links with paths.
            temperature: See `wireless.linkstate.calibration`.
            card: Record of the training and the scores.

        Raises:
            ValueError: If weights do not fit the inputs and options, or one is no number.
        """
        self.networks = [dict(weights) for weights in networks]
        self.inputs, self.options = tuple(inputs), dict(options or {})
        self.states, self.temperature, self.card = tuple(states), temperature, dict(card or {})
        shapes = relation_shapes(self.inputs, **self.options)
        for weights in self.networks:
            check_weights(weights, shapes)

    @property
    def parameters(self) -> int:
        """Count of trained numbers."""
        return sum(map(trained_numbers, self.networks))

    def predict(
        self,
        aoa_rad: Float[np.ndarray, "n paths"],
        snr_db: Float[np.ndarray, "*snr"],
        *,
        aod_rad: Float[np.ndarray, "*aod"] | None = None,
        peak: Float[np.ndarray, "*peak"] | None = None,
        delay_s: Float[np.ndarray, "*delay"] | None = None,
    ) -> Float[np.ndarray, "n 4"]:
        """Probability of each `LinkState`, in its order.

        Args:
            aoa_rad: Azimuths of arrival in the building's frame.
            snr_db: Signal-to-noise ratios; -inf or NaN where there is no path.
            aod_rad: Azimuths of departure in the building's frame.
            peak: Heights of peaks, as in the public data.
            delay_s: Delays; only their differences count.

        Raises:
            ValueError: If an input that this classifier needs is missing, or arrays do not fit.
        """
        return self.predict_tokens(self.tokens(aoa_rad, snr_db, aod_rad=aod_rad, peak=peak, delay_s=delay_s))

    def tokens(
        self, aoa_rad: np.ndarray, snr_db: np.ndarray, **others: np.ndarray | None
    ) -> Float32[np.ndarray, "n 5 5"]:
        """`make_tokens` of what this classifier needs.

        Raises:
            ValueError: If something is missing, or arrays do not fit.
        """
        measured = {"aoa": aoa_rad, "snr": snr_db} | {
            name.split("_")[0]: value for name, value in others.items()
        }
        if missing := [name for name in self.inputs if measured.get(name) is None]:
            raise ValueError(
                f"{missing[0]} is missing, but this classifier uses {', '.join(self.inputs)}. "
                "Give it, or load one without."
            )
        return make_tokens(aoa_rad, snr_db, **others)

    def predict_tokens(self, tokens: Float32[np.ndarray, "n 5 5"]) -> Float[np.ndarray, "n 4"]:
        """Predict link states from the array of `make_tokens`."""
        probability = np.zeros((len(tokens), N_STATES))
        reached = is_path(tokens).any(1)
        probability[~reached, LinkState.OUTAGE] = 1.0
        if reached.any():
            x = tokens if reached.all() else tokens[reached]
            raw = np.concatenate([self._mean(x[i : i + _BLOCK]) for i in range(0, len(x), _BLOCK)])
            probability[reached] = scaled(raw.astype(float), self.temperature)
        return probability

    def _mean(self, tokens: Float32[np.ndarray, "n 5 5"]) -> Float32[np.ndarray, "n 4"]:
        """Mean probabilities of the networks."""
        allowed = list(self.states)
        total = np.zeros((len(tokens), N_STATES), np.float32)
        for weights in self.networks:
            total[:, allowed] += softmax(relation_logits(weights, tokens, self.inputs)[:, allowed])
        return total / np.float32(len(self.networks))

    def files(self, name: str) -> dict[str, bytes]:
        """The contents of NAME.safetensors and of its card, NAME.json."""
        weights = {
            f"{i}.{key}": array for i, network in enumerate(self.networks) for key, array in network.items()
        }
        head = {
            "inputs": list(self.inputs),
            "options": self.options,
            "networks": len(self.networks),
            "states": list(self.states),
            "temperature": self.temperature,
        }
        return network_files(name, weights, head, self.card)


def load_classifier(path: str | Path) -> LinkStateClassifier:
    """A classifier from its weights; the card has the same name and ends in .json.

    Raises:
        FileError: If a file is missing or damaged, or they do not fit each other.
    """

    def make(weights: Weights, card: dict[str, Any]) -> LinkStateClassifier:
        card = _checked(card)
        networks = [_part(weights, str(i)) for i in range(card["networks"])]
        arguments = {name: card[name] for name in ("inputs", "options", "states", "temperature")}
        return LinkStateClassifier(networks, card=card, **arguments)

    what = "classifier of link states"
    return load_network(path, f"the {what}", f"a {what}", "Train one by `robosim train link-state`.", make)[0]


def _checked(card: dict[str, Any]) -> dict[str, Any]:
    """A card, if networks can be made by it, of a size that is worth the memory."""
    options, states = card["options"], card["states"]
    limits = {"width": (2, WIDEST), "rounds": (1, 16)}
    good = {
        "inputs": "aoa" in card["inputs"] and "snr" in card["inputs"] and set(card["inputs"]) <= set(COLUMNS),
        "networks": _is_whole(card["networks"], 1, 100),
        "options": set(options) <= {*limits, "dropout"}
        and all(_is_whole(options[name], *limits[name]) for name in limits if name in options),
        "states": 0 < len(states) == len(set(states))
        and all(_is_whole(state, 0, N_STATES - 1) for state in states),
        "temperature": isinstance(card["temperature"], float | int) and 0 < card["temperature"] < _HOTTEST,
    }
    for name, fine in good.items():
        if not fine:
            raise ValueError(f"{name} is {card[name]}")
    return card


def _is_whole(value: Any, least: int, greatest: int) -> bool:
    return isinstance(value, int) and least <= value <= greatest


def _part(weights: Weights, name: str) -> dict[str, np.ndarray]:
    """The weights of one of several networks, by its own names."""
    return {key.split(".", 1)[1]: value for key, value in weights.items() if key.startswith(f"{name}.")}
