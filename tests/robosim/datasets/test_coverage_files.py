"""GeoTIFF of a coverage map: tags and pages, upright and turned, against the places of its cells."""

import io

import numpy as np
import pytest
from PIL import Image

from robosim.datasets.coverage_files import _geotiff
from wireless.coverage import CellState, CoverageMap, ReceiverGrid

ROWS, COLUMNS, CELL_M = 3, 4, 0.5


def coverage_of(yaw):
    """Two transmitters over a grid of 3 x 4 cells, turned about (10, -3), whose first cell nothing reaches."""
    x, y = np.meshgrid(np.arange(COLUMNS + 1) * CELL_M, np.arange(ROWS + 1) * CELL_M)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    edges = np.dstack([x, y]) @ turn.T + [10.0, -3.0]
    cell = np.argwhere(np.ones((ROWS, COLUMNS), bool))
    middle = ((edges[:-1, :-1] + edges[1:, 1:]) / 2).reshape(-1, 2)
    grid = ReceiverGrid(
        position=np.column_stack([middle, np.full(len(cell), 1.5)]),
        cell=cell,
        shape=(ROWS, COLUMNS),
        edges=edges,
        unreached=np.full((ROWS, COLUMNS), CellState.NO_PATH, np.uint8),
    )
    gain = np.array([np.arange(12), np.arange(12)[::-1]]) * 1e-9
    gain[:, 0] = 0
    links = {
        name: np.ones((2, 12))
        for name in ("delay_s", "delay_spread_s", "aoa_az_spread_rad", "aod_az_spread_rad")
    }
    return CoverageMap.from_links(
        {**links, "gain": gain, "category": np.ones((2, 12), np.uint8)},
        grid,
        tx_position=np.zeros((2, 3)),
        tx_power_dbm=np.full(2, 20.0),
        noise_dbm=-90.0,
        frequency_hz=28e9,
        coherent=False,
    )


def test_geotiff_has_a_page_for_each_quantity_from_the_top():
    coverage = coverage_of(0.0)
    with Image.open(io.BytesIO(_geotiff(coverage))) as image:
        pages = {}
        for number in range(image.n_frames):
            image.seek(number)
            assert image.mode == "F" and image.size == (COLUMNS, ROWS)
            pages[image.tag_v2[270]] = np.array(image)
    assert list(pages) == ["power_dbm", "best_server", "snr_db", "sinr_db", "delay_s", "delay_spread_s"]
    np.testing.assert_array_equal(pages["power_dbm"], coverage.best("power_dbm")[::-1].astype(np.float32))
    # The first cell is at the lower left; the first six receive most of the second transmitter.
    assert np.isnan(pages["power_dbm"][-1, 0]) and np.isnan(pages["best_server"][-1, 0])
    assert pages["best_server"][0].tolist() == [1, 1, 1, 1] and pages["best_server"][-1, 1:].tolist() == [
        2,
        2,
        2,
    ]
    assert pages["power_dbm"][0, -1] == pytest.approx(20 + 10 * np.log10(11e-9))


def test_geotiff_has_the_place_of_an_upright_grid():
    """The upper left corner is (10, -1.5), cells are 0.5 m wide and high; metres, areas, no place on Earth."""
    with Image.open(io.BytesIO(_geotiff(coverage_of(0.0)))) as image:
        for number in range(image.n_frames):
            image.seek(number)
            tags = image.tag_v2
            assert tags[33550] == (0.5, 0.5, 0.0)
            assert tags[33922] == (0.0, 0.0, 0.0, 10.0, -1.5, 0.0)
            assert tags[34735] == (1, 1, 0, 3, 1024, 0, 1, 32767, 1025, 0, 1, 1, 3076, 0, 1, 9001)
            assert tags[42113] == "nan" and 34264 not in tags


def test_geotiff_has_the_place_of_a_turned_grid():
    """The transformation takes columns and rows to the middles of the cells."""
    coverage = coverage_of(0.6)
    with Image.open(io.BytesIO(_geotiff(coverage))) as image:
        matrix = np.reshape(image.tag_v2[34264], (4, 4))
        assert 33550 not in image.tag_v2 and 33922 not in image.tag_v2
    row, column = np.indices((ROWS, COLUMNS)) + 0.5
    place = np.stack([column, row, 0 * row, 0 * row + 1], axis=-1) @ matrix.T
    np.testing.assert_allclose(place[::-1, :, :2], coverage.position[..., :2], atol=1e-12)
