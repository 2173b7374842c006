"""Files of the coverage of a grid: `coverage.parquet`, `coverage.npz`, `coverage.tif` and `coverage.png`.

`coverage.tif` is a GeoTIFF with a page for each quantity of the best server, in 32-bit floats, rows from the top, NaN
where nothing arrives. Its frame is local, in metres: that of the plan or the scene.
Reference: OGC 19-008r4, GeoTIFF 1.1.
"""

import io
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from jaxtyping import Float
from PIL import Image, TiffImagePlugin

from robosim.drawing.radio_pictures import plot_coverage
from robosim.radio.scene import RadioSite
from robosim.support.files import npz_bytes, whole_file, write_whole
from wireless.coverage import CoverageMap, ReceiverGrid
from wireless.motion.bodies import Bodies

#: Pages of the GeoTIFF after the power and the number of the best server.
_QUANTITIES = ("snr_db", "sinr_db", "delay_s", "delay_spread_s")
#: Numbers of tags: ImageDescription, ModelPixelScale, ModelTiepoint, ModelTransformation, GeoKeyDirectory, GDAL_NODATA;
#: and types of their values.
_NAME, _SCALE, _TIEPOINT, _TRANSFORM, _KEYS, _NO_DATA = 270, 33550, 33922, 34264, 34735, 42113
_SHORT, _DOUBLE = 3, 12
#: Keys of a model of the user's own, pixels that are areas, and metres.
_LOCAL = (1, 1, 0, 3, 1024, 0, 1, 32767, 1025, 0, 1, 1, 3076, 0, 1, 9001)
#: Plans that are turned by less are not turned [m per cell].
_UPRIGHT_M = 1e-9


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
    write_whole(folder / "coverage.tif", _geotiff(coverage))
    if plots:
        plot_coverage(folder / "coverage.png", site.section(grid), coverage, bodies)
    return coverage


def _geotiff(coverage: CoverageMap) -> bytes:
    """Content of a GeoTIFF with a page for each quantity."""
    server = coverage.best_server
    pages = {
        "power_dbm": coverage.best("power_dbm"),
        "best_server": np.where(server < 0, np.nan, server + 1.0),
    }
    pages |= {name: coverage.best(name) for name in _QUANTITIES}
    corner, content = coverage.edges[-1, 0], io.BytesIO()
    right = (coverage.edges[-1, -1] - corner) / server.shape[1]
    down = (coverage.edges[0, 0] - corner) / server.shape[0]
    (a, d), (b, e), (x, y) = right, down, corner
    place = {_SCALE: (a, -e, 0.0), _TIEPOINT: (0.0, 0.0, 0.0, x, y, 0.0)}
    if max(abs(b), abs(d)) > _UPRIGHT_M:
        place = {_TRANSFORM: (a, b, 0.0, x, d, e, 0.0, y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)}
    with TiffImagePlugin.AppendingTiffWriter(content) as writer:
        for name, values in pages.items():
            tags = TiffImagePlugin.ImageFileDirectory_v2()
            for number, value in {**place, _KEYS: _LOCAL}.items():
                tags.tagtype[number], tags[number] = _SHORT if number == _KEYS else _DOUBLE, value
            tags[_NAME], tags[_NO_DATA] = name, "nan"
            image = Image.fromarray(np.ascontiguousarray(values[::-1], np.float32))
            image.save(writer, format="TIFF", tiffinfo=tags, compression="tiff_adobe_deflate")
            writer.newFrame()
    return content.getvalue()
