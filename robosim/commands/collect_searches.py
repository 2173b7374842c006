"""`robosim collect-searches`."""

from pathlib import Path

from tyro.conf import OmitArgPrefixes

from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import output_folder, resume_hint
from robosim.environments.collect import CollectSearchesConfig
from robosim.environments.collect import collect_searches as collect_data_set
from wireless.support.counting import counted

_DEFAULTS = CollectSearchesConfig()


def collect_searches(
    *, config: OmitArgPrefixes[CollectSearchesConfig] = _DEFAULTS, out: Path | None = None
) -> None:
    """Collect searches to learn from: trajectories with all observations, as a Minari data set.

    The same command resumes an interrupted run, and adds searches if more are given. Needs the extra `minari`.

    Example: robosim collect-searches --plan flat --episodes 20 --out out/searches

    Args:
        config: Which searches are collected.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    folder = output_folder(out, "collect-searches")
    with resume_hint(folder):
        data = collect_data_set(config, folder, console)
    emit_result({"searches": config.episodes, "data": str(data)}, folder)
    console.print(f"Wrote {counted(config.episodes, 'search', 'searches')} in {folder}")
    console.print(f"Next, in Python: minari.MinariDataset({str(data)!r})")
