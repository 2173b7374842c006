"""`--band`: its values are defaults, which other options override."""

import json

import pytest

from robosim.cli import main
from wireless.linkstate.data import read_links


def config_in(path):
    return json.loads(path.read_text())["config"]


def test_a_data_set_in_a_band(plan_file, tmp_path):
    """Carrier, power and antennas are the band's, the bandwidth its own; a tag shows no departures."""
    options = "--tx-per-plan 1 --grid 0.8 --estimator pca --workers 1"
    main(f"dataset {plan_file} {options} --band wifi-6 --bandwidth-mhz 80 --out {tmp_path}".split())
    config = config_in(tmp_path / "manifest.json")
    assert (config["radio"]["frequency_hz"], config["tx"], config["rx"]) == (6.185e9, "tag", "ring-8")
    assert config["radio"]["tx_power_dbm"] == 20.0
    assert config["sounding"] == {
        "tx_power_dbm": 20.0,
        "bandwidth_mhz": 80.0,
        "n_samples": 2048,
        "loss_db": 7.0,
        "half_window": 3,
    }
    assert read_links(tmp_path).measured == ("aoa", "snr", "delay")


@pytest.mark.parametrize(("given", "frequency_hz"), [("", 60.48e9), ("--frequency-ghz 62", 62e9)])
def test_a_trace_in_a_band(given, frequency_hz, plan_file, tmp_path):
    options = f"--tx 1.0,1.0 --grid 0.8 --no-plots --workers 1 --out {tmp_path}"
    main(f"trace {plan_file} {options} {given} --band 60ghz".split())
    settings = json.loads((tmp_path / "settings.json").read_text())["settings"]
    assert settings["frequency_hz"] == frequency_hz


def test_an_episode_in_a_band(plan_file, tmp_path):
    """The recorded configuration has the band's values, and those that were given after it or before."""
    given = "--radio.receiver ue --max-steps 2 --camera plan --no-video"
    main(f"episode {plan_file} --goal fused {given} --band=uwb-6.5 --out {tmp_path}".split())
    config = config_in(tmp_path / "result.json")
    radio = config["simulator"]["radio"]
    assert (radio["frequency_hz"], radio["transmitter"], radio["receiver"]) == (6.4896e9, "tag", "ue")
    assert (radio["sounding"]["bandwidth_mhz"], config["link_states"]) == (499.2, "uwb-6.5")


@pytest.mark.parametrize("command", ["episode", "dataset"])
def test_an_unknown_band(command, plan_file, capsys):
    with pytest.raises(SystemExit) as stop:
        main([command, str(plan_file), "--band", "wifi-7"])
    assert stop.value.code == 2
    assert "band is 'wifi-7'" in capsys.readouterr().err
