"""Tables and plot of `tests.benchmarks.estimation`."""

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from robosim.drawing.shares import draw_shares
from robosim.support.colours import STATE_NAMES
from robosim.support.figures import save_figure
from wireless.estimation.estimators import ESTIMATORS
from wireless.paths import LinkState


def tables(report: dict[str, Any]) -> list[Table]:
    """Speed, lone paths and traced plans."""
    return [_speed_table(report), _lone_table(report), _plan_table(report)]


def _table(title: str, caption: str, words: tuple[str, ...], numbers: tuple[str, ...]) -> Table:
    table = Table(title=title, caption=caption, box=None, pad_edge=False)
    for column in words:
        table.add_column(column)
    for column in numbers:
        table.add_column(column, justify="right")
    return table


def _speed_table(report: dict[str, Any]) -> Table:
    speed = report["speed"]
    workers = list(speed["sounding_links_per_s"])
    caption = (
        f"{speed['links']:,} traced links with {speed['rays_per_link']:.1f} paths each on average, warm; waveforms "
        f"of {speed['waveform_links']} of them. The closed form is {speed['ratio']:,.0f} times as fast. pca runs "
        f"on the threads that NumPy takes. Preparing sage took {report['prepare_s']['sage']:.1f} s."
    )
    names = tuple(f"links/s, {n} worker{'s' * (n > 1)}" for n in workers)
    table = _table("Speed", caption, ("step", "method"), ("one link, 1 worker", *names))
    table.add_row(
        "sounding",
        "waveform",
        f"{speed['waveform_ms']:,.0f} ms",
        f"{1e3 / speed['waveform_ms']:.1f}",
        *("-" for _ in workers[1:]),
    )
    rates = {("sounding", "closed form"): speed["sounding_links_per_s"]}
    rates |= {("estimating", name): of for name, of in speed["estimating_links_per_s"].items()}
    for (step, method), rate in rates.items():
        table.add_row(step, method, f"{1e3 / rate[1]:.2f} ms", *(f"{rate[n]:,.0f}" for n in workers))
    return table


def _lone_table(report: dict[str, Any]) -> Table:
    rows = report["lone_paths"]
    caption = (
        f"{rows[0]['links']} links at each SNR, azimuths at random. SNR: energy in the whole measurement over noise in "
        "one entry. Root mean square error; decibels above the bound; share within 5°. No path found: 180°."
    )
    table = _table("Azimuth of arrival of a lone path", caption, (), ("SNR [dB]", "bound", *ESTIMATORS))
    for row in rows:
        cells = (
            f"{row[name]['rms_deg']:.4f}°  {row[name]['above_bound_db']:+5.1f} dB  "
            f"{100 * row[name]['within_5_deg']:5.1f} %"
            for name in ESTIMATORS
        )
        table.add_row(f"{row['snr_db']:g}", f"{row['bound_deg']:.4f}°", *cells)
    return table


def _plan_table(report: dict[str, Any]) -> Table:
    caption = (
        "Strongest estimated path against strongest true one, links whose true one has 10 dB or more (left out: "
        "weaker). Rivals: true paths at most 3 dB weaker than the strongest, any of which counts. Limit: a perfect "
        "receiver that cannot tell paths apart whose signatures agree by 0.95. Published: arXiv 2110.14789, on "
        "other buildings; - where it gives no number; 60 % is an upper bound."
    )
    degrees = list(report["pooled"][0]["within"])
    numbers = ("links", "left out", *(f"within {most:g}°" for most in degrees), "5° of rivals")
    table = _table(
        "Azimuth of arrival on traced plans", caption, ("plan", "link state", "estimator"), numbers
    )
    for row in [*report["plans"], *({"plan": "all", **row} for row in report["pooled"])]:
        counted = [*(row["within"][most] for most in degrees), row["within_of_rivals"][5.0]]
        shares = (f"{100 * share:.1f} %" if row["links"] else "-" for share in counted)
        state = STATE_NAMES[LinkState[row["state"]]]
        table.add_row(
            Text(row["plan"]), state, row["estimator"], f"{row['links']:,}", f"{row['unheard']:,}", *shares
        )
    for name, shares_of in report["published"].items():
        shares = (f"{100 * shares_of[most]:.0f} %" if most in shares_of else "-" for most in degrees)
        table.add_row("published", STATE_NAMES[LinkState[name]], "", "", "", *shares)
    return table


def plot(report: dict[str, Any], path: Path) -> None:
    """Draw rates, errors over SNR, and shares of links over error."""
    figure = Figure(figsize=(15, 5), layout="constrained")
    axes = figure.subplots(1, 3)
    _draw_speed(axes[0], report["speed"])
    _draw_lone(axes[1], report["lone_paths"])
    draw_shares(axes[2], report["pooled"], report["published"])
    save_figure(figure, path)


def _draw_speed(ax: Axes, speed: dict[str, Any]) -> None:
    rates = {
        "sounding:\nwaveform": 1e3 / speed["waveform_ms"],
        "sounding:\nclosed form": 1e3 / speed["closed_ms"],
    }
    rates |= {f"estimating:\n{name}": of[1] for name, of in speed["estimating_links_per_s"].items()}
    bars = ax.bar(list(rates), list(rates.values()), color=["0.6", "C0", "C1", "C2"])
    ax.bar_label(bars, [f"{rate:,.0f}" if rate > 10 else f"{rate:.1f}" for rate in rates.values()])
    ax.set(yscale="log", ylabel="links per second, one worker", title="speed")


def _draw_lone(ax: Axes, rows: list[dict[str, Any]]) -> None:
    snr = [row["snr_db"] for row in rows]
    ax.plot(snr, [row["bound_deg"] for row in rows], "k:", lw=2, label="Cramér-Rao bound")
    for i, name in enumerate(ESTIMATORS):
        ax.plot(snr, [row[name]["rms_deg"] for row in rows], "o-", ms=4, color=f"C{i + 1}", label=name)
    ax.set(yscale="log", xlabel="SNR of the whole measurement [dB]", ylabel="RMS error of azimuth [deg]")
    ax.set_title("lone paths; a path not found counts 180°")
    ax.grid(True, which="major", lw=0.3)
    ax.legend()
