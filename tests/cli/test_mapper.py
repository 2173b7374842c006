"""`robosim collect` and `train mapper`, each option at least once."""

import json

import pytest

from robosim.cli import main


def test_from_frames_to_an_episode(tmp_path, capsys):
    """Collect, train, and drive with what came of it: the commands that each one names as the next."""
    frames, out = tmp_path / "frames", tmp_path / "mapper"
    main(
        f"collect --homes 2 --steps 5 --seed 4 --depth-noise 0.5 --noise 0.5 --workers 1 --out {frames}".split()
    )
    assert len(list(frames.glob("home-*.npz"))) == 2
    options = "--steps 2 --batch 4 --widths 4 8 --seed 1 --threads 1"
    main(f"train mapper --data {frames} {options} --out {out}".split())
    output = capsys.readouterr().out
    assert "robosim train mapper --data" in output and "learned: IoU" in output
    assert json.loads((out / "mapper.json").read_text())["widths"] == [4, 8]
    weights = out / "mapper.safetensors"
    episode = (
        f"episode cottage --goal explore --physics kinematic --max-steps 4 --no-video --out {tmp_path / 'e'}"
    )
    main(f"{episode} --depth-noise.level 1 --mapper {weights}".split())
    assert json.loads((tmp_path / "e" / "result.json").read_text())["config"]["mapper"] == str(weights)


def test_smoke_needs_no_data(tmp_path):
    """--smoke collects its own few frames; without it and without data there is one sentence."""
    main(f"train mapper --smoke --steps 2 --batch 4 --widths 4 8 --threads 1 --out {tmp_path}".split())
    assert (tmp_path / "mapper.safetensors").exists()
    with pytest.raises(SystemExit):
        main(["train", "mapper", "--out", str(tmp_path / "other")])
