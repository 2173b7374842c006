"""`robosim trace` and `robosim dataset`."""

import json
from dataclasses import fields, replace
from functools import partial
from itertools import chain
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from rich.text import Text
from tyro.conf import FlagCreatePairsOff, OmitArgPrefixes, Positional

from robosim.commands.option_help import option_name
from robosim.commands.output import console, emit_result
from robosim.commands.shared_options import (
    ALL_CORES,
    DEFAULT_RADIO,
    DEFAULT_WAVEFORM,
    NO_OPTIONS,
    Box,
    OnePlace,
    PlanOptions,
    RadioOptions,
    Reading,
    WaveformOptions,
    Work,
    output_folder,
    read_place,
    read_storey,
    resume_hint,
)
from robosim.parts import EstimatorPart, MoverPart, TerminalPart
from robosim.support.checks import ADVANCED, SEED, Range
from robosim.support.installation import install_first
from robosim.support.reading import expanded
from wireless.bands import BANDS, BandName, check_bandwidth
from wireless.support.counting import counted

if TYPE_CHECKING:
    from robosim.movers.movers import MoversConfig
    from robosim.radio.scene import RadioSite
    from wireless.motion.bodies import Bodies
    from wireless.paths import Paths

#: Options of the radio that a scene decides itself.
PLAN_ONLY = ("material", "tolerance", "wall_thickness", "wall_gap", "floor_ceiling")
#: Default rate of impulse responses along a trajectory.
RATE_HZ = 100.0


def trace(
    plan: Positional[str],
    *,
    tx: Annotated[tuple[OnePlace, ...], tyro.conf.UseAppendAction] = (),
    grid: float | None = None,
    rx: Annotated[tuple[OnePlace, ...], tyro.conf.UseAppendAction] = (),
    along: Path | None = None,
    rate: Annotated[float, Range(1e-3, 1e6, "Hz"), ADVANCED] = RATE_HZ,
    people: Annotated[int, Range(0, 1000, "people"), ADVANCED] = 0,
    mover: Annotated[MoverPart, ADVANCED] = "none",
    seed: Annotated[int, SEED, ADVANCED] = 0,
    csi: str | None = None,
    tx_antenna: Annotated[str, ADVANCED] = "isotropic",
    rx_antenna: Annotated[str, ADVANCED] = "isotropic",
    tx_array: Annotated[str | None, ADVANCED] = None,
    rx_array: Annotated[str | None, ADVANCED] = None,
    bounds: Annotated[Box, ADVANCED] = None,
    storey: int | None = None,
    scene_material: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, ADVANCED] = (),
    inspect: FlagCreatePairsOff[bool] = False,
    polarisation: Literal["vertical", "horizontal", "both"] = "vertical",
    band: BandName = "28ghz",
    bandwidth_mhz: Annotated[float | None, Range(1e-3, 1e5, "MHz"), ADVANCED] = None,
    radio: OmitArgPrefixes[RadioOptions] = DEFAULT_RADIO,
    reading: Reading = NO_OPTIONS,
    plots: bool = True,
    work: Work = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Trace radio paths from transmitters to receivers all over a floor plan, or over a Mitsuba or Sionna RT scene.

    Writes the coverage of the cells of a grid, coverage.parquet, .npz and .png: power of all paths,
    link state, delay, spreads, SNR, SINR, best server; paths.parquet, a DeepMIMO v4 scenario (deepmimo_scenarios/),
    NAME_Tx_K.csv in the format of mmwRobotNav, and pictures of each transmitter: power, link state and direction of
    arrival of the strongest path, and the rays of one link. The same command resumes an interrupted run, with the same
    result. If receivers are given without a grid, only the links to them are traced. A scene needs a grid, receivers or
    a trajectory; all of its surfaces reflect, level ones too.

    Example: robosim trace office --tx 6.5,13 --grid 0.15 --out out/radio

    Example: robosim trace canyon.xml --tx -20,0,15 --tx 20,0,15 --grid 1 --out out/map

    Example: robosim trace canyon.xml --tx -20,0,15 --rx 30,2,1.5 --tx-array 8x4:3gpp --csi 64x312.5kHz

    Args:
        plan: Floor plan: one shipped, by name, or a ROS map (.yaml), image, mesh, .dxf, .svg, .ifc, .json, .npy; the
            .yaml of a building of several storeys; or a Mitsuba or Sionna RT scene (.xml).
        tx: Transmitter [m] in the plan's frame; can be given several times.
        grid: Step between receivers [m]; by default 0.15, or no grid with receivers (--rx). Over a scene, cells of this
            side at --height above its lowest point.
        rx: Receiver [m]; can be given several times. With a grid, the one whose rays are drawn.
        along: Trajectory of a receiver, a TUM file such as an episode's trajectory.tum: impulse responses along it are
            written to channel_tx1.npz, instead of paths.
        rate: Impulse responses per second, with --along.
        people: People who stand on the floor plan and attenuate paths, on the storey of the receivers.
        mover: Other movers, where they are at time 0: a recorded crowd (.csv or .parquet: time, id, x, y, heading),
            another robot's trajectory (.tum), a list of doors, crowds and trajectories (.yaml), or module:Name.
        seed: Seed of the places of people.
        csi: Subcarriers of frequency responses (channel state information): their number and spacing, such as
            64x312.5kHz. Writes csi_txK.npz and csi_txK.png for each transmitter.
        tx_antenna: Antenna of transmitters, for --csi and the coverage: patch, 3gpp, isotropic, dipole, or a pattern
            file (.msi, .pln, .csv), and its yaw, pitch (down) and roll [degrees], such as sector.msi,90,6. Paths and
            pictures of each transmitter stay those between isotropic antennas.
        rx_antenna: Antenna of receivers; likewise.
        tx_array: Array of transmitters, for --csi and the coverage: rows x columns of the antenna, half a wavelength
            apart, such as 8x4, 8x4:3gpp,90,6 with the antenna, or 8x4@0.7 with the distance in wavelengths.
        rx_array: Array of receivers; likewise.
        bounds: Box of a grid over a scene: lower-left and upper-right corner [m]; by default all of the scene.
        storey: Storey of the receivers, and of transmitters without a height, in a building of several storeys; by
            default 0, the lowest. Heights count from the lowest floor.
        scene_material: Material of a scene by its name there, instead of its own, such as paint=glass: a material of
            ITU-R P.2040, 0.1 m thick, a wall of layers or a .yaml file; can be given several times.
        inspect: Print what is read of a scene, and trace nothing: shapes, triangles, and the permittivity, conductivity
            and thickness of materials at the carrier frequency.
        polarisation: Polarisation of all antennas; both takes the mean.
        band: Radio band, which sets the defaults of carrier frequency, transmit power, bandwidth and losses.
        bandwidth_mhz: Bandwidth [MHz], whose noise SNR and SINR of the coverage have; by default that of the band.
        radio: Which paths are traced.
        reading: How to read the plan.
        plots: Whether to draw pictures.
        work: Worker processes.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    from robosim.commands.antenna_options import parse_antenna
    from robosim.datasets.csi import parse_csi, write_csi
    from robosim.datasets.standing import standing_bodies
    from robosim.datasets.trace import check_terminals, trace_along, trace_link, trace_plan
    from robosim.movers.movers import MoversConfig
    from robosim.radio.receivers import check_step
    from robosim.radio.scene import radio_site
    from wireless.tracing.mitsuba_scene import is_mitsuba, read_mitsuba

    config, movers = radio.config(polarisation), MoversConfig(people=people, mover=mover)
    file = expanded(plan)
    is_scene = is_mitsuba(file)
    materials = None
    if (scene_material or inspect) and not is_scene:
        raise ValueError(
            f"{plan} is a floor plan, but scene_material or inspect is for scenes. Leave it out."
        )
    if is_scene:
        from robosim.commands.scene_report import inspect_scene, scene_materials

        materials = scene_materials(scene_material)
        if inspect:
            return inspect_scene(file, materials, config.frequency_hz, allow_large=reading.allow_large)
    if not tx:
        raise ValueError(
            "tx is missing, expected a transmitter. Give --tx X,Y, which can be given several times."
        )
    if is_scene:
        _check_scene(plan, grid, rx, along, storey, radio, reading, movers)
    if not storey:  # heights of other floors are known when the plan is read
        check_terminals(tx, rx, config.height_m)
    if not is_scene:
        check_step(0.15 if grid is None else grid)
    _check_together(grid, rx, along, csi, movers, seed)
    alone = grid is None and len(rx) > 0
    antennas = (
        parse_antenna("tx", tx_antenna, tx_array, polarisation),
        parse_antenna("rx", rx_antenna, rx_array, polarisation),
    )
    is_plain = (tx_antenna, tx_array) == (rx_antenna, rx_array) == ("isotropic", None)
    if csi is None and (alone or along) and not is_plain:
        raise ValueError(
            "An antenna or array is given, which count with --csi or --grid only. Give --csi 64x312.5kHz."
        )
    for name, value in {"bounds": bounds, "bandwidth_mhz": bandwidth_mhz}.items():
        if value is not None and (alone or along):
            raise ValueError(f"{name} is given without a grid. Give --grid 1, or leave it out.")
    if along is None and rate != RATE_HZ:
        raise ValueError(f"rate is {rate:g}, which samples a trajectory. Give --along, or leave it out.")
    if along is not None and config.threshold_dbm is not None:
        raise ValueError(
            "threshold_dbm is given with along, but impulse responses have no link states. Leave it out."
        )
    noise = BANDS[band].sounding
    if bandwidth_mhz is not None:
        noise = replace(noise, bandwidth_mhz=bandwidth_mhz)
    check_bandwidth(noise.bandwidth_mhz, config.frequency_hz)
    offsets = None if csi is None else parse_csi(csi, config.frequency_hz)
    folder = output_folder(out, "trace --along" if along else "trace --rx" if alone else "trace")
    with console.status("reading the scene ..." if is_scene else "reading the plan ..."):
        place = (
            read_mitsuba(file, materials, allow_large=reading.allow_large)
            if is_scene
            else read_storey(plan, storey, reading)
        )
    if along is not None:
        site = radio_site(place, config)
        samples = trace_along(site, folder, tx=tx, trajectory=along, rate_hz=rate, console=console)
        emit_result({"plan": site.name, "tx_m": tx, "samples": samples}, folder)
        console.print(f"{counted(samples, 'impulse response')} from {counted(len(tx), 'transmitter')}")
        console.print(f"Wrote channel_{_numbers(len(tx))}.npz in {folder}")
        return
    if alone:
        site = radio_site(place, config)
        bodies = standing_bodies(site, movers, seed)
        paths = trace_link(site, folder, tx=tx, rx=rx, bodies=bodies, plots=plots, console=console)
        if offsets is not None:
            write_csi(folder, offsets, antennas, len(tx), rx=None, plots=plots)
            console.print(f"Wrote csi_{_numbers(len(tx))}.npz in {folder}")
        _report_links(site, paths, folder, bodies, plots=plots)
        return
    with resume_hint(folder):
        result = trace_plan(
            place,
            config,
            folder,
            tx=tx,
            grid_m=0.15 if grid is None else grid,
            bounds_m=bounds,
            rx=rx[0] if rx else None,
            noise_dbm=noise.noise_dbm,
            antennas=antennas,
            bodies=standing_bodies(radio_site(place, config), movers, seed) if movers.any else None,
            plots=plots,
            workers=work.count,
            cluster=work.cluster,
            console=console,
        )
        if offsets is not None:
            write_csi(folder, offsets, antennas, len(tx), rx=rx[0] if rx else None, plots=plots)
    _report_map(result, folder, ("" if csi is None else ", csi_tx*.npz") + (", *.png" if plots else ""))


def _numbers(n_tx: int) -> str:
    """The transmitters as in names of files."""
    return "tx1" if n_tx == 1 else f"tx1 to tx{n_tx}"


def _check_scene(
    scene: str,
    grid: float | None,
    rx: tuple[tuple[float, ...], ...],
    along: Path | None,
    storey: int | None,
    radio: RadioOptions,
    reading: PlanOptions,
    movers: "MoversConfig",
) -> None:
    """Raise ValueError for options that a scene has no use for, and if it is given no receiver and no grid."""
    mover = None if movers.mover == "none" else movers.mover
    options: dict[str, Any] = {"storey": storey, "people": movers.people or None, "mover": mover}
    options |= {
        name: getattr(radio, name)
        for name in PLAN_ONLY
        if getattr(radio, name) != getattr(DEFAULT_RADIO, name)
    }
    options |= {
        option_name(field.name, field.type)[2:]: getattr(reading, field.name)
        for field in fields(reading)
        if getattr(reading, field.name) != field.default and field.name != "allow_large"
    }
    for name, value in options.items():
        if value is not None:
            raise ValueError(
                f"{scene}: --{name.replace('_', '-')} is {value}, which is for floor plans, and this is a Mitsuba "
                "scene. Leave the option out."
            )
    if not rx and along is None and grid is None:
        raise ValueError(
            f"{scene}: a Mitsuba scene needs receivers. Give --grid 1 for a map, --rx X,Y,Z, which can be given "
            "several times, or --along."
        )


def _check_together(
    grid: float | None,
    rx: tuple[OnePlace, ...],
    along: Path | None,
    csi: str | None,
    movers: "MoversConfig",
    seed: int,
) -> None:
    """Raise ValueError for options that contradict each other."""
    if along is not None and (grid is not None or rx or csi is not None):
        raise ValueError(
            "along is given with grid, rx or csi: give either a trajectory or places of receivers."
        )
    if movers.any and along is not None:
        raise ValueError(
            "people or mover is given with along, but they count with --grid and --rx only. Leave it out."
        )
    if seed and not movers.any:
        raise ValueError(f"seed is {seed}, which places people. Give --people 5, or leave it out.")
    if grid is not None and len(rx) > 1:
        raise ValueError(
            f"rx is given {len(rx)} times with grid, which has receivers. Give one, to draw its rays."
        )


def _report_map(result: dict[str, Any], folder: Path, more: str) -> None:
    """Print the states and the speed of a traced grid, and the command's result; `more` names further files."""
    emit_result(result, folder)
    timing, states = result["timing"], result["states"]
    shown = {name: n for name, n in states.items() if n or name != "obstructed_los"}
    shares = ", ".join(f"{name} {100 * n / result['links']:.1f} %" for name, n in shown.items())
    speed = f"{timing['traced']} traced in {timing['seconds']:.1f} s ({timing['links_per_s']:.0f} links/s)"
    console.print(Text.assemble((counted(result["links"], "link"), "bold"), f": {shares}; {speed}"))
    files = "coverage.parquet, coverage.npz, paths.parquet, "
    files += f"{result['plan']}_Tx_*.csv, deepmimo_scenarios/"
    console.print(f"Wrote {files}{more} in {folder}")
    load = f"import deepmimo; deepmimo.load('{result['deepmimo']}')"
    where = f"{install_first('deepmimo')}cd {quote(str(folder))}"
    console.print(f'Next: {where}; python -c "{load}"', soft_wrap=True)


def _report_links(
    site: "RadioSite", paths: "Paths", folder: Path, bodies: "Bodies | None", *, plots: bool
) -> None:
    """What the traced links have, on the terminal and as the command's result."""
    from robosim.datasets.standing import bodies_dict
    from wireless.paths import LinkCategory

    categories = paths.link_category(site.config.threshold_db)
    states = [[LinkCategory(category).name.lower() for category in row] for row in categories]
    n_rx = len(paths.rx_position)
    result = {
        "plan": site.name,
        "tx_m": paths.tx_position,
        "rx_m": paths.rx_position[0] if n_rx == 1 else paths.rx_position,
        "paths": len(paths),
        "states": [row[0] for row in states] if n_rx == 1 else states,
        **bodies_dict(bodies),
    }
    emit_result(result, folder)
    sources = counted(len(paths.tx_position), "transmitter")
    receivers = "the receiver" if n_rx == 1 else counted(n_rx, "receiver")
    console.print(f"{counted(len(paths), 'path')} from {sources} to {receivers}")
    pictures = f" and rays_{_numbers(len(paths.tx_position))}.png" if plots else ""
    console.print(f"Wrote paths.parquet{pictures} in {folder}")


def dataset(
    plans: Positional[tuple[str, ...]] = (),
    *,
    generated: Annotated[int, Range(0, 100_000, "homes")] = 0,
    tx_per_plan: int = 10,
    grid: float = 0.15,
    seed: int = 0,
    estimator: EstimatorPart = "sage",
    transmitter: TerminalPart = "gnb",
    receiver: TerminalPart = "ue",
    band: BandName = "28ghz",
    headings: Literal["fixed", "random"] = "fixed",
    people: int = 0,
    format: Annotated[tuple[Literal["mmwrobotnav", "deepmimo"], ...], tyro.conf.UseAppendAction] = (),
    radio: OmitArgPrefixes[RadioOptions] = DEFAULT_RADIO,
    waveform: Annotated[OmitArgPrefixes[WaveformOptions], ADVANCED] = DEFAULT_WAVEFORM,
    reading: Reading = NO_OPTIONS,
    work: Work = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Make a data set of links: true paths, link states, and what a receiver with beams estimates of them.

    Transmitters are placed at random, receivers on a grid. Links are traced, sounded in closed form with the antennas
    of the band, by default the reference's base station and robot, and estimated. Writes links/NAME_Tx_K.parquet, one
    row per link, and manifest.json, which describes them. The same command resumes an interrupted run, to the same
    bytes with any number of workers.

    Example: robosim dataset flat office --tx-per-plan 10 --grid 0.15 --out out/links

    Args:
        plans: Floor plans, or folders of them, or YAML files of buildings of several storeys.
        generated: Additional generated homes, from --seed on.
        tx_per_plan: Transmitters in each building.
        grid: Step between receivers [m].
        seed: Seed of places, phases and noise, and of the first generated home.
        estimator: Path estimator: sage, maximum likelihood of all paths together, or pca, the reference's, faster and
            less accurate.
        transmitter: Antennas of the transmitter; gnb are those of the published base station, tag is a dipole.
        receiver: Antennas of the receiver; ue are those of the published robot, ring-8 is a ring of dipoles.
        band: Radio band, which sets the defaults of carrier frequency, transmit power, waveform and antennas.
        headings: Headings of receivers: fixed, as published, or random, as of a moving robot.
        people: Mean number of people in each building, at random places for each link, who weaken its paths. States
            stay those of the building.
        format: Additional formats: CSV files of mmwRobotNav or DeepMIMO v4 scenarios; can be given several times.
        radio: Which paths are traced.
        waveform: How links are sounded.
        reading: How to read the plans.
        work: Worker processes.
        out: Output folder, also of a run to resume; by default a new one under runs/.
    """
    from robosim.datasets.link_units import LinkSetConfig
    from robosim.datasets.links import make_dataset
    from robosim.generator.generate import generate_plan
    from robosim.plans.files import find_plans

    if not plans and not generated:
        raise ValueError("plans is empty and generated is 0: give floor plans, folders or --generated 50.")
    config = LinkSetConfig(
        tx_per_plan=tx_per_plan,
        grid_m=grid,
        seed=seed,
        estimator=estimator,
        tx=transmitter,
        rx=receiver,
        headings=headings,
        people=people,
        formats=tuple(sorted(set(format))),
        radio=radio.config(),
        sounding=waveform.config(),
    )
    folder = output_folder(out, "dataset")
    buildings = chain(
        (read_place(str(plan), reading) for plan in find_plans(plans)),
        (partial(generate_plan, number) for number in range(seed, seed + generated)),
    )
    with resume_hint(folder):
        made = make_dataset(
            buildings, config, folder, workers=work.count, cluster=work.cluster, console=console
        )
    emit_result(made, folder)
    rows, timing = made["rows"], made["timing"]
    shares = ", ".join(f"{name} {100 * n / rows:.1f} %" for name, n in made["states"].items())
    details = f": {shares}; {timing['links']} made in {timing['seconds']:.1f} s ({timing['links_per_s']:.0f} links/s)"
    console.print(Text.assemble((counted(rows, "link"), "bold"), details))
    console.print(
        f"Wrote {counted(made['units'], 'table')} in {folder / 'links'}, and manifest.json, which describes them"
    )
    read_all = f"import pyarrow.parquet as p; print(p.read_table({json.dumps(str(folder / 'links'))}))"
    console.print(f"Next: python -c {quote(read_all)}", soft_wrap=True)
