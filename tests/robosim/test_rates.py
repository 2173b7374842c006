"""Rates of this machine: each part is measured. No bounds on times."""

from robosim import rates


def test_every_part_has_a_rate(monkeypatch):
    """Few calls and decisions: five positive rates, each with its unit."""
    monkeypatch.setattr(rates, "SECONDS", 0.01)
    monkeypatch.setattr(rates, "DECISIONS", 3)
    found = list(rates.measure_rates())
    assert len({rate.name for rate in found}) == 5
    assert all(rate.per_s > 0 and rate.unit for rate in found)
