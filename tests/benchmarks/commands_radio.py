"""`python -m tests.benchmarks`, of radio: speed against error."""

import math
from pathlib import Path

from tyro.conf import OmitArgPrefixes, Positional

from robosim.commands.output import console, emit_result_file
from robosim.commands.shared_options import (
    ALL_CORES,
    THREADS,
    WorkOptions,
    output_folder,
    read,
    results_folder,
    resume_hint,
)
from robosim.support.checks import PLANS, SEED, check_number, check_some


def wireless(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    receivers: int = 400,
    workers: int | None = None,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure the radio tracer: links per second against errors, over outline tolerance, reflections, diffraction.

    Also growth with walls and receivers, latency of one link, and visibility against Embree. Rooms of up to 1e5
    triangles are traced in space: paths found over rays, and links per second over facets.

    Example: python -m tests.benchmarks wireless flat office --out out/wireless

    Args:
        plans: Floor plans, or folders of them.
        receivers: Receivers of each plan when settings are compared.
        workers: Most threads; one on each available core if not given.
        seed: Seed of the places of transmitters and receivers.
        out: Folder for the tables and the plot; a new one under runs/ if not given.
    """
    from robosim.plans.files import find_plans
    from tests.benchmarks.wireless import run

    check_some("plans", plans, PLANS)
    check_number("receivers", receivers, 1, 1_000_000, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    if workers is not None:
        check_number("workers", workers, *THREADS, whole=True)
    with results_folder(out, "bench wireless") as folder:
        found = [read(str(plan)) for plan in find_plans(plans)]
        console.print(
            run(found, out=folder, receivers=receivers, workers=workers, seed=seed, console=console)
        )
    emit_result_file(folder / "wireless.json")
    console.print(f"Wrote wireless.json, wireless.png and space.png in {folder}")


def storeys(
    building: Positional[Path | None] = None,
    *,
    receivers: int = 200,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure the radio tracer in a building of several storeys: links per second of CPU, and paths against space.

    Example: python -m tests.benchmarks storeys house.yaml --out out/storeys

    Args:
        building: YAML file of the storeys; three shipped villas over each other if not given.
        receivers: Receivers on each storey.
        seed: Seed of the places of transmitters and receivers.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.plans.storeys_file import read_storeys
    from tests.benchmarks.storeys import run, three_villas

    check_number("receivers", receivers, 1, 1_000_000, whole=True)
    check_number("seed", seed, *SEED, whole=True)
    with results_folder(out, "bench storeys") as folder:
        plan = three_villas() if building is None else read_storeys(building)
        console.print(run(plan, out=folder, receivers=receivers, seed=seed))
    emit_result_file(folder / "storeys.json")
    console.print(f"Wrote storeys.json in {folder}")


def labels(
    data: Positional[Path],
    plans: Positional[Path],
    *,
    work: OmitArgPrefixes[WorkOptions] = ALL_CORES,
    out: Path | None = None,
) -> None:
    """Compare traced link states and angles with the published ones of mmwRobotNav, and say how many agree.

    Goes on after a kill if given the same folder for its results, which do not depend on the number of workers.

    Example: python -m tests.benchmarks labels mmwRobotNav/data mmwRobotNav/maps --out out/labels

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with the buildings' top-down grids.
        work: Who does the work.
        out: Folder for the table and the maps; a new one under runs/ if not given.
    """
    from tests.benchmarks.labels import run

    folder = output_folder(out, "bench labels")
    console.print(f"Writing labels.json and maps of the worst buildings in {folder}")
    with resume_hint(folder):
        run(data, plans, workers=work.count, cluster=work.cluster, out=folder, console=console)
    emit_result_file(folder / "labels.json")


def edges(
    data: Positional[Path],
    plans: Positional[Path],
    *,
    transmitters: int = 4,
    out: Path | None = None,
) -> None:
    """Compare the strength of lone diffractions with the published data of mmwRobotNav, by one law after the other.

    Strengths are told by SNRs that saturate, so traced paths are received by the published receiver too; the offset is
    that of far links in line of sight. Seven seconds a transmitter.

    Example: python -m tests.benchmarks edges mmwRobotNav/data mmwRobotNav/maps --out out/edges

    Args:
        data: Folder with a folder of measurements for each building.
        plans: Folder with the buildings' top-down grids.
        transmitters: How many of each building, at most.
        out: Folder for the table and the figure; a new one under runs/ if not given.
    """
    from tests.benchmarks.edges import run

    check_number("transmitters", transmitters, 1, 1000, "of each building", whole=True)
    with results_folder(out, "bench edges") as folder:
        console.print(run(data, plans, transmitters=transmitters, out=folder, console=console))
    emit_result_file(folder / "edges.json")
    console.print(f"Wrote edges.json and edges.png in {folder}")


def scattering(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    links: int = 200,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure what rough walls change: power and link states of random links with and without scattering.

    Example: python -m tests.benchmarks scattering flat office --out out/scattering

    Args:
        plans: Floor plans, or folders of them.
        links: Links of each plan, in tens.
        seed: Seed of the places.
        out: Folder for the table; a new one under runs/ if not given.
    """
    from robosim.plans.files import find_plans
    from tests.benchmarks.scattering import run

    check_some("plans", plans, PLANS)
    check_number("links", links, 10, 100_000, "in each plan", whole=True)
    check_number("seed", seed, *SEED, whole=True)
    found = [read(str(plan)) for plan in find_plans(plans)]
    with results_folder(out, "bench scattering") as folder:
        console.print(run(found, links=links, seed=seed, out=folder, console=console))
    emit_result_file(folder / "scattering.json")
    console.print(f"Wrote scattering.json in {folder}")


def estimation(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    links: int = 2000,
    tolerance: float | None = None,
    workers: int | None = None,
    seed: int = 0,
    out: Path | None = None,
) -> None:
    """Measure sounding and path estimation: links per second against the error of the angle of arrival.

    Waveforms against their closed form, estimators against the Cramér-Rao bound and on traced plans.

    Example: python -m tests.benchmarks estimation flat office --out out/estimation

    Args:
        plans: Floor plans, or folders of them, that links are traced in.
        links: Links of each plan, and a quarter as many lone paths at each SNR.
        tolerance: How far walls may be moved to save corners [m]; left out, walls under staircases are
            straight, but for published grids; 0 keeps every cell.
        workers: Most threads; one on each available core if not given. Errors do not depend on it.
        seed: Seed of places, phases and noise.
        out: Folder for the tables and the plot; a new one under runs/ if not given.
    """
    from robosim.building.outline import check_tolerance
    from robosim.plans.files import find_plans
    from tests.benchmarks.arrivals import TX_PER_PLAN
    from tests.benchmarks.estimation import run

    check_some("plans", plans, PLANS)
    check_number("links", links, 4 * TX_PER_PLAN, 1_000_000, "in each plan", whole=True)
    check_tolerance(tolerance)
    check_number("seed", seed, *SEED, whole=True)
    if workers is not None:
        check_number("workers", workers, *THREADS, whole=True)
    found = [read(str(plan)) for plan in find_plans(plans)]
    with results_folder(out, "bench estimation") as folder:
        console.print(
            run(
                found,
                out=folder,
                links=links,
                tolerance_m=tolerance,
                workers=workers,
                seed=seed,
                console=console,
            )
        )
    emit_result_file(folder / "estimation.json")
    console.print(f"Wrote estimation.json and estimation.png in {folder}")


def positioning(
    paths: Positional[Path],
    *,
    turn_deg: float = 0.0,
    out: Path | None = None,
) -> None:
    """Find receivers and the transmitter of a real hall from measured radio paths, and compare with the truth.

    Line of sight and single bounces, directions at both ends and delays; the clocks need not agree. Two minutes for
    45 places.

    Example: python -m tests.benchmarks positioning paths.csv --turn-deg -1.6 --out out/positioning

    Args:
        paths: Table with a row for each path (.csv): place, tx_x_m, tx_y_m, tx_heading_rad, rx_x_m, rx_y_m,
            rx_heading_rad, range_m, aod_rad, aoa_rad.
        turn_deg: What the transmitter's heading in the table is corrected by [deg].
        out: Folder for the table and the plot; a new one under runs/ if not given.
    """
    from robosim.published.measured_paths import read_measured_paths
    from tests.benchmarks.positioning import run
    from wireless.positioning.single_bounce import PositioningConfig

    check_number("turn_deg", turn_deg, -360, 360, "degrees")
    hall = read_measured_paths(paths, math.radians(turn_deg))
    with results_folder(out, "bench positioning") as folder:
        console.print(run(hall, folder, PositioningConfig(), console))
    emit_result_file(folder / "positioning.json")
    console.print(f"Wrote the table and the plot in {folder}")
