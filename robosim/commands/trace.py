"""`robosim trace`."""

from pathlib import Path
from shlex import quote
from typing import Annotated, Literal

import tyro
from rich.text import Text
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.radio import DEFAULT_RADIO, RadioOptions
from robosim.commands.speaking import console, tell
from robosim.commands.terminal import (
    ALL_CORES,
    NO_OPTIONS,
    OnePlace,
    Place,
    PlanOptions,
    WorkOptions,
    folder_for,
    going_on,
    read_storey,
)
from robosim.support.installation import install_first
from wireless.support.counting import counted


def trace(
    plan: Positional[str],
    *,
    tx: Annotated[tuple[OnePlace, ...], tyro.conf.UseAppendAction],
    grid: float | None = None,
    rx: Place = None,
    storey: int | None = None,
    polarisation: Literal["vertical", "horizontal", "both"] = "vertical",
    tolerance: float | None = None,
    radio: OmitArgPrefixes[RadioOptions] = DEFAULT_RADIO,
    reading: OmitArgPrefixes[PlanOptions] = NO_OPTIONS,
    plots: bool = True,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Trace radio paths from transmitters to receivers all over a floor plan.

    Writes paths.parquet, a DeepMIMO v4 scenario (deepmimo_scenarios/), NAME_Tx_K.csv as mmwRobotNav has it,
    and pictures of each transmitter: power, link state and direction of arrival of the strongest path, and
    the rays of one link. A long run that was interrupted or killed goes on when the same command is given
    again, with the same result. With --rx and no --grid, one link is traced.

    Example: robosim trace office --tx 6.5,13 --grid 0.15 --out out/radio

    Args:
        plan: Floor plan: a shipped one by name, a ROS map (.yaml), an image or mesh, a HouseExpo .json, .npy; or the
            .yaml of a building of several storeys.
        tx: A transmitter [m], in the plan's frame; can be given several times.
        grid: Step between receivers [m]; 0.15 if neither this nor --rx is given.
        rx: The receiver whose rays are drawn; without --grid also the only one.
        storey: Where receivers are, and transmitters that do not say their height, in a building of several
            storeys; 0, the lowest, if not given. Heights count from the lowest floor.
        polarisation: Of all antennas; both takes the mean.
        tolerance: How far walls may be moved to save corners [m]; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        radio: Which paths are traced.
        reading: How to read the plan, where it does not say.
        plots: Whether to draw pictures.
        work: Who does the work.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    from robosim.datasets.trace import check_terminals, trace_link, trace_plan
    from robosim.plans.floorplan import FloorPlan
    from robosim.radio.receivers import check_step
    from wireless.paths import LinkCategory

    config = radio.config(tolerance, polarisation)
    if not storey:  # how high the others' floors are is not known before the plan is read
        check_terminals(tx, rx, config.height_m)
    check_step(0.15 if grid is None else grid)
    alone = grid is None and rx is not None
    folder = folder_for(out, "trace --rx" if alone else "trace")
    floor_plan = read_storey(plan, storey, reading)
    if alone and rx is not None:
        paths = trace_link(floor_plan, config, folder, tx=tx, rx=rx, console=console)
        found = {
            "paths": len(paths),
            "states": [LinkCategory(one).name.lower() for one in paths.link_category()[:, 0]],
        }
        tell(
            {"plan": floor_plan.name, "tx_m": paths.tx_position, "rx_m": paths.rx_position[0], **found},
            folder,
        )
        console.print(f"{counted(len(paths), 'path')} from {counted(len(tx), 'transmitter')} to the receiver")
        drawn = "rays_tx1.png" if isinstance(floor_plan, FloorPlan) else "storeys_tx1.png"
        console.print(f"Wrote paths.parquet and {drawn} in {folder}")
        return
    with going_on(folder):
        result = trace_plan(
            floor_plan,
            config,
            folder,
            tx=tx,
            grid_m=0.15 if grid is None else grid,
            rx=rx,
            plots=plots,
            workers=work.count,
            cluster=work.cluster,
            console=console,
        )
    tell(result, folder)
    timing, states = result["timing"], result["states"]
    shown = {name: n for name, n in states.items() if n or name != "obstructed_los"}
    shares = ", ".join(f"{name} {100 * n / result['links']:.1f} %" for name, n in shown.items())
    told = f": {shares}; {timing['traced']} traced in {timing['seconds']:.1f} s ({timing['links_per_s']:.0f} links/s)"
    console.print(Text.assemble((counted(result["links"], "link"), "bold"), told))
    drawn = ", *.png" if plots else ""
    console.print(f"Wrote paths.parquet, {floor_plan.name}_Tx_*.csv, deepmimo_scenarios/{drawn} in {folder}")
    load = f"import deepmimo; deepmimo.load('{result['deepmimo']}')"
    where = f"{install_first('deepmimo')}cd {quote(str(folder))}"
    console.print(f'Next: {where}; python -c "{load}"', soft_wrap=True)
