"""Noise of the depth camera: published deviations, rounding, shadows and lost returns, against closed forms."""

import math

import numpy as np
import pytest

from robosim.camera.depth_noise import NATIVE_FOCAL_PX, DepthNoise

FOCAL_PX = 64.0
#: Only one effect at a time: everything else off.
PLAIN = {"baseline_m": 0.0, "step_px": 0.0, "lateral_px": 0.0}


def wall(depth_m: float, size: int = 128) -> np.ndarray:
    return np.full((size, size), depth_m, np.float32)


def slanted(angle_deg: float, distance_m: float = 2.0) -> np.ndarray:
    """Depth of an upright wall whose normal is turned from the view by an angle, at a distance along the view."""
    slope = (np.arange(128) + 0.5 - 64) / FOCAL_PX
    inverse = (1 - slope * math.tan(math.radians(angle_deg))) / distance_m
    row = np.where(inverse > 0.05, 1 / np.maximum(inverse, 0.05), 0)
    return np.tile(row.astype(np.float32), (128, 1))


def test_no_noise_at_level_zero():
    """Level 0 is the very same image, and draws nothing: later draws of the generator stay as they were."""
    rng, depth = np.random.default_rng(0), slanted(30)
    assert DepthNoise().apply(depth, FOCAL_PX, rng) is depth
    assert rng.integers(1 << 30) == np.random.default_rng(0).integers(1 << 30)


@pytest.mark.parametrize("depth_m", [0.4, 1.0, 2.0, 4.0])
def test_spread_grows_with_distance_squared(depth_m):
    """A wall faced: mean true, deviation 1.2 mm + 1.9 mm (z - 0.4)^2, in the middle of the image.

    40 x 40 pixels: bounds of 4 standard errors for the mean, 8 % for the deviation (4.5 standard errors).
    """
    noise = DepthNoise(level=1.0, **PLAIN)
    got = noise.apply(wall(depth_m), FOCAL_PX, np.random.default_rng(1))[44:84, 44:84].astype(float)
    expected = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    assert noise.sigma_m(depth_m) == pytest.approx(expected)
    assert abs(got.mean() - depth_m) < 4 * expected / 40
    assert got.std() == pytest.approx(expected, rel=0.08)


def test_level_scales_the_spread():
    """Twice the level, twice the deviation of the very same draws (to float32)."""
    one, two = (
        DepthNoise(level=level, **PLAIN).apply(wall(2.0), FOCAL_PX, np.random.default_rng(2)) - 2.0
        for level in (1.0, 2.0)
    )
    np.testing.assert_allclose(two, 2 * one, atol=1e-6)


def test_depths_come_in_steps_of_the_shift():
    """All depths are 1 / (k step) with whole k; at 3 m neighbours are z^2 step = 25.6 mm apart."""
    noise = DepthNoise(level=1.0, lateral_px=0.0)
    step = noise.step_px / (NATIVE_FOCAL_PX * noise.baseline_m)
    got = noise.apply(wall(3.0), FOCAL_PX, np.random.default_rng(3)).astype(float)
    got = got[got > 0]
    counts = 1 / (got * step)
    assert np.abs(counts - np.rint(counts)).max() < 1e-4
    gaps = np.diff(np.unique(got))
    assert gaps[np.abs(np.unique(got)[:-1] - 3.0).argmin()] == pytest.approx(9 * step, rel=0.02)
    assert 9 * step == pytest.approx(0.0256, abs=2e-4)


def test_sideways_jitter_moves_along_the_slope():
    """A wall turned by 45 degrees: deviation of the depth = z^2 (tan 45 / z f) lateral, added in squares."""
    noise = DepthNoise(level=20.0, baseline_m=0.0, step_px=0.0)
    still = DepthNoise(level=20.0, **PLAIN)
    depth = slanted(45.0, 0.5)
    rows = [n.apply(depth, FOCAL_PX, np.random.default_rng(4))[:, 64].astype(float) for n in (noise, still)]
    lateral_px = 20 * 0.8 * FOCAL_PX / NATIVE_FOCAL_PX
    expected = 0.5**2 * math.tan(math.pi / 4) / (0.5 * FOCAL_PX) * lateral_px
    error = rows[0] - rows[1]  # the same draws of the spread
    middle = error[44:84]
    many = [
        noise.apply(depth, FOCAL_PX, np.random.default_rng(seed))[44:84, 64].astype(float)
        - still.apply(depth, FOCAL_PX, np.random.default_rng(seed))[44:84, 64]
        for seed in range(40)
    ]
    assert len(middle) == 40
    assert np.std(many) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize(("near_m", "far_m"), [(0.5, 3.0), (1.0, 2.0), (0.8, 8.0)])
def test_a_near_edge_casts_a_shadow(near_m, far_m):
    """Right of a near post, f b (1 / near - 1 / far) pixels of the background are lost; left of it none.

    Within one pixel, as pixels are lost whole. A baseline of 0.3 m makes the shadows wide.
    """
    depth = wall(far_m)
    depth[:, 40:60] = near_m
    noise = DepthNoise(level=1.0, baseline_m=0.3, lateral_px=0.0, step_px=0.0, lost_deg=89.9, fading_deg=89.8)
    lost = noise.apply(depth, FOCAL_PX, np.random.default_rng(5)) == 0
    width = FOCAL_PX * 0.3 * (1 / near_m - 1 / far_m)
    assert abs(lost[64, 60:].sum() - width) <= 1.0
    assert not lost[64, :60].any()


@pytest.mark.parametrize(("angle_deg", "low", "high"), [(70, 0.0, 0.0), (80, 0.35, 0.65), (86, 1.0, 1.0)])
def test_grazing_surfaces_return_nothing(angle_deg, low, high):
    """Up to 75 degrees from the normal all return, beyond 85 none; at 80 about half (linear in the cosine: 0.51)."""
    noise = DepthNoise(level=1.0, **PLAIN)
    got = noise.apply(slanted(angle_deg, 1.0), FOCAL_PX, np.random.default_rng(6))
    lost = (got[54:74, 63:65] == 0).mean()
    assert low <= lost <= high


def test_edges_are_swapped_as_often_as_the_jitter_crosses_them():
    """The share of pixels next to an edge that show the other side is E max(jitter, 0), uniform edges in a pixel.

    The jitter is the sum of two uniform numbers with deviation s: E max = s sqrt(6) / 6. Here s = 0.44 px: 0.179 each.
    """
    depth = wall(1.0)
    depth[:, 64:] = 2.0
    noise = DepthNoise(level=5.0, baseline_m=0.0, step_px=0.0)
    shares = []
    for seed in range(20):
        got = noise.apply(depth, FOCAL_PX, np.random.default_rng(seed))
        shares.append([(got[:, 63] > 1.5).mean(), (got[:, 64] < 1.5).mean(), (got[:, 62] > 1.5).mean()])
    expected = 5 * 0.8 * FOCAL_PX / NATIVE_FOCAL_PX * math.sqrt(6) / 6
    inner, outer, beyond = np.mean(shares, axis=0)
    assert inner == pytest.approx(expected, abs=0.03)
    assert outer == pytest.approx(expected, abs=0.03)
    assert beyond == 0


def test_nothing_from_nothing():
    """Blank, too near and too far: all 0, nothing that is not a number."""
    noise, rng = DepthNoise(level=1.0), np.random.default_rng(0)
    for depth_m in (0.0, 0.1, 11.0):
        assert (noise.apply(wall(depth_m), FOCAL_PX, rng) == 0).all()


def test_same_generator_same_noise():
    """Bit for bit."""
    noise, depth = DepthNoise(level=1.0), slanted(50)
    first, second = (noise.apply(depth, FOCAL_PX, np.random.default_rng(9)) for _ in range(2))
    assert (first == second).all() and (first != depth).any()


@pytest.mark.parametrize(
    "wrong",
    [{"level": -1.0}, {"level": math.nan}, {"fading_deg": 88.0}, {"min_range_m": 11.0}, {"step_px": -1}],
)
def test_wrong_settings_are_rejected(wrong):
    with pytest.raises(ValueError, match="expected"):
        DepthNoise(**wrong)
