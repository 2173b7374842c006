"""`robosim trace`."""

from pathlib import Path
from typing import Annotated, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.terminal import NO_OPTIONS, Place, PlanOptions, console, folder_for, read


def trace(
    plan: Positional[str],
    *,
    tx: Annotated[tuple[Place, ...], tyro.conf.UseAppendAction],
    grid: float | None = None,
    rx: Place | None = None,
    frequency_ghz: float = 28.0,
    max_reflections: int = 3,
    diffraction: bool = True,
    diffraction_reflections: int = 1,
    floor_ceiling: bool = False,
    max_transmissions: int = 0,
    wall_thickness: float | None = None,
    max_paths: int = 25,
    polarisation: Literal["vertical", "horizontal", "both"] = "vertical",
    material: str = "drywall",
    tolerance: float = 0.0,
    height: float = 1.5,
    tx_power_dbm: float = 23.0,
    threshold_dbm: float | None = None,
    reading: OmitArgPrefixes[PlanOptions] = NO_OPTIONS,
    plots: bool = True,
    workers: int | None = None,
    out: Path | None = None,
) -> None:
    """Trace radio paths from transmitters to receivers all over a floor plan.

    Writes paths.parquet, a DeepMIMO v4 scenario (deepmimo_scenarios/), NAME_Tx_K.csv as mmwRobotNav has it,
    and pictures of each transmitter: power, link state and direction of arrival of the strongest path, and
    the rays of one link. A long run that was interrupted or killed goes on when the same command is given
    again, with the same result. With --rx and no --grid, one link is traced.

    Example: robosim trace office --tx 6.5,13 --grid 0.15 --out out/radio

    Args:
        plan: Floor plan: a shipped one by name, a ROS map (.yaml), an image or mesh, a HouseExpo .json, .npy.
        tx: A transmitter [m], in the plan's frame; can be given several times.
        grid: Step between receivers [m]; 0.15 if neither this nor --rx is given.
        rx: The receiver whose rays are drawn; without --grid also the only one.
        frequency_ghz: Carrier frequency [GHz].
        max_reflections: Most reflections on a path without diffraction.
        diffraction: Whether edges diffract.
        diffraction_reflections: Most reflections, before and after together, on a path with diffraction.
        floor_ceiling: Whether floor and ceiling reflect.
        max_transmissions: Most walls that a path goes through; needs --wall-thickness.
        wall_thickness: Thickness of all walls [m]; half-spaces if not given.
        max_paths: Most paths of a link; the strongest are kept.
        polarisation: Of all antennas; both takes the mean.
        material: Of walls and furniture.
        tolerance: How far walls may be moved to straighten them [m], faster; 0 keeps every cell.
        height: Of receivers, and of transmitters that do not say theirs [m].
        tx_power_dbm: Power sent, for pictures and the CSV file [dBm].
        threshold_dbm: Paths received with less do not count for the link state [dBm].
        reading: How to read the plan, where it does not say.
        plots: Whether to draw pictures.
        workers: Threads to trace in; one on each core if not given. The results do not depend on it.
        out: Folder for the results, and to go on from; a new one under runs/ if not given.
    """
    import sys

    from robosim.building import BuildingConfig
    from robosim.radio_scene import RadioConfig
    from robosim.trace import trace_link, trace_plan
    from wireless.raytrace import TracerConfig

    config = RadioConfig(
        frequency_hz=frequency_ghz * 1e9,
        height_m=height,
        tx_power_dbm=tx_power_dbm,
        threshold_dbm=threshold_dbm,
        tracer=TracerConfig(
            max_reflections=max_reflections,
            diffraction=diffraction,
            diffraction_reflections=diffraction_reflections,
            floor_ceiling=floor_ceiling,
            max_transmissions=max_transmissions,
            wall_thickness_m=wall_thickness,
            max_paths=max_paths,
            polarisation=polarisation,
        ),
        building=BuildingConfig(tolerance_m=tolerance, wall_material=material, furniture_material=material),
    )
    floor_plan = read(plan, reading)
    folder = folder_for(out, "trace")
    if grid is None and rx is not None:
        paths = trace_link(floor_plan, config, folder, tx=tx, rx=rx, console=console)
        console.print(f"{len(paths)} paths from {len(tx)} transmitter(s) to the receiver")
        console.print(f"Wrote paths.parquet and rays_tx1.png in {folder}")
        return
    try:
        result = trace_plan(
            floor_plan,
            config,
            folder,
            tx=tx,
            grid_m=0.15 if grid is None else grid,
            rx=rx,
            plots=plots,
            workers=workers,
            console=console,
        )
    except KeyboardInterrupt:
        console.print(f"Interrupted; what was traced is kept. Go on with the same command and --out {folder}")
        sys.exit(130)
    timing, states = result["timing"], result["states"]
    shares = ", ".join(f"{name} {100 * n / result['links']:.1f} %" for name, n in states.items())
    console.print(
        f"[bold]{result['links']} links[/]: {shares}; {timing['traced']} traced in {timing['seconds']:.1f} s "
        f"({timing['links_per_s']:.0f} links/s)"
    )
    drawn = ", *.png" if plots else ""
    console.print(f"Wrote paths.parquet, {floor_plan.name}_Tx_*.csv, deepmimo_scenarios/{drawn} in {folder}")
    console.print(f"Next: cd {folder}; python -c \"import deepmimo; deepmimo.load('{result['deepmimo']}')\"")
