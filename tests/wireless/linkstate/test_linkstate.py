"""What a classifier of link states promises of its inputs: order, symmetry, missing paths, files."""

import json

import numpy as np
import pytest
import torch

from robosim.support.torch_training import weights_of
from wireless.linkstate import LinkStateClassifier, load_classifier, make_tokens
from wireless.linkstate.learning.networks import RelationNetwork
from wireless.linkstate.tokens import AOA, AOD, DELAY, SNR

FULL = ("aoa", "aod", "snr", "peak", "delay")


def links(n=64, seed=0, paths=5):
    """Random estimates as keyword arguments of `predict`; about a fifth of the paths are missing."""
    rng = np.random.default_rng(seed)
    snr = np.where(rng.random((n, paths)) < 0.2, -np.inf, rng.uniform(0, 50, (n, paths)))
    return {
        "aoa_rad": rng.uniform(-np.pi, np.pi, (n, paths)),
        "snr_db": snr,
        "aod_rad": rng.uniform(-np.pi, np.pi, (n, paths)),
        "peak": rng.uniform(3, 26, (n, paths)),
        "delay_s": rng.uniform(0, 200e-9, (n, paths)),
    }


def classifier(inputs=FULL, states=(1, 2, 3), count=2):
    torch.manual_seed(0)
    networks = [weights_of(RelationNetwork(inputs)) for _ in range(count)]
    return LinkStateClassifier(networks, inputs=inputs, states=states, temperature=0.7)


def test_the_order_of_paths_changes_nothing():
    """Exactly: paths are put into an order of their own. Half have equal SNR, so that ties are met."""
    measured = links()
    measured["snr_db"][:, 1] = measured["snr_db"][:, 3]
    order = np.random.default_rng(1).permuted(np.tile(np.arange(5), (64, 1)), axis=1)
    mixed = {name: np.take_along_axis(values, order, 1) for name, values in measured.items()}
    model = classifier()
    assert np.array_equal(model.predict(**measured), model.predict(**mixed))


def turned(measured, sign, by):
    """The same links in a building that was mirrored and turned."""
    return {
        name: sign * values + by if name in ("aoa_rad", "aod_rad") else values
        for name, values in measured.items()
    }


def test_mirroring_a_building_changes_nothing():
    """To single precision: differences below 2e-4 for random weights. Turning arrivals alone does change much."""
    measured, model = links(), classifier()
    assert np.abs(model.predict(**measured) - model.predict(**turned(measured, -1, 0.0))).max() < 2e-4
    aside = {**measured, "aoa_rad": measured["aoa_rad"] + 0.5}
    assert np.abs(model.predict(**measured) - model.predict(**aside)).max() > 1e-3


@pytest.mark.parametrize("sign", [1, -1])
def test_without_departures_a_third_of_a_turn_changes_nothing(sign):
    """Three arrays 120 degrees apart see the same in turn; and departures are not required."""
    measured, model = links(), classifier(inputs=("aoa", "snr", "peak"))
    measured.pop("aod_rad")
    same = model.predict(**turned(measured, sign, 2 * np.pi / 3))
    assert np.abs(model.predict(**measured) - same).max() < 2e-4
    assert np.abs(model.predict(**measured) - model.predict(**turned(measured, 1, 0.5))).max() > 1e-3


def test_a_missing_path_may_hold_anything():
    """What lies in the places of a path with SNR -inf or NaN, or all zero, is not looked at; nor how many there are."""
    measured = links()
    missing = ~np.isfinite(measured["snr_db"])
    clean = classifier().predict(**measured)
    assert np.isfinite(clean).all()
    for rubbish in (np.nan, 1e9, 0.0):
        dirty = {name: np.where(missing, rubbish, values) for name, values in measured.items()}
        dirty["snr_db"] = np.where(missing, 0.0 if rubbish == 0 else np.nan, measured["snr_db"])
        assert np.array_equal(classifier().predict(**dirty), clean)
    more = {name: np.pad(values, ((0, 0), (0, 2))) for name, values in measured.items()}
    assert np.array_equal(classifier().predict(**more), clean)


def test_a_link_without_paths_is_an_outage():
    """For sure, and only such a link if the training data had no other outages."""
    measured = links()
    measured["snr_db"][::2] = -np.inf
    measured["snr_db"][1::2, 0] = 10.0
    probability = classifier().predict(**measured)
    assert (probability[::2] == [1, 0, 0, 0]).all()
    assert (probability[1::2, 0] == 0).all()
    assert np.allclose(probability.sum(1), 1)
    assert (classifier(states=(0, 1, 2, 3)).predict(**measured)[1::2, 0] > 0).all()


def test_tokens_hold_the_strongest_first():
    tokens = make_tokens(
        np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]]), np.array([[1.0, 5.0, -np.inf, 3.0, 9.0, 2.0]])
    )
    assert tokens[0, :, AOA].tolist() == np.float32([0.5, 0.2, 0.4, 0.6, 0.1]).tolist()
    assert tokens[0, :, SNR].tolist() == [9, 5, 3, 2, 1]
    assert np.isnan(tokens[0, :, [AOD, DELAY]]).all()


def test_inputs_that_do_not_fit_are_named():
    measured = links()
    with pytest.raises(ValueError, match=r"aod_rad has shape \(64, 4\), expected \(64, 5\)"):
        make_tokens(measured["aoa_rad"], measured["snr_db"], aod_rad=measured["aod_rad"][:, :4])
    measured["snr_db"][3, 2], measured["peak"][3, 2] = 10.0, np.nan
    with pytest.raises(ValueError, match="peak of path 2 of link 3 is nan"):
        classifier().predict(**measured)
    with pytest.raises(ValueError, match="aod is missing, but this classifier uses aoa, aod"):
        classifier().predict(
            measured["aoa_rad"], measured["snr_db"], peak=links()["peak"], delay_s=measured["delay_s"]
        )


@pytest.mark.parametrize(("name", "factor"), [("aoa_rad", 180 / np.pi), ("delay_s", 1e9)])
def test_inputs_in_degrees_or_nanoseconds_are_rejected(name, factor):
    measured = links()
    with pytest.raises(ValueError, match=rf"{name} of path \d of link \d is .*, expected a magnitude up to"):
        classifier().predict(**{**measured, name: factor * measured[name]})


def test_tokens_without_an_input_are_rejected():
    """Paths whose heights of peaks were not measured would count as paths of height 0."""
    measured = links() | {"peak": None}
    tokens = make_tokens(**measured)
    with pytest.raises(ValueError, match=r"peak is missing in .* paths, but this classifier uses aoa, aod"):
        classifier().predict_tokens(tokens)
    assert np.isfinite(classifier(inputs=("aoa", "aod", "snr", "delay")).predict_tokens(tokens)).all()


def write(made, folder):
    for name, content in made.files("some").items():
        (folder / name).write_bytes(content)


def test_files_keep_a_classifier(tmp_path):
    """Read back it answers the same, bit for bit."""
    made = classifier()
    made.card["note"] = "stored"
    write(made, tmp_path)
    read = load_classifier(str(tmp_path / "some.safetensors"))
    assert np.array_equal(read.predict(**links()), made.predict(**links()))
    assert read.card["note"] == "stored"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["some.json", "some.safetensors"]


def test_files_that_are_damaged_are_named(tmp_path):
    write(classifier(), tmp_path)
    card = json.loads((tmp_path / "some.json").read_text())
    for name, value in (("temperature", "0.8"), ("states", [1.0, 2, 3])):
        (tmp_path / "some.json").write_text(json.dumps({**card, name: value}))
        with pytest.raises(ValueError, match=f"{name} is "):
            load_classifier(tmp_path / "some.safetensors")
    (tmp_path / "some.json").write_text(json.dumps({**card, "inputs": ["aoa", "snr"]}))
    with pytest.raises(ValueError, match=r"some\.safetensors: not readable as the classifier of link states"):
        load_classifier(tmp_path / "some.safetensors")
    with pytest.raises(
        ValueError, match=r"none\.safetensors: no such file, expected the classifier of link states"
    ):
        load_classifier(tmp_path / "none.safetensors")
