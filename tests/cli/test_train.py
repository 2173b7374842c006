"""`robosim train link-state` on small made-up measurements in the public format."""

import csv
import json
import shutil

import numpy as np
import pytest

from robosim.cli import main
from robosim.policies.search_network import load_search
from robosim.training import explorer as explorer_training
from robosim.training.link_state import deal
from slam.exploration.choosing import load_chooser
from wireless.linkstate import load_classifier


def write_building(folder, name, transmitters, rng):
    """Measurements classified by the strongest SNR: 45, 30 and 15 dB for states 1, 2 and 3; an outage is all zeros."""
    place = folder / name
    place.mkdir(parents=True)
    with open(place / f"{name}_tx_pos.csv", "w") as file:
        file.write("index,x,y,z\n" + "".join(f"{k},{k}.0,-2.0,1.5\n" for k in range(1, transmitters + 1)))
    columns = [
        f"{n}_{i}" for n in ("aoaAzResult", "aodAzResult", "snrResult", "peakFracResult") for i in range(1, 6)
    ]
    for k in range(1, transmitters + 1):
        with open(place / f"{name}_Tx_{k}_beam_search.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["rxPos_1", "rxPos_2", "rxPosInd_1", "rxPosInd_2", "linkState", *columns])
            for row in range(200):
                state = row % 4
                snr = np.sort(rng.uniform(0, 5, 5))[::-1] + np.array([(0, 45, 30, 15)[state] - 5, 0, 0, 0, 0])
                values = np.concatenate([rng.uniform(-180, 180, 10), snr, rng.uniform(3, 20, 5)]) * (
                    state > 0
                )
                writer.writerow([round(0.15 * row, 2), -1, row + 1, 1, state, *values.round(3)])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    rng = np.random.default_rng(0)
    root = tmp_path_factory.mktemp("measurements")
    for name in ("Abel", "Berta", "Carl"):
        write_building(root / "train", name, 2, rng)
    write_building(root / "test", "Dora", 1, rng)
    return root


def run(folders, out, *more):
    main(
        [
            *f"train link-state --data {folders}/train --epochs 3 --members 2 --homes 0 --folds 1 --out {out}".split(),
            *more,
        ]
    )


def test_the_whole_run(folders, tmp_path, capsys):
    """The last line is the accuracy, the confusion matrix above it; what is written answers as was scored."""
    run(
        folders,
        tmp_path / "out",
        "--test",
        str(folders / "test"),
        "--epochs",
        "20",
        "--members",
        "1",
        "--folds",
        "2",
    )
    lines = capsys.readouterr().out.strip().splitlines()
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert lines[-1] == f"test accuracy {result['test']['accuracy']:.4f} (200 links)"
    above = "\n".join(lines[-9:-1])
    assert "test buildings: Dora" in above
    assert "true / found" in above
    assert result["test"]["accuracy"] > 0.8
    assert np.sum(result["test"]["confusion"]) == 200
    assert result["test"]["confusion"][0] == [50, 0, 0, 0]
    assert len(result["validation"]["fold0"]["accuracy_by_building"]) == 1
    classifier = load_classifier(tmp_path / "out" / "link-state.safetensors")
    assert len(classifier.networks) == 1
    assert classifier.card["recipe"]["epochs"] == 20
    assert {"curves.png", "test.png", "fold0.png"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_workers_and_interruptions_change_nothing(folders, tmp_path, capsys):
    """Weights byte for byte: by two processes, and again by one from what an interruption left."""
    run(folders, tmp_path, "--workers", "2")
    assert "validation accuracy" in capsys.readouterr().out.strip().splitlines()[-1]
    weights = (tmp_path / "link-state.safetensors").read_bytes()
    for lost in ("link-state.safetensors", "jobs/all-1.pt", "jobs/fold0-0.pt"):
        (tmp_path / lost).unlink()
    run(folders, tmp_path, "--workers", "1")
    assert (tmp_path / "link-state.safetensors").read_bytes() == weights


def test_a_fold_predicts_only_the_states_of_its_training(folders, tmp_path):
    """First order is in one building alone: the fold without that building gives it no probability.

    The test building has outages only: an accuracy of no links is null in the card, since JSON has no NaN.
    """
    shutil.copytree(folders / "train", tmp_path / "train")
    for file in (tmp_path / "train").glob("[AB]*/*_search.csv"):
        head, *lines = file.read_text().splitlines(keepends=True)
        file.write_text(head + "".join(line for line in lines if line.split(",")[4] != "2"))
    shutil.copytree(folders / "test", tmp_path / "test")
    for file in (tmp_path / "test").glob("*/*_search.csv"):
        head, *lines = file.read_text().splitlines(keepends=True)
        file.write_text(head + "".join(line for line in lines if line.split(",")[4] == "0"))
    run(tmp_path, tmp_path / "out", "--workers", "1", "--members", "1", "--test", str(tmp_path / "test"))
    card = json.loads((tmp_path / "out" / "link-state.json").read_text(), parse_constant=pytest.fail)
    assert card["test"]["accuracy_with_paths"] is None
    validation = card["validation"]["fold0"]
    assert list(validation["accuracy_by_building"]) == ["Carl"]
    assert validation["cross_entropy_with_paths"] > 27 / 3  # a third of the links, of probability 1e-12


def test_a_baseline_without_departures(folders, tmp_path):
    run(folders, tmp_path, "--no-aod", "--no-peak", "--workers", "1", "--members", "1")
    classifier = load_classifier(tmp_path / "link-state.safetensors")
    assert classifier.inputs == ("aoa", "snr")
    assert classifier.predict(np.zeros((1, 5)), np.full((1, 5), -np.inf)).tolist() == [[1, 0, 0, 0]]


def test_invalid_options_are_rejected(folders, tmp_path, capsys):
    for more, message in (
        (["--folds", "0"], "nothing would be scored"),
        (["--n-folds", "4"], "4 folds, expected 1 to 3"),
        (["--n-folds", "1", "--folds", "1"], "leaves none to train on"),
        (["--homes", "-1"], "homes is -1"),
        (["--workers", "0"], "workers is 0"),
        (["--folds", "4"], "folds is 4, expected at most n_folds = 3"),
    ):
        with pytest.raises(SystemExit) as stop:
            run(folders, tmp_path, *more)
        assert stop.value.code == 2
        assert message in " ".join(capsys.readouterr().err.split())


def test_folds_part_the_buildings():
    assert sorted(i for part in deal(18, 3) for i in part) == list(range(18))
    assert [len(part) for part in deal(7, 3)] == [3, 2, 2]


def test_an_explorer_is_the_same_with_any_number_of_workers_and_after_a_break(tmp_path, monkeypatch, capsys):
    """Two workers at once, or one that was stopped after a round and began again: the same weights, byte for byte."""
    options = "train explorer --homes 2 --decisions 12 --held-out 1 --seed 3 --smoke"
    main(f"{options} --workers 2 --out {tmp_path}/two".split())
    card = json.loads((tmp_path / "two" / "explorer.json").read_text())
    assert card["recipe"]["homes"] == 2
    assert set(card["mean_coverage"]) == {"nearest", "cheapest", "gain", "learned"}
    rounds = iter([explorer_training.improve])
    with monkeypatch.context() as patch, pytest.raises(SystemExit) as stop:
        # The second round has none to improve it, as if Ctrl-C had been pressed.
        patch.setattr(explorer_training, "improve", lambda *a: next(rounds, _interrupted)(*a))
        main(f"{options} --workers 1 --out {tmp_path}/one".split())
    assert stop.value.code == 130
    assert not (tmp_path / "one" / "explorer.safetensors").exists()
    main(f"{options} --workers 1 --out {tmp_path}/one".split())
    assert "learned" in capsys.readouterr().out
    weights = [(tmp_path / name / "explorer.safetensors").read_bytes() for name in ("one", "two")]
    assert weights[0] == weights[1]
    load_chooser(tmp_path / "one" / "explorer.safetensors")


def _interrupted(*_):
    raise KeyboardInterrupt


def test_a_search_goes_on_after_a_break_and_drives(tmp_path):
    """One epoch and later another, or both at once: the same weights, byte for byte. An episode is driven by them.

    The second of both runs finds its tables of radio in files, as a run that goes on does.
    """
    options = "train search --homes 2 --held-out 2 --seed 3 --smoke"
    main(f"{options} --epochs 1 --out {tmp_path}/one".split())
    shutil.copytree(tmp_path / "one" / "tables", tmp_path / "two" / "tables")
    main(f"{options} --epochs 2 --out {tmp_path}/one".split())
    main(f"{options} --epochs 2 --out {tmp_path}/two".split())
    weights = [(tmp_path / name / "search.safetensors").read_bytes() for name in ("one", "two")]
    assert weights[0] == weights[1]
    card = json.loads((tmp_path / "one" / "search.json").read_text())
    assert set(card["scores"]) == {"learned", "learned, most likely actions", "guide", "random"}
    assert card["data"] == "256 steps in 2 generated homes"
    curve = json.loads((tmp_path / "one" / "curve.json").read_text())["epochs"]
    assert [row["epoch"] for row in curve] == [1, 2]
    path = tmp_path / "one" / "search.safetensors"
    assert load_search(path).weights
    main(
        f"episode cottage --goal {path} --mapper classical --max-steps 12 --no-video --out {tmp_path}/episode".split()
    )
    result = json.loads((tmp_path / "episode" / "result.json").read_text())
    assert result["steps"] == 12
