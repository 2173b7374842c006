"""Files of the coverage of a grid: `coverage.parquet`, `coverage.npz` and `coverage.png`."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Float

from robosim.drawing.radio_pictures import plot_coverage
from robosim.radio.scene import RadioSite
from robosim.support.files import npz_bytes, whole_file, write_whole
from wireless.coverage import CoverageMap, ReceiverGrid
from wireless.motion.bodies import Bodies


def write_coverage(
    folder: Path,
    site: RadioSite,
    grid: ReceiverGrid,
    links: dict[str, np.ndarray],
    tx: Float[np.ndarray, "n_tx 3"],
    *,
    noise_dbm: float,
    bodies: Bodies | None = None,
    plots: bool,
) -> CoverageMap:
    """Write and return the map of the values of links from transmitters [m] (`wireless.coverage.link_values`)."""
    coverage = CoverageMap.from_links(
        links,
        grid,
        tx_position=tx,
        tx_power_dbm=np.full(len(tx), site.config.tx_power_dbm),
        noise_dbm=noise_dbm,
        frequency_hz=site.config.frequency_hz,
        coherent=False,
    )
    with whole_file(folder / "coverage.parquet") as partial:
        pq.write_table(coverage.to_table(), partial, compression="zstd")
    write_whole(folder / "coverage.npz", npz_bytes(coverage.to_arrays()))
    if plots:
        plot_coverage(folder / "coverage.png", site.section(grid), coverage, bodies)
    return coverage
