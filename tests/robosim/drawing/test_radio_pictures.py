"""Pictures of radio: what they draw, by the artists they are made of rather than by pixels."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import LineCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.quiver import Quiver
from PIL import Image

from robosim.building.building import make_building
from robosim.drawing.radio_pictures import (
    choose_link,
    conditions,
    draw_arrival,
    draw_power,
    draw_rays,
    draw_state,
    plot_grid,
)
from robosim.radio.receivers import receiver_grid
from robosim.support.colours import STATE_COLOURS, STATE_NAMES, css
from tests.plans import two_rooms
from wireless import LinkState, Tracer

TX = np.array([[0.7, 1.5, 1.5]])


@pytest.fixture(scope="module")
def building():
    return make_building(two_rooms(0.8))


@pytest.fixture(scope="module")
def grid(building):
    return receiver_grid(building, 0.3, 1.5)


@pytest.fixture(scope="module")
def paths(building, grid):
    return Tracer(building.mesh).trace(TX, grid.position)


@pytest.fixture
def axes():
    figure, axes = plt.subplots()
    yield axes
    plt.close(figure)


def first(paths):
    return paths.select(paths.rank == 0)


def cells(axes, grid):
    """Values in the picture, one for each receiver."""
    mesh = next(c for c in axes.collections if isinstance(c, QuadMesh))
    return np.ma.filled(mesh.get_array().reshape(grid.shape)[tuple(grid.cell.T)], np.nan), mesh


def labels(axes):
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_power_is_in_decibels_and_says_so(axes, building, grid, paths):
    """Friis at 28 GHz for each receiver in sight: 23 dBm - 20 log10(4 pi d / lambda), within 1e-9 dB."""
    draw_power(axes, building, grid, first(paths), TX[0], 23.0)
    values, mesh = cells(axes, grid)
    sight = paths.link_state()[0] == LinkState.LOS
    distance = np.linalg.norm(grid.position - TX[0], axis=1)
    friis = 23 - 20 * np.log10(4 * np.pi * distance * 28e9 / 299792458)
    assert 20 < sight.sum() < len(sight)
    assert values[sight] == pytest.approx(friis[sight], abs=1e-9)
    assert mesh.colorbar.ax.get_ylabel() == "received power [dBm], 23 dBm sent"
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    assert axes.get_aspect() == 1
    assert "transmitter" in labels(axes)


def test_titles_contain_frequency_and_heights(axes, building, grid, paths):
    """On every picture; heights of receivers from the lowest to the highest."""
    about = "28 GHz; transmitter 1.5 m, receivers 1.5 m high"
    for draw in (
        lambda: draw_power(axes, building, grid, first(paths), TX[0], 23.0),
        lambda: draw_arrival(axes, building, grid, first(paths), TX[0]),
        lambda: draw_state(axes, building, grid, paths.link_state()[0], TX[0], frequency_hz=28e9),
    ):
        draw()
        assert axes.get_title().splitlines()[1] == about
    draw_rays(axes, building, paths, 0, 3, 23.0)
    assert axes.get_title().splitlines()[1] == "28 GHz; transmitter 1.5 m, receiver 1.5 m high"
    assert conditions(5.2e9, TX[0], np.array([[0, 0, 0.4], [1, 1, 2.0]])) == (
        "5.2 GHz; transmitter 1.5 m, receivers 0.4 to 2 m high"
    )


def test_power_is_bright_where_it_is_strong(axes, building, grid, paths):
    """Luminance rises with power, of the floor and of rays (Rec. 709 weights on each map's 256 colours)."""
    draw_power(axes, building, grid, first(paths), TX[0], 23.0)
    draw_rays(axes, building, paths, 0, choose_link(paths, 0), 23.0)
    maps = [one.cmap for one in axes.collections if one.get_array() is not None]
    assert {type(one) for one in axes.collections if one.get_array() is not None} == {
        QuadMesh,
        LineCollection,
    }
    for cmap in maps:
        linear = cmap(np.linspace(0, 1, 256))[:, :3] ** 2.2
        assert (np.diff(linear @ (0.2126, 0.7152, 0.0722)) > -1e-3).all()


def test_states_have_their_colours_and_shares(axes, building, grid, paths):
    """The colour of each cell is the one that the legend gives its state; outage is left open."""
    state = paths.link_state()[0].copy()
    state[:7] = LinkState.OUTAGE
    draw_state(axes, building, grid, state, TX[0])
    values, mesh = cells(axes, grid)
    assert np.isnan(values[:7]).all()
    for one, name in STATE_NAMES.items():
        colour = css(STATE_COLOURS[one])
        share = 100 * (state == one).mean()
        if one == LinkState.OUTAGE or not share:
            continue
        assert f"{name} ({share:.0f} %)" in labels(axes)
        for value in values[state == one][:1]:
            assert to_hex(mesh.cmap(mesh.norm(value))) == colour.lower()
    assert f"outage ({700 / len(state):.0f} %)" in labels(axes)


def test_arrows_point_to_the_transmitter_where_it_is_in_sight(axes, building, grid, paths):
    """An arrow at a receiver in sight points to the transmitter, within 1e-9; black over white."""
    draw_arrival(axes, building, grid, first(paths), TX[0])
    white, black = (c for c in axes.collections if isinstance(c, Quiver))
    assert (white.U == black.U).all()
    at, arrow = np.column_stack([black.X, black.Y]), np.column_stack([black.U, black.V])
    state = {tuple(p): s for p, s in zip(grid.position[:, :2], paths.link_state()[0], strict=True)}
    sight = np.array([state[tuple(p)] == LinkState.LOS for p in at])
    assert sight.sum() > 10
    direction = TX[0, :2] - at[sight]
    assert arrow[sight] == pytest.approx(
        direction / np.linalg.norm(direction, axis=1, keepdims=True), abs=1e-9
    )
    _, mesh = cells(axes, grid)
    assert mesh.get_clim() == (-180, 180)
    assert np.array(mesh.cmap(0.0)) == pytest.approx(np.array(mesh.cmap(1.0)), abs=0.01)


def test_rays_go_from_the_transmitter_over_their_points_to_the_receiver(axes, building, paths):
    rx = choose_link(paths, 0)
    draw_rays(axes, building, paths, 0, rx, 23.0)
    link = paths.between(0, rx)
    rays = next(c for c in axes.collections if isinstance(c, LineCollection) and c.get_array() is not None)
    drawn = {len(segment): segment for segment in rays.get_segments()}
    assert len(rays.get_segments()) == len(link)
    assert rays.get_array()[-1] == pytest.approx(23 + link.power_db.max())
    for segment in drawn.values():
        assert segment[0] == pytest.approx(TX[0, :2])
        assert segment[-1] == pytest.approx(paths.rx_position[rx, :2])
    assert max(drawn) == link.order.max() + 2
    shown = np.concatenate(rays.get_segments())
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    assert west < shown[:, 0].min() and shown[:, 0].max() < east
    assert south < shown[:, 1].min() and shown[:, 1].max() < north
    assert {"transmitter", "receiver", "reflection", "diffraction"} <= set(labels(axes))


def test_the_link_chosen_is_out_of_sight_and_rich(paths):
    rx = choose_link(paths, 0)
    assert paths.link_state()[0, rx] != LinkState.LOS
    assert 2 * paths.count()[0, rx] >= paths.count()[0][paths.link_state()[0] != LinkState.LOS].max()


def test_pictures_are_drawn_of_nothing_too(building, grid, paths, tmp_path):
    """A transmitter without paths: five pictures, at least 500 pixels wide, and no error."""
    none = paths.select(np.zeros(len(paths), bool))
    files = plot_grid(
        tmp_path, "_tx1", building, grid, none, 0, tx_power_dbm=23.0, threshold_db=-np.inf, link=(none, 0, 0)
    )
    assert [file.name for file in files] == [
        f"{name}_tx1.png" for name in ("power", "state", "aoa", "rays", "overview")
    ]
    for file in files:
        with Image.open(file) as picture:
            assert picture.width > 500
