"""Paths do not depend on how a file holds a mesh: turned, moved, cut in more triangles, rounded, in any order."""

from collections import Counter

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.constants import speed_of_light
from scipy.optimize import linear_sum_assignment

from tests.wireless.tracing.rounded import (
    Placed,
    box,
    first_order,
    furnished_room,
    in_32_bits,
    places_above,
    renumbered,
    subdivided,
)
from wireless.paths import Interaction
from wireless.tracing.tracer import Tracer, TracerConfig

ROOM = furnished_room(6, 1, seed=3)
POINTS = places_above(np.random.default_rng(5), 9)
UTM = (691_607.0, 5_334_760.0, 519.0)


def traced(mesh, tx, rx, **options):
    options = {"scene": "space", "max_paths": 2000, "max_transmissions": 0, "polarisation": "both"} | options
    return Tracer(mesh, frequency_hz=5e9, config=TracerConfig(**options)).trace(tx, rx, workers=1)


def rows(paths, placed):
    """Receiver, interactions, length, directions turned back, and power of each path."""
    ways = [
        placed.back(np.column_stack([np.cos(el) * np.cos(az), np.cos(el) * np.sin(az), np.sin(el)]))
        for az, el in ((paths.aod_az, paths.aod_el), (paths.aoa_az, paths.aoa_el))
    ]
    kind = paths.interaction @ (10.0 ** np.arange(paths.interaction.shape[1]))
    return np.column_stack([100 * paths.rx, 100 * kind, paths.delay_s * speed_of_light, *ways]), paths.power


def assert_same(one, other, atol):
    """The same paths, each once: by count and kind exactly, lengths [m] and directions, and powers to 0.01 dB."""
    assert len(one[0]) == len(other[0])
    for rx in np.unique(one[0][:, 0]):
        mine, theirs = (rows[:, 0] == rx for rows in (one[0], other[0]))
        off = np.abs(one[0][mine][:, None] - other[0][theirs][None]).max(axis=2)
        i, j = linear_sum_assignment(off)
        assert len(i) == mine.sum() == theirs.sum() and off[i, j].max() < atol
        db = 10 * np.log10(one[1][mine][i] / other[1][theirs][j])
        strong = one[1][mine][i] > 1e-6 * one[1].max()
        assert np.abs(db[strong]).max() < 0.01
    assert np.isclose(one[1].sum(), other[1].sum(), rtol=1e-4)


def test_turning_moving_cutting_rounding_and_renumbering_keep_all_paths():
    """Any rigid motion, once or twice subdivided, at UTM coordinates and back, in 32 bits: the same path set.

    Reflections of second order and edges, counts exact, lengths and directions to 2e-5, by both searches.
    """
    options = {"max_reflections": 2, "floor_ceiling": True}
    still = rows(traced(ROOM, POINTS[:1], POINTS[1:], **options), Placed())
    assert len(still[0]) > 400

    @settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
    @given(
        turn=st.tuples(*3 * [st.floats(-3, 3)]),
        upright=st.booleans(),
        shift=st.sampled_from([(0.0, 0.0, 0.0), (31.7, -12.3, 4.4), UTM]),
        times=st.integers(0, 2),
        bits=st.sampled_from([32, 64]),
        order=st.randoms(use_true_random=False),
        search=st.sampled_from(["exhaustive", "rays"]),
    )
    def check(turn, upright, shift, times, bits, order, search):
        utm = shift == UTM
        placed = Placed((0, 0, turn[2]) if upright else turn, (0, 0, 0) if utm else shift)
        mesh = placed.mesh(subdivided(ROOM, times))
        if bits == 32:
            mesh = in_32_bits(mesh)
        there = Placed(None, UTM if utm else (0, 0, 0))
        mesh = renumbered(there.mesh(mesh), np.random.default_rng(order.randrange(1 << 30)))
        tx, rx = (there.points(placed.points(p)) for p in (POINTS[:1], POINTS[1:]))
        level = {"floor_ceiling": True}  # floor and ceiling reflect as walls do, however they are turned
        moved = rows(traced(mesh, tx, rx, search=search, max_reflections=2, **level), placed)
        assert_same(still, moved, 2e-5)

    check()
