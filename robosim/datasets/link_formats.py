"""Links of a building in formats of others: CSV files of mmwRobotNav and DeepMIMO v4 scenarios."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robosim.radio.receivers import ReceiverGrid
from robosim.radio.scene import RadioScene
from wireless.estimates import PathEstimates
from wireless.formats.deepmimo_scenario import scenario_name, scene_files, transmitter_files
from wireless.formats.mmwrobotnav_csv import estimated_csv, traced_csv
from wireless.paths import Paths

#: Folder below which `deepmimo.load` looks for scenarios.
SCENARIOS = "deepmimo_scenarios"
#: Contents of files by their names.
Files = dict[str, bytes]


def csv_files(
    scene: RadioScene, grid: ReceiverGrid, paths: Paths, tx: int, estimates: PathEstimates | None = None
) -> Files:
    """`NAME_Tx_K.csv` with traced paths of a transmitter, and `NAME_Tx_K_beam_search.csv` with its estimates."""
    config, start = scene.config, f"{scene.building.plan.name}_Tx_{tx + 1}"
    power = {"tx_power_dbm": config.tx_power_dbm, "threshold_db": config.threshold_db}
    files = {f"{start}.csv": traced_csv(paths, tx, grid.cell, grid.shape, **power)}
    if estimates is not None:
        state = paths.link_state(config.threshold_db)[tx]
        content = estimated_csv(estimates, grid.position, state, grid.cell, grid.shape)
        files[f"{start}_beam_search.csv"] = content
    return files


def transmitters_file(name: str, transmitters: Float[np.ndarray, "n 3"]) -> Files:
    """`NAME_tx_pos.csv`, the places of transmitters [m]."""
    rows = [f"{i},{x:.10g},{y:.10g},{z:.10g}" for i, (x, y, z) in enumerate(transmitters)]
    return {f"{name}_tx_pos.csv": ("\n".join([",x,y,z", *rows]) + "\n").encode("ascii")}


def deepmimo_folder(out: Path, name: str) -> Path:
    """Folder of the scenario of a building."""
    return out / SCENARIOS / scenario_name(name)


def deepmimo_paths(scene: RadioScene, paths: Paths, tx: int) -> Files:
    """Files of a transmitter in a scenario."""
    return transmitter_files(paths, tx, horizontal=scene.config.tracer.polarisation == "horizontal")


def deepmimo_scene(scene: RadioScene, n_tx: int, n_rx: int, n_rx_active: int) -> Files:
    """The other files of a scenario, which are written last: they complete it."""
    return scene_files(
        mesh=scene.whole.mesh,
        materials=scene.whole.materials,
        face_material=scene.face_material,
        frequency_hz=scene.config.frequency_hz,
        config=scene.config.tracer,
        n_tx=n_tx,
        n_rx=n_rx,
        n_rx_active=n_rx_active,
    )
