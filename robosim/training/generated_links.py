"""Links of generated homes with the tracer and receiver of the public ones: additional training buildings.

A classifier overfits to a dozen public buildings. Each generated home gets a few transmitters, and some receivers of
the published grid at random places. Paths and powers are those of the published ray tracer
(`robosim.training.label_links`), received by the published receiver (`wireless.estimation.public`). A home is one
file, which depends only on its seed.
"""

from functools import cache
from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float32, UInt8
from rich.console import Console

from robosim.building.building import make_building
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.radio.receivers import receiver_grid
from robosim.support.arrays_in import Array, read_npz
from robosim.support.files import npz_bytes, write_whole
from robosim.support.progress import unit_progress
from robosim.support.reading import reading
from robosim.support.workers import Workers
from robosim.training.label_links import TRACER, published_mesh, published_paths
from wireless.estimation.public import PublicReceiver
from wireless.formats.mmwrobotnav_measurements import link_states
from wireless.linkstate.tokens import make_tokens
from wireless.paths import LinkState
from wireless.sounding.sounder import Rays
from wireless.tracing.tracer import Tracer

#: Transmitters of a home, receivers of each, grid [m] and height of both [m].
TRANSMITTERS, RECEIVERS, GRID_M, HEIGHT_M = 3, 260, 0.15, 1.5
#: Least distance of a transmitter from walls [m], as in public data; a few receivers are behind a wall.
TX_CLEARANCE_M = 0.04
#: Seed of the first home, far from usual seeds.
FIRST_SEED = 1_000_220

_ARRAYS = {"tokens": Array("f4", "n 5 5"), "state": Array("u1", "n")}
#: Estimated paths and states of links.
HomeLinks = tuple[Float32[np.ndarray, "n 5 5"], UInt8[np.ndarray, " n"]]


def generate_homes(
    count: int, folder: Path, *, workers: int, cluster: str | None = None, console: Console
) -> None:
    """Write missing files of the first homes with worker processes, or with those of a dask scheduler.

    Raises:
        WorkerLost: If a process was killed, after the other homes are written.
    """
    missing = [seed for seed in _seeds(count) if not _file(folder, seed).exists()]
    if not missing:
        return
    with (
        Workers(min(workers, len(missing)), cluster, what="homes") as pool,
        unit_progress(console, "generated homes", count, count - len(missing)) as advance,
    ):
        for number, content in pool.run(_home_file, [(seed,) for seed in missing]):
            write_whole(_file(folder, missing[number]), content)
            advance("")


def read_homes(count: int, folder: Path) -> HomeLinks:
    """Links of the first homes, in the order of their seeds."""
    tokens, states = [], []
    for seed in _seeds(count):
        with reading(_file(folder, seed), "links of a generated home", "Delete it to make it again.") as file:
            arrays = read_npz(file, _ARRAYS)
            if not np.isin(arrays["state"], list(LinkState)).all():
                raise ValueError("an unknown link state")
        tokens.append(arrays["tokens"])
        states.append(arrays["state"])
    return np.concatenate(tokens), np.concatenate(states)


def generate_home(seed: int) -> HomeLinks:
    """Links with paths of one home."""
    rng = np.random.default_rng(seed)
    building = make_building(generate_plan(seed, config=GeneratorConfig(navigable=True)))
    tracer = Tracer(published_mesh(building.plan, building.height_m), config=TRACER)
    grid = receiver_grid(building, GRID_M, HEIGHT_M)
    inside = building.free.buffer(-TX_CLEARANCE_M)
    places = grid.position[shapely.contains_xy(inside, grid.position[:, 0], grid.position[:, 1])]
    tokens, states = [], []
    for _ in range(TRANSMITTERS):
        tx = places[rng.integers(len(places))]
        chosen = np.sort(rng.permutation(len(grid.position))[:RECEIVERS])
        # Published rows count from 1 at the top.
        cell = np.array([grid.shape[0], 1]) + grid.cell[chosen] * (-1, 1)
        paths = published_paths(tx, grid.position[chosen], cell, tracer)
        state = link_states(paths)[0]
        aoa, aod, snr, peak = _receiver().receive(Rays.from_paths(paths), rng)
        has_paths = state != LinkState.OUTAGE
        tokens.append(make_tokens(aoa, snr, aod_rad=aod, peak=peak)[has_paths])
        states.append(state[has_paths])
    return np.concatenate(tokens), np.concatenate(states)


def _home_file(seed: int) -> bytes:
    tokens, state = generate_home(seed)
    return npz_bytes({"tokens": tokens, "state": state}, compressed=False)


@cache
def _receiver() -> PublicReceiver:
    return PublicReceiver()


def _seeds(count: int) -> range:
    return range(FIRST_SEED, FIRST_SEED + count)


def _file(folder: Path, seed: int) -> Path:
    return folder / f"home-{seed}.npz"
