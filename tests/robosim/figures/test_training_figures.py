"""Pictures of training runs: which numbers go into them."""

import csv
import json

import numpy as np
import pytest

from robosim.figures.training import confusion_of, draw_training, read_card, read_epochs

FOLDS = np.array([np.diag([4, 3, 2, 1]), np.diag([1, 1, 1, 1])[::-1]])


def write_run(folder, *, inputs=("aoa", "aod", "snr"), test=None, epochs=3):
    """A finished run of two folds, in the format of `robosim train link-state`."""
    (folder / "jobs").mkdir(parents=True)
    card = {
        "recipe": {"inputs": list(inputs)},
        "validation": {
            **{f"fold{i}": {"confusion": fold.tolist()} for i, fold in enumerate(FOLDS)},
            "mean_accuracy": 0.5,
        },
    }
    if test is not None:
        card["test"] = {"confusion": test}
    (folder / "result.json").write_text(json.dumps(card))
    for name in ("fold0-0", "all-0"):
        with open(folder / "jobs" / f"{name}.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["epoch", "loss", "accuracy", "watched_loss"])
            held_out = name != "all-0"
            for e in range(1, epochs + 1):
                writer.writerow([e, 1 / e, *((1 - 0.5 / e, 0.5 / e) if held_out else ("", ""))])
    return folder


def test_epochs_are_read_as_written(tmp_path):
    """Numbers of each network; a network that holds out no buildings has no scores."""
    epochs = read_epochs(write_run(tmp_path / "run"))
    assert [epoch.loss for epoch in epochs["fold0-0"]] == pytest.approx([1, 1 / 2, 1 / 3])
    assert epochs["fold0-0"][1].accuracy == 0.75
    assert epochs["all-0"][0].accuracy is None


def test_confusion_is_of_test_buildings_or_else_of_all_folds(tmp_path):
    """Folds add up; test buildings come first; a card without either has none."""
    card = read_card(write_run(tmp_path / "a") / "result.json")
    words, matrix = confusion_of(card)
    assert words == "held-out buildings of 2 folds"
    np.testing.assert_array_equal(matrix, FOLDS.sum(axis=0))
    test = np.eye(4, dtype=int).tolist()
    words, matrix = confusion_of(read_card(write_run(tmp_path / "b", test=test) / "result.json"))
    assert (words, matrix.trace()) == ("test buildings", 4)
    assert confusion_of({"validation": {}}) is None


def test_runs_with_and_without_departures_are_all_there_is_to_draw(tmp_path):
    """Two runs: both pictures, nothing missing. One alone: its counterpart is missed. None: shipped ones, no curves."""
    runs = [write_run(tmp_path / "with"), write_run(tmp_path / "without", inputs=("aoa", "snr"))]
    pictures, notes = draw_training(runs, tmp_path / "out")
    assert [picture.name for picture in pictures] == ["training.png", "confusion.png"]
    assert notes == []
    for picture in pictures:
        assert (tmp_path / "out" / picture.name).stat().st_size > 10_000
    _, notes = draw_training(runs[:1], tmp_path / "one")
    assert notes == ["No confusion matrix without angles of departure: no such classifier was given."]
    pictures, notes = draw_training([], tmp_path / "none")
    assert [picture.name for picture in pictures] == ["confusion.png"]
    assert notes[0].startswith("No curves of training")


def test_folders_without_a_finished_run_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"result\.json: no such file, expected a result of training"):
        draw_training([tmp_path], tmp_path)
    (tmp_path / "result.json").write_text("{}")
    with pytest.raises(ValueError, match="'recipe' is missing"):
        draw_training([tmp_path], tmp_path)
    with pytest.raises(ValueError, match="same name"):
        draw_training([write_run(tmp_path / "a" / "run"), write_run(tmp_path / "b" / "run")], tmp_path)
