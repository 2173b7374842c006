"""Links of a building in the formats that others read: mmwRobotNav's CSV files and DeepMIMO v4 scenarios."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.radio_scene import RadioScene
from robosim.receivers import ReceiverGrid
from robosim.support.files import whole_file
from wireless.deepmimo_scenario import scenario_name, write_matrices, write_scenario
from wireless.estimated_csv import write_estimated_csv
from wireless.estimates import PathEstimates
from wireless.paths import Paths
from wireless.traced_csv import write_traced_csv

#: Folder below which `deepmimo.load` looks for scenarios.
SCENARIOS = "deepmimo_scenarios"


def write_csv(
    folder: Path,
    scene: RadioScene,
    grid: ReceiverGrid,
    paths: Paths,
    tx: int,
    estimates: PathEstimates | None = None,
) -> None:
    """`NAME_Tx_K.csv` with the traced paths of a transmitter, and `NAME_Tx_K_beam_search.csv` if there are estimates.

    Args:
        folder: Where to.
        scene: The building.
        grid: The receivers.
        paths: Paths of this transmitter, and perhaps of others.
        tx: Number of the transmitter, from 0.
        estimates: What a receiver makes out of its links, in the frame of the scene.
    """
    config, start = scene.config, f"{scene.building.plan.name}_Tx_{tx + 1}"
    with whole_file(folder / f"{start}.csv") as partial:
        write_traced_csv(
            partial,
            paths,
            tx,
            grid.cell,
            grid.shape,
            tx_power_dbm=config.tx_power_dbm,
            threshold_db=config.threshold_db,
        )
    if estimates is not None:
        state = paths.link_state(config.threshold_db)[tx]
        with whole_file(folder / f"{start}_beam_search.csv") as partial:
            write_estimated_csv(partial, estimates, grid.position, state, grid.cell, grid.shape)


def write_transmitters(folder: Path, name: str, senders: Float[np.ndarray, "n 3"]) -> None:
    """`NAME_tx_pos.csv`: where transmitters are."""
    with whole_file(folder / f"{name}_tx_pos.csv") as partial:
        rows = [f"{i},{x:.10g},{y:.10g},{z:.10g}" for i, (x, y, z) in enumerate(senders)]
        partial.write_text("\n".join([",x,y,z", *rows]) + "\n", encoding="ascii")


def deepmimo_folder(out: Path, name: str) -> Path:
    """Where the scenario of a building belongs."""
    return out / SCENARIOS / scenario_name(name)


def write_deepmimo_paths(folder: Path, scene: RadioScene, paths: Paths, tx: int) -> None:
    """Paths of a transmitter into the folder of a scenario."""
    folder.mkdir(parents=True, exist_ok=True)
    write_matrices(folder, paths, tx, horizontal=scene.config.tracer.polarisation == "horizontal")


def write_deepmimo_scene(folder: Path, scene: RadioScene, n_tx: int, n_rx: int, n_rx_active: int) -> None:
    """What a scenario has beside its paths, last of all: with it the scenario is complete."""
    write_scenario(
        folder,
        mesh=scene.building.mesh,
        materials=scene.building.materials,
        face_material=scene.face_material,
        frequency_hz=scene.config.frequency_hz,
        config=scene.config.tracer,
        n_tx=n_tx,
        n_rx=n_rx,
        n_rx_active=n_rx_active,
    )
