"""Columns of paths: states by definition, order, and files that lose nothing."""

from dataclasses import fields

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer, TracerConfig


def made_of(links):
    """Paths whose links have (order, power in dB) each, on one transmitter."""
    rx = np.repeat(np.arange(len(links)), [len(link) for link in links])
    order, power_db = np.array([path for link in links for path in link], float).reshape(-1, 2).T
    n = len(rx)
    return Paths(
        tx_position=np.zeros((1, 3)),
        rx_position=np.ones((len(links), 3)),
        frequency_hz=28e9,
        tx=np.zeros(n, int),
        rx=rx,
        gain=np.zeros((n, 2, 2), complex),
        power=10 ** (power_db / 10),
        **{name: np.zeros(n) for name in ("delay_s", "aoa_az", "aoa_el", "aod_az", "aod_el")},
        order=order.astype(np.uint8),
        interaction=np.zeros((n, 3), np.uint8),
        primitive=np.full((n, 3), -1),
        point=np.zeros((n, 3, 3)),
    )


def test_link_states_are_those_of_the_reference():
    """Strongest direct: LOS. Else any with one interaction: first. Else any: higher. None above: outage."""
    paths = made_of(
        [
            [(0, -60), (1, -70)],
            [(1, -60), (0, -70)],  # a direct path that is not the strongest makes no LOS
            [(2, -80), (1, -95), (3, -96)],
            [(2, -80), (2, -81)],
            [],
            [(0, -120)],
        ]
    )
    outage, los, first, higher = LinkState
    assert paths.link_state().tolist() == [[los, first, first, higher, outage, los]]
    assert paths.link_state(-90.0).tolist() == [[los, first, higher, higher, outage, outage]]
    assert paths.strongest().order.tolist() == [0, 1, 2, 2, 0]
    assert paths.count().tolist() == [[2, 2, 3, 2, 0, 1]]


@pytest.fixture(scope="module")
def traced(extruded, ring):
    mesh = extruded(np.concatenate([ring((0, 0), (6, 0), (6, 4), (0, 4)), ring((2, 1), (3, 1), (3, 2))]))
    tx, rx = (
        np.array([[1.0, 1.4, 1.5], [4.0, 3.1, 1.2]]),
        np.array([[5.0, 0.9, 1.5], [2.5, 1.2, 2.0], [1, 3, 1]]),
    )
    return Tracer(mesh, config=TracerConfig(max_paths=12)).trace(tx, rx)


def test_paths_are_sorted_and_bounded(traced):
    """By transmitter, receiver and falling power; at most as many per link as configured."""
    assert np.all(np.diff(traced.link) >= 0) and traced.count().max() == 12
    assert np.all(np.diff(traced.power)[np.diff(traced.link) == 0] <= 0)


def test_points_make_up_the_delay_and_the_angles(traced):
    """Legs between the listed points add up to c times the delay, and the outer ones point as angles say."""
    for i in range(len(traced)):
        n = traced.order[i]
        ends = traced.tx_position[traced.tx[i]], traced.rx_position[traced.rx[i]]
        points = np.array([ends[0], *traced.point[i, :n], ends[1]])
        legs = np.diff(points, axis=0)
        assert abs(np.linalg.norm(legs, axis=1).sum() - traced.delay_s[i] * 299792458.0) < 1e-9
        assert np.isnan(traced.point[i, n:]).all() and (traced.primitive[i, n:] == -1).all()
        assert abs(np.arctan2(legs[0, 1], legs[0, 0]) - traced.aod_az[i]) < 1e-9
        assert abs(np.arctan2(-legs[-1, 1], -legs[-1, 0]) - traced.aoa_az[i]) < 1e-9


def test_doppler_shift_is_the_rate_of_the_delay(extruded, ring):
    """Both ends move: central differences of delays traced in the moved scene, 1e-6 relative, also round edges."""
    mesh = extruded(np.concatenate([ring((0, 0), (6, 0), (6, 4), (0, 4)), ring((2, 1), (3, 1), (3, 2))]))
    tracer = Tracer(mesh, config=TracerConfig(floor_ceiling=False))
    tx, rx = np.array([[1.0, 1.4, 1.5], [4.0, 3.1, 1.2]]), np.array([[5.0, 0.9, 1.5], [2.5, 1.2, 2.0]])
    v_tx, v_rx, step_s = np.array([0.4, -0.3, 0.1]), np.array([[-0.5, 0.7, 0.0], [0.2, 0.9, -0.2]]), 2e-5
    now, before, after = (tracer.trace(tx + v_tx * t, rx + v_rx * t) for t in (0.0, -step_s, step_s))
    for link in np.unique(now.link):
        here, then, later = (paths.select(paths.link == link) for paths in (now, before, after))
        same = (here.digits == then.digits) & (here.digits == later.digits) & (here.order > 0)
        same &= (here.primitive == then.primitive).all(axis=1) & (here.primitive == later.primitive).all(
            axis=1
        )
        assert same.sum() > 10 and (here.interaction[same] == 2).any()
        rate = (later.delay_s - then.delay_s) / (2 * step_s)
        shift = here.doppler_hz(tx_velocity=v_tx, rx_velocity=v_rx)
        np.testing.assert_allclose(shift[same], -28e9 * rate[same], rtol=1e-6, atol=1e-4)
    assert (now.doppler_hz() == 0).all()
    for velocity in (1.0, [[1.0], [2.0]], np.zeros((3, 3)), [np.nan, 0.0, 0.0]):
        with pytest.raises(
            ValueError, match=r"rx_velocity has shape .*, expected \(3,\) or \(2, 3\), finite"
        ):
            now.doppler_hz(rx_velocity=velocity)


def test_between_rejects_links_that_are_not_there(traced):
    """A number beyond the last terminal, or before the first, names no outage."""
    for tx, rx, name in ((0, len(traced.rx_position), "rx"), (-1, 0, "tx")):
        with pytest.raises(ValueError, match=f"{name} is "):
            traced.between(tx, rx)


def test_paths_do_not_change_with_the_arrays_they_were_traced_from(extruded, ring):
    """Positions are copied, so that one array can be written again for the next trace."""
    tracer, rx = Tracer(extruded(ring((0, 0), (6, 0), (6, 4), (0, 4)))), np.array([[5.0, 0.9, 1.5]])
    paths = tracer.trace([[1.0, 1.4, 1.5]], rx)
    rx[0] = 2.0
    assert paths.rx_position.tolist() == [[5.0, 0.9, 1.5]]


def test_parquet_gives_back_every_bit(traced, tmp_path):
    """All columns, positions and the frequency, and types as they were; link states included."""
    traced.write_parquet(tmp_path / "paths.parquet")
    back = Paths.read_parquet(tmp_path / "paths.parquet")
    for field in fields(Paths):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(traced, field.name), field.name)
    assert np.array_equal(back.link_state(-90.0), traced.link_state(-90.0))


def test_columns_and_metadata_are_shown_in_text(traced, tmp_path):
    """Each column has a unit and a meaning, and all metadata are UTF-8, which polars needs to open the file."""
    traced.write_parquet(tmp_path / "paths.parquet")
    schema = pq.read_schema(tmp_path / "paths.parquet")
    for field in schema:
        assert field.metadata[b"meaning"]
    assert schema.field("delay_s").metadata[b"unit"] == b"s"
    assert schema.field("tx_x_m").metadata == {b"unit": b"m", b"meaning": b"place of the transmitter"}
    for text in schema.metadata.values():
        text.decode("utf-8")


@pytest.mark.parametrize("reader", ["polars", "duckdb", "pandas"])
def test_others_open_the_file(traced, tmp_path, reader):
    """Rows, columns and powers as written, by programs that are not needed here."""
    module = pytest.importorskip(reader, reason=f"needs {reader}, which is not installed")
    path = str(tmp_path / "paths.parquet")
    traced.write_parquet(path)
    if reader == "duckdb":
        power = module.sql(f"select power from '{path}'").fetchnumpy()["power"]
    else:
        power = module.read_parquet(path)["power"].to_numpy()
    np.testing.assert_array_equal(power, traced.power)


def test_other_parquet_is_rejected(tmp_path):
    """A table of something else is named as such, with its columns."""
    pq.write_table(pa.table({"x": [1]}), tmp_path / "x.parquet")
    with pytest.raises(ValueError, match=r"no radio paths.*\['x'\]"):
        Paths.read_parquet(tmp_path / "x.parquet")
